//! A context that is made in pieces is the one that is made at once.
#![allow(unsafe_code)] // C functions

mod common;
use common::*;
use elunar_capi::ffi;
use elunar_capi::status::*;
use elunar_capi::types::*;
use std::ptr::null_mut;

/// Memory of exactly the model's need, and a call of `eld_init_step` on it.
struct Pieces {
    memory: Vec<u64>,
    bytes: usize,
    handle: *mut eld_context_t,
}

impl Pieces {
    fn new() -> Self {
        let bytes = info(nano()).unwrap().memory_bytes as usize;
        Self { memory: vec![0xa5a5_a5a5_a5a5_a5a5; bytes.div_ceil(8)], bytes, handle: null_mut() }
    }

    fn step(&mut self, model: &[u8], budget_macs: u64) -> eld_status_t {
        let (memory, model_bytes) = (self.memory.as_mut_ptr().cast(), model.len());
        // SAFETY: memory, model and a handle of our own.
        unsafe {
            ffi::eld_init_step(
                memory,
                self.bytes,
                model.as_ptr().cast(),
                model_bytes,
                budget_macs,
                &raw mut self.handle,
            )
        }
    }
}

#[test]
fn a_context_made_in_pieces_makes_the_same_tile() {
    let tile = Tile::golden();
    let mut at_once = Context::new(nano());
    assert_eq!(at_once.begin(&tile), ELD_OK);
    at_once.finish();
    for budget in [1, 5_000_000] {
        let (mut pieces, mut calls) = (Pieces::new(), 1);
        while pieces.step(nano(), budget) == ELD_RUNNING {
            // It is no context yet.
            // SAFETY: at least a context's bytes of our own.
            assert_eq!(unsafe { ffi::eld_step(pieces.handle, 1) }, ELD_FAULT_CONTEXT_LOST);
            calls += 1;
        }
        assert!(calls > if budget == 1 { 400 } else { 20 }, "{calls}");
        let mut context = Context { memory: pieces.memory, handle: pieces.handle };
        assert_eq!(context.begin(&tile), ELD_OK);
        context.finish();
        assert_eq!(bits(&context.output().unwrap().0), bits(&at_once.output().unwrap().0));
    }
}

#[test]
fn what_goes_wrong_on_the_way_is_told() {
    let model = nano().to_vec();
    // Another model, or other memory, than at the call before.
    let mut pieces = Pieces::new();
    assert_eq!(pieces.step(&model, 1), ELD_RUNNING);
    assert_eq!(pieces.step(&model.clone(), 1), ELD_FAULT_CONTEXT_LOST);
    assert!(pieces.handle.is_null());
    // From the start again.
    assert_eq!(pieces.step(&model, 1_000_000), ELD_RUNNING);
    // One copy of the position is repaired, both are not.
    pieces.memory[3] ^= 1;
    assert_eq!(pieces.step(&model, 1_000_000), ELD_RUNNING);
    pieces.memory[3] ^= 1;
    pieces.memory[3 + 15] ^= 1;
    assert_eq!(pieces.step(&model, 1_000_000), ELD_FAULT_CONTEXT_LOST);
    // A byte of the model that has changed.
    let mut spoilt = model.clone();
    let middle = spoilt.len() / 2;
    let mut pieces = Pieces::new();
    assert_eq!(pieces.step(&spoilt, 1), ELD_RUNNING);
    spoilt[middle] ^= 4;
    let last = loop {
        match pieces.step(&spoilt, 10_000_000) {
            ELD_RUNNING => {}
            status => break status,
        }
    };
    assert_eq!((last, pieces.handle.is_null()), (ELD_REFUSED_MODEL_CHECKSUM, true));
    // Memory that is too short for a position, and for the model.
    for (bytes, calls) in [(100, 1), (100_000, 2)] {
        let mut pieces = Pieces { bytes, ..Pieces::new() };
        assert_eq!(pieces.step(&model, if calls == 1 { 1 } else { u64::MAX }), ELD_REFUSED_MEMORY_SHORT);
    }
    // A handle that is neither NULL nor that memory begins from the start.
    let mut pieces = Pieces::new();
    pieces.handle = std::ptr::dangling_mut();
    assert_eq!(pieces.step(&model, 1), ELD_RUNNING);
}
