//! Inputs without an end, or of another kind than a file, in the place of every input of every command, under a limit of the address space. The
//! campaign tries every kind in every place:
//!
//! ```sh
//! cargo test -p host-train --test endless -- --ignored --nocapture --test-threads 1
//! ```
#![cfg(unix)]

use std::io::Write;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use support::Shell;

mod support;

/// Address space of a command, KiB: that of the program with its libraries, and room for a small scene.
const LIMIT_KIB: usize = 1 << 20;
/// No command may wait or work longer for an input that it refuses.
const MOST: Duration = Duration::from_secs(60);

/// What stands in the place of an input. Names of the files that the bench makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// A link to the device that gives zeros for ever.
    Zero,
    /// A FIFO that nobody writes.
    Silent,
    /// A FIFO that gives lines of text for ever.
    Lines,
    /// A sparse file of a terabyte.
    Terabyte,
    /// A sparse file of 1 GiB, the most that is read of a list.
    Gigabyte,
    /// A folder.
    Folder,
}

impl Kind {
    const ALL: [Self; 6] = [Self::Zero, Self::Silent, Self::Lines, Self::Terabyte, Self::Gigabyte, Self::Folder];

    /// Makes it at `path`.
    fn make(self, path: &Path) {
        let sparse = |bytes| std::fs::File::create(path).unwrap().set_len(bytes).unwrap();
        match self {
            Self::Zero => symlink("/dev/zero", path).unwrap(),
            Self::Silent | Self::Lines => assert!(Command::new("mkfifo").arg(path).status().unwrap().success()),
            Self::Terabyte => sparse(1 << 40),
            Self::Gigabyte => sparse(1 << 30),
            Self::Folder => std::fs::create_dir(path).unwrap(),
        }
    }
}

/// A command with a bad input.
struct Case {
    words: Vec<String>,
    /// The bad input.
    input: String,
    /// Whether it is a text, which may come from a pipe.
    is_text: bool,
    /// Whether a label points at it.
    has_label: bool,
}

/// Commands with `@` and the extension of a file in the place of one input, a line each; `@@` for texts, `L@` for a label that points at the
/// input.
const CASES: &str = "
predict --image @.tif --coarse C --model nano -o out.tif
predict --image I --coarse @.tif --model nano -o out.tif
predict --image I --coarse C --model @.eld -o out.tif
predict --image I --coarse C --model @.safetensors -o out.tif
predict --image @.lbl --coarse C --model nano -o out.tif
predict --image L@.img --coarse C --model nano -o out.tif
inspect L@.img
join --parts 2 --image @.tif --coarse C --model nano -o out.tif
join --parts 2 --image I --coarse @.tif --model nano -o out.tif
join --parts 2 --image I --coarse C --model @.eld -o out.tif
latency --model @.eld --json
latency --model @.safetensors
manifest I --coarse @.tif --model nano -o out.jsonl
manifest --table @@.csv --coarse C --model nano -o out.jsonl
manifest --check @@.jsonl
batch --manifest @@.jsonl
status --manifest @@.jsonl --json
status --manifest m.jsonl @@.jsonl
plan --manifest @@.jsonl --json
prepare --list @@.csv --out out
prepare --image @.tif --dtm T --coarse C --out out
prepare --image I --dtm @.tif --coarse C --out out
prepare --image I --dtm T --coarse @.tif --out out
export --weights @.safetensors -o out.eld
sfs --image @.tif --coarse C --sun-azimuth 1 --sun-elevation 30 -o out.tif
sfs --image I --coarse @.tif --sun-azimuth 1 --sun-elevation 30 -o out.tif
sfs --image I --coarse C --truth @.tif --sun-azimuth 1 --sun-elevation 30 -o out.tif
evaluate --dtm @.tif --truth T
evaluate --dtm T --truth @.tif
evaluate --dtm T --truth T --coarse @.tif
evaluate --dtm T --truth T --uncertainty @.tif
hillshade @.tif -o out.tif
render @.tif --sun-azimuth 1 --sun-elevation 30 -o out.tif
diff @.tif T -o out.tif
diff T @.tif --json
mosaic @.tif T -o out.tif
mosaic T @.tif -o out.tif
mosaic -l @@.txt -o out.tif
lola --dtm @.tif --tracks tracks.csv
lola --dtm T --tracks @@.csv
inspect @.tif
inspect @.eld --json
inspect @.safetensors
init --from @.safetensors -o out.safetensors
check @.safetensors
train --start-from @.safetensors --steps 1 --out out
train --preset small --swin @.safetensors --steps 1 --out out
train --config @@.toml --steps 1 --out out
average @.safetensors @.safetensors -o out.safetensors
experiment @@.toml --out out
experiment host-train.toml --suite @@.toml --out out
suite --suite @@.toml --out out
suite --model @.eld --out out
suite --model @.safetensors --out out
faults @.eld --injections 1
train-speed --start-from @.safetensors --count 1
";

/// Returns a folder with good inputs.
fn bench() -> Shell {
    let shell = Shell::new();
    shell.made(&["synth", "--out", "s", "--rows", "256", "--cols", "320", "--seed", "5"]);
    let item = r#"{"id":"a","image":"I","coarse":"C","model":"nano","output":"a.tif"}"#;
    std::fs::write(shell.path("m.jsonl"), item).unwrap();
    std::fs::write(shell.path("tracks.csv"), "lon,lat,radius_km\n0,0,1737.4\n").unwrap();
    std::fs::write(shell.path("host-train.toml"), "name = \"n\"\n").unwrap();
    shell
}

/// Returns the case of a line, with the bad input at a path of its own.
fn case(line: &str, kind: Kind) -> Case {
    let scene = |what: &str| format!("s/scene_0000_{what}.tif");
    let mut input = String::new();
    let mut word = |word: &str| match word {
        "I" => scene("image"),
        "C" => scene("coarse"),
        "T" => scene("truth"),
        _ if word.starts_with("L@") => {
            input = format!("{kind:?}").to_lowercase() + word.trim_start_matches("L@");
            "label.lbl".into()
        }
        _ if word.starts_with('@') => {
            input = format!("{kind:?}").to_lowercase() + word.trim_start_matches('@');
            input.clone()
        }
        _ => word.into(),
    };
    let words = line.split_whitespace().map(&mut word).collect();
    Case { words, input, is_text: line.contains("@@"), has_label: line.contains("L@") }
}

/// Runs a case. It must end with one line about its input and without an output; otherwise returns how it ended.
fn refuse(shell: &Shell, Case { words, input, is_text, has_label }: &Case, kind: Kind) -> Option<String> {
    let path = shell.path(input);
    kind.make(&path);
    if *has_label {
        let text = "OBJECT = IMAGE\nLINES = 9000\nLINE_SAMPLES = 9000\nSAMPLE_TYPE = UNSIGNED_INTEGER\n\
            SAMPLE_BITS = 8\nEND_OBJECT = IMAGE\nEND\n";
        std::fs::write(shell.path("label.lbl"), format!("PDS_VERSION_ID = PDS3\n^IMAGE = \"{input}\"\n{text}"))
            .unwrap();
    }
    if kind == Kind::Lines {
        let path = path.clone();
        // It waits for a reader, and ends with it; without one, with the file.
        std::thread::spawn(move || {
            let mut file = std::fs::File::options().write(true).open(path)?;
            loop {
                file.write_all(&b"name = 1\n".repeat(1000))?;
            }
            #[allow(unreachable_code)]
            Ok::<(), std::io::Error>(())
        });
    }
    let limit = format!("ulimit -v {LIMIT_KIB} || exit 99; exec \"$@\"");
    let mut command = Command::new("sh");
    command.current_dir(shell.path("")).args(["-c", &limit, "sh", env!("CARGO_BIN_EXE_host-train")]).args(words);
    command.env("MALLOC_ARENA_MAX", "1").env("RAYON_NUM_THREADS", "2");
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let (mut child, start) = (command.spawn().unwrap(), Instant::now());
    while child.try_wait().unwrap().is_none() {
        if start.elapsed() > MOST {
            child.kill().unwrap();
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let out = child.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&out.stderr);
    let what = format!("{kind:?}, {words:?}: {:?} {text}", out.status);
    // What may be read, 1 GiB, may be more than the system grants.
    let may_fill = *is_text && kind == Kind::Lines || kind == Kind::Gigabyte;
    let code = out.status.code();
    let mut is_right = matches!(code, Some(64 | 65)) || may_fill && code == Some(71);
    let errors: Vec<&str> = text.lines().filter(|line| line.starts_with("ERROR: ")).collect();
    is_right &= errors.len() == 1 && errors[0].contains(input.as_str());
    let outputs =
        ["out.tif", "out.eld", "out.jsonl", "out.safetensors", "a.tif", "out/manifest.json", "out/owner.lock"];
    for name in outputs.iter().flat_map(|name| [name.to_string(), format!("{name}.lock"), format!("{name}.part")]) {
        is_right &= std::fs::remove_file(shell.path(&name)).is_err();
    }
    let _ = std::fs::remove_dir_all(shell.path("out"));
    if kind == Kind::Folder { std::fs::remove_dir(&path) } else { std::fs::remove_file(&path) }.unwrap();
    (!is_right).then_some(what)
}

fn lines() -> impl Iterator<Item = &'static str> {
    CASES.lines().filter(|line| !line.is_empty())
}

/// Whether a case can be tried: of a text, a FIFO without a writer waits for one, as in other programs.
fn is_tried(case: &Case, kind: Kind) -> bool {
    !(case.is_text && kind == Kind::Silent)
}

#[test]
fn endless_inputs_are_refused() {
    let shell = bench();
    let chosen = |line: &&str| {
        ["predict", "manifest", "status", "prepare --list", "mosaic -l", "lola", "suite"]
            .iter()
            .any(|c| line.starts_with(c))
    };
    let mut tried = 0;
    for line in lines().filter(chosen) {
        for kind in [Kind::Zero, Kind::Silent] {
            let case = case(line, kind);
            if is_tried(&case, kind) {
                assert_eq!(refuse(&shell, &case, kind), None);
                tried += 1;
            }
        }
    }
    assert!(tried > 20, "{tried}");
}

#[test]
#[ignore = "a campaign of minutes: tests/campaigns/run.sh endless"]
fn every_input_of_every_command() {
    let shell = bench();
    let (mut tried, mut wrong) = (0, vec![]);
    for kind in Kind::ALL {
        let start = Instant::now();
        for line in lines() {
            let case = case(line, kind);
            if is_tried(&case, kind) {
                wrong.extend(refuse(&shell, &case, kind));
                tried += 1;
            }
        }
        println!("{kind:?}: {:.1} s", start.elapsed().as_secs_f64());
    }
    println!("{tried} commands, {} not refused by one line about their input", wrong.len());
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
