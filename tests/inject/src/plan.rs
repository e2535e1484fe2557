//! Draws the injections, and shares them among workers.

use crate::row::{Class, Outcome, Row, Sample};
use crate::{Args, table};
use elunar_base::{Error, Result, atomic_write, read};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::io::{Read, Write};
use std::process::{Child, Command, Stdio};

/// Most bytes of a record.
const MOST_BYTES: u64 = 1 << 32;

/// Runs a campaign, or a worker of one.
///
/// # Errors
/// Inputs that cannot be used, or a system that does not let processes be watched.
pub(crate) fn run(args: &Args) -> Result<()> {
    if let Some(samples) = args.worker {
        return work(args, samples);
    }
    let rows = match &args.replay {
        Some(path) => parse(&read::bytes(path, MOST_BYTES)?)?,
        None => draw(args)?,
    };
    let count = rows.len();
    let mut done = share(args, rows)?;
    done.sort_by_key(|row| row.injection);
    if done.len() != count {
        return Err(Error::input(format!("inject: expected {count} outcomes, found {}", done.len())));
    }
    std::fs::create_dir_all(&args.out).map_err(Error::io(&args.out))?;
    atomic_write(&args.out.join("injections.csv"), &lines(&done)?)?;
    let text = table::markdown(&done);
    atomic_write(&args.out.join("inject.md"), text.as_bytes())?;
    table::write_picture(&args.out.join("inject.png"), &done)?;
    print!("{text}");
    Ok(())
}

/// Draws injections at moments that a worker takes.
fn draw(args: &Args) -> Result<Vec<Row>> {
    let count = args.injections as usize * Class::ALL.len();
    let mut samples: Vec<Sample> = parse(&start(args, count as u64, &[])?.output()?)?;
    let mut rng = ChaCha8Rng::seed_from_u64(args.seed);
    let mut rows = Vec::new();
    for injection in 0..count {
        // Every class has moments of the whole tile.
        let sample = samples.swap_remove(rng.random_range(0..samples.len().max(1)));
        rows.push(Row::draw(injection as u64, Class::ALL[injection % Class::ALL.len()], &sample, &mut rng));
    }
    Ok(rows)
}

/// Lets workers make the injections.
fn share(args: &Args, mut rows: Vec<Row>) -> Result<Vec<Row>> {
    rows.iter_mut().for_each(|row| {
        (row.outcome, row.error_m, row.wrong_px) = (Outcome::Planned, 0.0, 0);
        row.message.clear();
    });
    rows.sort_by_key(|row| row.unit);
    let workers = args.workers as usize;
    let of = |worker: usize| rows.iter().skip(worker).step_by(workers).cloned().collect::<Vec<_>>();
    let started: Result<Vec<Worker>> = (0..workers).map(|worker| start(args, 0, &lines(&of(worker))?)).collect();
    let done: Result<Vec<Vec<Row>>> = started?.into_iter().map(|worker| parse(&worker.output()?)).collect();
    Ok(done?.concat())
}

/// A worker that has its input.
struct Worker(Child);

impl Worker {
    /// Returns what it writes.
    fn output(mut self) -> Result<Vec<u8>> {
        let broken = |e: std::io::Error| Error::input(format!("inject: a worker: {e}"));
        let mut out = Vec::new();
        if let Some(mut pipe) = self.0.stdout.take() {
            pipe.read_to_end(&mut out).map_err(broken)?;
        }
        let status = self.0.wait().map_err(broken)?;
        if status.success() { Ok(out) } else { Err(Error::input("inject: a worker failed")) }
    }
}

/// Starts a worker, always at the same addresses and with the same environment.
fn start(args: &Args, samples: u64, input: &[u8]) -> Result<Worker> {
    let broken = |e: std::io::Error| Error::input(format!("inject: a worker: {e}"));
    let mut command = Command::new(std::env::current_exe().map_err(broken)?);
    command.arg(&args.model).arg("--tile").arg(&args.tile).arg("--out").arg(&args.out);
    command.args(["--kernel", &args.kernel, "--seed", &args.seed.to_string(), "--worker", &samples.to_string()]);
    command.args(args.trust_code.then_some("--trust-code"));
    fix_addresses()?;
    let mut child = command.env_clear().stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().map_err(broken)?;
    if let Some(mut pipe) = child.stdin.take() {
        pipe.write_all(input).map_err(broken)?;
    }
    Ok(Worker(child))
}

fn lines<T: Serialize>(rows: &[T]) -> Result<Vec<u8>> {
    let mut csv = csv::Writer::from_writer(vec![]);
    let broken = |e: String| Error::input(format!("inject: a line of the record: {e}"));
    rows.iter().try_for_each(|row| csv.serialize(row)).map_err(|e| broken(e.to_string()))?;
    csv.into_inner().map_err(|e| broken(e.to_string()))
}

fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<Vec<T>> {
    let rows: std::result::Result<Vec<T>, _> = csv::Reader::from_reader(bytes).deserialize().collect();
    rows.map_err(|e| Error::input(format!("inject: a line of the record: {e}")))
}

#[cfg(not(all(target_os = "linux", target_arch = "x86_64")))]
fn fix_addresses() -> Result<()> {
    Err(Error::input("inject: expected Linux on x86-64, found another system"))
}

#[cfg(not(all(target_os = "linux", target_arch = "x86_64")))]
fn work(_: &Args, _: u64) -> Result<()> {
    fix_addresses()
}

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
use crate::linux::fix_addresses;

/// Does a worker's part: takes moments, or makes the injections of the input.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn work(args: &Args, samples: u64) -> Result<()> {
    use elunar_core::nn::Kernel;
    let broken = |e: std::io::Error| Error::input(format!("inject: a worker: {e}"));
    let mut input = Vec::new();
    std::io::stdin().read_to_end(&mut input).map_err(broken)?;
    let kernel = Kernel::available().find(|kernel| kernel.name().starts_with(&args.kernel));
    let kernel = kernel.ok_or_else(|| Error::input(format!("inject: no kernel '{}'", args.kernel)))?;
    let mut bench = crate::linux::Bench::new(crate::tile::Tile::new(&args.model, &args.tile, kernel)?)?;
    let mut out = std::io::stdout();
    if samples > 0 {
        let mut rng = ChaCha8Rng::seed_from_u64(!args.seed);
        let samples = bench.sample(samples as usize, || rng.random())?;
        return out.write_all(&lines(&samples)?).map_err(broken);
    }
    let mut csv = csv::Writer::from_writer(out);
    bench.run(parse(&input)?, !args.trust_code, |row| {
        csv.serialize(&row).map_err(|e| Error::input(format!("inject: {e}")))?;
        csv.flush().map_err(broken)
    })
}
