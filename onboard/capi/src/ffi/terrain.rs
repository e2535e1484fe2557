//! Terrain maps and hazards of a grid whose lines come one at a time.

use super::pointers::*;
use crate::context::Outcome;
use crate::layout::ALIGN_BYTES;
use crate::status::*;
use crate::terrain::{self, LINES_AT, STATE_BYTES, State};
use crate::types::*;
use core::ffi::c_void;
use core::ops::Range;
use elunar_core::terrain::LineMaps;

/// Writes how much memory terrain maps with these options need. `options->struct_bytes` must be set.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_terrain_plan(
    options: *const eld_terrain_options_t,
    memory_bytes: *mut u64,
) -> eld_status_t {
    let plan = || {
        apart(&span(options, 1)?, &span(memory_bytes, 1)?)?;
        // SAFETY: the caller's promise, here and below.
        let options = terrain::options(&unsafe { structure(options) }?)?;
        let bytes = terrain::bytes(&options)? as u64;
        // SAFETY: not NULL and aligned.
        unsafe { memory_bytes.write(bytes) };
        Ok(ELD_OK)
    };
    status_of(plan())
}

/// Makes terrain maps at the start of `memory`, which is lent as long as they are used, and zeroes it. Writes them to `*terrain`, NULL if refused.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_terrain_init(
    memory: *mut c_void,
    memory_bytes: usize,
    options: *const eld_terrain_options_t,
    terrain: *mut *mut eld_terrain_t,
) -> eld_status_t {
    let init = || {
        let (home, result, asked) = (bytes_of(memory, memory_bytes)?, span(terrain, 1)?, span(options, 1)?);
        apart(&home, &result)?;
        // SAFETY: not NULL and aligned; the caller promises that it is writable.
        unsafe { terrain.write(core::ptr::null_mut()) };
        apart(&home, &asked)?;
        if !home.start.is_multiple_of(ALIGN_BYTES) {
            return Err(ELD_REFUSED_MEMORY_ALIGNMENT);
        }
        // SAFETY: the caller's promise.
        let c = unsafe { structure(options) }?;
        let bytes = terrain::bytes(&terrain::options(&c)?)?;
        if memory_bytes < bytes {
            return Err(ELD_REFUSED_MEMORY_SHORT);
        }
        // SAFETY: within the lent memory, which is not shared.
        let all = unsafe { slice_mut(memory.cast::<u8>(), bytes) }?;
        all.fill(0);
        let (block, _) = all.split_at_mut_checked(STATE_BYTES).ok_or(ELD_REFUSED_MEMORY_SHORT)?;
        State::make(block, memory.expose_provenance(), c);
        // SAFETY: as above.
        unsafe { terrain.write(memory.cast()) };
        Ok(ELD_OK)
    };
    status_of(init())
}

/// Takes the next line of the grid: `len` heights, metres, NaN for voids; and, if the options ask for standard deviations, those of the errors of its
/// slopes (as `eld_error_maps` writes them), or NULL if unknown. If the maps of a line are complete, they are written, and its number, counted from 0,
/// to `*row`; otherwise `ELD_NOTICE_NO_LINE`. A line comes out `radius_px` lines after it was pushed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_terrain_push(
    terrain: *mut eld_terrain_t,
    line_m: *const f32,
    slope_sd: *const f32,
    len: usize,
    maps: *const eld_terrain_maps_t,
    row: *mut u64,
) -> eld_status_t {
    // SAFETY: the caller's promise.
    status_of(unsafe { work(terrain, Some((line_m, slope_sd, len)), maps, row) })
}

/// Writes the maps of the next line after the last push, and its number to `*row`; `ELD_NOTICE_NO_LINE` when all are out. Then the next grid may
/// begin.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_terrain_finish(
    terrain: *mut eld_terrain_t,
    maps: *const eld_terrain_maps_t,
    row: *mut u64,
) -> eld_status_t {
    // SAFETY: the caller's promise.
    status_of(unsafe { work(terrain, None, maps, row) })
}

/// Returns an error unless spans share no byte with each other; empty ones share none.
fn all_apart(spans: &[Range<usize>]) -> Result<(), eld_status_t> {
    let mut rest = spans;
    while let Some((one, others)) = rest.split_first() {
        others.iter().filter(|_| !one.is_empty()).try_for_each(|other| apart(one, other))?;
        rest = others;
    }
    Ok(())
}

/// Does a piece of work: pushes a line, or finishes.
///
/// # Safety
/// The caller's promise holds for all pointers.
unsafe fn work(
    terrain: *mut eld_terrain_t,
    line: Option<(*const f32, *const f32, usize)>,
    maps: *const eld_terrain_maps_t,
    row: *mut u64,
) -> Outcome {
    let place = terrain.cast::<u8>();
    span(terrain.cast::<u64>(), STATE_BYTES / size_of::<u64>())?;
    // SAFETY: not NULL; the caller promises that the memory exists and is not shared.
    let block = unsafe { slice_mut(place, STATE_BYTES) }?;
    let mut open = State::open(block, place.addr())?;
    let options = terrain::options(&open.state.options).map_err(|_| ELD_FAULT_CONTEXT_LOST)?;
    let (cols, home) = (options.cols, place.addr()..place.addr().saturating_add(terrain::bytes(&options)?));
    let (asked, result) = (span(maps, 1)?, span(row, 1)?);
    all_apart(&[home.clone(), asked, result.clone()])?;
    // SAFETY: the caller's promise; the structure does not overlap any memory that is borrowed.
    let to = unsafe { structure(maps) }?;
    let (line_m, slope_sd) = match line {
        Some((_, _, len)) if len != cols => return Err(ELD_REFUSED_BUFFER),
        Some((line_m, slope_sd, _)) => (span(line_m, cols)?, optional_span(slope_sd, cols)?),
        None => (0..0, 0..0),
    };
    let floats = [to.slope_deg, to.footprint_slope_deg, to.roughness_m];
    let [slope, footprint, roughness] = floats.map(|map| optional_span(map, cols));
    let [hillshade, hazard] = [to.hillshade, to.hazard].map(|map| optional_span(map, cols));
    all_apart(&[home, result, slope?, footprint?, roughness?, hillshade?, hazard?, line_m, slope_sd])?;
    // SAFETY: the caller's promise; nothing that is written overlaps anything else.
    let (mut out, lines, line) = unsafe {
        let out = LineMaps {
            slope_deg: optional_slice_mut(to.slope_deg, cols)?.unwrap_or_default(),
            hillshade: optional_slice_mut(to.hillshade, cols)?.unwrap_or_default(),
            footprint_slope_deg: optional_slice_mut(to.footprint_slope_deg, cols)?.unwrap_or_default(),
            roughness_m: optional_slice_mut(to.roughness_m, cols)?.unwrap_or_default(),
            hazard: optional_slice_mut(to.hazard, cols)?.unwrap_or_default(),
        };
        let line = match line {
            Some((line_m, slope_sd, _)) => {
                let slope_sd = if slope_sd.is_null() { &[][..] } else { slice(slope_sd, cols)? };
                Some((slice(line_m, cols)?, slope_sd))
            }
            None => None,
        };
        (out, slice_mut(place.add(LINES_AT).cast::<f32>(), options.memory_len())?, line)
    };
    let mut given = 0;
    let status = open.work(block, lines, line, &mut out, &mut given)?;
    if status != ELD_NOTICE_NO_LINE {
        // SAFETY: not NULL and aligned.
        unsafe { row.write(given) };
    }
    Ok(status)
}
