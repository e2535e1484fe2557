//! The light of a scene.

use super::pointers::*;
use super::tile::caller_tile;
use super::{apart_from_ours, with_model, with_record};
use crate::context::{Context, Lent};
use crate::light;
use crate::status::*;
use crate::types::*;
use elunar_core::nn::Model;

/// Adds what a tile shows of the light of its scene, a piece of about `budget_macs` multiply-accumulates at a time. `ELD_RUNNING`: call again with
/// the same structure, and unchanged maps. The angles of the Sun and `light` do not matter here. A tile in progress is dropped, with a notice.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_light_add(
    context: *mut eld_context_t,
    tile: *const eld_tile_t,
    budget_macs: u64,
) -> eld_status_t {
    let add = |context: &mut Context<'_>, model: Model<'_>, lent: Lent<'_>| {
        // SAFETY: the caller's promise.
        let tile = unsafe { caller_tile(tile, &context.record, &model) }?;
        light::add(context, model, lent, &tile, budget_macs)
    };
    // SAFETY: the caller's promise.
    unsafe { with_model(context, add) }
}

/// Decides the light of the scene whose tiles were added: stated angles of the Sun are kept (degrees as in `eld_tile_t`, NaN if unknown), the rest is
/// fitted to all of them. `out->struct_bytes` must be set. The light is for the tiles of the scene (`eld_tile_t.light`).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_light_decide(
    context: *mut eld_context_t,
    sun_azimuth_deg: f32,
    sun_elevation_deg: f32,
    out: *mut eld_lighting_t,
) -> eld_status_t {
    let decide = |context: &mut Context<'_>, model: Model<'_>, lent: Lent<'_>| {
        apart_from_ours(&context.record, &span(out, 1)?)?;
        // SAFETY: the caller's promise; the structure does not overlap any memory that is borrowed.
        let asked = unsafe { structure(out) }?;
        let sun = (sun_azimuth_deg, sun_elevation_deg);
        let found = light::decide(context, &model, lent, sun, asked.struct_bytes)?;
        // SAFETY: validated by `structure`.
        unsafe { out.write(found) };
        Ok(ELD_OK)
    };
    // SAFETY: the caller's promise.
    unsafe { with_model(context, decide) }
}

/// Forgets what was added by `eld_light_add`, before another scene.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_light_clear(context: *mut eld_context_t) -> eld_status_t {
    // SAFETY: the caller's promise.
    unsafe { with_record(context, light::clear) }
}
