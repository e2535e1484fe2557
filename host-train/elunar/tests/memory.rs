//! The promise about memory holds for hostile files, too: under a limit of the address space they are read or refused.

#![cfg(unix)]

use elunar_core::sun::Body;
use elunar_raster::geotiff::{WriteOptions, read, write};
use elunar_raster::{Crs, GeoRef, Raster};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/nano.eld");
/// Address space of `predict` on one thread, KiB: that of a small scene, and the 192 MiB that decoding the largest strip may take.
const LIMIT_KIB: usize = 288 << 10;
/// The largest strip that is read has 4096 x 4096 pixels.
const SIDE: usize = 4096;

fn elunar(folder: &Path, words: &[&str]) -> Output {
    elunar_within(LIMIT_KIB, folder, words)
}

/// Runs the program within an address space of so many KiB.
fn elunar_within(limit_kib: usize, folder: &Path, words: &[&str]) -> Output {
    let limit = format!("ulimit -v {limit_kib} || exit 99; exec \"$@\"");
    let mut shell = Command::new("sh");
    shell.current_dir(folder).args(["-c", &limit, "sh", env!("CARGO_BIN_EXE_elunar")]).args(words);
    // glibc reserves 128 MiB of addresses for every thread's own heap, used or not.
    shell.env("MALLOC_ARENA_MAX", "1").env("RAYON_NUM_THREADS", "2").output().unwrap()
}

/// A ZSTD frame of `count` bytes of zero: blocks of 128 KiB, four bytes each.
fn zeros(count: usize) -> Vec<u8> {
    const BLOCK: usize = 128 << 10;
    // Magic number, no content size, a window of 128 KiB.
    let mut frame = vec![0x28, 0xB5, 0x2F, 0xFD, 0x00, 7 << 3];
    let blocks = count.div_ceil(BLOCK);
    for block in 0..blocks {
        let size = BLOCK.min(count - block * BLOCK);
        let (last, repeated) = (usize::from(block + 1 == blocks), 1 << 1);
        frame.extend(&(size << 3 | repeated | last).to_le_bytes()[..3]);
        frame.push(0);
    }
    frame
}

/// Writes a GeoTIFF of zeros, `bits` a sample, as a single strip of ZSTD.
fn one_strip(path: &Path, (rows, cols): (usize, usize), bits: usize, georef: &GeoRef) {
    enum Value {
        Number(usize),
        Shorts(Vec<u16>),
        Doubles(Vec<f64>),
        Text(String),
    }
    use Value::{Doubles, Number, Shorts, Text};
    let data = zeros(rows * cols * bits / 8);
    let [x, dx, _, y, _, dy] = georef.transform;
    let mut tags = vec![
        (256, Number(cols)),
        (257, Number(rows)),
        (258, Number(bits)),
        (259, Number(50000)),
        (262, Number(1)),
        (273, Number(8)),
        (277, Number(1)),
        (278, Number(rows)),
        (279, Number(data.len())),
        (339, Number(if bits == 8 { 1 } else { 3 })),
        (33550, Doubles(vec![dx, -dy, 0.0])),
        (33922, Doubles(vec![0.0, 0.0, 0.0, x, y, 0.0])),
        (34735, Shorts(georef.crs.directory.clone())),
    ];
    if !georef.crs.doubles.is_empty() {
        tags.push((34736, Doubles(georef.crs.doubles.clone())));
    }
    if !georef.crs.ascii.is_empty() {
        tags.push((34737, Text(georef.crs.ascii.clone())));
    }
    let mut bytes = b"II*\0".to_vec();
    let values_at = 8 + data.len();
    let (mut values, mut directory) = (Vec::<u8>::new(), (tags.len() as u16).to_le_bytes().to_vec());
    for (tag, value) in tags {
        let (kind, count, stored): (u16, usize, Vec<u8>) = match value {
            Number(n) => (4, 1, (n as u32).to_le_bytes().to_vec()),
            Shorts(list) => (3, list.len(), list.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Doubles(list) => (12, list.len(), list.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Text(text) => (2, text.len() + 1, [text.as_bytes(), b"\0"].concat()),
        };
        directory.extend((tag as u16).to_le_bytes());
        directory.extend(kind.to_le_bytes());
        directory.extend((count as u32).to_le_bytes());
        if stored.len() <= 4 {
            directory.extend([&stored[..], &[0; 4]].concat()[..4].iter());
        } else {
            directory.extend(((values_at + values.len()) as u32).to_le_bytes());
            values.extend(stored);
        }
    }
    directory.extend([0; 4]);
    bytes.extend(((values_at + values.len()) as u32).to_le_bytes());
    bytes.extend(data);
    bytes.extend(values);
    bytes.extend(directory);
    std::fs::write(path, bytes).unwrap();
}

/// Returns the words of `predict` with one thread.
fn predict<'a>(image: &'a str, coarse: &'a str) -> Vec<&'a str> {
    vec!["predict", "--image", image, "--coarse", coarse, "--model", MODEL, "-o", "dtm.tif", "--threads", "1"]
}

#[test]
fn predict_keeps_its_memory_whatever_the_files_claim() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| -> PathBuf { folder.path().join(name) };
    let made = elunar(folder.path(), &["synth", "--out", "s", "--rows", "256", "--cols", "320", "--seed", "5"]);
    if made.status.code() == Some(99) {
        elunar_testing::skipped("predict_keeps_its_memory_whatever_the_files_claim", "no ulimit -v here");
        return;
    }
    let text = |out: &Output| String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(made.status.success(), "{}", text(&made));
    let (image, coarse) = ("s/scene_0000_image.tif", "s/scene_0000_coarse.tif");
    let out = elunar(folder.path(), &predict(image, coarse));
    assert!(out.status.success(), "the limit is too small for a small scene: {}", text(&out));

    // The largest strip that is read, in the widest samples: 128 MiB of f64 in a file of a few kilobytes.
    let Raster { georef, .. } = read(at(coarse)).unwrap();
    let georef = georef.unwrap();
    one_strip(&at("largest.tif"), (SIDE, SIDE), 64, &georef);
    assert!(std::fs::metadata(at("largest.tif")).unwrap().len() < 10_000);
    let out = elunar(folder.path(), &predict(image, "largest.tif"));
    assert!(out.status.success() && read(at("dtm.tif")).unwrap().valid_count() > 0, "{:?} {}", out.status, text(&out));

    // Larger ones are refused by one line, as image and as coarse DTM: these would take 1.1 GB as they are stored, and four times that as
    // samples.
    one_strip(&at("bomb.tif"), (8 * SIDE, 8 * SIDE), 8, &georef);
    for (image, coarse) in [(image, "bomb.tif"), ("bomb.tif", coarse)] {
        let out = elunar(folder.path(), &predict(image, coarse));
        let text = text(&out);
        assert!(out.status.code() == Some(65) && text.lines().count() == 1, "{:?} {text}", out.status);
        assert!(text.starts_with("ERROR: bomb.tif: not supported: strips of 32768 x 32768 pixels"), "{text}");
    }
}

/// Address space of `evaluate`, KiB.
const EVALUATE_KIB: usize = 1 << 20;

/// Two DTMs of more pixels than are transformed whole. As whole rasters with their spectra they take more than 2 GB.
#[test]
fn evaluate_keeps_its_memory_whatever_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let side = 4100;
    let transform = [0.0, 2.0, 0.0, 0.0, 0.0, -2.0];
    let georef = GeoRef { transform, crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0) };
    let wave = |i: usize| ((i / side) as f32 * 0.05).sin() * 9.0 + ((i % side) as f32 * 0.03).cos() * 4.0;
    for (name, factor) in [("truth.tif", 1.0), ("dtm.tif", 0.5)] {
        let samples = (0..side * side).map(|i| factor * wave(i)).collect();
        let raster = Raster { rows: side, cols: side, samples, georef: Some(georef.clone()) };
        write(&folder.path().join(name), &raster, &WriteOptions::heights("waves")).unwrap();
    }
    let words = ["evaluate", "--dtm", "dtm.tif", "--truth", "truth.tif", "--json"];
    let out = elunar_within(EVALUATE_KIB, folder.path(), &words);
    if out.status.code() == Some(99) {
        return elunar_testing::skipped("evaluate_keeps_its_memory_whatever_the_scene", "no ulimit -v here");
    }
    assert!(out.status.success(), "{:?} {}", out.status, String::from_utf8_lossy(&out.stderr));
    let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let found = &found["candidates"][0];
    // Half of waves of 9 and 4 m, and the waves themselves, of 251 and 419 m.
    let rms = (0.5_f64 * (4.5 * 4.5 + 2.0 * 2.0)).sqrt();
    assert!((found["rmse_m"].as_f64().unwrap() / rms - 1.0).abs() < 0.01, "{found}");
    let octaves = found["octaves"].as_array().unwrap();
    let gain = octaves.iter().find(|octave| octave["longest_m"].as_f64().unwrap() > 300.0).unwrap();
    assert!((gain["gain"].as_f64().unwrap() - 0.5).abs() < 0.01, "{found}");
}
