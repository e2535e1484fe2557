//! `elunar batch`: runs a chunk of a manifest.

use super::manifest::uses_of;
use crate::cluster::batch::{BatchOptions, run as run_items};
use crate::cluster::manifest::BatchManifest;
use crate::cluster::{apart, foreign};
use elunar_base::rounds::ItemCounts;
use elunar_base::{Error, Result, say};
use elunar_scene::predict::span::PartOf;
use std::path::PathBuf;
use std::time::Duration;

/// Options of `batch`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
All lines of the manifest are checked first. Every item is a process of its own; what is finished is recognised by its contents \
and left. One line of JSON for every attempt goes to standard output; `status` reads them. A failure ends its item alone.

Exit codes: 0 all items are done; 75 some may succeed later: run the same command again; 65 some never will, the others are done.

Example:
  elunar batch --manifest m.jsonl --chunk 3/100 --jobs 16")]
pub struct Args {
    /// Manifest, JSON lines.
    #[arg(long, value_name = "M.jsonl")]
    pub manifest: PathBuf,
    /// Run chunk K of N: lines K, K + N, K + 2 N and so on.
    #[arg(long, value_name = "K/N", default_value = "1/1")]
    pub chunk: PartOf,
    /// Number of images at a time; 0 takes as many as the machine offers.
    #[arg(long, value_name = "J", default_value_t = 1, value_parser = crate::threads::number)]
    pub jobs: usize,
    /// Threads for each image.
    #[arg(long, value_name = "T", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1024))]
    pub threads: u64,
    /// Folder for the rows of unfinished DTMs, such as a disk of this machine [default: beside each DTM].
    #[arg(long, value_name = "DIR")]
    pub part_dir: Option<PathBuf>,
    /// How long items are tried again that another run holds, or that met an error of the system, seconds.
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub wait: u64,
}

/// Runs the command.
///
/// # Errors
/// [`Error::Broken`] if a line of the manifest is wrong, or an item would write what another one reads or writes, or replace a file of others: nothing is started then. [`Error::Stopped`] if items may succeed later,
/// [`Error::Input`] if some never will.
pub fn run(args: Args) -> Result<()> {
    let manifest = BatchManifest::read(&args.manifest)?;
    apart::check(&args.manifest, uses_of(&manifest, &args.manifest))?;
    let items = manifest.chunk(args.chunk);
    foreign::check(&args.manifest, &items, &manifest.folder, args.part_dir.as_deref())?;
    let program = std::env::current_exe().map_err(Error::io("this program"))?;
    let available = std::thread::available_parallelism().map_or(1, usize::from);
    let more = args.part_dir.iter().map(|folder| format!("--part-dir={}", folder.display())).collect();
    let options = BatchOptions {
        program,
        more,
        jobs: if args.jobs == 0 { available } else { args.jobs },
        threads: args.threads as usize,
        wait: Duration::from_secs(args.wait),
        chunk: args.chunk.to_string(),
    };
    let (all, mut count) = (items.len(), 0);
    let counts = run_items(&items, &manifest.folder, &options, &mut |outcome| {
        count += 1;
        let line = serde_json::to_string(outcome).map_err(|e| Error::usage(format!("{}: {e}", outcome.id)))?;
        println!("{line}");
        let what = outcome.error.as_deref().unwrap_or(if outcome.pixels.is_some() { "done" } else { "done before" });
        say::note(&format!("{count}/{all} {}: {what} ({:.1} s)", outcome.id, outcome.seconds));
        Ok(())
    })?;
    let ItemCounts { done, failed, again } = counts;
    let text =
        format!("chunk {}: {done} of {all} items are done, {again} may succeed later, {failed} never", args.chunk);
    match counts {
        ItemCounts { again: 0, failed: 0, .. } => Ok(()),
        ItemCounts { again: 0, .. } => Err(Error::input(text)),
        _ => Err(Error::stopped(text)),
    }
}
