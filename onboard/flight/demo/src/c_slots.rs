//! Model slots through the C functions, with marks around every call: slot A is the model, read in place. Slot B is memory for a chunk, and then, as
//! if an upload had ended, the model again. The record and its copy are memory.

use crate::c_calls::{BUDGET_MACS, counted};
use core::fmt::Write;
use elunar_capi::elunar_core::nn::slots::ModelId;
use elunar_capi::ffi::slots::*;
use elunar_capi::slots::types::*;
use elunar_capi::status::*;
use elunar_capi::types::{eld_context_t, eld_status_t};

const SECTOR: usize = 4096;
/// Bytes of slot B that exist: those of the first chunk.
const ROOM: usize = 2 * SECTOR;

/// The storage.
struct Flash<'m> {
    model: &'m [u8],
    slot_b: &'m mut [u8],
    record: &'m mut [u8],
    copy: &'m mut [u8],
    /// Whether slot B has the whole model.
    is_uploaded: bool,
}

impl Flash<'_> {
    fn region(&mut self, region: u32) -> &mut [u8] {
        match region {
            ELD_REGION_SLOT_B => self.slot_b,
            ELD_REGION_RECORD => self.record,
            ELD_REGION_RECORD_COPY => self.copy,
            _ => &mut [],
        }
    }
}

/// Boots the slots, confirms the model by the finished self test of `context`, uploads it, tries it, and rejects it.
pub(crate) fn run(model: &[u8], context: *mut eld_context_t, memory: &mut [u64], console: &mut impl Write) -> bool {
    let _ = writeln!(console, "tile Slots");
    let (state, rest) = memory.split_at_mut(ELD_SLOTS_BYTES as usize / 8);
    // SAFETY: any bits are bytes.
    let rest = unsafe { rest.align_to_mut::<u8>().1 };
    let (slot_b, rest) = rest.split_at_mut(ROOM);
    let (record, rest) = rest.split_at_mut(SECTOR);
    let mut flash = Flash { model, slot_b, record, copy: &mut rest[..SECTOR], is_uploaded: false };
    flash.slot_b.fill(0xff);
    flash.record.fill(0xff);
    flash.copy.fill(0xff);
    let storage = eld_slots_storage_t {
        struct_bytes: size_of::<eld_slots_storage_t>() as u32,
        slot_sector_bytes: SECTOR as u32,
        record_bytes: SECTOR as u32,
        record_sector_bytes: SECTOR as u32,
        slot_bytes: model.len().next_multiple_of(SECTOR) as u64,
    };
    let mut slots = core::ptr::null_mut();
    // SAFETY: memory and structures of our own, here and below.
    let made = counted("eld_slots_init", console, || unsafe {
        eld_slots_init(state.as_mut_ptr().cast(), size_of_val(state), &raw const storage, &raw mut slots)
    });
    // SAFETY: as above.
    let booted = counted("eld_slots_boot", console, || unsafe { eld_slots_boot(slots) });
    let booted = drive(slots, booted, &mut flash, console);
    let last = booted.max(update(slots, context, &mut flash, console));
    let mut told = eld_slots_state_t { struct_bytes: size_of::<eld_slots_state_t>() as u32, ..Default::default() };
    // SAFETY: as above.
    let _ = counted("eld_slots_state", console, || unsafe { eld_slots_state(slots, &raw mut told) });
    let (standing, there) = (told.standing, told.uploaded_bytes);
    let _ = writeln!(console, "tile Slots booted {booted:08x} last {last:08x} uploaded {there} sum {standing:08x}");
    made == ELD_OK && severity(booted) <= NOTICE && severity(last) <= NOTICE
}

/// Uploads and tries the model. Returns the last status, or a worse one before.
fn update(
    slots: *mut eld_slots_t,
    context: *mut eld_context_t,
    flash: &mut Flash<'_>,
    console: &mut impl Write,
) -> eld_status_t {
    let model = flash.model;
    let ModelId { file_bytes, header_crc } = ModelId::of(model);
    let mut worst = ELD_OK;
    let mut call = |name: &str, flash: &mut Flash<'_>, begin: &dyn Fn() -> eld_status_t| {
        let begun = counted(name, console, begin);
        worst = worst.max(drive(slots, begun, flash, console));
    };
    // SAFETY: slots, a context and bytes of our own, here and below.
    call("eld_slots_confirm", flash, &|| unsafe { eld_slots_confirm(slots, context) });
    // SAFETY: as above.
    call("eld_slots_upload", flash, &|| unsafe { eld_slots_upload(slots, file_bytes, header_crc) });
    // SAFETY: as above.
    call("eld_slots_write", flash, &|| unsafe { eld_slots_write(slots, 0, model.as_ptr().cast(), SECTOR) });
    flash.is_uploaded = true;
    // SAFETY: as above.
    call("eld_slots_upload", flash, &|| unsafe { eld_slots_upload(slots, file_bytes, header_crc) });
    // SAFETY: as above.
    call("eld_slots_start_trial", flash, &|| unsafe { eld_slots_start_trial(slots, 1) });
    // SAFETY: as above.
    call("eld_slots_boot", flash, &|| unsafe { eld_slots_boot(slots) });
    // SAFETY: as above.
    call("eld_slots_reject", flash, &|| unsafe { eld_slots_reject(slots) });
    worst
}

/// Does what is wanted until the work is done.
fn drive(
    slots: *mut eld_slots_t,
    begun: eld_status_t,
    flash: &mut Flash<'_>,
    console: &mut impl Write,
) -> eld_status_t {
    let struct_bytes = size_of::<eld_slots_want_t>() as u32;
    let data = core::ptr::null();
    let mut want = eld_slots_want_t { struct_bytes, what: 0, region: 0, reserved: 0, offset_bytes: 0, bytes: 0, data };
    let (mut status, mut read) = (begun, (core::ptr::null(), 0));
    while status == ELD_RUNNING {
        // SAFETY: bytes and structures of our own.
        status = counted("eld_slots_step", console, || unsafe {
            eld_slots_step(slots, read.0, read.1, 0, BUDGET_MACS, &raw mut want)
        });
        let (at, len) = (want.offset_bytes as usize, want.bytes as usize);
        let is_mapped = want.region == ELD_REGION_SLOT_A || want.region == ELD_REGION_SLOT_B && flash.is_uploaded;
        let model = flash.model;
        match (want.what, flash.region(want.region).get_mut(at..)) {
            (ELD_SLOTS_READ | ELD_SLOTS_READ_AGAIN, _) if is_mapped => {
                read = (model.as_ptr().wrapping_add(at).cast(), len.min(model.len()));
            }
            (ELD_SLOTS_READ | ELD_SLOTS_READ_AGAIN, Some(bytes)) => read = (bytes.as_ptr().cast(), len),
            (ELD_SLOTS_ERASE, Some(bytes)) => {
                read = (core::ptr::null(), 0);
                bytes.iter_mut().take(SECTOR).for_each(|byte| *byte = 0xff);
            }
            (ELD_SLOTS_WRITE, Some(bytes)) => {
                read = (core::ptr::null(), 0);
                // SAFETY: a record in the slots' memory, or the chunk.
                let from = unsafe { core::slice::from_raw_parts(want.data.cast::<u8>(), len) };
                bytes.iter_mut().zip(from).for_each(|(to, byte)| *to = *byte);
            }
            _ => {}
        }
    }
    status
}
