//! The convergence of a whole scene: CSV, picture and JSON.

use super::journal::{LevelLog, StepLog, TileLog};
use super::settings::SfsSettings;
use elunar_base::quantile::quantile;
use elunar_base::table::to_csv;
use elunar_base::{Error, Result, atomic_write};
use elunar_core::metrics::{HeightErrors, SlopeErrors};
use elunar_picture::{Chart, Series, plot, png_bytes};
use serde::Serialize;
use std::path::Path;

/// One point of the curve: means over all tiles. A tile that has finished the level counts with its last step.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct CurvePoint {
    /// Number of steps so far, over all levels. The start of each level counts as one.
    pub step: usize,
    /// Number of times the image was halved.
    pub level: usize,
    /// Step within the level; 0 is its start.
    pub level_step: usize,
    /// Number of tiles that took this step.
    pub tiles: usize,
    /// Cost per pixel: the sum of all terms.
    pub cost: f64,
    /// Brightness term of the cost.
    pub brightness: f64,
    /// Roughness term of the cost.
    pub smoothness: f64,
    /// Term of the departure from the coarse DTM.
    pub dem: f64,
    /// Root mean square error of height, metres, if there is a truth.
    pub rmse_m: Option<f64>,
    /// Mean absolute error of slope, degrees, if there is a truth.
    pub slope_mae_deg: Option<f64>,
}

/// Returns the curve of a scene's tiles.
#[must_use]
pub fn curve(tiles: &[TileLog]) -> Vec<CurvePoint> {
    let depth = tiles.iter().map(|tile| tile.levels.len()).max().unwrap_or(0);
    let mut points = vec![];
    for level in 0..depth {
        let logs: Vec<&LevelLog> = tiles.iter().filter_map(|tile| tile.levels.get(level)).collect();
        let longest = logs.iter().map(|log| log.steps.len()).max().unwrap_or(0);
        for level_step in 0..longest {
            let at = |log: &&LevelLog| log.steps.get(level_step).or(log.steps.last()).copied();
            let steps: Vec<StepLog> = logs.iter().filter_map(at).collect();
            let taking = logs.iter().filter(|log| level_step < log.steps.len()).count();
            points.push(CurvePoint {
                level: depth - 1 - level,
                level_step,
                tiles: taking,
                ..mean(&steps, points.len())
            });
        }
    }
    points
}

fn mean(steps: &[StepLog], step: usize) -> CurvePoint {
    let of = |term: fn(&StepLog) -> f64| steps.iter().map(term).sum::<f64>() / steps.len() as f64;
    let (mut heights, mut slopes) = (HeightErrors::default(), SlopeErrors::default());
    for (height, slope) in steps.iter().filter_map(|s| s.errors.as_ref()) {
        heights.merge(height);
        slopes.merge(slope);
    }
    CurvePoint {
        step,
        level: 0,
        level_step: 0,
        tiles: 0,
        cost: of(StepLog::cost),
        brightness: of(|s| s.brightness),
        smoothness: of(|s| s.smoothness),
        dem: of(|s| s.dem),
        rmse_m: heights.rmse_m(),
        slope_mae_deg: slopes.mae_deg(),
    }
}

/// Writes the curve as a table (`.csv`) or a picture (`.png`), whole or not at all.
///
/// # Errors
/// [`Error::Usage`] for another extension or without tiles, [`Error::Io`] if the file cannot be written.
pub fn write_curve(path: &Path, points: &[CurvePoint]) -> Result<()> {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("csv") => atomic_write(path, &csv(points)?),
        Some("png") => atomic_write(path, &png_bytes(&picture(points)?.into())?),
        _ => Err(Error::usage(format!("{}: a name ending in .csv or .png expected", path.display()))),
    }
}

fn csv(points: &[CurvePoint]) -> Result<Vec<u8>> {
    let heading =
        ["step", "level", "level_step", "tiles", "cost", "brightness", "smoothness", "dem", "rmse_m", "slope_mae_deg"];
    let row = |p: &CurvePoint| {
        let CurvePoint { step, level, level_step, tiles, .. } = p;
        let [step, level, level_step, tiles] = [step, level, level_step, tiles].map(usize::to_string);
        let [cost, brightness, smoothness, dem] =
            [p.cost, p.brightness, p.smoothness, p.dem].map(|term| format!("{term:.9e}"));
        let [rmse, slope] =
            [p.rmse_m, p.slope_mae_deg].map(|error| error.map_or_else(String::new, |error| format!("{error:.6}")));
        [step, level, level_step, tiles, cost, brightness, smoothness, dem, rmse, slope]
    };
    to_csv(std::iter::once(heading.map(String::from)).chain(points.iter().map(row)))
}

fn picture(points: &[CurvePoint]) -> Result<image::RgbImage> {
    let series = |name: &str, value: &dyn Fn(&CurvePoint) -> Option<f64>| Series {
        name: name.into(),
        points: points.iter().filter_map(|p| Some((p.step as f64, value(p)?))).collect(),
    };
    let mut all = vec![series("cost per pixel", &|p| Some(p.cost))];
    all.extend([
        series("RMSE of height, m", &|p| p.rmse_m),
        series("mean absolute slope error, °", &|p| p.slope_mae_deg),
    ]);
    all.retain(|one| !one.points.is_empty());
    let chart =
        Chart { title: "shape from shading, coarsest level first", x: "step", y: "cost per pixel, m, °", log_y: true };
    plot(&chart, &all)
}

/// Returns median, mean and largest of the tiles' seconds; `None` without tiles.
#[must_use]
pub fn seconds_per_tile(tiles: &[TileLog]) -> Option<(f64, f64, f64)> {
    let mut seconds: Vec<f64> = tiles.iter().map(|tile| tile.seconds).collect();
    let mean = seconds.iter().sum::<f64>() / seconds.len() as f64;
    let largest = seconds.iter().copied().fold(0.0, f64::max);
    Some((quantile(&mut seconds, 0.5)?, mean, largest))
}

/// Returns all settings and logs of a run as JSON.
#[must_use]
pub fn json(settings: &SfsSettings, tiles: &[TileLog]) -> String {
    let one = |tile: &TileLog| {
        let finest = tile.levels.last().map(|level| level.steps.as_slice()).unwrap_or_default();
        serde_json::json!({
            "row": tile.row,
            "col": tile.col,
            "seconds": tile.seconds,
            "lit_px": tile.lit_px,
            "converged": tile.converged(),
            "steps": tile.levels.iter().map(|level| level.steps.len() - 1).collect::<Vec<_>>(),
            "gradients": tile.levels.iter().flat_map(|level| &level.steps).map(|step| step.gradients).sum::<usize>(),
            "exposure": finest.last().map(|step| step.exposure),
            "cost_per_px": [finest.first().map(StepLog::cost), finest.last().map(StepLog::cost)],
        })
    };
    let seconds = seconds_per_tile(tiles);
    let value = serde_json::json!({
        "settings": settings,
        "seconds_per_tile": seconds.map(|(median, mean, largest)| serde_json::json!({
            "median": median, "mean": mean, "largest": largest
        })),
        "tiles": tiles.iter().map(one).collect::<Vec<_>>(),
        "curve": curve(tiles),
    });
    format!("{value:#}")
}
