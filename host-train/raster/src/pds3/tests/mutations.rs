//! Damaged labels and images are refused or read. The reader never panics and never needs more memory than the file can hold.

use super::super::LabelBlock;
use super::{EQUIRECTANGULAR, POLAR, attached, shared, sldem_label};
use crate::source::{open, read_all};
use elunar_testing::mutate;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Pieces with a meaning in a label. Mutations with them test more than random bytes do.
const PIECES: [&str; 24] = [
    "=",
    "(",
    ")",
    "{",
    "}",
    ",",
    "\"",
    "'",
    "<",
    ">",
    "/*",
    "*/",
    "END",
    "OBJECT = IMAGE\n",
    "END_OBJECT\n",
    "\0",
    "16#FF#",
    "N/A",
    "-1",
    "18446744073709551615",
    "1e308",
    "^IMAGE = 1\n",
    "\u{e9}",
    "GROUP = G\n",
];

#[test]
fn damaged_labels_never_panic() {
    let mut seeds = vec![sldem_label("A", 3, 4).into_bytes(), attached(2, 3, "UNIT = 'm'", EQUIRECTANGULAR, 4)];
    seeds.push(b"A = (1, {2.5 <m>, \"t\"}, 16#FF#); GROUP = G B = 1990-158T01:02:03Z END_GROUP = G END".to_vec());
    if let Some(folder) = shared("pds3_labels/grammar") {
        seeds.extend(std::fs::read_dir(folder).unwrap().flatten().filter_map(|e| std::fs::read(e.path()).ok()));
    }
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    let (mut parsed, mut refused) = (0, 0);
    for round in 0..6000 {
        let mut bytes = seeds[round % seeds.len()].clone();
        mutate(&mut bytes, &PIECES, &mut rng);
        match LabelBlock::parse(&bytes) {
            Ok(_) => parsed += 1,
            Err(defect) => {
                assert!(defect.line >= 1 && defect.line <= bytes.iter().filter(|&&b| b == b'\n').count() + 1);
                refused += 1;
            }
        }
    }
    assert!(parsed > 500 && refused > 500, "{parsed} read, {refused} refused");
}

#[test]
fn damaged_images_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("A.IMG");
    let image =
        "SAMPLE_TYPE = PC_REAL SAMPLE_BITS = 32 SCALING_FACTOR = 0.5 OFFSET = 1737.4 MISSING_CONSTANT = 16#FF7FFFFB#";
    let seeds = [EQUIRECTANGULAR, POLAR].map(|place| [attached(6, 7, image, place, 4), vec![0x3F; 168]].concat());
    let mut rng = ChaCha8Rng::seed_from_u64(32);
    let (mut read, mut refused) = (0, 0);
    for round in 0..3000 {
        let mut bytes = seeds[round % 2].clone();
        mutate(&mut bytes, &PIECES, &mut rng);
        std::fs::write(&path, &bytes).unwrap();
        match open(&path).and_then(|source| read_all(&*source)) {
            Ok(raster) => {
                assert_eq!(raster.samples.len(), raster.rows * raster.cols);
                assert!(raster.samples.len() <= bytes.len());
                read += 1;
            }
            Err(error) => {
                assert!(!error.to_string().contains('\n'), "{error}");
                refused += 1;
            }
        }
    }
    assert!(read > 200 && refused > 200, "{read} read, {refused} refused");
}
