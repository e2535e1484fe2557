//! Any calls of the C interface, in any order, with any arguments, while bits flip: every call returns, with a status that fits.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    elunar_provoke::c_abi::c_abi(bytes);
});
