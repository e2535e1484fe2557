//! Matrix products of any shape: all kernels of this machine agree with the scalar one.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    elunar_provoke::model::kernels(bytes);
});
