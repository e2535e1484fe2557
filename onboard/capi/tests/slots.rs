//! Model slots by the C functions: the core's bytes in the storage, refusals, and bits that flip between two calls.
#![allow(unsafe_code)] // C functions

mod common;
mod small;
use common::{Context, repository};
use elunar_capi::ffi::slots::*;
use elunar_capi::slots::types::*;
use elunar_capi::status::*;
use elunar_capi::types::eld_status_t;
use elunar_core::nn::file::{seal_file, set_word, word};
use elunar_core::nn::slots::{ModelId, Region, SelfTestPassed, Slot, Slots, Storage, StorageError};
use elunar_core::nn::{Model, Progress, Runner, required};
use std::ptr::{null, null_mut};

const SECTOR: usize = 1024;
const SLOT: usize = 80 * SECTOR;

/// Storage in memory.
#[derive(Debug, Clone, PartialEq)]
struct Flash([Vec<u8>; 4]);

fn index(region: Region) -> usize {
    match region {
        Region::Model(Slot::A) => 0,
        Region::Model(Slot::B) => 1,
        Region::Record => 2,
        Region::RecordCopy => 3,
    }
}

impl Storage for Flash {
    fn bytes(&self, region: Region) -> &[u8] {
        &self.0[index(region)]
    }

    fn sector_bytes(&self, _: Region) -> usize {
        SECTOR
    }

    fn erase(&mut self, region: Region, at: usize) -> Result<(), StorageError> {
        self.0[index(region)][at..at + SECTOR].fill(0xff);
        Ok(())
    }

    fn write(&mut self, region: Region, at: usize, bytes: &[u8]) -> Result<(), StorageError> {
        let to = &mut self.0[index(region)][at..at + bytes.len()];
        assert!(to.iter().all(|byte| *byte == 0xff), "not erased");
        to.copy_from_slice(bytes);
        Ok(())
    }
}

impl Flash {
    /// With a model in slot A.
    fn with(model: &[u8]) -> Self {
        let mut flash = Self([vec![0xff; SLOT], vec![0xff; SLOT], vec![0xff; SECTOR], vec![0xff; SECTOR]]);
        flash.0[0][..model.len()].copy_from_slice(model);
        flash
    }
}

fn storage() -> eld_slots_storage_t {
    eld_slots_storage_t {
        struct_bytes: size_of::<eld_slots_storage_t>() as u32,
        slot_sector_bytes: SECTOR as u32,
        record_bytes: SECTOR as u32,
        record_sector_bytes: SECTOR as u32,
        slot_bytes: SLOT as u64,
    }
}

fn new_model() -> Vec<u8> {
    std::fs::read(repository().join("tests/golden/provoked/int8.eld")).unwrap()
}

/// Slots in C with their storage, which is read into a buffer.
struct CSlots {
    memory: Vec<u64>,
    handle: *mut eld_slots_t,
    flash: Flash,
    buffer: Vec<u8>,
    /// The number of the driver's error, and the call that it ends.
    error: (u32, usize),
    calls: usize,
}

impl CSlots {
    fn new(flash: Flash) -> Self {
        let (mut memory, mut handle) = (vec![7u64; ELD_SLOTS_BYTES as usize / 8], null_mut());
        // SAFETY: memory and a structure of our own.
        let status = unsafe {
            let (place, bytes) = (memory.as_mut_ptr().cast(), 8 * memory.len());
            eld_slots_init(place, bytes, &storage(), &raw mut handle)
        };
        assert_eq!(status, ELD_OK);
        Self { memory, handle, flash, buffer: Vec::new(), error: (0, 0), calls: 0 }
    }

    fn want() -> eld_slots_want_t {
        let struct_bytes = size_of::<eld_slots_want_t>() as u32;
        eld_slots_want_t { struct_bytes, what: 9, region: 9, reserved: 9, offset_bytes: 9, bytes: 9, data: null() }
    }

    fn step(&mut self, data: *const u8, len: usize, error: u32, want: &mut eld_slots_want_t) -> eld_status_t {
        // SAFETY: a buffer and structures of our own.
        unsafe { eld_slots_step(self.handle, data.cast(), len, error, 50_000, want) }
    }

    /// Does the work that was begun.
    fn drive(&mut self, begun: eld_status_t) -> eld_status_t {
        let (mut want, mut status, mut has_read) = (Self::want(), begun, false);
        while status == ELD_RUNNING {
            self.calls += 1;
            let error = if self.error.1 == self.calls { self.error.0 } else { 0 };
            let buffer = std::mem::take(&mut self.buffer);
            let data = if has_read { buffer.as_ptr() } else { null() };
            status = self.step(data, if has_read { buffer.len() } else { 0 }, error, &mut want);
            self.buffer = buffer;
            if status != ELD_RUNNING {
                break;
            }
            let region = [Region::Model(Slot::A), Region::Model(Slot::B), Region::Record, Region::RecordCopy]
                [want.region as usize];
            let (at, len) = (want.offset_bytes as usize, want.bytes as usize);
            has_read = false;
            match want.what {
                ELD_SLOTS_READ => {
                    self.buffer = self.flash.bytes(region)[at..at + len].to_vec();
                    has_read = true;
                }
                ELD_SLOTS_READ_AGAIN => has_read = true,
                ELD_SLOTS_ERASE => self.flash.erase(region, at).unwrap(),
                ELD_SLOTS_WRITE => {
                    // SAFETY: a record in our memory, or the chunk.
                    let bytes = unsafe { std::slice::from_raw_parts(want.data.cast::<u8>(), len) };
                    self.flash.write(region, at, bytes).unwrap();
                }
                other => panic!("wanted {other}"),
            }
        }
        status
    }

    fn boot(&mut self) -> eld_status_t {
        // SAFETY: slots of our own, here and below.
        let begun = unsafe { eld_slots_boot(self.handle) };
        self.drive(begun)
    }

    fn begin_upload(&mut self, id: ModelId) -> eld_status_t {
        // SAFETY: as above.
        let begun = unsafe { eld_slots_upload(self.handle, id.file_bytes, id.header_crc) };
        self.drive(begun)
    }

    fn write(&mut self, at: u64, chunk: &[u8]) -> eld_status_t {
        // SAFETY: as above.
        let begun = unsafe { eld_slots_write(self.handle, at, chunk.as_ptr().cast(), chunk.len()) };
        self.drive(begun)
    }

    fn upload(&mut self, file: &[u8]) -> eld_status_t {
        let mut status = self.begin_upload(ModelId::of(file));
        while status == ELD_OK && self.state().uploaded_bytes < file.len() as u64 {
            let at = self.state().uploaded_bytes as usize;
            status = self.write(at as u64, &file[at..file.len().min(at + 700)]);
        }
        if status == ELD_OK { self.start_trial(1) } else { status }
    }

    fn start_trial(&mut self, boots: u32) -> eld_status_t {
        // SAFETY: as above.
        let begun = unsafe { eld_slots_start_trial(self.handle, boots) };
        self.drive(begun)
    }

    fn reject(&mut self) -> eld_status_t {
        // SAFETY: as above.
        let begun = unsafe { eld_slots_reject(self.handle) };
        self.drive(begun)
    }

    /// Runs the self test of this model and confirms it.
    fn confirm(&mut self, model: &[u8]) -> eld_status_t {
        let mut context = Context::new(model);
        context.self_test_begin();
        context.finish();
        // SAFETY: as above, and a context of our own.
        let begun = unsafe { eld_slots_confirm(self.handle, context.handle) };
        self.drive(begun)
    }

    fn state(&self) -> eld_slots_state_t {
        let struct_bytes = size_of::<eld_slots_state_t>() as u32;
        let mut out = eld_slots_state_t { struct_bytes, ..Default::default() };
        // SAFETY: as above.
        let status = unsafe { eld_slots_state(self.handle, &raw mut out) };
        assert!(worked(status), "{:?}", text(status));
        out
    }

    fn flip(&mut self, bit: usize) {
        self.memory[bit / 64] ^= 1 << (bit % 64);
    }
}

/// With the small model confirmed.
fn commissioned() -> CSlots {
    let old = small::model();
    let mut slots = CSlots::new(Flash::with(&old));
    assert_eq!(slots.boot(), ELD_NOTICE_SLOTS_SALVAGED);
    assert_eq!(slots.state().standing, ELD_STANDING_SALVAGED);
    assert_eq!(slots.confirm(&old), ELD_OK);
    slots
}

fn passed(slots: &Slots<&mut Flash>) -> SelfTestPassed {
    let model = slots.model().unwrap();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    runner.begin_self_test().unwrap();
    while runner.step(u64::MAX).unwrap() == Progress::Running {}
    SelfTestPassed::of(&mut runner).unwrap()
}

#[test]
fn an_update_leaves_the_bytes_of_the_core() {
    let (old, new) = (small::model(), new_model());
    let mut flash = Flash::with(&old);
    let mut core = Slots::new(&mut flash);
    core.boot().unwrap();
    core.confirm(passed(&core)).unwrap();
    let mut there = core.begin_upload(ModelId::of(&new)).unwrap();
    while there < new.len() {
        there = core.write(there, &new[there..new.len().min(there + 700)]).unwrap();
    }
    core.start_trial(1).unwrap();
    core.boot().unwrap();
    core.confirm(passed(&core)).unwrap();

    let mut slots = commissioned();
    assert_eq!(slots.upload(&new), ELD_OK);
    assert_eq!((slots.state().boots_left, slots.state().uploading), (1, 0));
    assert_eq!(slots.boot(), ELD_NOTICE_SLOTS_TRIAL);
    let known = slots.state();
    assert_eq!((known.standing, known.slot, known.file_bytes), (ELD_STANDING_TRIAL, 1, new.len() as u32));
    // The boot's validation makes a context.
    let mut context = Context::new(&new);
    // SAFETY: memory, model and a check of our own.
    let status = unsafe {
        let (place, bytes) = (context.memory.as_mut_ptr().cast(), 8 * context.memory.len());
        let (model, len, check) = (new.as_ptr().cast(), new.len(), &raw const known.check);
        elunar_capi::ffi::eld_init_checked(place, bytes, model, len, check, &raw mut context.handle)
    };
    assert_eq!((status, context.step(1)), (ELD_OK, ELD_REFUSED_NO_TILE));
    assert_eq!(slots.confirm(&old), ELD_REFUSED_SLOTS_OTHER_MODEL);
    assert_eq!(slots.confirm(&new), ELD_OK);
    assert!(slots.flash == flash, "other bytes than the core's");
    let known = slots.state();
    assert_eq!((known.standing, known.record_copies, known.rollbacks), (ELD_STANDING_CONFIRMED, 2, 0));
    assert!(slots.calls > 400 && known.faults == 0, "{} calls", slots.calls);
}

#[test]
fn every_status_of_slots_is_reached() {
    let (old, new) = (small::model(), new_model());
    let (id, mut failing) = (ModelId::of(&new), new.clone());
    set_word(&mut failing, word::SELF_TEST_CRC, 1);
    seal_file(&mut failing);
    let mut slots = CSlots::new(Flash::with(&old));
    // Before the boot, and while it is at work.
    let mut want = CSlots::want();
    assert_eq!(slots.step(null(), 0, 0, &mut want), ELD_REFUSED_SLOTS_IDLE);
    assert_eq!(slots.begin_upload(id), ELD_REFUSED_SLOTS_NOT_BOOTED);
    assert_eq!(slots.reject(), ELD_REFUSED_SLOTS_NOT_BOOTED);
    // SAFETY: slots of our own.
    assert_eq!(unsafe { eld_slots_boot(slots.handle) }, ELD_RUNNING);
    assert_eq!(slots.begin_upload(id), ELD_REFUSED_SLOTS_BUSY);
    assert_eq!(slots.step(null(), 0, 0, &mut want), ELD_RUNNING);
    assert_eq!((want.what, want.region, want.bytes), (ELD_SLOTS_READ, ELD_REGION_RECORD, 64));
    assert_eq!(slots.step(new.as_ptr(), 63, 0, &mut want), ELD_REFUSED_BUFFER);
    assert_eq!(slots.step(null(), 64, 0, &mut want), ELD_REFUSED_NULL);
    assert_eq!(slots.step(slots.memory.as_ptr().cast(), 64, 0, &mut want), ELD_REFUSED_OVERLAP);
    // Given up, and begun again.
    assert_eq!(slots.boot(), ELD_NOTICE_SLOTS_SALVAGED);
    assert_eq!(slots.begin_upload(id), ELD_REFUSED_SLOTS_UNCONFIRMED);
    assert_eq!(slots.confirm(&old), ELD_OK);
    assert_eq!(slots.reject(), ELD_REFUSED_SLOTS_CONFIRMED);
    assert_eq!(slots.write(0, &new), ELD_REFUSED_SLOTS_NO_UPLOAD);
    assert_eq!(slots.start_trial(1), ELD_REFUSED_SLOTS_NO_UPLOAD);
    assert_eq!(slots.begin_upload(ModelId { file_bytes: 1 << 30, ..id }), ELD_REFUSED_SLOTS_LENGTH);
    assert_eq!(slots.begin_upload(id), ELD_OK);
    assert_eq!(slots.write(5, &new), ELD_REFUSED_SLOTS_OFFSET);
    assert_eq!(slots.start_trial(1), ELD_REFUSED_SLOTS_LENGTH);
    assert_eq!(slots.write(0, &failing), ELD_REFUSED_SLOTS_OTHER_MODEL);
    assert_eq!(slots.begin_upload(id), ELD_OK);
    assert_eq!(slots.write(0, &vec![1; new.len()]), ELD_REFUSED_MODEL_MAGIC);
    assert_eq!(slots.begin_upload(id), ELD_OK);
    assert_eq!(slots.write(0, &new), ELD_OK);
    assert_eq!(slots.start_trial(17), ELD_REFUSED_SLOTS_BOOTS);
    // The driver cannot erase; then it says that it has written, and has not.
    slots.error = (5, slots.calls + 4);
    assert_eq!(slots.begin_upload(ModelId::of(&old)), ELD_OK);
    slots.error = (5, slots.calls + 4);
    assert_eq!(slots.write(0, &old), ELD_FAULT_SLOTS_STORAGE);
    assert_eq!(slots.state().last_fault, ELD_FAULT_SLOTS_STORAGE);
    assert_eq!(slots.begin_upload(id), ELD_OK);
    let (status, mut want) = (not_written(&mut slots, &new), CSlots::want());
    assert_eq!((status, slots.state().uploading), (ELD_FAULT_SLOTS_NOT_WRITTEN, 0));
    assert_eq!(slots.step(null(), 0, 0, &mut want), ELD_REFUSED_SLOTS_IDLE);
    // A model that fails its self test, and one that runs nowhere.
    assert_eq!((slots.upload(&failing), slots.boot()), (ELD_OK, ELD_NOTICE_SLOTS_TRIAL));
    assert_eq!(slots.confirm(&failing), ELD_FAULT_SELF_TEST);
    assert_eq!((slots.reject(), slots.state().rollbacks), (ELD_OK, 1));
    let mut nothing = CSlots::new(Flash::with(&[]));
    assert_eq!(nothing.boot(), ELD_REFUSED_SLOTS_NOTHING_RUNS);
    assert_eq!((nothing.state().standing, nothing.upload(&new)), (ELD_STANDING_NOTHING, ELD_OK));
    assert!(Model::new(&nothing.flash.0[0][..new.len()]).is_ok());
}

/// Writes a chunk with a driver that writes nothing.
fn not_written(slots: &mut CSlots, chunk: &[u8]) -> eld_status_t {
    let mut want = CSlots::want();
    // SAFETY: slots and bytes of our own.
    let mut status = unsafe { eld_slots_write(slots.handle, 0, chunk.as_ptr().cast(), chunk.len()) };
    let mut zeros = vec![0; 0];
    while status == ELD_RUNNING {
        let data = if zeros.is_empty() { null() } else { zeros.as_ptr() };
        status = slots.step(data, zeros.len(), 0, &mut want);
        zeros = if want.what == ELD_SLOTS_READ { vec![0u8; want.bytes as usize] } else { Vec::new() };
        if want.region >= 2 && want.what == ELD_SLOTS_READ {
            zeros.copy_from_slice(&slots.flash.0[want.region as usize][..64]);
        }
    }
    status
}

#[test]
fn flipped_bits_of_the_state_are_repaired_and_both_copies_reported() {
    let mut slots = commissioned();
    let before = slots.state();
    let copy_bytes = (ELD_SLOTS_BYTES as usize - 64) / 2;
    for bit in (0..8 * 2 * copy_bytes).step_by(5) {
        slots.flip(bit);
        let now = slots.state();
        let counted = eld_slots_state_t { calls: before.calls, context_repairs: 0, ..now };
        assert_eq!((counted, now.context_repairs), (before, 1 + bit as u64 / 5), "bit {bit}");
    }
    assert_eq!(slots.boot(), ELD_OK);
    slots.flip(99);
    slots.flip(8 * copy_bytes + 1000);
    // SAFETY: slots of our own, here and below.
    assert_eq!(unsafe { eld_slots_boot(slots.handle) }, ELD_FAULT_CONTEXT_LOST);
    let moved = commissioned();
    let mut elsewhere = moved.memory.clone();
    // SAFETY: as above.
    assert_eq!(unsafe { eld_slots_boot(elsewhere.as_mut_ptr().cast()) }, ELD_FAULT_CONTEXT_MOVED);
}

#[test]
fn wrong_pointers_and_regions_are_refused() {
    let (mut memory, mut handle) = (vec![7u64; ELD_SLOTS_BYTES as usize / 8], null_mut());
    let (place, all) = (memory.as_mut_ptr(), ELD_SLOTS_BYTES as usize);
    let mut init = |place: *mut u64, bytes: usize, storage: eld_slots_storage_t| {
        // SAFETY: memory and structures of our own, or refused.
        let status = unsafe { eld_slots_init(place.cast(), bytes, &raw const storage, &raw mut handle) };
        assert_eq!(handle.is_null(), status != ELD_OK);
        status
    };
    assert_eq!(init(null_mut(), all, storage()), ELD_REFUSED_NULL);
    assert_eq!(init(place, all - 1, storage()), ELD_REFUSED_MEMORY_SHORT);
    assert_eq!(init(place.wrapping_byte_add(4), all, storage()), ELD_REFUSED_MEMORY_ALIGNMENT);
    assert_eq!(init(place, all, eld_slots_storage_t { struct_bytes: 8, ..storage() }), ELD_REFUSED_STRUCT_BYTES);
    for wrong in [
        eld_slots_storage_t { slot_sector_bytes: 0, ..storage() },
        eld_slots_storage_t { record_sector_bytes: 0, ..storage() },
        eld_slots_storage_t { record_bytes: 63, ..storage() },
        eld_slots_storage_t { slot_bytes: 0, ..storage() },
        eld_slots_storage_t { slot_bytes: SLOT as u64 + 1, ..storage() },
        eld_slots_storage_t { slot_bytes: u64::MAX, ..storage() },
    ] {
        assert_eq!(init(place, all, wrong), ELD_REFUSED_SLOTS_STORAGE);
    }
    assert_eq!(init(place, all, storage()), ELD_OK);
    // SAFETY: refused before they are used.
    unsafe {
        assert_eq!(eld_slots_boot(null_mut()), ELD_REFUSED_NULL);
        assert_eq!(eld_slots_write(handle, 0, null(), 4), ELD_REFUSED_NULL);
        assert_eq!(eld_slots_write(handle, 0, handle.cast(), 4), ELD_REFUSED_OVERLAP);
        assert_eq!(eld_slots_state(handle, null_mut()), ELD_REFUSED_NULL);
        assert_eq!(eld_slots_state(handle, handle.cast()), ELD_REFUSED_OVERLAP);
        assert_eq!(eld_slots_step(handle, null(), 0, 0, 1, null_mut()), ELD_REFUSED_NULL);
        assert_eq!(eld_slots_step(handle, null(), 0, 0, 1, handle.cast()), ELD_REFUSED_OVERLAP);
        assert_eq!(eld_slots_confirm(handle, null_mut()), ELD_REFUSED_NULL);
    }
}
