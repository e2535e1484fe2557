//! Checks whether work depends on data: runs another tile beside the self test's, with marks around every step, so that the counter reports
//! each step.

use crate::calls::elunar_call_step;
use crate::mark::{elunar_count_start, elunar_count_stop};
use core::fmt::Write;
use elunar_core::nn::{Progress, RunError, Runner};
use elunar_core::tile::Shape;

/// Begins a tile of random numbers inside and outside the legal range; `values` is memory for them.
pub(crate) fn begin_other(runner: &mut Runner<'_, '_>, values: &mut [f32]) -> Result<(), RunError> {
    let (Shape { rows, cols }, maps, nr) = (runner.model().tile(), runner.model().image_maps(), runner.model().nr());
    let (image, rest) = values.split_at_mut(values.len().min(maps * rows * cols));
    let coarse_samples = rest.len().min(rows * cols);
    let coarse = &mut rest[..coarse_samples];
    let mut state = 1u32;
    let mut next = || {
        // A linear congruence (Numerical Recipes), whose upper bits are random enough to differ from a landscape.
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    image.iter_mut().for_each(|sample| *sample = 3.0 * next() - 1.0);
    coarse.iter_mut().for_each(|sample| *sample = nr * (3.0 * next() - 1.0));
    runner.begin(image, coarse)
}

/// Steps until the tile is done; prints the operator at which each step began, the number of steps and the number of cut results.
pub(crate) fn steps(
    runner: &mut Runner<'_, '_>,
    macs: u64,
    tile: &str,
    console: &mut impl Write,
) -> Result<(), RunError> {
    let (before, mut progress) = (runner.telemetry(), Progress::Running);
    while progress == Progress::Running {
        let at = runner.position().and_then(|index| runner.model().entry(index)).map_or(0, |entry| entry.operator);
        elunar_count_start();
        progress = elunar_call_step(runner, macs)?;
        elunar_count_stop();
        let _ = writeln!(console, "at {at}");
    }
    let after = runner.telemetry();
    let (steps, cut) = (after.steps - before.steps, after.saturated - before.saturated);
    let _ = writeln!(console, "tile {tile}: {steps} steps, {cut} results cut");
    Ok(())
}
