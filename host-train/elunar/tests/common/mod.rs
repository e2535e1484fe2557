//! The program, as users run it.
#![allow(dead_code)] // each test file uses only some functions

use elunar_core::sun::Body;
use elunar_raster::geotiff::{SampleType, WriteOptions, write};
use elunar_raster::{Crs, GeoRef, Raster};
use std::path::Path;
use std::process::{Command, Output};

/// Returns the program with these words, in a folder.
pub(crate) fn command(folder: &Path, words: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_elunar"));
    command.current_dir(folder).args(words);
    command
}

/// Runs the program.
pub(crate) fn elunar(folder: &Path, words: &[&str]) -> Output {
    command(folder, words).output().unwrap()
}

/// Returns the output of a command that must succeed.
pub(crate) fn made(folder: &Path, words: &[&str]) -> String {
    let out = elunar(folder, words);
    assert!(out.status.success(), "{words:?}: {}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8_lossy(&out.stdout).into_owned()
}

/// Writes a DTM of 60 x 50 pixels of 40 m, and an image of 300 x 250 of 8 m: brighter where the ground rises eastwards.
pub(crate) fn scene(folder: &Path) {
    let raster = |rows: usize, cols: usize, pixel_m: f64, value: &dyn Fn(f64, f64) -> f64| {
        let crs = Crs::equirectangular(Body::Moon.radius_m(), 20.0, 10.0);
        let georef = GeoRef { transform: [9000.0, pixel_m, 0.0, 604_000.0, 0.0, -pixel_m], crs };
        let at = |i: usize| value((i % cols) as f64 * pixel_m, (i / cols) as f64 * pixel_m) as f32;
        Raster { rows, cols, samples: (0..rows * cols).map(at).collect(), georef: Some(georef) }
    };
    let height = |x: f64, y: f64| 60.0 * (x / 150.0).sin() * (y / 210.0).cos() + 0.02 * x;
    let bright = |x: f64, y: f64| (500.0 + 8.0 * (height(x + 8.0, y) - height(x - 8.0, y))).round();
    let image = raster(250, 300, 8.0, &bright);
    write(&folder.join("image.tif"), &image, &WriteOptions::image(SampleType::U16, "image")).unwrap();
    write(&folder.join("coarse.tif"), &raster(50, 60, 40.0, &height), &WriteOptions::heights("coarse")).unwrap();
}
