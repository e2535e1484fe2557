//! Any bytes are a table of finite points, or refused.
#![no_main]

use elunar_evaluate::lola::csv::parse;
use elunar_raster::MOON_RADIUS_M;
use std::path::Path;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Ok(table) = parse(Path::new("fuzz.csv"), bytes, None, MOON_RADIUS_M) {
        assert!(table.points.iter().all(|point| point.height_m.is_finite()));
    }
});
