//! Any bytes are a model that runs without memory errors with equal results of two kernels, or refused. The mutator mends checksums, so that
//! changes get past them.
#![no_main]

use elunar_provoke::{mender, model};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    model::raw_model(bytes);
});

libfuzzer_sys::fuzz_mutator!(|bytes: &mut [u8], len: usize, _most: usize, seed: u32| {
    mender::mutate(bytes, len, seed, libfuzzer_sys::fuzzer_mutate)
});
