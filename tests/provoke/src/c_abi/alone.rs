//! Calls without a context, and with invalid pointers.

use super::{Play, Slot, text, worked};
use alloc::vec;
use core::ptr::{null, null_mut};
use elunar_capi::ffi;
use elunar_capi::types::*;

impl Play<'_> {
    /// Sums a part of the model, and asks where the Sun stands.
    fn alone(&mut self, slot: &Slot) {
        let len = self.reader.word() as usize % (slot.model.len() + 1);
        let mut sums = [0u32; 2];
        let mut sun = eld_sun_t { struct_bytes: size_of::<eld_sun_t>() as u32, ..Default::default() };
        let mut within = |most: f64| f64::from(self.reader.word() as i32) / f64::from(i32::MAX) * most;
        let (days, lat, lon) = (within(40_000.0), within(100.0), within(400.0));
        for sum in &mut sums {
            // SAFETY: a model and a number of the test.
            self.count(unsafe { ffi::eld_code_sum(slot.model.as_ptr().cast(), len, sum) });
        }
        assert_eq!(sums[0], sums[1]);
        // SAFETY: a structure of the test.
        let status = unsafe { ffi::eld_sun_position(days, lat, lon, &raw mut sun) };
        self.count(status);
        let stands = (0.0..=360.0).contains(&sun.azimuth_deg) && (-90.0..=90.0).contains(&sun.elevation_deg);
        assert!(if worked(status) { stands } else { sun.azimuth_deg == 0.0 }, "{days} {lat} {lon}: {sun:?}");
        assert!(!worked(status) || lat.abs() <= 90.0);
    }

    /// Calls with invalid pointers.
    pub(super) fn nothing_there(&mut self, slot: Slot) -> Option<Slot> {
        let (px, handle) =
            (slot.shape().0 * slot.shape().1, slot.handle.wrapping_byte_add(self.reader.byte() as usize % 8));
        let (mut short, mut made) = (vec![0f32; px], null_mut());
        let len = self.reader.size(2 * px);
        // SAFETY: errors are refused before memory is used; every correct length has its buffer.
        let statuses = unsafe {
            [
                ffi::eld_begin(null_mut(), null()),
                ffi::eld_begin(slot.handle, null()),
                ffi::eld_begin_step(null_mut(), null(), 1),
                ffi::eld_begin_step(slot.handle, null(), 1),
                ffi::eld_abort(null_mut()),
                ffi::eld_step(null_mut(), 1),
                ffi::eld_output(slot.handle, null_mut(), len, null_mut(), len),
                ffi::eld_output(handle, short.as_mut_ptr(), if len == px { 0 } else { len }, null_mut(), 0),
                ffi::eld_init(null_mut(), len, null(), len, null_mut()),
                ffi::eld_init(null_mut(), len, slot.model.as_ptr().cast(), slot.model.len(), &raw mut made),
                ffi::eld_init(short.as_mut_ptr().cast(), 4 * px, null(), len, &raw mut made),
                ffi::eld_telemetry(slot.handle, null_mut()),
                ffi::eld_errors(slot.handle, null_mut()),
                ffi::eld_error_maps(null_mut(), short.as_mut_ptr(), null_mut(), null_mut(), px),
                ffi::eld_error_maps(
                    handle,
                    short.as_mut_ptr(),
                    null_mut(),
                    null_mut(),
                    if len == px { 0 } else { len },
                ),
                ffi::eld_kernel_name(short.as_mut_ptr().cast(), len.min(4 * px)),
            ]
        };
        for (number, status) in statuses.into_iter().enumerate() {
            self.count(status);
            assert!(number == 15 || !worked(status), "call {number}: {:?}", text(status));
        }
        self.alone(&slot);
        slot.guarded();
        Some(slot)
    }
}
