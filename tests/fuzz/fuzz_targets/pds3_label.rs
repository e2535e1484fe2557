//! Any bytes are a label, or an error with its line.
#![no_main]

use elunar_raster::pds3::LabelBlock;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Err(defect) = LabelBlock::parse(bytes) {
        assert!(defect.line >= 1);
    }
});
