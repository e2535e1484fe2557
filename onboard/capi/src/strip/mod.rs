//! Strips: every call rebuilds a [`Strip`] of the core for its duration, and pauses it again.

pub(crate) mod record;
pub mod types;

use crate::begin::stated_sun;
use crate::context::Outcome;
use crate::light;
use crate::status::*;
use crate::types::{eld_lighting_t, eld_status_t};
use core::ops::Range;
use elunar_core::nn::{Kernel, LightSource, Lighting, Model, Runner};
use elunar_core::norm::LightFit;
use elunar_core::pixels::PixelForm;
use elunar_core::strip::{Next, PostGrid, Strip, StripError, StripMemory, StripPaused, StripPlan, StripSettings};
use record::{STRIP_HEAD_BYTES, StripRecord};
use types::{eld_strip_settings_t, eld_strip_telemetry_t};

/// Alignment of the parts (a cache line), if the memory has it.
const LINE_BYTES: usize = 64;

/// Byte ranges within the memory lent to a strip.
#[derive(Debug, Clone)]
pub(crate) struct StripLayout {
    pub(crate) bytes: Range<usize>,
    pub(crate) samples: Range<usize>,
    pub(crate) sums: Range<usize>,
    pub(crate) arena: Range<usize>,
}

impl StripLayout {
    /// Returns the layout for a plan; `None` if this machine cannot address it.
    pub(crate) fn of(plan: &StripPlan) -> Option<Self> {
        let mut end = STRIP_HEAD_BYTES;
        let mut next = |len: usize, bytes: usize| {
            let start = end.checked_next_multiple_of(LINE_BYTES)?;
            end = start.checked_add(len.checked_mul(bytes)?).filter(|end| *end <= isize::MAX as usize)?;
            Some(start..end)
        };
        Some(Self {
            bytes: next(plan.bytes_len(), 1)?,
            samples: next(plan.samples_len(), 4)?,
            sums: next(plan.sums_len(), 8)?,
            arena: next(plan.arena_bytes(), 1)?,
        })
    }

    /// Number of bytes of all parts.
    pub(crate) fn end(&self) -> usize {
        self.arena.end
    }
}

/// The lent memory of a strip, but its state.
pub(crate) struct StripLent<'m> {
    pub(crate) memory: StripMemory<'m>,
    pub(crate) arena: &'m mut [u8],
}

/// Returns the settings for a model, with its light decided.
///
/// # Errors
/// The status of what is refused.
pub(crate) fn settings(
    model: &Model<'_>,
    asked: &eld_strip_settings_t,
    pixels: PixelForm,
    light: Option<&eld_lighting_t>,
) -> Result<StripSettings, eld_status_t> {
    let eld_strip_settings_t { network_alone, expected_errors, processor_checks, post_cols, .. } = *asked;
    if [network_alone, expected_errors, processor_checks].iter().any(|choice| *choice > 1) {
        return Err(ELD_REFUSED_STRIP_SETTINGS);
    }
    let sun = stated_sun(asked.sun_azimuth_deg, asked.sun_elevation_deg)?;
    let light = match light {
        Some(light) => light::of_c(light, model.illumination())?,
        None => Lighting::decide(model.illumination(), sun, &LightFit::default()),
    };
    let posts = PostGrid {
        cols: post_cols as usize,
        row0: asked.post_row0,
        rows_per_line: asked.post_rows_per_line,
        col0: asked.post_col0,
        cols_per_px: asked.post_cols_per_px,
    };
    let least = StripPlan::least_lines(model);
    Ok(StripSettings {
        cols: asked.cols as usize,
        ring_lines: if asked.ring_lines == 0 { least } else { asked.ring_lines as usize },
        overlap_px: asked.overlap_px as usize,
        pixel_m: asked.pixel_m,
        coarse_px: asked.coarse_px,
        anchor: network_alone == 0,
        checked: processor_checks == 1,
        light,
        pixels,
        posts: (post_cols > 0).then_some(posts),
        expected_errors: expected_errors == 1,
    })
}

/// Returns plan and layout of a strip.
///
/// # Errors
/// The status of what is refused.
pub(crate) fn plan(model: &Model<'_>, settings: StripSettings) -> Result<(StripPlan, StripLayout), eld_status_t> {
    let plan = StripPlan::new(model, settings).map_err(strip_status)?;
    Ok((plan, StripLayout::of(&plan).ok_or(ELD_REFUSED_STRIP_SIZE)?))
}

/// Makes a strip in lent memory; the state is kept in `record`. Returns the status of the call.
pub(crate) fn make(plan: StripPlan, model: Model<'_>, lent: StripLent<'_>, record: &mut StripRecord) -> Outcome {
    let runner = Runner::with_kernel(Kernel::best(), model, lent.arena).map_err(|_| ELD_REFUSED_MEMORY_SHORT)?;
    let strip = Strip::new(plan, runner, lent.memory).map_err(strip_status)?;
    (record.settings, record.paused) = (plan.settings().to_words(), strip.pause().to_words());
    let assumed = plan.settings().light.source == LightSource::Assumed;
    Ok(if assumed { ELD_NOTICE_LIGHT_ASSUMED } else { ELD_OK })
}

/// Returns the plan and the position of a record.
///
/// # Errors
/// [`ELD_FAULT_RUN`], [`ELD_FAULT_MODEL_CHANGED`].
pub(crate) fn reopen(
    record: &StripRecord,
    model: &Model<'_>,
) -> Result<(StripPlan, StripLayout, StripPaused), eld_status_t> {
    let settings = StripSettings::from_words(record.settings).ok_or(ELD_FAULT_RUN)?;
    let (plan, layout) = plan(model, settings).map_err(|_| ELD_FAULT_MODEL_CHANGED)?;
    let paused = StripPaused::from_words(record.paused, model.input_rules(), model.tile()).ok_or(ELD_FAULT_RUN)?;
    if layout.end() as u64 != record.home_bytes {
        return Err(ELD_FAULT_MODEL_CHANGED);
    }
    Ok((plan, layout, paused))
}

/// Rebuilds a strip for the duration of `work`, and keeps its new position in `record`.
pub(crate) fn resume<'a>(
    record: &mut StripRecord,
    (plan, paused): (StripPlan, StripPaused),
    model: Model<'a>,
    lent: StripLent<'_>,
    work: impl FnOnce(&mut Strip<'a, '_>) -> Outcome,
) -> Outcome {
    let runner = Runner::resume(Kernel::best(), model, lent.arena, &paused.runner).map_err(|_| ELD_FAULT_RUN)?;
    let mut strip = Strip::resume(plan, runner, lent.memory, &paused).map_err(|_| ELD_FAULT_RUN)?;
    let outcome = work(&mut strip);
    record.paused = strip.pause().to_words();
    outcome
}

/// Returns the status of the next call that a strip needs.
pub(crate) fn next_status(next: Next) -> eld_status_t {
    match next {
        Next::Step => ELD_RUNNING,
        Next::Push => ELD_NOTICE_STRIP_PUSH,
        Next::Posts => ELD_NOTICE_STRIP_POSTS,
        Next::Take => ELD_NOTICE_STRIP_TAKE,
        Next::Done => ELD_NOTICE_STRIP_DONE,
    }
}

/// Returns the status of a refused call.
pub(crate) fn strip_status(error: StripError) -> eld_status_t {
    match error {
        StripError::Columns { .. } => ELD_REFUSED_STRIP_SIZE,
        StripError::Tile(_) | StripError::Ring { .. } => ELD_REFUSED_STRIP_SETTINGS,
        StripError::Pixel => ELD_REFUSED_TILE_PIXEL,
        StripError::Posts => ELD_REFUSED_STRIP_GRID,
        StripError::Line(_) => ELD_REFUSED_BUFFER,
        StripError::Full => ELD_REFUSED_STRIP_FULL,
        StripError::Ended => ELD_REFUSED_STRIP_ENDED,
        StripError::PostsFirst => ELD_REFUSED_STRIP_POSTS_FIRST,
        StripError::NoPosts => ELD_REFUSED_STRIP_NO_POSTS,
        // Decided, planned and lent before the call.
        StripError::Light | StripError::Model | StripError::Memory(_) => ELD_FAULT_RUN,
    }
}

/// Returns the counters.
pub(crate) fn telemetry(record: &StripRecord, strip: &Strip<'_, '_>, struct_bytes: u32) -> eld_strip_telemetry_t {
    let (c, t) = (strip.counters(), strip.telemetry());
    let last_run = c.last_fault.map_or(record.last_fault, crate::run::run_status);
    eld_strip_telemetry_t {
        struct_bytes,
        last_fault: if record.last_fault != 0 { record.last_fault } else { last_run },
        ready: strip.ready() as u64,
        calls: record.calls,
        faults: record.faults,
        context_repairs: record.repairs,
        tiles: c.tiles,
        tiles_coarse: c.tiles_coarse,
        tiles_empty: c.tiles_empty,
        tiles_again: c.tiles_again,
        tiles_lost: c.tiles_lost,
        tiles_void: c.tiles_void,
        memory_faults: c.memory_faults,
        pieces_lost: c.pieces_lost,
        steps: t.steps,
        macs: t.macs,
        inputs_clamped: t.inputs_clamped,
        saturated: t.saturated,
        scrubbed_bytes: t.scrubbed_bytes,
        scrub_passes: t.scrub_passes,
        scrub_faults: t.scrub_faults,
        tile_faults: t.tile_faults,
    }
}
