//! Begins a tile, a bounded piece of work at a time. Every argument is validated before anything changes.

use crate::context::{Context, Lent, Outcome};
use crate::record::{ContextRecord, DROPPED, EMPTY, PREPARING, SELF_TEST, TILE};
use crate::run::{job_status, keep_errors, run_status, runner, tile_job};
use crate::sealed::write_job;
use crate::status::*;
use crate::tile::CallerTile;
use crate::types::eld_status_t;
use elunar_core::nn::file::crc32c;
use elunar_core::nn::{KnownSun, LightSource, Model};
use elunar_core::{Made, Progress, TileJob};

/// Returns the known angles of the Sun from those of a tile, degrees; NaN stands for unknown.
///
/// # Errors
/// [`ELD_REFUSED_TILE_SUN`] for angles that are not those of a Sun over lit ground.
pub(crate) fn stated_sun(azimuth_deg: f32, elevation_deg: f32) -> Result<KnownSun, eld_status_t> {
    let known = |deg: f32| (!deg.is_nan()).then_some(f64::from(deg));
    let (azimuth_deg, elevation_deg) = (known(azimuth_deg), known(elevation_deg));
    let legal = azimuth_deg.is_none_or(|deg| (-360.0..=360.0).contains(&deg))
        && elevation_deg.is_none_or(|deg| deg > 0.0 && deg < 90.0);
    if legal { Ok(KnownSun { azimuth_deg, elevation_deg }) } else { Err(ELD_REFUSED_TILE_SUN) }
}

/// Returns the job of a tile that is prepared or surveyed: a new one, or, if it may `go_on` and is the same tile, the one in progress. The arena is
/// marked as changing.
///
/// # Errors
/// The status of a refused tile; then nothing has changed.
pub(crate) fn job_of(
    context: &mut Context<'_>,
    model: &Model<'_>,
    block: &[u8],
    tile: &CallerTile<'_>,
    (kind, go_on): (u32, bool),
) -> Result<TileJob, eld_status_t> {
    if go_on && context.record.tile == kind && context.record.tile_crc == tile.crc {
        let job = tile_job(context, model, block)?;
        context.start();
        return Ok(job);
    }
    let rules = tile.rules;
    if ![rules.pixel_m, rules.coarse_px].iter().all(|v| v.is_finite() && *v > 0.0) {
        return Err(ELD_REFUSED_TILE_PIXEL);
    }
    if !tile.has_valid_pixels() {
        return Err(ELD_REFUSED_TILE_MASKED);
    }
    let dropped = context.at_work();
    context.start();
    let record = &mut context.record;
    record.tiles_dropped = record.tiles_dropped.wrapping_add(u64::from(dropped));
    (record.tile, record.tile_crc, record.made, record.valid_px) = (kind, tile.crc, 0, 0);
    record.notices = if dropped { DROPPED } else { 0 };
    Ok(TileJob::new(rules, model.input_rules(), model.tile()))
}

/// Begins the caller's tile, or goes on with it.
pub(crate) fn begin(
    context: &mut Context<'_>,
    model: Model<'_>,
    mut lent: Lent<'_>,
    tile: &CallerTile<'_>,
    budget: Option<u64>,
) -> Outcome {
    let mut job = job_of(context, &model, lent.job, tile, (PREPARING, budget.is_some()))?;
    let record = &mut context.record;
    let mut runner = runner(record, model, lent.arena)?;
    let prepared = job.prepare(&mut runner, &tile.input(), &mut lent.tile, budget.unwrap_or(u64::MAX));
    record.suspended = runner.suspend();
    let prepared = prepared.map_err(|error| lost(record, job_status(error)))?;
    write_job(lent.job, &job);
    if prepared == Progress::Running {
        return Ok(ELD_RUNNING);
    }
    if job.made() == Some(Made::Empty) {
        return Err(lost(record, ELD_REFUSED_TILE_MASKED));
    }
    let assumed = job.lighting().source == LightSource::Assumed && job.made() == Some(Made::Predicted);
    record.tile = TILE;
    record.valid_px = job.valid_px() as u32;
    job.mark_dark(tile.input().image, lent.dark);
    record.dark_crc = crc32c(lent.dark);
    record.lights_assumed = record.lights_assumed.wrapping_add(u64::from(assumed));
    keep_errors(record, &job);
    let dropped = record.notices & DROPPED != 0;
    Ok(match (job.made() == Some(Made::Coarse), assumed, dropped) {
        (true, _, true) => ELD_NOTICE_DROPPED_COARSE,
        (true, _, false) => ELD_NOTICE_COARSE,
        (_, true, true) => ELD_NOTICE_DROPPED_LIGHT_ASSUMED,
        (_, true, false) => ELD_NOTICE_LIGHT_ASSUMED,
        (_, _, true) => ELD_NOTICE_DROPPED,
        (_, _, false) => ELD_OK,
    })
}

/// Loses the tile that could not begin; returns the status.
fn lost(record: &mut ContextRecord, status: eld_status_t) -> eld_status_t {
    record.lose_tile();
    status
}

/// Gives the tile up, whatever it is.
pub(crate) fn abort(context: &mut Context<'_>) -> Outcome {
    if context.record.tile == EMPTY {
        return Err(ELD_REFUSED_NO_TILE);
    }
    let dropped = context.at_work();
    let before = context.record.tiles_dropped;
    context.record.lose_tile();
    context.record.tiles_dropped = before.wrapping_add(u64::from(dropped));
    Ok(if dropped { ELD_NOTICE_DROPPED } else { ELD_OK })
}

/// Begins the tile of the self test; steps load it.
pub(crate) fn begin_self_test(context: &mut Context<'_>, model: Model<'_>, lent: Lent<'_>) -> Outcome {
    let dropped = context.at_work();
    context.start();
    let mut runner = runner(&context.record, model, lent.arena)?;
    let begun = runner.begin_self_test_in_steps().map_err(run_status);
    let record = &mut context.record;
    begun.map_err(|status| lost(record, status))?;
    record.suspended = runner.suspend();
    (record.tile, record.valid_px, record.made) = (SELF_TEST, 0, 0);
    record.tiles_dropped = record.tiles_dropped.wrapping_add(u64::from(dropped));
    Ok(if dropped { ELD_NOTICE_DROPPED } else { ELD_OK })
}
