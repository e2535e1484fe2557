//! The functions for C, and the only `unsafe`: pointers and lengths are validated and become slices here; the other modules do the work.
//!
//! # What every caller promises
//! Every property that the library can check has a status: NULL, alignment, lengths that wrap, overlaps and the order of calls. Spans are
//! compared before anything that they contain is read or written. The remaining conditions are the caller's. The `SAFETY` comments below call them "the caller's promise":
//!
//! - a pointer with its length refers to existing memory, which nobody else writes during the call (nor reads, if the library writes it);
//! - the memory lent to `eld_init` and the model stay at their addresses as long as the context is used;
//! - a context pointer came from `eld_init`, or points to `HEAD_BYTES` readable and writable bytes;
//! - one thread at a time uses a context.
#![allow(unsafe_code)] // with its parts in ffi/ the only file of this package with unsafe code
#![allow(clippy::missing_safety_doc)] // the promises above hold for every function
#![allow(non_camel_case_types)]

mod light;
mod pointers;
pub mod slots;
pub mod strip;
mod sun;
mod terrain;
mod tile;

pub use light::{eld_light_add, eld_light_clear, eld_light_decide};
pub use sun::eld_sun_position;
pub use terrain::{eld_terrain_finish, eld_terrain_init, eld_terrain_plan, eld_terrain_push};

use crate::begin;
use crate::check::{self, CHECK_BYTES};
use crate::context::{Context, Lent, Outcome};
use crate::info;
use crate::layout::{ALIGN_BYTES, Layout};
use crate::record::ContextRecord;
use crate::run::{self, ErrorMaps};
use crate::sealed::{HEAD_BYTES, Head};
use crate::status::*;
use crate::types::*;
use core::ffi::{c_char, c_void};
use core::ops::Range;
use elunar_core::TileMemory;
use elunar_core::nn::{Kernel, Model, code_sum, file};
use elunar_core::tile::Shape;
use pointers::*;
use tile::caller_tile;

// ---- contexts ---------------------------------------------------------------------------------------------------------

/// Opens a context and closes it after `work`.
///
/// # Safety
/// The caller's promise holds for `context`, and `work` does not touch its first [`HEAD_BYTES`].
unsafe fn with_record(context: *mut eld_context_t, work: impl FnOnce(&mut Context<'_>) -> Outcome) -> eld_status_t {
    let place = context.cast::<u64>();
    if let Err(status) = span(place, HEAD_BYTES / size_of::<u64>()) {
        return status;
    }
    // SAFETY: not NULL; `Head` is an array of bytes. The caller promises that the memory exists and is not shared.
    let head = unsafe { &mut *place.cast::<Head>() };
    match Context::open(head, place.addr()) {
        Ok(mut context) => {
            let outcome = work(&mut context);
            context.close(outcome)
        }
        Err(status) => status,
    }
}

/// As [`with_record`], with the model and the parts of the lent memory behind the record.
///
/// # Safety
/// As [`with_record`].
unsafe fn with_model(
    context: *mut eld_context_t,
    work: impl FnOnce(&mut Context<'_>, Model<'_>, Lent<'_>) -> Outcome,
) -> eld_status_t {
    let memory = context.cast::<u8>();
    let work = |context: &mut Context<'_>| {
        let (model, model_bytes) = (context.record.model as usize, context.record.verdict.file_bytes as usize);
        // SAFETY: `eld_init` validated the address and the length, and the record's checksum protects them. The caller promises that the
        // model still exists.
        let bytes = unsafe { slice(core::ptr::with_exposed_provenance::<u8>(model), model_bytes) }?;
        let model = context.model(bytes)?;
        let layout = Layout::of(&model).filter(|layout| layout.bytes() as u64 == context.record.home_bytes);
        let layout = layout.ok_or(ELD_FAULT_MODEL_CHANGED)?;
        // SAFETY: the layout fits the lent memory, and its parts do not overlap each other or the record.
        let lent = unsafe { lent(memory, &layout) }?;
        work(context, model, lent)
    };
    // SAFETY: the caller's promise; the parts are behind the record.
    unsafe { with_record(context, work) }
}

/// Returns the parts of the lent memory.
///
/// # Safety
/// `layout.bytes()` bytes at `memory` were lent, and no live reference refers to those behind the record.
unsafe fn lent<'m>(memory: *mut u8, layout: &Layout) -> Result<Lent<'m>, eld_status_t> {
    let Layout { job, survey, valid, dark, coarse, scratch, lines, arena } = layout;
    // SAFETY: the layout's ranges are inside the memory and do not overlap. Any bit pattern of the memory is a float.
    unsafe {
        let floats =
            |part: &Range<usize>| slice_mut(memory.add(part.start).cast::<f32>(), part.len() / size_of::<f32>());
        let tile = TileMemory {
            coarse_m: floats(coarse)?,
            valid: slice_mut(memory.add(valid.start), valid.len())?,
            scratch: floats(scratch)?,
            lines: slice_mut(memory.add(lines.start).cast::<f64>(), lines.len() / size_of::<f64>())?,
        };
        let [job, survey, dark, arena] =
            [job, survey, dark, arena].map(|part| slice_mut(memory.add(part.start), part.len()));
        Ok(Lent { job: job?, survey: survey?, tile, dark: dark?, arena: arena? })
    }
}

/// Refuses a buffer that shares bytes with the lent memory or the model.
fn apart_from_ours(record: &ContextRecord, buffer: &Range<usize>) -> Result<(), eld_status_t> {
    let (home, model) = (record.home as usize, record.model as usize);
    apart(buffer, &(home..home.saturating_add(record.home_bytes as usize)))?;
    apart(buffer, &(model..model.saturating_add(record.verdict.file_bytes as usize)))
}

// ---- functions for C --------------------------------------------------------------------------------------------------

/// Returns the version of this library's interface, major << 16 | minor << 8 | patch. If its major number differs from that of the header's
/// `ELD_VERSION`, call no other function.
#[unsafe(no_mangle)]
pub extern "C" fn eld_version() -> u32 {
    ELD_VERSION
}

/// Returns the version of the model files that this library reads.
#[unsafe(no_mangle)]
pub extern "C" fn eld_format_version() -> u32 {
    file::VERSION
}

/// Returns the meaning of a status in one line of ASCII; never NULL, and never to be freed.
#[unsafe(no_mangle)]
pub extern "C" fn eld_status_text(status: eld_status_t) -> *const c_char {
    text(status).as_ptr()
}

/// Writes the name of the kernel for this processor, ended by NUL, into `name` of `name_bytes` bytes; 64 are enough.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_kernel_name(name: *mut c_char, name_bytes: usize) -> eld_status_t {
    let found = Kernel::best();
    let text = found.name().as_bytes();
    // SAFETY: the caller's promise.
    let name = match unsafe { slice_mut(name.cast::<u8>(), name_bytes) } {
        Ok(name) => name,
        Err(status) => return status,
    };
    let Some((to, [end, ..])) = name.split_at_mut_checked(text.len()) else { return ELD_REFUSED_BUFFER };
    to.copy_from_slice(text);
    *end = 0;
    ELD_OK
}

/// Writes the checksum of a part of the program, for example a page, into `*sum`. Note it when the program is good, and compare it before or after a
/// tile: a flipped bit of an instruction stays, and makes every tile wrong. About one instruction for every four bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_code_sum(code: *const c_void, code_bytes: usize, sum: *mut u32) -> eld_status_t {
    let ranges = || -> Result<(), eld_status_t> { apart(&span(code.cast::<u8>(), code_bytes)?, &span(sum, 1)?) };
    // SAFETY: the caller's promise; the two do not overlap.
    match ranges().and_then(|()| unsafe { Ok((slice(code.cast::<u8>(), code_bytes)?, slice_mut(sum, 1)?)) }) {
        Ok((code, sum)) => {
            sum.fill(code_sum(code));
            ELD_OK
        }
        Err(status) => status,
    }
}

/// Validates every byte of a model file and writes its properties and requirements. `info->struct_bytes` must be set.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_model_check(
    model: *const c_void,
    model_bytes: usize,
    info: *mut eld_model_info_t,
) -> eld_status_t {
    let check = || {
        apart(&bytes_of(model, model_bytes)?, &span(info, 1)?)?;
        // SAFETY: the caller's promise.
        let asked = unsafe { structure(info) }?;
        // SAFETY: the caller's promise.
        let bytes = unsafe { slice(model.cast::<u8>(), model_bytes) }?;
        let (model, layout) = info::open(bytes)?;
        // SAFETY: validated by `structure`.
        unsafe { info.write(info::info(&model, &layout, asked.struct_bytes)) };
        Ok(ELD_OK)
    };
    status_of(check())
}

/// Validates as `eld_model_check` does, a piece of about `budget_macs` multiply-accumulates at a time. `*check` is zero at the first call.
/// `ELD_RUNNING`: call again with the same arguments and an unchanged model. `ELD_OK`: `*info` is written, and `*check` serves `eld_init_checked`
/// and strips as long as the model is unchanged. After every other status but a refused pointer, `*check` is zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_model_check_step(
    model: *const c_void,
    model_bytes: usize,
    budget_macs: u64,
    check: *mut eld_check_t,
    info: *mut eld_model_info_t,
) -> eld_status_t {
    let step = || {
        let (source, kept, told) = (bytes_of(model, model_bytes)?, span(check, 1)?, span(info, 1)?);
        for (a, b) in [(&source, &kept), (&source, &told), (&kept, &told)] {
            apart(a, b)?;
        }
        // SAFETY: the caller's promise; nothing overlaps.
        let (asked, bytes, block) = unsafe {
            let bytes = slice(model.cast::<u8>(), model_bytes)?;
            (structure(info)?, bytes, slice_mut(check.cast::<u8>(), CHECK_BYTES)?)
        };
        let Some((model, layout)) = check::go_on(block, bytes, budget_macs)? else { return Ok(ELD_RUNNING) };
        // SAFETY: validated by `structure`.
        unsafe { info.write(info::info(&model, &layout, asked.struct_bytes)) };
        Ok(ELD_OK)
    };
    status_of(step())
}

/// Opens a model: with a finished check, or validates all of it if there is none.
///
/// # Safety
/// The caller's promise holds for both.
unsafe fn opened<'m>(
    (model, model_bytes): (*const c_void, usize),
    check: Option<*const eld_check_t>,
) -> Result<(Model<'m>, Layout), eld_status_t> {
    // SAFETY: the caller's promise.
    let file = unsafe { slice(model.cast::<u8>(), model_bytes) }?;
    let Some(check) = check else { return info::open(file) };
    span(check, 1)?;
    // SAFETY: the caller's promise; any bytes are legal.
    check::finished(unsafe { slice(check.cast::<u8>(), CHECK_BYTES) }?, file)
}

/// Validates a model as `eld_model_check` does and makes a context for it at the start of `memory`. Memory and model are lent as long as
/// the context is used; the model is read in place. Writes the context to `*context`. If refused, writes NULL (nothing if `context` itself
/// lies in the memory or the model), and `memory` is unchanged.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_init(
    memory: *mut c_void,
    memory_bytes: usize,
    model: *const c_void,
    model_bytes: usize,
    context: *mut *mut eld_context_t,
) -> eld_status_t {
    // SAFETY: the caller's promise.
    status_of(unsafe { init((memory, memory_bytes), (model, model_bytes), None, context) })
}

/// As `eld_init`, without a second validation: `check` is finished (`eld_model_check_step`).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_init_checked(
    memory: *mut c_void,
    memory_bytes: usize,
    model: *const c_void,
    model_bytes: usize,
    check: *const eld_check_t,
    context: *mut *mut eld_context_t,
) -> eld_status_t {
    // SAFETY: the caller's promise.
    status_of(unsafe { init((memory, memory_bytes), (model, model_bytes), Some(check), context) })
}

/// Makes a context.
///
/// # Safety
/// The caller's promise holds for all pointers.
unsafe fn init(
    (memory, memory_bytes): (*mut c_void, usize),
    (model, model_bytes): (*const c_void, usize),
    check: Option<*const eld_check_t>,
    context: *mut *mut eld_context_t,
) -> Outcome {
    // Not even NULL is written into the memory, the model or its check, whether or not these are refused.
    let result = span(context, 1)?;
    let kept = (check.unwrap_or(core::ptr::null()).cast::<c_void>(), CHECK_BYTES);
    for (pointer, len) in [(memory.cast_const(), memory_bytes), (model, model_bytes), kept] {
        let wraps = |overlap| bytes_of(pointer, len).err().unwrap_or(overlap);
        apart(&reach(pointer, len), &result).map_err(wraps)?;
    }
    // SAFETY: not NULL and aligned; the caller promises that it is writable.
    unsafe { context.write(core::ptr::null_mut()) };
    let (home, source) = (bytes_of(memory, memory_bytes)?, bytes_of(model, model_bytes)?);
    apart(&home, &source)?;
    if let Some(check) = check {
        apart(&home, &span(check, 1)?)?;
    }
    if !home.start.is_multiple_of(ALIGN_BYTES) {
        return Err(ELD_REFUSED_MEMORY_ALIGNMENT);
    }
    // SAFETY: the caller's promise.
    let (validated, layout) = unsafe { opened((model, model_bytes), check) }?;
    if memory_bytes < layout.bytes() {
        return Err(ELD_REFUSED_MEMORY_SHORT);
    }
    // Every byte is written before any is read, because memory with error correction may contain words that were never written.
    // SAFETY: within the lent memory.
    unsafe { memory.cast::<u8>().write_bytes(0, layout.bytes()) };
    let record = ContextRecord {
        home: memory.expose_provenance() as u64,
        home_bytes: layout.bytes() as u64,
        model: model.expose_provenance() as u64,
        verdict: validated.verdict(),
        ..ContextRecord::default()
    };
    // SAFETY: the layout is longer than the head; `Head` is an array of bytes; the caller promises that the memory is not shared.
    Context::make(unsafe { &mut *memory.cast::<Head>() }, record);
    // SAFETY: as above.
    unsafe { context.write(memory.cast()) };
    Ok(ELD_OK)
}

/// Begins a tile: validates, fills and normalises it, finds its light, and prepares for the first step. `tile->struct_bytes` must be set. The
/// maps are not needed after this call, which does all of the work at once; `eld_begin_step` does it in pieces. A tile in progress is dropped,
/// with a notice; if the new tile is refused, it continues.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_begin(context: *mut eld_context_t, tile: *const eld_tile_t) -> eld_status_t {
    // SAFETY: the caller's promise.
    unsafe { begin_tile(context, tile, None) }
}

/// Begins a tile as `eld_begin` does, a piece of about `budget_macs` multiply-accumulates at a time. `ELD_RUNNING`: call again with the same
/// structure, and unchanged maps; any other structure begins another tile. If the maps have changed, call `eld_abort` first: a structure with
/// the same fields goes on. Every other status is that of `eld_begin`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_begin_step(
    context: *mut eld_context_t,
    tile: *const eld_tile_t,
    budget_macs: u64,
) -> eld_status_t {
    // SAFETY: the caller's promise.
    unsafe { begin_tile(context, tile, Some(budget_macs)) }
}

/// Begins a tile from the start and at once, or goes on with a budget.
///
/// # Safety
/// The caller's promise holds for all pointers.
unsafe fn begin_tile(context: *mut eld_context_t, tile: *const eld_tile_t, budget_macs: Option<u64>) -> eld_status_t {
    let begin = |context: &mut Context<'_>, model: Model<'_>, lent: Lent<'_>| {
        // SAFETY: the caller's promise.
        let tile = unsafe { caller_tile(tile, &context.record, &model) }?;
        begin::begin(context, model, lent, &tile, budget_macs)
    };
    // SAFETY: the caller's promise.
    unsafe { with_model(context, begin) }
}

/// Works until `budget_macs` multiply-accumulates are spent or the tile is done. It does at least one unit of work, and exceeds the budget
/// by less than one unit (`largest_unit_macs`). Other work, such as rounding and comparing, counts as well. It does not depend on the
/// data. `ELD_RUNNING`: call again; `ELD_OK`: the tile is done.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_step(context: *mut eld_context_t, budget_macs: u64) -> eld_status_t {
    // SAFETY: the caller's promise.
    unsafe { with_model(context, |context, model, lent| run::step(context, model, lent, budget_macs)) }
}

/// Gives the tile or the self test up, whether it is prepared, in progress or finished. `ELD_NOTICE_DROPPED` if it was not finished.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_abort(context: *mut eld_context_t) -> eld_status_t {
    // SAFETY: the caller's promise.
    unsafe { with_record(context, begin::abort) }
}

/// Copies the finished tile: heights in metres above the 1737.4 km sphere, and for each height 1 if it is valid, 0 where image or coarse
/// DTM are void; heights there are filled. `valid` may be NULL with length 0. May be called again until the next tile begins.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_output(
    context: *mut eld_context_t,
    heights_m: *mut f32,
    heights_len: usize,
    valid: *mut u8,
    valid_len: usize,
) -> eld_status_t {
    let output = |context: &mut Context<'_>, model: Model<'_>, lent: Lent<'_>| {
        let Shape { rows, cols } = model.tile();
        let masked = !valid.is_null() || valid_len != 0;
        let heights = span(heights_m, heights_len)?;
        apart_from_ours(&context.record, &heights)?;
        if masked {
            let mask = span(valid, valid_len)?;
            apart_from_ours(&context.record, &mask)?;
            apart(&heights, &mask)?;
        }
        if heights_len != rows * cols || (masked && valid_len != rows * cols) {
            return Err(ELD_REFUSED_BUFFER);
        }
        // SAFETY: the caller's promise; the buffers do not overlap each other, the lent memory or the model.
        let heights_m = unsafe { slice_mut(heights_m, heights_len) }?;
        let valid = match masked {
            // SAFETY: as above.
            true => Some(unsafe { slice_mut(valid, valid_len) }?),
            false => None,
        };
        run::output(context, &model, &lent, heights_m, valid)
    };
    // SAFETY: the caller's promise.
    unsafe { with_model(context, output) }
}

/// Copies the errors that the finished tile's heights and slopes are expected to have. `out->struct_bytes` must be set. Refused unless the
/// model's light is `ELD_LIGHT_WEIGHED` or `ELD_LIGHT_SLOPED`. Reads only the context.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_errors(context: *mut eld_context_t, out: *mut eld_errors_t) -> eld_status_t {
    let errors = |context: &mut Context<'_>| {
        apart_from_ours(&context.record, &span(out, 1)?)?;
        // SAFETY: the caller's promise; the structure does not overlap any memory that is borrowed.
        let asked = unsafe { structure(out) }?;
        let found = run::errors(context, asked.struct_bytes)?;
        // SAFETY: validated by `structure`.
        unsafe { out.write(found) };
        Ok(ELD_OK)
    };
    // SAFETY: the caller's promise.
    unsafe { with_record(context, errors) }
}

/// Writes the errors that the finished tile's heights and slopes are expected to have, standard deviations: of each height, metres, and of the
/// slope along either axis, metres per metre; and the origin of each height, one of `ELD_ORIGIN_*`. Errors are NaN where heights are not valid.
/// Each map has `len` samples, one per pixel, or is NULL. Refused as `eld_errors`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_error_maps(
    context: *mut eld_context_t,
    height_m: *mut f32,
    slope: *mut f32,
    origin: *mut u8,
    len: usize,
) -> eld_status_t {
    let write = |context: &mut Context<'_>, model: Model<'_>, lent: Lent<'_>| {
        let spans = [optional_span(height_m, len)?, optional_span(slope, len)?, optional_span(origin, len)?];
        for (i, map) in spans.iter().enumerate() {
            apart_from_ours(&context.record, map)?;
            spans.iter().skip(i + 1).try_for_each(|other| apart(map, other))?;
        }
        if len != model.tile().pixels() {
            return Err(ELD_REFUSED_BUFFER);
        }
        // SAFETY: the caller's promise; the buffers do not overlap each other, the lent memory or the model.
        let maps = unsafe {
            ErrorMaps {
                height_m: optional_slice_mut(height_m, len)?,
                slope: optional_slice_mut(slope, len)?,
                origin: optional_slice_mut(origin, len)?,
            }
        };
        run::error_maps(context, &model, &lent, maps)
    };
    // SAFETY: the caller's promise.
    unsafe { with_model(context, write) }
}

/// Compares up to `max_bytes` of the model with its checksums. Each call continues after the last one, and starts again at the end. It may
/// be called at any time between other calls. A fault means that a chunk has changed since it was loaded; the next call continues behind
/// it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_scrub(context: *mut eld_context_t, max_bytes: usize) -> eld_status_t {
    // SAFETY: the caller's promise.
    unsafe { with_model(context, |context, model, lent| run::scrub(context, model, lent, max_bytes)) }
}

/// Begins the built-in tile, which the first steps load. Call `eld_step` until done, then `eld_self_test_check`. A tile in progress is dropped, with a notice.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_self_test_begin(context: *mut eld_context_t) -> eld_status_t {
    // SAFETY: the caller's promise.
    unsafe { with_model(context, begin::begin_self_test) }
}

/// Compares the finished self test with the result stored in the model, byte for byte.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_self_test_check(context: *mut eld_context_t) -> eld_status_t {
    // SAFETY: the caller's promise.
    unsafe { with_model(context, run::check_self_test) }
}

/// Copies the counters. `out->struct_bytes` must be set. Reads only the context, so it works with a damaged model.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_telemetry(context: *mut eld_context_t, out: *mut eld_telemetry_t) -> eld_status_t {
    let telemetry = |context: &mut Context<'_>| {
        apart_from_ours(&context.record, &span(out, 1)?)?;
        // SAFETY: the caller's promise; the structure does not overlap any memory that is borrowed.
        let asked = unsafe { structure(out) }?;
        // SAFETY: validated by `structure`.
        unsafe { out.write(run::telemetry(&context.record, asked.struct_bytes)) };
        Ok(ELD_OK)
    };
    // SAFETY: the caller's promise.
    unsafe { with_record(context, telemetry) }
}
