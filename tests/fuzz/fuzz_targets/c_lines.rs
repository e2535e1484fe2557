//! Any calls on strips, terrain maps, model slots and checks of models by the C interface, with bit flips: every call returns a possible status.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    elunar_provoke::c_lines::c_lines(bytes);
});
