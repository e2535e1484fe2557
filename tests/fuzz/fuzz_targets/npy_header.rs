//! Any text is a NumPy header, or refused.
#![no_main]

use elunar_raster::npy::Header;

libfuzzer_sys::fuzz_target!(|text: &str| {
    let _ = Header::parse(text);
});
