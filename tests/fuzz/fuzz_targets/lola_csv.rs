//! Any bytes are a table of finite points, or refused.
#![no_main]

use elunar_core::sun::Body;
use elunar_evaluate::lola::csv::parse;
use std::path::Path;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Ok(table) = parse(Path::new("fuzz.csv"), bytes, None, Body::Moon.radius_m()) {
        assert!(table.points.iter().all(|point| point.height_m.is_finite()));
    }
});
