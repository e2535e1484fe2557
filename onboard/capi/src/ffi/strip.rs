//! The functions of strips for C. What [`super`] says holds for them.

use super::ALIGN_BYTES;
use super::pointers::*;
use super::tile::form_of;
use crate::context::Outcome;
use crate::status::*;
use crate::strip::record::{STRIP_HEAD_BYTES, StripHead, StripRecord};
use crate::strip::types::{eld_strip_settings_t, eld_strip_t, eld_strip_telemetry_t};
use crate::strip::{self, StripLayout, StripLent, strip_status};
use crate::types::eld_status_t;
use core::ffi::c_void;
use core::ops::Range;
use elunar_core::nn::Model;
use elunar_core::strip::{LineErrors, Strip, StripMemory, StripSettings};

/// Opens a strip and closes it after `work`, which gets its record and the core's strip.
///
/// # Safety
/// The caller's promise holds for `strip`, and `work` does not touch its lent memory but by the strip.
unsafe fn with_strip(
    strip: *mut eld_strip_t,
    work: impl FnOnce(&StripRecord, &mut Strip<'_, '_>) -> Outcome,
) -> eld_status_t {
    let place = strip.cast::<u64>();
    if let Err(status) = span(place, STRIP_HEAD_BYTES / size_of::<u64>()) {
        return status;
    }
    // SAFETY: not NULL; `StripHead` is an array of bytes. The caller promises that the memory exists and is not shared.
    let head = unsafe { &mut *place.cast::<StripHead>() };
    let mut record = match StripRecord::open(head, place.addr()) {
        Ok(record) => record,
        Err(status) => return status,
    };
    let all = || {
        // SAFETY: `eld_strip_init` validated address and length, and the record's checksum protects them. The caller promises that the model
        // still exists.
        let bytes = unsafe {
            slice(core::ptr::with_exposed_provenance::<u8>(record.model as usize), record.verdict.file_bytes as usize)
        }?;
        let model = record.open_model(bytes)?;
        let (plan, layout, paused) = strip::reopen(&record, &model)?;
        StripRecord { busy: 1, ..record }.write(head);
        // SAFETY: the layout fits the lent memory, and its parts do not overlap each other or the record.
        let lent = unsafe { lent(strip.cast(), &layout) }?;
        let before = record;
        strip::resume(&mut record, (plan, paused), model, lent, |strip| work(&before, strip))
    };
    let outcome = all();
    record.close(head, outcome)
}

/// Returns the parts of the lent memory.
///
/// # Safety
/// `layout.end()` bytes at `memory` were lent, and no live reference refers to those behind the record.
unsafe fn lent<'m>(memory: *mut u8, layout: &StripLayout) -> Result<StripLent<'m>, eld_status_t> {
    let StripLayout { bytes, samples, sums, arena } = layout;
    // SAFETY: the layout's ranges are inside the memory and do not overlap. Any bit pattern of the memory is a float.
    unsafe {
        let memory_of = StripMemory {
            bytes: slice_mut(memory.add(bytes.start), bytes.len())?,
            samples: slice_mut(memory.add(samples.start).cast::<f32>(), samples.len() / size_of::<f32>())?,
            sums: slice_mut(memory.add(sums.start).cast::<f64>(), sums.len() / size_of::<f64>())?,
        };
        Ok(StripLent { memory: memory_of, arena: slice_mut(memory.add(arena.start), arena.len())? })
    }
}

/// Refuses a buffer that shares bytes with the lent memory or the model.
fn apart_from_strip(record: &StripRecord, buffer: &Range<usize>) -> Result<(), eld_status_t> {
    let (home, model) = (record.home as usize, record.model as usize);
    apart(buffer, &(home..home.saturating_add(record.home_bytes as usize)))?;
    apart(buffer, &(model..model.saturating_add(record.verdict.file_bytes as usize)))
}

/// Returns a validated model with the settings of a strip for it.
///
/// # Safety
/// The caller's promise holds for the pointers.
unsafe fn asked<'m>(
    (model, model_bytes): (*const c_void, usize),
    settings: *const eld_strip_settings_t,
) -> Result<(Model<'m>, StripSettings), eld_status_t> {
    // SAFETY: the caller's promise.
    let asked = unsafe { structure(settings) }?;
    let pixels = form_of(&asked.pixels)?;
    let light = match asked.light.is_null() {
        true => None,
        // SAFETY: the caller's promise.
        false => Some(unsafe { structure(asked.light) }?),
    };
    let check = (!asked.check.is_null()).then_some(asked.check);
    // SAFETY: the caller's promise.
    let (model, _) = unsafe { super::opened((model, model_bytes), check) }?;
    let settings = strip::settings(&model, &asked, pixels, light.as_ref())?;
    Ok((model, settings))
}

/// Validates a model, unless the settings have its check, and the settings of a strip; writes the number of bytes of memory for
/// `eld_strip_init`, which needs alignment as `eld_init`. `settings->struct_bytes` must be set.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_strip_plan(
    model: *const c_void,
    model_bytes: usize,
    settings: *const eld_strip_settings_t,
    memory_bytes: *mut u64,
) -> eld_status_t {
    let plan = || {
        let result = span(memory_bytes, 1)?;
        apart(&bytes_of(model, model_bytes)?, &result)?;
        apart(&span(settings, 1)?, &result)?;
        // SAFETY: the caller's promise.
        let (model, settings) = unsafe { asked((model, model_bytes), settings) }?;
        let (_, layout) = strip::plan(&model, settings)?;
        // SAFETY: not NULL and aligned; the caller promises that it is writable.
        unsafe { memory_bytes.write(layout.end() as u64) };
        Ok(ELD_OK)
    };
    status_of(plan())
}

/// Validates as `eld_strip_plan` does and makes a strip at the start of `memory`. Memory and model are lent as long as the strip is used; the
/// model is read in place. Writes the strip to `*strip`; NULL if refused, and `memory` is unchanged. Lines may be pushed then.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_strip_init(
    memory: *mut c_void,
    memory_bytes: usize,
    model: *const c_void,
    model_bytes: usize,
    settings: *const eld_strip_settings_t,
    strip: *mut *mut eld_strip_t,
) -> eld_status_t {
    // SAFETY: the caller's promise.
    status_of(unsafe { init((memory, memory_bytes), (model, model_bytes), settings, strip) })
}

/// Makes a strip.
///
/// # Safety
/// The caller's promise holds for all pointers.
unsafe fn init(
    (memory, memory_bytes): (*mut c_void, usize),
    (model, model_bytes): (*const c_void, usize),
    settings: *const eld_strip_settings_t,
    result: *mut *mut eld_strip_t,
) -> Outcome {
    let place = span(result, 1)?;
    let (home, source, asked_at) = (bytes_of(memory, memory_bytes)?, bytes_of(model, model_bytes)?, span(settings, 1)?);
    for (a, b) in [(&place, &home), (&place, &source), (&place, &asked_at), (&home, &source), (&home, &asked_at)] {
        apart(a, b)?;
    }
    // SAFETY: not NULL and aligned; the caller promises that it is writable.
    unsafe { result.write(core::ptr::null_mut()) };
    if !home.start.is_multiple_of(ALIGN_BYTES) {
        return Err(ELD_REFUSED_MEMORY_ALIGNMENT);
    }
    // SAFETY: the caller's promise.
    let (validated, settings) = unsafe { asked((model, model_bytes), settings) }?;
    let (plan, layout) = strip::plan(&validated, settings)?;
    if memory_bytes < layout.end() {
        return Err(ELD_REFUSED_MEMORY_SHORT);
    }
    // Every byte is written before any is read, because memory with error correction may contain words that were never written.
    // SAFETY: within the lent memory.
    unsafe { memory.cast::<u8>().write_bytes(0, layout.end()) };
    let mut record = StripRecord {
        home: memory.expose_provenance() as u64,
        home_bytes: layout.end() as u64,
        model: model.expose_provenance() as u64,
        verdict: validated.verdict(),
        busy: 0,
        repairs_untold: 0,
        last_fault: 0,
        calls: 0,
        faults: 0,
        repairs: 0,
        settings: [0; _],
        paused: [0; _],
    };
    // SAFETY: the memory is as long as the layout.
    let lent = unsafe { lent(memory.cast(), &layout) }?;
    let status = strip::make(plan, validated, lent, &mut record)?;
    // SAFETY: the layout is longer than the head; `StripHead` is an array of bytes; the caller promises that the memory is not shared.
    record.write(unsafe { &mut *memory.cast::<StripHead>() });
    // SAFETY: as above.
    unsafe { result.write(memory.cast()) };
    Ok(status)
}

/// Takes the next line: its pixels as the camera has them, in the form of the settings, and the coarse DTM on the same pixels, metres above
/// the 1737.4 km sphere; with posts NULL and 0. The buffers are not needed after the call.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_strip_push(
    strip: *mut eld_strip_t,
    line: *const c_void,
    line_bytes: usize,
    coarse_m: *const f32,
    coarse_len: usize,
) -> eld_status_t {
    let push = |record: &StripRecord, strip: &mut Strip<'_, '_>| {
        apart_from_strip(record, &bytes_of(line, line_bytes)?)?;
        // SAFETY: the caller's promise; the buffer does not overlap any memory that is borrowed.
        let pixels = unsafe { slice(line.cast::<u8>(), line_bytes) }?;
        let coarse_m = match coarse_len {
            0 => &[],
            _ => {
                apart_from_strip(record, &span(coarse_m, coarse_len)?)?;
                // SAFETY: as above.
                unsafe { slice(coarse_m, coarse_len) }?
            }
        };
        strip.push_pixels(pixels, coarse_m).map(|_| ELD_OK).map_err(strip_status)
    };
    // SAFETY: the caller's promise.
    unsafe { with_strip(strip, push) }
}

/// Takes the next row of the coarse DTM's posts, metres above the 1737.4 km sphere.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_strip_push_posts(
    strip: *mut eld_strip_t,
    posts_m: *const f32,
    posts_len: usize,
) -> eld_status_t {
    let push = |record: &StripRecord, strip: &mut Strip<'_, '_>| {
        apart_from_strip(record, &span(posts_m, posts_len)?)?;
        // SAFETY: the caller's promise; the buffer does not overlap any memory that is borrowed.
        let posts_m = unsafe { slice(posts_m, posts_len) }?;
        strip.push_posts(posts_m).map(|()| ELD_OK).map_err(strip_status)
    };
    // SAFETY: the caller's promise.
    unsafe { with_strip(strip, push) }
}

/// Ends the rows of posts: lines up to the outer edge of the last row are continued from it, lines beyond are voids.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_strip_finish_posts(strip: *mut eld_strip_t) -> eld_status_t {
    let finish = |_: &StripRecord, strip: &mut Strip<'_, '_>| {
        strip.finish_posts();
        Ok(ELD_OK)
    };
    // SAFETY: the caller's promise.
    unsafe { with_strip(strip, finish) }
}

/// Ends the strip with the last line taken in.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_strip_finish(strip: *mut eld_strip_t) -> eld_status_t {
    let finish = |_: &StripRecord, strip: &mut Strip<'_, '_>| {
        strip.finish();
        Ok(ELD_OK)
    };
    // SAFETY: the caller's promise.
    unsafe { with_strip(strip, finish) }
}

/// Works until `budget_macs` multiply-accumulates are spent, or a tile is done; nothing if a line must be pushed or taken first. Returns what
/// the strip needs next: `ELD_RUNNING` this function, `ELD_NOTICE_STRIP_*` another.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_strip_step(strip: *mut eld_strip_t, budget_macs: u64) -> eld_status_t {
    let step = |_: &StripRecord, strip: &mut Strip<'_, '_>| Ok(strip::next_status(strip.step(budget_macs)));
    // SAFETY: the caller's promise.
    unsafe { with_strip(strip, step) }
}

/// Copies the next finished line: heights in metres above the 1737.4 km sphere, NaN in voids, and its number. `ELD_NOTICE_STRIP_NO_LINE`: none
/// is finished, and nothing is written. With expected errors in the settings: standard deviations of heights, metres, and slopes, metres per
/// metre, and the origin of each height: 0 the image, 1 image and coarse DTM, 2 the coarse DTM, 3 a shadow, 4 a void. Each buffer has
/// `heights_len` values. They may be NULL, all or none.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_strip_take(
    strip: *mut eld_strip_t,
    heights_m: *mut f32,
    height_errors_m: *mut f32,
    slope_errors: *mut f32,
    origins: *mut u8,
    heights_len: usize,
    line: *mut u64,
) -> eld_status_t {
    let take = |record: &StripRecord, strip: &mut Strip<'_, '_>| {
        let with_errors = !(height_errors_m.is_null() && slope_errors.is_null() && origins.is_null());
        let mut spans = [span(heights_m, heights_len)?, span(line, 1)?, 0..0, 0..0, 0..0];
        if with_errors {
            let errors = [span(height_errors_m, heights_len)?, span(slope_errors, heights_len)?];
            [spans[2], spans[3]] = errors;
            spans[4] = span(origins, heights_len)?;
        }
        for (number, one) in spans.iter().enumerate() {
            apart_from_strip(record, one)?;
            spans.iter().skip(number + 1).try_for_each(|other| apart(one, other))?;
        }
        // SAFETY: the caller's promise; the buffers do not overlap each other, the lent memory or the model.
        let heights_m = unsafe { slice_mut(heights_m, heights_len) }?;
        let taken = if with_errors {
            // SAFETY: as above.
            let errors = unsafe {
                LineErrors {
                    height_m: slice_mut(height_errors_m, heights_len)?,
                    slope: slice_mut(slope_errors, heights_len)?,
                    origin: slice_mut(origins, heights_len)?,
                }
            };
            strip.take_line_with(heights_m, errors)
        } else {
            strip.take_line(heights_m)
        };
        let Some(number) = taken.map_err(strip_status)? else { return Ok(ELD_NOTICE_STRIP_NO_LINE) };
        // SAFETY: not NULL and aligned; the caller promises that it is writable.
        unsafe { line.write(number as u64) };
        Ok(ELD_OK)
    };
    // SAFETY: the caller's promise.
    unsafe { with_strip(strip, take) }
}

/// Compares up to `max_bytes` of the model with its checksums, as `eld_scrub`. A model that was loaded again at its place serves the strip on.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_strip_scrub(strip: *mut eld_strip_t, max_bytes: usize) -> eld_status_t {
    let scrub = |_: &StripRecord, strip: &mut Strip<'_, '_>| {
        strip.scrub(max_bytes).map(|()| ELD_OK).map_err(crate::run::run_status)
    };
    // SAFETY: the caller's promise.
    unsafe { with_strip(strip, scrub) }
}

/// Copies the counters. `out->struct_bytes` must be set.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_strip_telemetry(strip: *mut eld_strip_t, out: *mut eld_strip_telemetry_t) -> eld_status_t {
    let telemetry = |record: &StripRecord, strip: &mut Strip<'_, '_>| {
        apart_from_strip(record, &span(out, 1)?)?;
        // SAFETY: the caller's promise; the structure does not overlap any memory that is borrowed.
        let asked = unsafe { structure(out) }?;
        // SAFETY: validated by `structure`.
        unsafe { out.write(strip::telemetry(record, strip, asked.struct_bytes)) };
        Ok(ELD_OK)
    };
    // SAFETY: the caller's promise.
    unsafe { with_strip(strip, telemetry) }
}
