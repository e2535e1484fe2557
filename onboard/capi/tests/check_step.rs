//! A model that is checked in pieces serves contexts and strips as one that is validated at once.
#![allow(unsafe_code)] // C functions

mod common;
use common::*;
use elunar_capi::ffi;
use elunar_capi::status::*;
use elunar_capi::types::*;
use elunar_core::nn::file::word;
use std::ptr::{null, null_mut};
use std::sync::OnceLock;

/// A check with its information.
#[derive(Default)]
struct Checked {
    check: eld_check_t,
    info: eld_model_info_t,
}

impl Checked {
    fn new() -> Self {
        let struct_bytes = size_of::<eld_model_info_t>() as u32;
        Self { info: eld_model_info_t { struct_bytes, ..Default::default() }, ..Self::default() }
    }

    fn step(&mut self, model: &[u8], budget_macs: u64) -> eld_status_t {
        let (check, info) = (&raw mut self.check, &raw mut self.info);
        // SAFETY: a slice and structures of our own.
        unsafe { ffi::eld_model_check_step(model.as_ptr().cast(), model.len(), budget_macs, check, info) }
    }

    /// Returns the status of a context made with the check, and the context.
    fn init(&self, model: &[u8]) -> (eld_status_t, Context) {
        static BYTES: OnceLock<u64> = OnceLock::new();
        let bytes = *BYTES.get_or_init(|| info(nano()).unwrap().memory_bytes) as usize;
        let (mut memory, mut handle) = (vec![0xa5a5_a5a5_a5a5_a5a5_u64; bytes.div_ceil(8)], null_mut());
        let place = memory.as_mut_ptr().cast();
        // SAFETY: memory, model and a check of our own.
        let status = unsafe {
            ffi::eld_init_checked(
                place,
                bytes,
                model.as_ptr().cast(),
                model.len(),
                &raw const self.check,
                &raw mut handle,
            )
        };
        assert_eq!(handle.is_null(), status != ELD_OK);
        (status, Context { memory, handle })
    }
}

#[test]
fn a_model_checked_in_pieces_makes_the_same_tile() {
    let tile = Tile::golden();
    let mut at_once = Context::new(nano());
    assert_eq!(at_once.begin(&tile), ELD_OK);
    at_once.finish();
    for budget in [1_000, 5_000_000] {
        let (mut checked, mut calls) = (Checked::new(), 1);
        let before = checked.info;
        while checked.step(nano(), budget) == ELD_RUNNING {
            assert_eq!((checked.init(nano()).0, checked.info), (ELD_REFUSED_NOT_CHECKED, before));
            calls += 1;
            // It may be copied.
            checked.check = eld_check_t { ..checked.check };
        }
        assert!(calls > if budget == 1_000 { 400 } else { 20 }, "{calls}");
        assert_eq!(checked.info, info(nano()).unwrap());
        assert_eq!(checked.step(nano(), budget), ELD_OK, "it stays finished");
        let (status, mut context) = checked.init(nano());
        assert_eq!((status, context.begin(&tile)), (ELD_OK, ELD_OK));
        context.finish();
        assert_eq!(bits(&context.output().unwrap().0), bits(&at_once.output().unwrap().0));
        // A second context of the same check, with the model elsewhere.
        let elsewhere = nano().to_vec();
        assert_eq!(checked.init(&elsewhere).0, ELD_OK);
    }
}

#[test]
fn what_goes_wrong_on_the_way_is_told() {
    let model = nano().to_vec();
    // Every bit is under the checksum; the next call begins anew.
    let mut half = Checked::new();
    assert_eq!(half.step(&model, 1_000_000), ELD_RUNNING);
    for bit in (0..64 * half.check.words.len()).step_by(7) {
        let mut spoilt = Checked { check: half.check, info: half.info };
        spoilt.check.words[bit / 64] ^= 1 << (bit % 64);
        assert_eq!(spoilt.step(&model, 1), ELD_FAULT_CHECK, "bit {bit}");
        assert_eq!(spoilt.check, eld_check_t::default());
    }
    // Another model than at the call before.
    let mut other = model.clone();
    other[4 * word::HEADER_CRC] ^= 1;
    assert_eq!(half.step(&other, 1), ELD_FAULT_CHECK);
    // A byte of the model that has changed.
    let (mut spoilt, mut checked, middle) = (model.clone(), Checked::new(), model.len() / 2);
    assert_eq!(checked.step(&spoilt, 1), ELD_RUNNING);
    spoilt[middle] ^= 4;
    let last = loop {
        match checked.step(&spoilt, 10_000_000) {
            ELD_RUNNING => {}
            status => break status,
        }
    };
    assert_eq!((last, checked.check), (ELD_REFUSED_MODEL_CHECKSUM, eld_check_t::default()));
    // A finished check that has changed, or is of another model.
    let mut checked = Checked::new();
    assert_eq!(checked.step(&model, u64::MAX), ELD_OK);
    assert_eq!(checked.init(&model).0, ELD_OK);
    checked.check.words[4] ^= 1 << 40;
    assert_eq!(checked.init(&model).0, ELD_FAULT_CHECK);
}

#[test]
fn wrong_pointers_are_refused() {
    let mut all = Checked::new();
    let (model, bytes) = (nano().as_ptr().cast(), nano().len());
    let (check, info) = (&raw mut all.check, &raw mut all.info);
    let (mut memory, mut handle) = ([0u64; 200], null_mut());
    // SAFETY: wrong pointers are refused before they are used.
    unsafe {
        assert_eq!(ffi::eld_model_check_step(null(), bytes, 1, check, info), ELD_REFUSED_NULL);
        assert_eq!(ffi::eld_model_check_step(model, bytes, 1, null_mut(), info), ELD_REFUSED_NULL);
        assert_eq!(ffi::eld_model_check_step(model, bytes, 1, check, null_mut()), ELD_REFUSED_NULL);
        let odd = check.wrapping_byte_add(1);
        assert_eq!(ffi::eld_model_check_step(model, bytes, 1, odd, info), ELD_REFUSED_ALIGNMENT);
        assert_eq!(ffi::eld_model_check_step(model, bytes, 1, check, check.cast()), ELD_REFUSED_OVERLAP);
        assert_eq!(ffi::eld_model_check_step(check.cast(), 88, 1, check, info), ELD_REFUSED_OVERLAP);
        let place = memory.as_mut_ptr();
        let init = |check, handle| ffi::eld_init_checked(place.cast(), 1600, model, bytes, check, handle);
        assert_eq!(init(null(), &raw mut handle), ELD_REFUSED_NULL);
        assert_eq!(init(place.cast(), &raw mut handle), ELD_REFUSED_OVERLAP);
        assert_eq!(init(check, check.cast()), ELD_REFUSED_OVERLAP);
        assert_eq!(init(check, null_mut()), ELD_REFUSED_NULL);
    }
    assert_eq!(all.check, eld_check_t::default(), "refused, and nothing has changed");
}
