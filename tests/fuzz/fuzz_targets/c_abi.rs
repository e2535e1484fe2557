//! Any calls of the C interface, in any order, with any arguments, with bit flips: every call returns a possible status.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    elunar_provoke::c_abi::c_abi(bytes);
});
