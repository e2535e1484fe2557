//! `host-train latency`: how long a tile takes.

use crate::predict::int8;
use crate::{Error, Result};
use elunar_core::nn::{Model, Progress, Runner, required};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Options of `latency`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  host-train latency --model nano.eld --threads 2")]
pub struct Args {
    /// Model file (.eld).
    #[arg(long, value_name = "M.eld")]
    pub model: PathBuf,
    /// Threads, each with a tile of its own; 0 takes as many as the machine offers.
    #[arg(long, default_value_t = 1)]
    pub threads: usize,
    /// Seconds to measure for.
    #[arg(long, default_value_t = 3.0)]
    pub seconds: f64,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// If the model cannot be read or fails its self test.
pub fn run(args: Args) -> Result<()> {
    let opened = int8::open(&args.model)?;
    let model = opened.model();
    let available = std::thread::available_parallelism().map_or(1, |n| n.get());
    let threads = if args.threads == 0 { available } else { args.threads.min(256) };
    let duration = Duration::from_secs_f64(args.seconds.clamp(0.1, 3600.0));
    let start = Instant::now();
    let runs: Result<Vec<Vec<f64>>> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(|| measure(model, duration))).collect();
        workers
            .into_iter()
            .map(|w| w.join().unwrap_or_else(|_| Err(Error::usage("latency: a thread failed"))))
            .collect()
    });
    let wall_s = start.elapsed().as_secs_f64();
    let mut tiles_s: Vec<f64> = runs?.into_iter().flatten().collect();
    tiles_s.sort_by(f64::total_cmp);
    let median_ms = tiles_s[tiles_s.len() / 2] * 1e3;
    let tiles_per_s = tiles_s.len() as f64 / wall_s;
    let gmac_per_s = model.macs() as f64 * tiles_per_s / 1e9;
    let arena = required(&model);
    if args.json {
        let report = serde_json::json!({
            "median_ms": median_ms, "min_ms": tiles_s[0] * 1e3, "tiles": tiles_s.len(), "threads": threads,
            "tiles_per_s": tiles_per_s, "gmac_per_s": gmac_per_s, "macs": model.macs(), "arena_bytes": arena,
            "kernel": elunar_core::nn::kernels::scalar::NAME,
        });
        println!("{report}");
        return Ok(());
    }
    println!("{}: {:.3} GMAC per tile, arena {arena} bytes", args.model.display(), model.macs() as f64 / 1e9);
    println!("  kernel {}, {threads} thread(s), {} tiles", elunar_core::nn::kernels::scalar::NAME, tiles_s.len());
    println!("  median {median_ms:.1} ms per tile, fastest {:.1} ms", tiles_s[0] * 1e3);
    println!("  {tiles_per_s:.2} tiles/s, {gmac_per_s:.2} GMAC/s");
    Ok(())
}

/// Seconds of each tile: the built-in self-test tile over and over, checked each time.
fn measure(model: Model<'_>, duration: Duration) -> Result<Vec<f64>> {
    let fault = |e: elunar_core::nn::RunError| Error::usage(format!("latency: {e}"));
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::new(model, &mut arena).map_err(fault)?;
    let (mut tiles, start) = (Vec::new(), Instant::now());
    while tiles.is_empty() || start.elapsed() < duration {
        let tile = Instant::now();
        runner.begin_self_test();
        while runner.step(u64::MAX).map_err(fault)? == Progress::Running {}
        runner.check_self_test().map_err(fault)?;
        tiles.push(tile.elapsed().as_secs_f64());
    }
    Ok(tiles)
}
