//! Networks for the benchmarks: every preset with random weights, exported when needed, and a tile for them.

use elunar_base::Result;
use elunar_core::tile::{TILE_COLS, TILE_ROWS};
use elunar_learn::model::init::initial_weights;
use elunar_net::config::{NetConfig, Preset};
use elunar_net::export::{CalibrationTile, CompileOptions, MapBits, export};
use std::path::Path;

/// Seed of the weights, on which time does not depend.
const SEED: u64 = 1;

/// Name of the variable that includes `paper` in the benchmarks if it is 1: minutes more, and several GB of memory.
pub const PAPER_VARIABLE: &str = "ELUNAR_BENCH_PAPER";

/// Returns the presets to measure, smallest first. Reports it if `paper` is left out.
pub fn presets() -> Vec<Preset> {
    let mut presets = vec![Preset::Nano, Preset::Tiny, Preset::Small];
    if std::env::var(PAPER_VARIABLE).is_ok_and(|value| value == "1") {
        presets.push(Preset::Paper);
    } else {
        println!("SKIPPED: paper: minutes and several GB; {PAPER_VARIABLE}=1 takes it in");
    }
    presets
}

/// Returns the preset's name on the command line.
pub fn name(preset: Preset) -> &'static str {
    match preset {
        Preset::Nano => "nano",
        Preset::Tiny => "tiny",
        Preset::Small => "small",
        Preset::Paper => "paper",
    }
}

/// Returns a tile of `rows` x `cols` with texture and relief, image in [0, 1] and coarse DTM in [0, 50]. Time does not depend on it.
pub fn tile(rows: usize, cols: usize, maps: usize) -> (Vec<f32>, Vec<f32>) {
    let image = (0..maps * rows * cols).map(|i| (i % 97) as f32 / 96.0).collect();
    let coarse = (0..rows * cols).map(|i| (i / cols) as f32 * 50.0 / rows as f32).collect();
    (image, coarse)
}

/// Returns the model file of a preset with random weights, for tiles of 256 x 320, in the default precision of `host-train export`.
///
/// # Errors
/// Those of the export.
pub fn exported(preset: Preset) -> Result<Vec<u8>> {
    let config = NetConfig::preset(preset);
    let weights = initial_weights(&config, SEED);
    let (image, coarse) = tile(TILE_ROWS, TILE_COLS, config.image_maps());
    let tiles = [CalibrationTile { image, coarse, ground: None }];
    let options = CompileOptions { tile: (TILE_ROWS, TILE_COLS), precision: MapBits::Mixed, name: name(preset).into() };
    Ok(export(&config, &weights, Path::new(name(preset)), &tiles, &options, |_| ())?.bytes)
}
