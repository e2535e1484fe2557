//! Choice of the maps that keep 16 bits. At first there are none. The most sensitive maps are added until the growth of the runner's slope
//! error is within a bound.

use super::calibrate::{CalibrationTile, Range};
use super::compile::{CompileOptions, Export, finish};
use super::graph::Graph;
use super::report::{RunnerDifferences, compare};
use super::sensitivity::Sensitivity;
use crate::config::NetConfig;
use elunar_base::{Error, Result};
use elunar_core::nn::{Model, required};
use serde::Serialize;
use std::fmt;

/// Input of an export, and the tiles for measuring its error.
#[derive(Debug, Clone, Copy)]
pub struct ExportJob<'a> {
    /// The network's configuration.
    pub config: &'a NetConfig,
    /// The network.
    pub graph: &'a Graph,
    /// Ranges of its maps.
    pub ranges: &'a [Range],
    /// Tile and name. The precision is not used, because it is chosen here.
    pub options: &'a CompileOptions,
    /// Tiles with truth.
    pub tiles: &'a [CalibrationTile],
}

/// One export during the search.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ExportTrial {
    /// Number of maps with 16 bits, of those that can have 8 or 16.
    pub wide_maps: usize,
    /// Name of the map that was added last.
    pub added: String,
    /// Size of the arena, bytes.
    pub arena_bytes: usize,
    /// Comparison of the runner with the float network.
    pub comparison: RunnerDifferences,
}

/// The export that meets the bound.
#[derive(Debug, Clone)]
pub struct Chosen {
    /// Whether each node's map keeps 16 bits.
    pub wide: Vec<bool>,
    /// The export.
    pub export: Export,
    /// All trials; the last one is the export.
    pub trials: Vec<ExportTrial>,
}

/// Exports with a growing number of maps of 16 bits, in the order of [`Sensitivity::by_gain`], until the slope error grows by no more than
/// `percent`. Calls `progress` with the number of trials.
///
/// # Errors
/// [`Error::Input`] if 16 bits everywhere do not suffice, or the tiles have no truth. Otherwise as [`finish`] and [`compare`].
pub fn choose(
    job: &ExportJob<'_>,
    sensitivity: &Sensitivity,
    percent: f64,
    progress: impl Fn(usize),
) -> Result<Chosen> {
    let mut wide = vec![false; job.graph.nodes.len()];
    let order = sensitivity.by_gain();
    let mut trials = Vec::new();
    let mut best = f64::INFINITY;
    for wide_maps in 0..=order.len() {
        let last = wide_maps.checked_sub(1).map(|index| order[index]);
        last.into_iter().for_each(|id| wide[id] = true);
        let export = finish(job.config, job.graph.clone(), job.ranges, &wide, job.options)?;
        let comparison = compare(&export, job.tiles, |_| {})?;
        let Some(ground) = comparison.ground else {
            return Err(Error::input("export: expected tiles with truth to choose by, found none"));
        };
        let model = Model::new(&export.bytes).map_err(|e| Error::input(format!("export: {e}")))?;
        let added = last.map_or_else(String::new, |id| job.graph.nodes[id].name.clone());
        trials.push(ExportTrial { wide_maps, added, arena_bytes: required(&model), comparison });
        progress(trials.len());
        if ground.slope_error_growth_percent <= percent {
            return Ok(Chosen { wide, export, trials });
        }
        best = best.min(ground.slope_error_growth_percent);
    }
    Err(Error::input(format!(
        "export: expected a growth of the slope error of {percent} % at most, found {best:.3} % with every map in 16 bits that can have them"
    )))
}

impl fmt::Display for ExportTrial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ground = self.comparison.ground.unwrap_or_default();
        write!(
            f,
            "{:>3} maps in 16 bits: slope error {:+.2} %, error {:+.2} %; to float {:.3} m, {:.3} deg; arena {} bytes {}",
            self.wide_maps,
            ground.slope_error_growth_percent,
            ground.error_growth_percent,
            ground.rmse_m,
            ground.slope_rmse_deg,
            self.arena_bytes,
            if self.added.is_empty() { String::new() } else { format!("(now also {})", self.added) }
        )
    }
}
