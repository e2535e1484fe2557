//! `elunar latency`: measures the time of a tile.

use elunar_base::quantile::quantile;
use elunar_base::{Error, Result};
use elunar_core::nn::{self, Kernel, Progress, Runner, required};
use elunar_core::tile::Shape;
use elunar_net::kernels;
use elunar_scene::predict::int8;
use elunar_scene::predict::network::TileModel;
use elunar_scene::predict::whole::WholeTile;
use std::path::PathBuf;
use std::thread::ScopedJoinHandle;
use std::time::{Duration, Instant};

/// Help text below the options.
pub const HELP: &str = "\
Two clocks: the network alone, and a whole tile as `predict` makes it (light, maps, network, anchor). Every thread runs one tile before a clock starts.

Examples:
  elunar latency --model nano.eld --threads 2
  elunar latency --model nano.eld --tiles 20 --json";

/// Options of `latency`.
#[derive(Debug, clap::Args)]
#[command(after_help = HELP)]
pub struct Args {
    /// Model: `ground` or `nano`, which are in this program, or a file, `.eld` for the int8 runner. `host-train` also accepts `.safetensors`, the float network.
    #[arg(long, value_name = "M")]
    pub model: PathBuf,
    /// Number of threads, each with its own tile; 0 takes as many as the machine offers. The float backend may use more threads internally.
    #[arg(long, default_value_t = 1, value_parser = crate::threads::number)]
    pub threads: usize,
    /// Number of tiles to measure on every thread with each clock [default: as many as take three seconds].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub tiles: Option<u64>,
    /// Kernel of the int8 runner [default: the fastest this processor runs].
    #[arg(long, value_name = "NAME")]
    pub kernel: Option<String>,
    /// Run the int8 runner without the checksums of rows, records and model.
    #[arg(long)]
    pub unprotected: bool,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// Properties of a model apart from its time.
struct Facts {
    kernel: String,
    macs: Option<u64>,
    /// Arena of one thread, bytes.
    arena_bytes: Option<usize>,
    model_bytes: Option<usize>,
}

/// Duration of the measurement.
#[derive(Debug, Clone, Copy)]
enum Extent {
    Time(Duration),
    Tiles(u64),
}

impl Extent {
    /// Runs tiles for the whole extent. Returns the seconds of each tile.
    fn measure(self, mut tile: impl FnMut() -> Result<()>) -> Result<Vec<f64>> {
        let (mut tiles_s, start) = (Vec::new(), Instant::now());
        let enough = |done: usize| match self {
            Self::Time(duration) => done > 0 && start.elapsed() >= duration,
            Self::Tiles(count) => done as u64 >= count,
        };
        while !enough(tiles_s.len()) {
            let start = Instant::now();
            tile()?;
            tiles_s.push(start.elapsed().as_secs_f64());
        }
        Ok(tiles_s)
    }
}

/// Measurements of all threads together.
struct Measured {
    threads: usize,
    /// Seconds of each tile, sorted.
    tiles_s: Vec<f64>,
    /// Sum of the threads' rates. Each rate refers to the thread's own time.
    tiles_per_s: f64,
}

/// Runs the command.
///
/// # Errors
/// If the model cannot be read or fails its self test.
pub fn run(args: Args) -> Result<()> {
    let kernel = kernel(args.kernel.as_deref())?;
    let protected_every = if args.unprotected { u64::MAX } else { 1 };
    let opened = int8::open(&args.model)?.in_large_steps()?.with_kernel(kernel).with_protected_every(protected_every);
    let model = opened.model();
    let facts = Facts {
        kernel: kernel.name().into(),
        macs: Some(model.macs()),
        arena_bytes: Some(required(&model)),
        model_bytes: Some(model.raw().bytes().len()),
    };
    let extent = args.extent();
    let measured = on_threads(args.threads, || measure_int8(kernel, model, !args.unprotected, extent))?;
    print(&args, &facts, &measured, &on_threads(args.threads, || measure_whole(&opened, extent))?);
    Ok(())
}

/// Measures a network of another kind. `kernel` names what computes it.
///
/// # Errors
/// If the network fails.
pub fn run_other(args: &Args, model: &dyn TileModel, kernel: String) -> Result<()> {
    let facts = Facts { kernel, macs: None, arena_bytes: None, model_bytes: None };
    let extent = args.extent();
    let measured = on_threads(args.threads, || measure_other(model, extent))?;
    print(args, &facts, &measured, &on_threads(args.threads, || measure_whole(model, extent))?);
    Ok(())
}

impl Args {
    fn extent(&self) -> Extent {
        self.tiles.map_or(Extent::Time(Duration::from_secs(3)), Extent::Tiles)
    }
}

/// Returns the kernel with that name; without a name, the fastest.
fn kernel(name: Option<&str>) -> Result<Kernel> {
    let Some(name) = name else { return Ok(kernels::best()) };
    kernels::kernels().find(|kernel| kernel.name() == name).ok_or_else(|| {
        let names: Vec<&str> = kernels::kernels().map(|kernel| kernel.name()).collect();
        Error::usage(format!("--kernel: expected one of {}, found {name}", names.join(", ")))
    })
}

/// Runs `measure` on every thread.
fn on_threads(threads: usize, measure: impl Fn() -> Result<Vec<f64>> + Sync) -> Result<Measured> {
    let available = std::thread::available_parallelism().map_or(1, |n| n.get());
    let threads = if threads == 0 { available } else { threads.min(256) };
    let on_others = || {
        std::thread::scope(|scope| {
            let workers: Vec<_> = (0..threads).map(|_| scope.spawn(&measure)).collect();
            let join =
                |w: ScopedJoinHandle<_>| w.join().unwrap_or_else(|_| Err(Error::usage("latency: a thread failed")));
            workers.into_iter().map(join).collect::<Result<_>>()
        })
    };
    // One needs no other, which WebAssembly does not have.
    let runs: Vec<Vec<f64>> = if threads == 1 { vec![measure()?] } else { on_others()? };
    let tiles_per_s = runs.iter().map(|run| run.len() as f64 / run.iter().sum::<f64>()).sum();
    let tiles_s: Vec<f64> = runs.into_iter().flatten().collect();
    Ok(Measured { threads, tiles_s, tiles_per_s })
}

impl Measured {
    /// Returns the median and the fastest time of a tile, milliseconds.
    fn median_and_fastest_ms(&self) -> [f64; 2] {
        let mut ordered = self.tiles_s.clone();
        [0.5, 0.0].map(|share| 1e3 * quantile(&mut ordered, share).unwrap_or(f64::NAN))
    }
}

fn print(args: &Args, facts: &Facts, measured: &Measured, whole: &Measured) {
    let Measured { threads, tiles_s, tiles_per_s } = measured;
    let ([median_ms, fastest_ms], [whole_ms, whole_fastest_ms]) =
        (measured.median_and_fastest_ms(), whole.median_and_fastest_ms());
    let gmac_per_s = facts.macs.map(|macs| macs as f64 * tiles_per_s / 1e9);
    if args.json {
        let report = serde_json::json!({
            "median_ms": median_ms, "min_ms": fastest_ms, "tiles": tiles_s.len(), "threads": threads,
            "tiles_per_s": tiles_per_s, "gmac_per_s": gmac_per_s, "macs": facts.macs,
            "arena_bytes": facts.arena_bytes, "model_bytes": facts.model_bytes, "kernel": facts.kernel,
            "whole_median_ms": whole_ms, "whole_min_ms": whole_fastest_ms,
        });
        println!("{report}");
        return;
    }
    println!("{}: kernel {}, {threads} thread(s), {} tiles", args.model.display(), facts.kernel, tiles_s.len());
    println!(
        "  network alone: median {median_ms:.1} ms per tile, fastest {fastest_ms:.1} ms, {tiles_per_s:.2} tiles/s"
    );
    println!(
        "  whole tile: median {whole_ms:.1} ms, fastest {whole_fastest_ms:.1} ms, {:.2} times the network",
        whole_ms / median_ms
    );
    if let (Some(macs), Some(rate), Some(arena)) = (facts.macs, gmac_per_s, facts.arena_bytes) {
        println!("  {:.3} GMAC per tile, {rate:.2} GMAC/s, arena {arena} bytes", macs as f64 / 1e9);
    }
}

/// Measures the seconds of each tile of a network. It runs one synthetic tile repeatedly.
fn measure_other(model: &dyn TileModel, extent: Extent) -> Result<Vec<f64>> {
    let Shape { rows, cols } = model.tile();
    let samples = model.input_rules().illumination.image_maps() * rows * cols;
    let image: Vec<f32> = (0..samples).map(|i| (i % 97) as f32 / 96.0).collect();
    let coarse: Vec<f32> = (0..rows * cols).map(|i| (i / cols) as f32 * 50.0 / rows as f32).collect();
    let (mut worker, mut output) = (model.worker()?, vec![0.0; rows * cols]);
    let mut tile = || worker.predict(&image, &coarse, &mut output);
    tile()?;
    extent.measure(tile)
}

/// Measures the seconds of each tile from samples to heights.
fn measure_whole(model: &dyn TileModel, extent: Extent) -> Result<Vec<f64>> {
    let mut tile = WholeTile::new(model)?;
    tile.make()?;
    extent.measure(|| tile.make())
}

/// Measures the seconds of each tile. It runs the built-in self-test tile repeatedly and checks each result.
fn measure_int8(kernel: Kernel, model: nn::Model<'_>, protect: bool, extent: Extent) -> Result<Vec<f64>> {
    let fault = |e: nn::RunError| Error::usage(format!("latency: {e}"));
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::with_kernel(kernel, model, &mut arena).map_err(fault)?;
    runner.protect(protect);
    let mut tile = || {
        runner.begin_self_test().map_err(fault)?;
        while runner.step(u64::MAX).map_err(fault)? == Progress::Running {}
        runner.check_self_test().map_err(fault)
    };
    tile()?;
    extent.measure(tile)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_tiles_are_timed_as_asked_for() {
        let mut runs = 0;
        let mut tile = || {
            runs += 1;
            Ok(())
        };
        assert_eq!(Extent::Tiles(3).measure(&mut tile).unwrap().len(), 3);
        let timed = Extent::Time(Duration::ZERO).measure(&mut tile).unwrap().len();
        assert_eq!((timed, runs), (1, 4), "at least one tile, however short the time");
        let measured = on_threads(2, || Ok(vec![0.5, 0.25, 0.25])).unwrap();
        assert_eq!((measured.threads, measured.tiles_s.len(), measured.tiles_per_s), (2, 6, 6.0));
        assert!(Extent::Tiles(1).measure(|| Err(Error::usage("no"))).is_err());
    }
}
