//! What a run will take, from costs that are measured on this machine.

use super::item::BatchItem;
use elunar_base::{Error, Result};
use elunar_core::tile::{Shape, Tiling};
use serde::Serialize;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

/// Rows and columns of the two scenes that are timed. Tiles of 256 x 320 pixels that overlap by 100: 1 and 36 tiles.
const SMALL: (usize, usize) = (256, 320);
const LARGE: (usize, usize) = (900, 1240);
/// Times that each is run; the median counts.
const REPEATS: usize = 3;
/// Memory of a process: a constant, and bytes a column (300 MB at 5,000 columns).
const MEMORY_BYTES: u64 = 40_000_000;
const MEMORY_A_COLUMN: u64 = 52_000;

/// Costs of one process with one thread, while as many run as the machine has processors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Costs {
    /// Seconds of a process without tiles.
    pub start_s: f64,
    /// Seconds of a tile, with everything that grows with it.
    pub tile_s: f64,
    /// Bytes of a DTM with its hillshade, a pixel.
    pub bytes_a_pixel: f64,
    /// Processes at a time.
    pub jobs: usize,
}

impl Costs {
    /// Times `predict` on two synthetic scenes, `jobs` processes at a time.
    ///
    /// # Errors
    /// If a process fails.
    pub fn measure(program: &Path, model: &Path, jobs: usize) -> Result<Self> {
        let folder = tempfile::tempdir().map_err(Error::io("temporary folder"))?;
        let at = folder.path();
        let time = |(rows, cols): (usize, usize)| -> Result<f64> {
            let name = format!("{rows}");
            let sides = [rows.to_string(), cols.to_string()];
            finish(run(program, at, &["synth", "--out", &name, "--rows", &sides[0], "--cols", &sides[1]])?)?;
            let mut seconds = vec![];
            for repeat in 0..REPEATS {
                let start = Instant::now();
                let begun = (0..jobs).map(|job| {
                    let words = [
                        "predict".to_string(),
                        format!("--image={name}/scene_0000_image.tif"),
                        format!("--coarse={name}/scene_0000_coarse.tif"),
                        format!("--model={}", model.display()),
                        format!("--output={name}/{repeat}-{job}.tif"),
                        "--threads=1".into(),
                    ];
                    run(program, at, &words.each_ref().map(String::as_str))
                });
                begun.collect::<Result<Vec<_>>>()?.into_iter().try_for_each(finish)?;
                seconds.push(start.elapsed().as_secs_f64());
            }
            seconds.sort_by(f64::total_cmp);
            Ok(seconds[REPEATS / 2])
        };
        let (small, large) = (time(SMALL)?, time(LARGE)?);
        let tiles = |(rows, cols)| tiles(rows as u64, cols as u64) as f64;
        let tile_s = ((large - small) / (tiles(LARGE) - tiles(SMALL))).max(1e-6);
        let bytes: u64 = ["0-0.tif", "0-0_hillshade.png"]
            .iter()
            .map(|name| at.join(LARGE.0.to_string()).join(name).metadata().map_or(0, |found| found.len()))
            .sum();
        let start_s = (small - tile_s * tiles(SMALL)).max(0.0);
        Ok(Self { start_s, tile_s, bytes_a_pixel: bytes as f64 / (LARGE.0 * LARGE.1) as f64, jobs })
    }

    /// Returns the seconds of an item on one processor. The size of the image must be known.
    #[must_use]
    pub fn seconds(&self, item: &BatchItem) -> f64 {
        self.start_s + self.tile_s * tiles(item.rows.unwrap_or(1), item.cols.unwrap_or(1)) as f64
    }
}

fn run(program: &Path, folder: &Path, words: &[&str]) -> Result<std::process::Child> {
    let mut command = Command::new(program);
    command.current_dir(folder).args(words).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    command.spawn().map_err(Error::io(program))
}

fn finish(child: std::process::Child) -> Result<()> {
    let out = child.wait_with_output().map_err(Error::io("this program"))?;
    let text = String::from_utf8_lossy(&out.stderr);
    let why = text.lines().last().unwrap_or_default().trim_start_matches("ERROR: ");
    if out.status.success() { Ok(()) } else { Err(Error::input(format!("measuring: {why}"))) }
}

/// Returns the number of tiles of an image.
fn tiles(rows: u64, cols: u64) -> usize {
    let tile = Shape::new(256, 320);
    let covered = Shape::new((rows as usize).max(tile.rows), (cols as usize).max(tile.cols));
    Tiling::new(covered, tile, elunar_core::tile::INFERENCE_OVERLAP_PX).map_or(1, |tiling| tiling.len())
}

/// The cluster, as the user states it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cluster {
    /// Nodes.
    pub nodes: usize,
    /// Processors of each.
    pub cores: usize,
    /// What the storage reads and writes, bytes a second, for all nodes together.
    pub storage_bytes_s: f64,
    /// What the engine takes to begin a task, seconds.
    pub task_s: f64,
    /// Most tasks of an array.
    pub most_tasks: usize,
}

/// What a run will take.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BatchPlan {
    /// Items whose size is known.
    pub items: usize,
    /// Items whose size is unknown: they cost nothing here.
    pub unknown: usize,
    /// Hours of processors.
    pub core_hours: f64,
    /// Bytes that are read.
    pub bytes_in: u64,
    /// Bytes that are written: the DTMs, and the rows that wait for them.
    pub bytes_out: u64,
    /// Memory of a node, bytes.
    pub node_bytes: u64,
    /// Tasks of the array.
    pub chunks: usize,
    /// Items of a task.
    pub chunk_items: usize,
    /// Seconds, if processors limit.
    pub processors_s: f64,
    /// Seconds, if storage limits.
    pub storage_s: f64,
    /// What limits.
    pub limit: &'static str,
    /// Seconds of the run.
    pub seconds: f64,
}

/// Length of a task that is aimed at, seconds: short enough to be requeued, long against its start.
const TASK_S: f64 = 1800.0;
/// Least tasks of a node, so that nodes end together.
const TASKS_A_NODE: usize = 4;

/// Plans the run of some items.
#[must_use]
pub fn plan<'a>(items: impl IntoIterator<Item = &'a BatchItem>, costs: &Costs, cluster: &Cluster) -> BatchPlan {
    let (known, others): (Vec<&BatchItem>, Vec<&BatchItem>) =
        items.into_iter().partition(|item| item.rows.is_some() && item.cols.is_some());
    let pixels = |item: &BatchItem| item.rows.unwrap_or(0) * item.cols.unwrap_or(0);
    let seconds: Vec<f64> = known.iter().map(|item| costs.seconds(item)).collect();
    let total_s: f64 = seconds.iter().sum();
    let bytes_in = known.iter().filter_map(|item| item.image_bytes).sum();
    let all_pixels: u64 = known.iter().map(|item| pixels(item)).sum();
    // Rows wait as floats.
    let bytes_out = (all_pixels as f64 * (costs.bytes_a_pixel + 4.0)) as u64;
    let widest = known.iter().filter_map(|item| item.cols).max().unwrap_or(0);
    let by_length = (total_s / cluster.cores as f64 / TASK_S).ceil() as usize;
    let chunks = by_length.max(TASKS_A_NODE * cluster.nodes).min(known.len().max(1)).min(cluster.most_tasks);
    let processors_s = makespan(&seconds, chunks, cluster);
    let storage_s = (bytes_in + bytes_out) as f64 / cluster.storage_bytes_s;
    BatchPlan {
        items: known.len(),
        unknown: others.len(),
        core_hours: total_s / 3600.0,
        bytes_in,
        bytes_out,
        node_bytes: cluster.cores as u64 * (MEMORY_BYTES + MEMORY_A_COLUMN * widest),
        chunks,
        chunk_items: known.len().div_ceil(chunks.max(1)),
        processors_s,
        storage_s,
        limit: if storage_s > processors_s { "storage" } else { "processors" },
        seconds: processors_s.max(storage_s),
    }
}

/// Returns the seconds of a run, by going through it: nodes take tasks in order, the processors of a node the items of its task.
fn makespan(seconds: &[f64], chunks: usize, cluster: &Cluster) -> f64 {
    let mut nodes: BinaryHeap<Reverse<u64>> = (0..cluster.nodes).map(|_| Reverse(0)).collect();
    let micro = |seconds: f64| (seconds * 1e6) as u64;
    let mut end = 0;
    for chunk in 0..chunks {
        let Some(Reverse(free)) = nodes.pop() else { return 0.0 };
        let begin = free + micro(cluster.task_s);
        let mut cores: BinaryHeap<Reverse<u64>> = (0..cluster.cores).map(|_| Reverse(begin)).collect();
        let mut done = begin;
        for item_s in seconds.iter().skip(chunk).step_by(chunks) {
            let Some(Reverse(core)) = cores.pop() else { return 0.0 };
            done = done.max(core + micro(*item_s));
            cores.push(Reverse(core + micro(*item_s)));
        }
        nodes.push(Reverse(done));
        end = end.max(done);
    }
    end as f64 / 1e6
}

/// Returns the model of a manifest: that of its first item.
#[must_use]
pub fn model_of(items: &[BatchItem], folder: &Path) -> PathBuf {
    items.first().map_or_else(PathBuf::new, |item| item.model_at(folder))
}

#[cfg(test)]
mod tests {
    use super::*;

    const COSTS: Costs = Costs { start_s: 1.0, tile_s: 0.5, bytes_a_pixel: 3.0, jobs: 1 };

    fn cluster(nodes: usize, cores: usize, storage_bytes_s: f64) -> Cluster {
        Cluster { nodes, cores, storage_bytes_s, task_s: 0.0, most_tasks: 1000 }
    }

    fn item(rows: u64, cols: u64) -> BatchItem {
        BatchItem { rows: Some(rows), cols: Some(cols), image_bytes: Some(rows * cols), ..BatchItem::default() }
    }

    #[test]
    fn equal_items_take_what_a_division_says() {
        assert_eq!((tiles(256, 320), tiles(100, 100), tiles(412, 320), tiles(900, 1240)), (1, 1, 2, 36));
        let items: Vec<BatchItem> = (0..64).map(|_| item(412, 320)).collect();
        let made = plan(&items, &COSTS, &cluster(4, 2, 1e12));
        // Two seconds each, 16 tasks of 4 items, 4 tasks a node one after the other.
        assert_eq!((made.chunks, made.chunk_items, made.limit), (16, 4, "processors"));
        assert!((made.processors_s - 16.0).abs() < 1e-3 && (made.core_hours - 128.0 / 3600.0).abs() < 1e-9, "{made:?}");
        let slow = plan(&items, &COSTS, &cluster(4, 2, 1e6));
        let bytes = 64.0 * 412.0 * 320.0;
        assert_eq!(slow.limit, "storage");
        assert!((slow.seconds - (bytes + 7.0 * bytes) / 1e6).abs() < 0.01, "{slow:?}");
        let unknown = plan(&[BatchItem::default()], &COSTS, &cluster(1, 1, 1e6));
        assert_eq!((unknown.items, unknown.unknown, unknown.seconds), (0, 1, 0.0));
    }
}
