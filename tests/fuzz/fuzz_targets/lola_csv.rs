//! Any bytes are a table of points, all of them finite, or refused.
#![no_main]

use host_train::lola::csv::parse;
use host_train::raster::MOON_RADIUS_M;
use std::path::Path;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Ok(table) = parse(Path::new("fuzz.csv"), bytes, None, MOON_RADIUS_M) {
        assert!(table.points.iter().all(|point| point.height_m.is_finite()));
    }
});
