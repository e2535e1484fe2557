//! A chunk of a manifest: one process an image, several at a time. A failure ends its item alone.

use super::item::BatchItem;
use super::outcome::{AttemptRecord, ItemOutcome, now_s};
use elunar_base::rounds::{ItemCounts, ItemEnd, ItemRounds};
use elunar_base::{Error, Result, folder_of, interrupt, say};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// How items are run.
#[derive(Debug, Clone)]
pub struct BatchOptions {
    /// The program whose `predict` is run.
    pub program: PathBuf,
    /// Further words for `predict`.
    pub more: Vec<String>,
    /// Number of items at a time.
    pub jobs: usize,
    /// Threads of each.
    pub threads: usize,
    /// How long to try again what may succeed later.
    pub wait: Duration,
    /// The chunk, for the lines.
    pub chunk: String,
}

/// An item, and its line in the manifest.
type Line = (usize, BatchItem);

/// Pause between two rounds of attempts.
const PAUSE: Duration = Duration::from_secs(2);
/// Time between two looks at a running process.
const LOOK: Duration = Duration::from_millis(10);
/// How long a process that also got the signal may take to end by itself.
const GRACE: Duration = Duration::from_millis(300);

/// Runs items, and passes every line to `tell` as it comes. What may succeed later is tried again until the time to wait is over.
///
/// # Errors
/// Errors of `tell`.
pub fn run(
    items: &[&Line],
    folder: &Path,
    options: &BatchOptions,
    tell: &mut dyn FnMut(&AttemptRecord) -> Result<()>,
) -> Result<ItemCounts> {
    interrupt::listen();
    let start = Instant::now();
    let rounds = ItemRounds {
        slots: options.jobs,
        attempt: &|item: &Line, slot| {
            let (start_s, start) = (now_s(), Instant::now());
            let ended = check(&item.1, folder).and_then(|()| attempt(&item.1, folder, options));
            outcome(item, ended, options, slot, (start_s, start.elapsed().as_secs_f64()))
        },
        stops: &interrupt::requested,
    };
    let mut told = |_: &Line, record: AttemptRecord| {
        tell(&record)?;
        Ok(match record.verdict {
            ItemOutcome::Done | ItemOutcome::DoneBefore => ItemEnd::Done,
            ItemOutcome::Failed => ItemEnd::Failed,
            ItemOutcome::TryAgain => ItemEnd::TryAgain,
        })
    };
    rounds.run(items, &mut told, &mut || start.elapsed() < options.wait && pauses())
}

/// Waits for the next round; returns whether there is one.
fn pauses() -> bool {
    let pause = Instant::now();
    while pause.elapsed() < PAUSE && !interrupt::requested() {
        std::thread::sleep(LOOK);
    }
    !interrupt::requested()
}

/// Checks that files whose hashes the manifest states have the sizes that it states, and makes the folder of the DTM.
fn check(item: &BatchItem, folder: &Path) -> Result<()> {
    let stated =
        [(&item.image, item.image_bytes, &item.image_sha256), (&item.coarse, item.coarse_bytes, &item.coarse_sha256)];
    for (path, bytes, hash) in stated {
        let (Some(bytes), Some(_)) = (bytes, hash) else { continue };
        let path = folder.join(path);
        let found = path.metadata().map_err(Error::io(&path))?.len();
        if found != bytes {
            let what = "bytes expected by the manifest, which states its hash";
            return Err(Error::input(format!(
                "{}: {bytes} {what}, {found} found: make the manifest again",
                path.display()
            )));
        }
    }
    let output = folder.join(&item.output);
    std::fs::create_dir_all(folder_of(&output)).map_err(Error::io(folder_of(&output)))
}

/// What a process left: its status, its object of JSON, its error line.
struct Left {
    status: ExitStatus,
    record: serde_json::Value,
    error: Option<String>,
}

fn attempt(item: &BatchItem, folder: &Path, options: &BatchOptions) -> Result<Left> {
    let program = Error::io(&options.program);
    let mut command = Command::new(&options.program);
    command.arg("predict").args(item.words(folder)?).arg(format!("--threads={}", options.threads)).arg("--json");
    command.args(&options.more).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().map_err(program)?;
    let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
    let (status, record, text) = std::thread::scope(|scope| {
        let stdout = scope.spawn(|| whole(stdout));
        let stderr = scope.spawn(|| whole(stderr));
        let status = wait(&mut child);
        (status, stdout.join().unwrap_or_default(), stderr.join().unwrap_or_default())
    });
    let error = text.lines().rev().find_map(|line| line.strip_prefix("ERROR: ")).map(String::from);
    text.lines()
        .filter(|line| line.starts_with("WARNING: "))
        .for_each(|line| say::note(&format!("{}: {line}", item.id)));
    let status = status.map_err(Error::io(&options.program))?;
    Ok(Left { status, record: serde_json::from_str(&record).unwrap_or_default(), error })
}

fn whole(pipe: Option<impl Read>) -> String {
    let mut bytes = vec![];
    // What cannot be read is missing in the line about the item. The exit code decides.
    let _ = pipe.map(|mut pipe| pipe.read_to_end(&mut bytes));
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Waits for a process. If the batch is asked to stop, the process gets the same signal, unless it ends by itself.
fn wait(child: &mut Child) -> std::io::Result<ExitStatus> {
    let mut asked: Option<Instant> = None;
    let mut told = false;
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        if interrupt::requested() {
            let since = *asked.get_or_insert_with(Instant::now);
            if !told && since.elapsed() > GRACE {
                told = true;
                stop(child);
            }
        }
        std::thread::sleep(LOOK);
    }
}

/// Asks a process that was not waited for to stop.
fn stop(child: &mut Child) {
    #[cfg(unix)]
    {
        // The standard library only kills. The shell's own `kill` needs no further program. The process may have ended just now.
        let words = ["-c", "kill -TERM \"$0\"", &child.id().to_string()];
        let _ = Command::new("sh").args(words).stdin(Stdio::null()).stderr(Stdio::null()).status();
    }
    #[cfg(not(unix))]
    let _ = child.kill();
}

fn outcome(
    (line, item): &Line,
    ended: Result<Left>,
    options: &BatchOptions,
    slot: usize,
    (start_s, seconds): (f64, f64),
) -> AttemptRecord {
    let (code, error, record) = match ended {
        Ok(ended) => (code_of(ended.status), ended.error, ended.record),
        Err(error) => (i32::from(crate::program::code_of(&error)), Some(error.to_string()), serde_json::Value::Null),
    };
    let verdict = ItemOutcome::of(Some(code), record["finished_before"] == true);
    let pixels = record["rows"].as_u64().zip(record["cols"].as_u64()).map(|(rows, cols)| rows * cols);
    let error = error.or_else(|| (code != 0).then(|| format!("ended with code {code}, without an error line")));
    AttemptRecord {
        id: item.id.clone(),
        line: *line,
        verdict,
        code,
        error: error.filter(|_| code != 0),
        output: item.output.display().to_string(),
        start_s,
        seconds,
        host: elunar_base::output::host_name(),
        slot,
        chunk: options.chunk.clone(),
        pixels,
    }
}

/// Returns the exit code, or 128 plus the signal as a shell does.
fn code_of(status: ExitStatus) -> i32 {
    #[cfg(unix)]
    let signal = std::os::unix::process::ExitStatusExt::signal(&status).map(|signal| 128 + signal);
    #[cfg(not(unix))]
    let signal = None;
    status.code().or(signal).unwrap_or(i32::from(crate::program::TRY_AGAIN))
}
