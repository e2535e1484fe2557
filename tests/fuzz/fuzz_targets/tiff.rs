//! Any bytes are a raster, or refused.
#![no_main]

use elunar_raster::geotiff::read;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    // The reader reads windows of a file, so it needs a path.
    let path = std::env::temp_dir().join(format!("elunar_fuzz_{}.tif", std::process::id()));
    std::fs::write(&path, bytes).expect("room in the temporary folder");
    if let Ok(raster) = read(&path) {
        assert_eq!(raster.samples.len(), raster.rows * raster.cols);
    }
});
