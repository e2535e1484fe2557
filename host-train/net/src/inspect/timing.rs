//! Times of a tile's operators, measured on the self-test tile, one entry of the schedule at a time.

use elunar_base::quantile::quantile;
use elunar_base::{Error, Result};
use elunar_core::nn::file::Operator;
use elunar_core::nn::{Kernel, Model, Progress, RunError, Runner, required};
use serde::Serialize;
use std::time::Instant;

/// Milliseconds per tile.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Times {
    /// Name of the kernel.
    pub kernel: &'static str,
    /// Number of tiles measured, after one tile that was not.
    pub tiles: usize,
    /// Median over the tiles, for every operator, milliseconds. Stepping and reading the clock are included.
    #[serde(skip)]
    pub operators_ms: Vec<f64>,
    /// Sum of the operators, milliseconds per tile.
    pub tile_ms: f64,
}

/// Returns the multiply-accumulates of an entry of the schedule.
pub(super) fn entry_macs(model: &Model<'_>, index: usize) -> u64 {
    over_units(model, index, Model::unit_macs)
}

/// Adds up a figure of the units of an entry.
fn over_units<'m>(model: &Model<'m>, index: usize, of: fn(&Model<'m>, &Operator, usize, usize) -> u64) -> u64 {
    let Some(entry) = model.entry(index) else { return 0 };
    let Some(operator) = model.operator(entry.operator) else { return 0 };
    let steps = entry.first..entry.first + entry.count;
    steps.map(|step| (0..model.units(&operator)).map(|unit| of(model, &operator, step, unit)).sum::<u64>()).sum()
}

/// Runs `tiles` tiles, after one tile that is not measured.
///
/// # Errors
/// [`Error::Input`] if the self test fails.
pub fn measure(kernel: Kernel, model: Model<'_>, tiles: usize) -> Result<Times> {
    let fault = |e: RunError| Error::input(format!("inspect: {e}"));
    let budgets: Vec<u64> = (0..model.entry_count()).map(|index| over_units(&model, index, Model::unit_work)).collect();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::with_kernel(kernel, model, &mut arena).map_err(fault)?;
    let mut measured = vec![Vec::with_capacity(tiles); model.operator_count()];
    for tile in 0..=tiles {
        let mut seconds = vec![0.0; model.operator_count()];
        runner.begin_self_test().map_err(fault)?;
        let mut before = Instant::now();
        while let Some(entry) = runner.position().and_then(|at| model.entry(at).map(|entry| (at, entry))) {
            let (at, entry) = entry;
            // This runs exactly one entry: the runner stops at the first unit beyond its budget.
            runner.step(budgets[at]).map_err(fault)?;
            let after = Instant::now();
            seconds[entry.operator] += after.duration_since(before).as_secs_f64();
            before = after;
        }
        // The rest is the model's checksums, which belong to no operator.
        while runner.step(u64::MAX).map_err(fault)? == Progress::Running {}
        runner.check_self_test().map_err(fault)?;
        if tile > 0 {
            measured.iter_mut().zip(seconds).for_each(|(of, s)| of.push(1e3 * s));
        }
    }
    let operators_ms: Vec<f64> = measured.iter_mut().map(|ms| quantile(ms, 0.5).unwrap_or(0.0)).collect();
    let tile_ms = operators_ms.iter().sum();
    Ok(Times { kernel: kernel.name(), tiles, operators_ms, tile_ms })
}
