//! Two slots for a model, in a storage that the caller reads, erases and writes as the library asks.

use super::pointers::*;
use super::with_model;
use crate::context::{Context, Lent, Outcome};
use crate::layout::ALIGN_BYTES;
use crate::run;
use crate::slots::types::*;
use crate::slots::{self, STATE_BYTES, SlotsRecord};
use crate::status::*;
use crate::types::*;
use core::ffi::c_void;
use core::ops::Range;
use elunar_core::nn::Model;
use elunar_core::nn::slots::{ModelId, RECORD_BYTES, Region, Want};

/// Returns the addresses of the lent memory.
fn home_of(slots: *const eld_slots_t) -> Range<usize> {
    let start = slots.addr();
    start..start.saturating_add(ELD_SLOTS_BYTES as usize)
}

/// Opens slots and closes them after `work`.
///
/// # Safety
/// The caller's promise holds for `slots`, and `work` does not touch its first [`STATE_BYTES`].
unsafe fn with_slots(slots: *mut eld_slots_t, work: impl FnOnce(&mut SlotsRecord) -> Outcome) -> eld_status_t {
    let open = || {
        span(slots.cast::<u64>(), ELD_SLOTS_BYTES as usize / size_of::<u64>())?;
        // SAFETY: not NULL; the caller promises that the memory exists and is not shared.
        let block = unsafe { slice_mut(slots.cast::<u8>(), STATE_BYTES) }?;
        let record = SlotsRecord::open(block, slots.addr())?;
        Ok((block, record))
    };
    match open() {
        Ok((block, mut record)) => {
            let outcome = work(&mut record);
            record.close(block, outcome)
        }
        Err(status) => status,
    }
}

/// Makes the work on slots at the start of `memory` of `ELD_SLOTS_BYTES`, which is lent as long as it is used. Reads nothing of the storage. Writes
/// it to `*slots`, NULL if refused. `eld_slots_boot` follows.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_slots_init(
    memory: *mut c_void,
    memory_bytes: usize,
    storage: *const eld_slots_storage_t,
    slots: *mut *mut eld_slots_t,
) -> eld_status_t {
    let init = || {
        let (home, result, asked) = (bytes_of(memory, memory_bytes)?, span(slots, 1)?, span(storage, 1)?);
        apart(&home, &result)?;
        apart(&asked, &result)?;
        // SAFETY: not NULL and aligned; the caller promises that it is writable.
        unsafe { slots.write(core::ptr::null_mut()) };
        apart(&home, &asked)?;
        if !home.start.is_multiple_of(ALIGN_BYTES) {
            return Err(ELD_REFUSED_MEMORY_ALIGNMENT);
        }
        // SAFETY: the caller's promise.
        let places = slots::places(&unsafe { structure(storage) }?)?;
        if memory_bytes < ELD_SLOTS_BYTES as usize {
            return Err(ELD_REFUSED_MEMORY_SHORT);
        }
        // SAFETY: within the lent memory, which is not shared.
        let all = unsafe { slice_mut(memory.cast::<u8>(), ELD_SLOTS_BYTES as usize) }?;
        all.fill(0);
        SlotsRecord::make(all, memory.expose_provenance(), places);
        // SAFETY: as above.
        unsafe { slots.write(memory.cast()) };
        Ok(ELD_OK)
    };
    status_of(init())
}

/// Begins to find out which model to run: after every reset, and at any time to give up what is at work. Call `eld_slots_step` while it returns
/// `ELD_RUNNING`; then `ELD_OK`: the confirmed model runs; `ELD_NOTICE_SLOTS_TRIAL`, `ELD_NOTICE_SLOTS_SALVAGED`: run its self test, then call
/// `eld_slots_confirm` or `eld_slots_reject`. An upload must be begun again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_slots_boot(slots: *mut eld_slots_t) -> eld_status_t {
    // SAFETY: the caller's promise.
    unsafe { with_slots(slots, SlotsRecord::boot) }
}

/// Does a piece of the work of about `budget_macs` multiply-accumulates, and says in `*want` what the caller shall do before the next call:
/// nothing of the storage is touched here. `data` has the bytes that were wanted, else NULL and 0. `storage_error` is 0, or the driver's number if
/// it could not read, erase or write. `ELD_RUNNING`: do it and call again. `want->struct_bytes` must be set.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_slots_step(
    slots: *mut eld_slots_t,
    data: *const c_void,
    data_bytes: usize,
    storage_error: u32,
    budget_macs: u64,
    want: *mut eld_slots_want_t,
) -> eld_status_t {
    let step = |record: &mut SlotsRecord| {
        let result = span(want, 1)?;
        apart(&result, &home_of(slots))?;
        // SAFETY: the caller's promise; the structure does not overlap any memory that is borrowed.
        let asked = unsafe { structure(want) }?;
        let bytes = match record.asked() {
            Some(len) if storage_error == 0 => {
                let read = bytes_of(data, data_bytes)?;
                apart(&read, &result)?;
                apart(&read, &home_of(slots))?;
                if data_bytes != len {
                    return Err(ELD_REFUSED_BUFFER);
                }
                // SAFETY: the caller's promise; the bytes do not overlap any memory that is written.
                unsafe { slice(data.cast::<u8>(), data_bytes) }?
            }
            _ => &[],
        };
        let next = record.step(bytes, storage_error, budget_macs);
        let (wanted, again) = next.unwrap_or((Want::Nothing, false));
        // SAFETY: behind the state; `ELD_SLOTS_BYTES` were lent.
        let room = unsafe { slice_mut(slots.cast::<u8>().add(STATE_BYTES), RECORD_BYTES) }?;
        let told = told(wanted, again, asked.struct_bytes, record.chunk, room);
        // SAFETY: validated by `structure`.
        unsafe { want.write(told) };
        next.map(|_| ELD_RUNNING)
    };
    // SAFETY: the caller's promise; the record that is written is behind the state.
    unsafe { with_slots(slots, step) }
}

/// Returns what is wanted, for C; a record that is to be written is in `room`.
fn told(want: Want, again: bool, struct_bytes: u32, chunk: u64, room: &mut [u8]) -> eld_slots_want_t {
    let (mut data, mut offset, mut len) = (core::ptr::null(), 0, 0);
    let (what, region) = match want {
        Want::Nothing => (ELD_SLOTS_NOTHING, Region::Record),
        Want::Read { region, offset_bytes, len: bytes } => {
            (offset, len) = (offset_bytes, bytes);
            (if again { ELD_SLOTS_READ_AGAIN } else { ELD_SLOTS_READ }, region)
        }
        Want::Erase { region, offset_bytes } => {
            offset = offset_bytes;
            (ELD_SLOTS_ERASE, region)
        }
        Want::WriteRecord { region, bytes } => {
            room.copy_from_slice(&bytes);
            (data, len) = (room.as_ptr().cast(), RECORD_BYTES);
            (ELD_SLOTS_WRITE, region)
        }
        Want::WriteChunk { slot, offset_bytes, len: bytes } => {
            (data, offset, len) = (core::ptr::with_exposed_provenance(chunk as usize), offset_bytes, bytes);
            (ELD_SLOTS_WRITE, Region::Model(slot))
        }
    };
    let region = slots::region_number(region);
    eld_slots_want_t { struct_bytes, what, region, reserved: 0, offset_bytes: offset as u64, bytes: len as u64, data }
}

/// Begins to record the model that runs as confirmed. `context` is one of that model whose self test is finished: it is compared here
/// (`eld_self_test_check`). `ELD_RUNNING`: call `eld_slots_step`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_slots_confirm(slots: *mut eld_slots_t, context: *mut eld_context_t) -> eld_status_t {
    let mut passed = None;
    let check = |context: &mut Context<'_>, model: Model<'_>, lent: Lent<'_>| {
        apart(
            &home_of(slots),
            &(context.record.home as usize..(context.record.home + context.record.home_bytes) as usize),
        )?;
        let verdict = model.verdict();
        let status = run::check_self_test(context, model, lent)?;
        passed = Some(ModelId { file_bytes: verdict.file_bytes, header_crc: verdict.header_crc });
        Ok(status)
    };
    // SAFETY: the caller's promise.
    let status = unsafe { with_model(context, check) };
    let Some(passed) = passed.filter(|_| worked(status)) else { return status };
    // SAFETY: the caller's promise.
    unsafe { with_slots(slots, |record| record.begin(|work| work.confirm(passed))) }
}

/// Begins to end the trial of the model that runs, after its self test has failed, and to find out which model to run instead; the end is that of
/// `eld_slots_boot`. While the confirmed model runs, a trial that has not begun is withdrawn.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_slots_reject(slots: *mut eld_slots_t) -> eld_status_t {
    // SAFETY: the caller's promise.
    unsafe { with_slots(slots, |record| record.begin(|work| work.reject())) }
}

/// Begins the upload of a model into the free slot, or goes on with it after a reset: length of the file and the last word of its header, as a
/// number. At the end `uploaded_bytes` of `eld_slots_state` says which chunk comes next.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_slots_upload(slots: *mut eld_slots_t, file_bytes: u32, header_crc: u32) -> eld_status_t {
    let id = ModelId { file_bytes, header_crc };
    // SAFETY: the caller's promise.
    unsafe { with_slots(slots, |record| record.begin(|work| work.begin_upload(id))) }
}

/// Begins to write the next chunk of the file. The bytes stay where they are, unchanged, until `eld_slots_step` does not return `ELD_RUNNING`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_slots_write(
    slots: *mut eld_slots_t,
    offset_bytes: u64,
    chunk: *const c_void,
    chunk_bytes: usize,
) -> eld_status_t {
    let write = |record: &mut SlotsRecord| {
        apart(&bytes_of(chunk, chunk_bytes)?, &home_of(slots))?;
        let offset_bytes = usize::try_from(offset_bytes).map_err(|_| ELD_REFUSED_SLOTS_OFFSET)?;
        // SAFETY: the caller's promise; the bytes do not overlap any memory that is written.
        let bytes = unsafe { slice(chunk.cast::<u8>(), chunk_bytes) }?;
        let status = record.begin(|work| work.write(offset_bytes, bytes))?;
        record.chunk = chunk.expose_provenance() as u64;
        Ok(status)
    };
    // SAFETY: the caller's promise.
    unsafe { with_slots(slots, write) }
}

/// Begins to validate the upload and to put it on trial: the next 1 to 16 `boots` run it, unless it is confirmed or rejected before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_slots_start_trial(slots: *mut eld_slots_t, boots: u32) -> eld_status_t {
    // SAFETY: the caller's promise.
    unsafe { with_slots(slots, |record| record.begin(|work| work.start_trial(boots))) }
}

/// Copies what is known of the slots. `out->struct_bytes` must be set.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_slots_state(slots: *mut eld_slots_t, out: *mut eld_slots_state_t) -> eld_status_t {
    let state = |record: &mut SlotsRecord| {
        apart(&span(out, 1)?, &home_of(slots))?;
        // SAFETY: the caller's promise; the structure does not overlap any memory that is borrowed.
        let asked = unsafe { structure(out) }?;
        // SAFETY: validated by `structure`.
        unsafe { out.write(record.state(asked.struct_bytes)) };
        Ok(ELD_OK)
    };
    // SAFETY: the caller's promise.
    unsafe { with_slots(slots, state) }
}
