//! Step 3: makes the model file of the int8 runner from float weights.

use super::console::say;
use super::folder::{FLOAT_MODEL, Folder, INT8_MODEL};
use super::{Seeds, TourSettings, tune};
use elunar_base::progress::bar;
use elunar_base::{Error, Result, atomic_write};
use elunar_core::nn::{Model, required};
use elunar_core::tile::{TILE_COLS, TILE_ROWS};
use elunar_data::calibration::calibration_tiles;
use elunar_net::config::config_of;
use elunar_net::export::report::{RunnerDifferences, compare};
use elunar_net::export::{CompileOptions, MapBits, export};
use elunar_net::weights::NetWeights;
use elunar_synth::SceneEntry;

/// Size of the int8 model, and its difference from float.
pub(super) struct Shrunk {
    /// Size of the float weights' file, bytes.
    pub float_bytes: usize,
    /// Size of the model file, bytes.
    pub flash_bytes: usize,
    /// Working memory of the runner, bytes.
    pub arena_bytes: usize,
    /// Multiply-accumulates of one tile.
    pub macs: u64,
    /// Number of operators of its program.
    pub operators: usize,
    /// Comparison with float, on tiles that were not used for calibration.
    pub comparison: RunnerDifferences,
}

/// Calibrates, quantises, compares and writes.
///
/// # Errors
/// If weights cannot be read, tiles cannot be made, or the network does not fit the runner.
pub(super) fn run(settings: &TourSettings, folder: &Folder, seeds: Seeds, scene: &SceneEntry) -> Result<Shrunk> {
    let path = folder.file(FLOAT_MODEL);
    let weights = NetWeights::read(&path)?;
    let config = config_of(&weights, &path)?;
    let source = tune::moon(seeds.calibration, scene).open()?;
    let tiles = calibration_tiles(&*source, &config, 0, settings.calibration_tiles)?;
    let held_out = calibration_tiles(&*source, &config, settings.calibration_tiles, settings.comparison_tiles)?;
    let options = CompileOptions { tile: (TILE_ROWS, TILE_COLS), precision: MapBits::Mixed, name: "model".into() };
    let calibrating = bar("calibrating", settings.calibration_tiles, "tiles");
    let made = export(&config, &weights, &path, &tiles, &options, |done| calibrating.set_position(done as u64))?;
    calibrating.finish_and_clear();
    let comparing = bar("comparing", settings.comparison_tiles, "tiles");
    let comparison = compare(&made, &held_out, |done| comparing.set_position(done as u64))?;
    comparing.finish_and_clear();
    atomic_write(&folder.file(INT8_MODEL), &made.bytes)?;
    let model = Model::new(&made.bytes).map_err(|e| Error::input(format!("export: {e}")))?;
    let shrunk = Shrunk {
        float_bytes: weights.to_bytes().len(),
        flash_bytes: made.bytes.len(),
        arena_bytes: required(&model),
        macs: model.macs(),
        operators: model.operator_count(),
        comparison,
    };
    say(format!(
        "{INT8_MODEL}: flash {:.2} MB (float weights {:.2} MB), RAM {:.2} MB, {:.2} GMAC a tile of {TILE_ROWS} x {TILE_COLS}",
        shrunk.flash_bytes as f64 / 1e6,
        shrunk.float_bytes as f64 / 1e6,
        shrunk.arena_bytes as f64 / 1e6,
        shrunk.macs as f64 / 1e9
    ));
    if let Some(ground) = &shrunk.comparison.ground {
        say(format!(
            "int8 differs from float by {:.3} m and {:.3}° of slope (RMS, {} tiles not used for calibration)",
            ground.rmse_m, ground.slope_rmse_deg, shrunk.comparison.tiles
        ));
    }
    Ok(shrunk)
}
