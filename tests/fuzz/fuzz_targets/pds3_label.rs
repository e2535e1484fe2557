//! Any bytes are a label, or an error with its line.
#![no_main]

use elunar_raster::pds3::Block;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Err(defect) = Block::parse(bytes) {
        assert!(defect.line >= 1);
    }
});
