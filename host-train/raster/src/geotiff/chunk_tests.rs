//! Files of one huge strip or tile: the memory that decoding takes has a limit, whatever a small file claims.

use super::layout::MOST_CHUNK_PX;
use super::tests::scratch;
use super::*;
use std::path::Path;
use tiff::encoder::compression::{CompressionAlgorithm, Deflate};

const COLS: usize = 4096;

#[derive(Clone, Copy, PartialEq)]
enum Packing {
    None,
    Deflate,
    Zstd,
}

/// Writes bytes of one value as a single strip (or tile) of `rows` rows.
fn one_chunk(path: &Path, rows: usize, packing: Packing, tiled: bool) {
    let samples = vec![7_u8; rows * COLS];
    let (code, data) = match packing {
        Packing::None => (1, samples),
        Packing::Deflate => {
            let mut packed = vec![];
            Deflate::default().write_to(&mut packed, &samples).unwrap();
            (8, packed)
        }
        Packing::Zstd => (50000, zstd::bulk::compress(&samples, 1).unwrap()),
    };
    let (at, long) = if tiled { (324, 325) } else { (273, 279) };
    let mut tags = vec![
        (256, COLS),
        (257, rows),
        (258, 8),
        (259, code),
        (262, 1),
        (277, 1),
        (339, 1),
        (at, 8),
        (long, data.len()),
    ];
    tags.extend(if tiled { vec![(322, COLS), (323, rows)] } else { vec![(278, rows)] });
    tags.sort_unstable();
    let mut bytes = b"II*\0".to_vec();
    bytes.extend((8 + data.len() as u32).to_le_bytes());
    bytes.extend(data);
    bytes.extend((tags.len() as u16).to_le_bytes());
    for (tag, value) in tags {
        // One number of 32 bits each.
        bytes.extend((tag as u16).to_le_bytes());
        bytes.extend(4_u16.to_le_bytes());
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend((value as u32).to_le_bytes());
    }
    bytes.extend([0; 4]);
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn a_chunk_beyond_the_limit_is_refused_before_it_is_decoded() {
    let folder = scratch();
    let path = folder.path().join("a.tif");
    let most_rows = MOST_CHUNK_PX / COLS;
    for (packing, tiled) in
        [(Packing::Deflate, false), (Packing::Zstd, false), (Packing::Deflate, true), (Packing::Zstd, true)]
    {
        one_chunk(&path, most_rows, packing, tiled);
        let whole = read(&path).unwrap();
        assert!(whole.samples.len() == MOST_CHUNK_PX && whole.samples.iter().all(|v| *v == 7.0));
        // Tiles have sides of multiples of 16.
        one_chunk(&path, most_rows + 16, packing, tiled);
        let error = open(&path).map(drop).unwrap_err();
        assert!(matches!(error, elunar_base::Error::Unsupported { .. }), "{error}");
        let kind = if tiled { "tiles" } else { "strips" };
        let expected =
            format!("a.tif: not supported: {kind} of 4112 x 4096 pixels; at most 16777216 pixels in one expected");
        assert!(error.to_string().contains(&expected), "{error}");
    }
    // Rows without compression are read one by one.
    one_chunk(&path, most_rows + 16, Packing::None, false);
    assert_eq!(read(&path).unwrap().rows, most_rows + 16);
}
