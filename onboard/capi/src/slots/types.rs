//! Types of model slots, with C names.
#![allow(non_camel_case_types)]

use crate::types::{eld_check_t, eld_status_t};
use core::ffi::c_void;

/// Bytes of memory for `eld_slots_init`.
pub const ELD_SLOTS_BYTES: u32 = 1616;

/// The work on model slots, at the start of the memory lent to `eld_slots_init`. The rules of `eld_context_t` hold.
pub struct eld_slots_t {
    _opaque: [u8; 0],
}

/// The storage: two slots of equal length, and two regions for the record. Regions share no sector.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct eld_slots_storage_t {
    /// sizeof(eld_slots_storage_t), set by the caller.
    pub struct_bytes: u32,
    /// Bytes of a slot that are erased at once, at least 1. 1: memory without erasing.
    pub slot_sector_bytes: u32,
    /// Bytes of a region of the record, at least 64.
    pub record_bytes: u32,
    /// Bytes of it that are erased at once, at least 1.
    pub record_sector_bytes: u32,
    /// Bytes of a slot: the longest model that is ever to be loaded; whole sectors.
    pub slot_bytes: u64,
}

/// Wanted: nothing, the work is done.
pub const ELD_SLOTS_NOTHING: u32 = 0;
/// Wanted: `bytes` bytes of a region, from `offset_bytes` on, as `data` of the next call: a whole model, or else at most a header (128 bytes), a
/// record (64 bytes) or the chunk that was written.
pub const ELD_SLOTS_READ: u32 = 1;
/// Wanted: the bytes of the call before, once more.
pub const ELD_SLOTS_READ_AGAIN: u32 = 2;
/// Wanted: that the sector that begins at `offset_bytes` be erased.
pub const ELD_SLOTS_ERASE: u32 = 3;
/// Wanted: that `bytes` bytes at `data` be written from `offset_bytes` on.
pub const ELD_SLOTS_WRITE: u32 = 4;

/// Region: slot A.
pub const ELD_REGION_SLOT_A: u32 = 0;
/// Region: slot B.
pub const ELD_REGION_SLOT_B: u32 = 1;
/// Region: the record.
pub const ELD_REGION_RECORD: u32 = 2;
/// Region: its copy.
pub const ELD_REGION_RECORD_COPY: u32 = 3;

/// What the caller shall do before the next call of `eld_slots_step`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct eld_slots_want_t {
    /// sizeof(eld_slots_want_t), set by the caller.
    pub struct_bytes: u32,
    /// One of `ELD_SLOTS_*`.
    pub what: u32,
    /// One of `ELD_REGION_*`.
    pub region: u32,
    /// 0.
    pub reserved: u32,
    /// First byte in the region.
    pub offset_bytes: u64,
    /// Number of bytes.
    pub bytes: u64,
    /// The bytes to be written; else NULL.
    pub data: *const c_void,
}

/// Standing of the model that runs: `eld_slots_boot` is not finished.
pub const ELD_STANDING_UNKNOWN: u32 = 0;
/// Standing of the model that runs: confirmed.
pub const ELD_STANDING_CONFIRMED: u32 = 1;
/// Standing of the model that runs: on trial.
pub const ELD_STANDING_TRIAL: u32 = 2;
/// Standing of the model that runs: found without a record.
pub const ELD_STANDING_SALVAGED: u32 = 3;
/// No model runs.
pub const ELD_STANDING_NOTHING: u32 = 4;

/// What is known of the slots.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct eld_slots_state_t {
    /// sizeof(eld_slots_state_t), set by the caller.
    pub struct_bytes: u32,
    /// Standing of the model that runs: one of `ELD_STANDING_*`.
    pub standing: u32,
    /// Its slot: `ELD_REGION_SLOT_A` or `ELD_REGION_SLOT_B`.
    pub slot: u32,
    /// Its length, bytes.
    pub file_bytes: u32,
    /// Checksum of its header.
    pub header_crc: u32,
    /// Boots that a trial has left; 0 without one.
    pub boots_left: u32,
    /// Trials that ended without confirmation.
    pub rollbacks: u32,
    /// Copies of the record that are intact and equal, when it was used last: 2, unless the storage is worn or damaged.
    pub record_copies: u32,
    /// 1 while an upload is begun.
    pub uploading: u32,
    /// Latest fault; 0 if there was none.
    pub last_fault: eld_status_t,
    /// Bytes of the upload that are written: the next chunk's offset.
    pub uploaded_bytes: u64,
    /// Calls since `eld_slots_init`.
    pub calls: u64,
    /// Calls that ended with a fault.
    pub faults: u64,
    /// Damaged copies of the state that were repaired.
    pub context_repairs: u64,
    /// After a boot, the finished check of the model that runs, for `eld_init_checked`; zero if another model was read since.
    pub check: eld_check_t,
}
