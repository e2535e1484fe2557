//! Begins a tile. Every argument is validated before anything changes.

use crate::context::{Context, Lent, Outcome};
use crate::record::{ContextRecord, SELF_TEST, TILE};
use crate::run::{run_status, runner};
use crate::status::*;
use crate::types::eld_status_t;
use crate::validity;
use elunar_core::nn::file::crc32c;
use elunar_core::nn::{Begun, KnownSun, LightSource, Model, TileError, TileInput, TileScale};
use elunar_core::norm::NormError;
use elunar_core::photoclinometry::ExpectedErrors;

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

/// Begins the caller's tile.
pub(crate) fn begin(context: &mut Context<'_>, model: Model<'_>, lent: Lent<'_>, tile: TileInput<'_>) -> Outcome {
    let positive = |v: f32| v.is_finite() && v > 0.0;
    if !(positive(tile.pixel_m) && positive(tile.coarse_px)) {
        return Err(ELD_REFUSED_TILE_PIXEL);
    }
    if validity::count(tile.image, tile.coarse_m, tile.valid) == 0 {
        return Err(ELD_REFUSED_TILE_MASKED);
    }
    let dropped = context.at_work();
    context.start();
    let mut runner = runner(&context.record, model, lent.arena)?;
    let begun = runner.begin_metres(&tile, lent.scratch).map_err(tile_status);
    let record = &mut context.record;
    let Begun { scale, light, expected } = begun.inspect_err(|status| half_begun(record, *status))?;
    let assumed = light == LightSource::Assumed;
    record.suspended = runner.suspend();
    record.tile = TILE;
    record.valid_px = validity::pack(tile.image, tile.coarse_m, tile.valid, lent.validity);
    record.validity_crc = crc32c(lent.validity);
    keep(record, &scale);
    let expected = expected.unwrap_or(ExpectedErrors::UNKNOWN).to_values();
    record.expected_bits = expected.map(f32::to_bits);
    record.tiles_dropped = record.tiles_dropped.wrapping_add(u64::from(dropped));
    record.lights_assumed = record.lights_assumed.wrapping_add(u64::from(assumed));
    Ok(match (assumed, dropped) {
        (true, true) => ELD_NOTICE_DROPPED_LIGHT_ASSUMED,
        (true, false) => ELD_NOTICE_LIGHT_ASSUMED,
        (false, true) => ELD_NOTICE_DROPPED,
        (false, false) => ELD_OK,
    })
}

/// Updates the previous tile after the next one could not begin: a refusal leaves it unchanged; a fault of the model, found on the way into
/// the arena, loses it.
fn half_begun(record: &mut ContextRecord, status: eld_status_t) {
    if severity(status) == FAULT {
        record.lose_tile();
    }
}

fn keep(record: &mut ContextRecord, scale: &TileScale) {
    let TileScale { elevation, mirror, .. } = scale;
    record.scale_bits = [elevation.min_m(), elevation.relief_m(), elevation.nr()].map(f32::to_bits);
    record.mirror = mirror.rows as u32 | (mirror.cols as u32) << 1;
}

/// Begins the tile of the self test.
pub(crate) fn begin_self_test(context: &mut Context<'_>, model: Model<'_>, lent: Lent<'_>) -> Outcome {
    let dropped = context.at_work();
    context.start();
    let mut runner = runner(&context.record, model, lent.arena)?;
    let begun = runner.begin_self_test().map_err(run_status);
    let record = &mut context.record;
    begun.inspect_err(|status| half_begun(record, *status))?;
    record.suspended = runner.suspend();
    (record.tile, record.valid_px) = (SELF_TEST, 0);
    record.tiles_dropped = record.tiles_dropped.wrapping_add(u64::from(dropped));
    Ok(if dropped { ELD_NOTICE_DROPPED } else { ELD_OK })
}

fn tile_status(error: TileError) -> eld_status_t {
    match error {
        TileError::Run(error) => run_status(error),
        TileError::Norm(NormError::Length(_)) => ELD_REFUSED_TILE_SIZE,
        TileError::Norm(NormError::TooFewValid { .. }) => ELD_REFUSED_TILE_MASKED,
        TileError::Norm(NormError::ConstantImage) => ELD_REFUSED_TILE_CONSTANT_IMAGE,
        TileError::Norm(NormError::Relief { .. } | NormError::Margin { .. }) => ELD_REFUSED_TILE_NO_RELIEF,
        // From the header, which was validated before.
        TileError::Norm(NormError::Range { .. }) => ELD_FAULT_MODEL_CHANGED,
    }
}
