//! Any bytes are a cube, a PDS4 label or a VRT, or refused.
#![no_main]

use elunar_raster::source::read_all;
use elunar_raster::{isis, pds4, vrt};

/// Most samples that are read: a VRT of a few bytes may have any size.
const MOST_SAMPLES: usize = 1 << 16;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    // The readers read windows of files, so they need paths. Labels may name `a.dat`, an array of 2 x 3 bytes.
    let folder = std::env::temp_dir().join(format!("elunar_fuzz_{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("room in the temporary folder");
    let path = folder.join("a.xml");
    std::fs::write(&path, bytes).expect("room in the temporary folder");
    let header = format!("{:<117}\n", "{'descr': '|u1', 'fortran_order': False, 'shape': (2, 3), }");
    let array = [b"\x93NUMPY\x01\0v\0", header.as_bytes(), &[7; 6]].concat();
    std::fs::write(folder.join("a.dat"), array).expect("room in the temporary folder");
    for open in [isis::open, pds4::open, vrt::open] {
        let Ok(source) = open(&path) else { continue };
        let (rows, cols) = (source.info().rows, source.info().cols);
        if rows.saturating_mul(cols) <= MOST_SAMPLES
            && let Ok(raster) = read_all(&*source)
        {
            assert_eq!(raster.samples.len(), rows * cols);
        }
    }
});
