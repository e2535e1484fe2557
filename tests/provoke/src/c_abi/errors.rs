//! Calls about expected errors.

use super::{Phase, Play, Slot};
use alloc::vec;
use core::ptr::null_mut;
use elunar_capi::ffi;
use elunar_capi::status::*;
use elunar_capi::types::*;

impl Play<'_> {
    pub(super) fn errors(&mut self, slot: &mut Slot) {
        let mut out = eld_errors_t { struct_bytes: size_of::<eld_errors_t>() as u32, ..Default::default() };
        // SAFETY: a context and a structure of the test.
        let status = unsafe { ffi::eld_errors(slot.handle, &raw mut out) };
        self.count(status);
        if slot.whole && worked(status) {
            assert!(matches!(slot.phase, Phase::Tile { done: true, .. }) && !out.explained.is_nan(), "{out:?}");
        }
        let px = slot.shape().0 * slot.shape().1;
        let (mut slope, mut origin) = (vec![-1f32; px], vec![9u8; px]);
        let maps = (slope.as_mut_ptr(), origin.as_mut_ptr());
        // SAFETY: a context and buffers of the test.
        let found = unsafe { ffi::eld_error_maps(slot.handle, null_mut(), maps.0, maps.1, px) };
        self.count(found);
        assert!(!slot.whole || found == status || status == ELD_NOTICE_REPAIRED, "{:?}", text(found));
        let written = slope.iter().zip(&origin).all(|(s, o)| *o < 5 && s.is_nan() == (*o == ELD_ORIGIN_VOID));
        let kept = slope.iter().all(|s| *s == -1.0) && origin.iter().all(|o| *o == 9);
        assert!(!slot.whole || if worked(found) { written } else { kept });
    }
}
