//! `elunar status`: says what became of the items of a manifest.

use super::manifest::uses_of;
use crate::cluster::apart::{self, User};
use crate::cluster::manifest::{BatchManifest, text};
use crate::cluster::status::{ItemState, Status, done_list, read_logs};
use crate::html::{Cell, document, escaped, table};
use crate::outputs::OutputTarget;
use crate::program;
use elunar_base::output::Owner;
use elunar_base::{Error, Result, atomic_write};
use std::path::{Path, PathBuf};

/// Options of `status`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
An item is done if its DTM and the DTM's SHA-256 lie there; the lines of the batches say why others are not. Exit codes with \
--require: 0 enough items are done; 75 not yet; 65 never, since too many failed for good.

Examples:
  elunar status --manifest m.jsonl logs/a.jsonl logs/b.jsonl --resubmit again.jsonl --html status.html
  elunar status --manifest m.jsonl --require 99% --done list.txt")]
pub struct Args {
    /// Manifest, JSON lines.
    #[arg(long, value_name = "M.jsonl")]
    pub manifest: PathBuf,
    /// Lines of batches.
    #[arg(value_name = "LOG.jsonl")]
    pub logs: Vec<PathBuf>,
    /// Share of items that must be done.
    #[arg(long, value_name = "P%", value_parser = percent)]
    pub require: Option<f64>,
    /// Read all DTMs, and compare them with their SHA-256.
    #[arg(long)]
    pub verify: bool,
    /// Write the paths of the finished DTMs, one a line, as `mosaic --dem-list` reads them.
    #[arg(long, value_name = "LIST.txt")]
    pub done: Option<PathBuf>,
    /// Write the lines of the items that are not done and may succeed, beside the manifest.
    #[arg(long, value_name = "AGAIN.jsonl")]
    pub resubmit: Option<PathBuf>,
    /// Write a page.
    #[arg(long, value_name = "P.html")]
    pub html: Option<PathBuf>,
    /// Print one object of JSON.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// If the manifest or a log cannot be read, a file cannot be written, or fewer items are done than required.
pub fn run(args: Args) -> Result<()> {
    let manifest = BatchManifest::read(&args.manifest)?;
    let _owners = take(&args, &manifest)?;
    let status = Status::new(&manifest, read_logs(&args.logs)?, args.verify);
    if let Some(path) = &args.done {
        atomic_write(path, done_list(&status, &manifest.folder).as_bytes())?;
    }
    if let Some(path) = &args.resubmit {
        atomic_write(path, text(status.of(&[ItemState::TryAgain, ItemState::Waiting]))?.as_bytes())?;
    }
    if let Some(path) = &args.html {
        atomic_write(path, page(&args.manifest, &status).as_bytes())?;
    }
    let enough = required(&status, args.require);
    say(&status, args.json, enough.as_ref().err());
    enough
}

/// Takes the files to write, before the work starts: none is the manifest, a log, or a file that an item reads or writes.
fn take(args: &Args, manifest: &BatchManifest) -> Result<Vec<Owner>> {
    let outputs = [(&args.done, "--done"), (&args.resubmit, "--resubmit"), (&args.html, "--html")];
    if let Some(path) = &args.resubmit {
        let same = |path: &Path| std::path::absolute(elunar_base::folder_of(path)).ok();
        if same(path) != same(&args.manifest) {
            let what = "--resubmit: a file beside the manifest expected, since paths start from its folder";
            return Err(Error::usage(format!("{what}, {} found", path.display())));
        }
    }
    let outputs = || outputs.iter().filter_map(|(path, option)| Some((path.as_ref()?, *option)));
    // Without an output, the items are told even where they are not apart.
    if outputs().next().is_some() {
        let mut uses = uses_of(manifest, &args.manifest);
        args.logs.iter().for_each(|log| uses.read(log, User::other("this command")));
        outputs().for_each(|(path, option)| uses.write(&OutputTarget::File(path).files(), User::other(option)));
        apart::check(&args.manifest, uses)?;
    }
    outputs().map(|(path, _)| Owner::of_file(path)).collect()
}

/// Counts, their names and states.
const STATES: [(&str, ItemState); 4] = [
    ("done", ItemState::Done),
    ("failed for good", ItemState::Failed),
    ("to try again", ItemState::TryAgain),
    ("without an attempt", ItemState::Waiting),
];

/// Prints the counts. The object of too few done has its error, too.
fn say(status: &Status, json: bool, error: Option<&Error>) {
    let (failures, made) = (status.failures(), status.throughput());
    if json {
        let kinds: serde_json::Map<String, serde_json::Value> = failures
            .iter()
            .map(|(kind, (count, error))| ((*kind).into(), serde_json::json!({ "items": count, "example": error })))
            .collect();
        let [done, failed, try_again, waiting] = STATES.map(|(_, state)| status.count(state));
        let mut found = serde_json::json!({
            "items": status.items.len(), "done": done, "failed": failed, "try_again": try_again, "waiting": waiting,
            "failures": kinds, "throughput": made,
        });
        if let Some(error) = error {
            program::add_error(&mut found, error);
        }
        println!("{found}");
        return;
    }
    let counts: Vec<String> = STATES.iter().map(|(name, state)| format!("{} {name}", status.count(*state))).collect();
    println!("{} items: {}", status.items.len(), counts.join(", "));
    for (kind, (count, error)) in failures {
        println!("{count} x {kind}, such as: {error}");
    }
    if made.items > 0 {
        let rate = made.pixels as f64 / 1e6 / made.wall_s.max(1e-9);
        let (items, wall_s, busy) = (made.items, made.wall_s, made.process_s / made.wall_s.max(1e-9));
        println!("{items} made in {wall_s:.1} s: {rate:.2} megapixels/s, {busy:.1} processes at a time");
    }
}

fn required(status: &Status, percent: Option<f64>) -> Result<()> {
    let Some(percent) = percent else { return Ok(()) };
    let (all, done) = (status.items.len() as f64, status.done_percent());
    // A share that is stated with decimals is compared as it is; rounding of the division does not count.
    if done >= percent - 1e-9 {
        return Ok(());
    }
    let reachable = 100.0 * (all - status.count(ItemState::Failed) as f64) / all;
    let text = format!("--require: {percent} % of the items done expected, {done:.2} % found");
    if reachable >= percent - 1e-9 {
        Err(Error::stopped(text))
    } else {
        Err(Error::input(text + "; too many failed for good"))
    }
}

fn page(manifest: &Path, status: &Status) -> String {
    let title = format!("Status of {}", manifest.display());
    let mut body = format!("<h1>{}</h1>\n", escaped(&title));
    let row = |name: &str, value: String| vec![Cell::plain(name), Cell::plain(value)];
    let made = status.throughput();
    let mut rows: Vec<Vec<Cell>> =
        STATES.iter().map(|(name, state)| row(name, status.count(*state).to_string())).collect();
    rows.push(row("megapixels made", format!("{:.1}", made.pixels as f64 / 1e6)));
    rows.push(row("time, s", format!("{:.1}", made.wall_s)));
    rows.push(row("time of all processes, s", format!("{:.1}", made.process_s)));
    body += &table(&["items", &status.items.len().to_string()], &rows);
    let failures = status.failures();
    if !failures.is_empty() {
        body += "<h2>Failures</h2>\n";
        let rows: Vec<Vec<Cell>> = failures
            .into_iter()
            .map(|(kind, (count, error))| vec![Cell::plain(kind), Cell::plain(count.to_string()), Cell::plain(error)])
            .collect();
        body += &table(&["kind", "items", "such as"], &rows);
    }
    document(&title, &body)
}

/// Parses a share such as `99%` or `99.5`.
fn percent(text: &str) -> std::result::Result<f64, String> {
    let number = text.strip_suffix('%').unwrap_or(text).parse::<f64>().ok();
    number.filter(|share| (0.0..=100.0).contains(share)).ok_or_else(|| "0% to 100% expected".into())
}
