//! `elunar plan`: says beforehand what a manifest takes.

use crate::cluster::item::BatchItem;
use crate::cluster::manifest::BatchManifest;
use crate::cluster::plan::{Cluster, Costs, model_of, plan};
use elunar_base::{Error, Result};
use elunar_net::shipped;
use std::path::PathBuf;

/// Options of `plan`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Times `predict` on two small synthetic scenes, with as many processes at a time as the machine has processors (at most --cores): \
the nodes should be such machines. What the storage of the cluster does must be told.

Example:
  elunar plan --manifest m.jsonl --nodes 10 --cores 32 --storage-mb 2000")]
pub struct Args {
    /// Manifest, JSON lines, with the sizes of the images.
    #[arg(long, value_name = "M.jsonl")]
    pub manifest: PathBuf,
    /// Nodes.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub nodes: u64,
    /// Processors of a node, and images at a time on it.
    #[arg(long, value_name = "C", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1024))]
    pub cores: u64,
    /// What the storage reads and writes for all nodes together, 10^6 bytes a second.
    #[arg(long, value_name = "MB/s", default_value_t = 500.0)]
    pub storage_mb: f64,
    /// Most tasks of an array (MaxArraySize of Slurm, less one).
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..=4_000_000))]
    pub most_tasks: u64,
    /// Print one object of JSON.
    #[arg(long)]
    pub json: bool,
}

/// What an engine takes to begin a task, seconds.
const TASK_S: f64 = 0.1;

/// Runs the command.
///
/// # Errors
/// If the manifest cannot be read, or `predict` fails on the scenes that are timed.
pub fn run(args: Args) -> Result<()> {
    if !(args.storage_mb.is_finite() && args.storage_mb > 0.0) {
        return Err(Error::usage(format!("--storage-mb: a number above 0 expected, {} found", args.storage_mb)));
    }
    let manifest = BatchManifest::read(&args.manifest)?;
    let items: Vec<BatchItem> = manifest.items.iter().map(|(_, item)| item.clone()).collect();
    let program = std::env::current_exe().map_err(Error::io("this program"))?;
    let model = model_of(&items, &manifest.folder);
    let model =
        if shipped::find(&model).is_some() { model } else { std::path::absolute(model).map_err(Error::io("model"))? };
    let here = std::thread::available_parallelism().map_or(1, usize::from);
    let costs = Costs::measure(&program, &model, here.min(args.cores as usize))?;
    let cluster = Cluster {
        nodes: args.nodes as usize,
        cores: args.cores as usize,
        storage_bytes_s: 1e6 * args.storage_mb,
        task_s: TASK_S,
        most_tasks: args.most_tasks as usize,
    };
    let made = plan(&items, &costs, &cluster);
    if args.json {
        println!("{}", serde_json::json!({ "costs": costs, "cluster": cluster, "plan": made }));
        return Ok(());
    }
    let Costs { start_s, tile_s, jobs, .. } = costs;
    println!("measured here, {jobs} processes at a time: {start_s:.2} s a process, {tile_s:.3} s a tile");
    println!("{} images: {:.2} core hours", made.items, made.core_hours);
    if made.unknown > 0 {
        println!("WARNING: {} images of unknown size are not counted", made.unknown);
    }
    let gb = |bytes: u64| bytes as f64 / 1e9;
    println!(
        "{:.2} GB in, {:.2} GB out; {:.1} GB of memory a node",
        gb(made.bytes_in),
        gb(made.bytes_out),
        gb(made.node_bytes)
    );
    println!("array 1-{} of about {} images each, --cpus-per-task={}", made.chunks, made.chunk_items, args.cores);
    println!(
        "{:.1} s on {} nodes; {} limit ({:.1} s by processors, {:.1} s by storage)",
        made.seconds, args.nodes, made.limit, made.processors_s, made.storage_s
    );
    Ok(())
}
