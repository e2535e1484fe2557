//! Which maps keep 16 bits, chosen by what they cost: from none on, the most sensitive first, until the runner's slope error is
//! within a bound.

use super::calibrate::{CalibrationTile, Range};
use super::compile::{Export, Options, finish};
use super::graph::Graph;
use super::report::{Comparison, compare};
use super::sensitivity::Sensitivity;
use crate::config::NetConfig;
use elunar_core::nn::{Model, required};
use elunar_raster::{Error, Result};
use serde::Serialize;
use std::fmt;

/// What an export is made of, and what its error is measured with.
#[derive(Debug, Clone, Copy)]
pub struct Job<'a> {
    /// The network's configuration.
    pub config: &'a NetConfig,
    /// The network.
    pub graph: &'a Graph,
    /// What its maps reach.
    pub ranges: &'a [Range],
    /// Tile and name; the precision is what is chosen here.
    pub options: &'a Options,
    /// Tiles with truth.
    pub tiles: &'a [CalibrationTile],
}

/// One export on the way.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Trial {
    /// Maps with 16 bits of those that may have either.
    pub wide_maps: usize,
    /// Name of the one that was added last.
    pub added: String,
    /// Bytes of memory.
    pub arena_bytes: usize,
    /// The runner against the float network.
    pub comparison: Comparison,
}

/// An export that is good enough.
#[derive(Debug, Clone)]
pub struct Chosen {
    /// Which maps keep 16 bits, by node.
    pub wide: Vec<bool>,
    /// The export.
    pub export: Export,
    /// All that were tried; the last is the export.
    pub trials: Vec<Trial>,
}

/// Exports with more and more maps of 16 bits, in the order of [`Sensitivity::by_gain`], until the slope error grows by no more
/// than `percent`. `progress` is told how many were tried.
///
/// # Errors
/// [`Error::Usage`] if 16 bits everywhere are not enough, or the tiles have no truth; those of [`finish`] and [`compare`].
pub fn choose(job: &Job<'_>, sensitivity: &Sensitivity, percent: f64, progress: impl Fn(usize)) -> Result<Chosen> {
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
            return Err(Error::usage("export: expected tiles with truth to choose by, found none"));
        };
        let model = Model::new(&export.bytes).map_err(|e| Error::usage(format!("export: {e}")))?;
        let added = last.map_or_else(String::new, |id| job.graph.nodes[id].name.clone());
        trials.push(Trial { wide_maps, added, arena_bytes: required(&model), comparison });
        progress(trials.len());
        if ground.slope_error_growth_percent <= percent {
            return Ok(Chosen { wide, export, trials });
        }
        best = best.min(ground.slope_error_growth_percent);
    }
    Err(Error::usage(format!(
        "export: expected a growth of the slope error of {percent} % at most, found {best:.3} % with every map in 16 bits that can have them"
    )))
}

impl fmt::Display for Trial {
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
