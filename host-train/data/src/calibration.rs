//! Tiles for the exporter, which measures ranges and compares results on them.

use super::sample::{RawTile, Sample};
use super::source::TileSource;
use elunar_base::{Error, Result};
use elunar_core::tile::{Shape, TILE_COLS, TILE_ROWS};
use elunar_net::config::NetConfig;
use elunar_net::export::CalibrationTile;
use elunar_net::export::calibrate::TileTruth;

/// Returns the tiles `first..first + count` of a source, normalised as `config` says.
///
/// # Errors
/// If a tile cannot be made or has the wrong size. Tiles without relief are skipped.
pub fn calibration_tiles(
    source: &dyn TileSource,
    config: &NetConfig,
    first: u64,
    count: u64,
) -> Result<Vec<CalibrationTile>> {
    (first..first + count)
        .map(|index| {
            let raw = source.tile(index)?;
            if (raw.rows, raw.cols) != (TILE_ROWS, TILE_COLS) {
                let found = (raw.rows, raw.cols);
                return Err(Error::input(format!("tile {index}: expected {TILE_ROWS} x {TILE_COLS}, found {found:?}")));
            }
            calibration_tile(config, &raw)
        })
        .collect()
}

fn calibration_tile(config: &NetConfig, raw: &RawTile) -> Result<CalibrationTile> {
    let sample = Sample::new(config, raw)?;
    let mut truth = vec![0.0; raw.truth_m.len()];
    let bad = |e| Error::input(format!("tile cannot be normalised: {e}"));
    sample.scale.normalise(Shape::new(raw.rows, raw.cols), &raw.truth_m, &mut truth).map_err(bad)?;
    let ground = TileTruth { metres_per_unit: sample.scale.elevation.metres_per_unit(), pixel_m: raw.pixel_m, truth };
    Ok(CalibrationTile { image: sample.image, coarse: sample.coarse, ground: Some(ground) })
}
