//! The program in a temporary folder, as in a user's shell.

// Each test program uses only a part of this module.
#![allow(dead_code)]

use elunar_learn::model::init::initial_weights;
use elunar_net::config::{NetConfig, OutputHead, Preset};
use elunar_raster::{Crs, GeoRef, Raster};
use std::path::PathBuf;
use std::process::{Command, Output};

/// A folder that is removed when the test ends, and commands that run in it.
pub(crate) struct Shell {
    folder: tempfile::TempDir,
}

impl Shell {
    pub(crate) fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    /// Makes a folder with a scene (`s/scene_0000_*.tif`), the shipped `nano.eld`, and `small.safetensors`, weights of a small network.
    pub(crate) fn with_scene(rows: &str, cols: &str) -> Self {
        let shell = Self::new();
        shell.made(&["synth", "--out", "s", "--rows", rows, "--cols", cols, "--seed", "5"]);
        std::fs::copy(concat!(env!("CARGO_MANIFEST_DIR"), "/models/nano.eld"), shell.path("nano.eld")).unwrap();
        let config = NetConfig {
            embed: 2,
            depths: [2, 1, 1, 1],
            heads: [1, 1, 2, 1],
            stem: 1,
            dtm: [1; 5],
            decoder: [2; 5],
            head: OutputHead::Residual,
            ..NetConfig::preset(Preset::Nano)
        };
        initial_weights(&config, 1).write(&shell.path("small.safetensors")).unwrap();
        shell
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Returns a command that is not started yet.
    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_host-train"));
        command.args(arguments).current_dir(self.folder.path());
        command
    }

    pub(crate) fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Returns the output of a command that must succeed. Without a terminal, it must print nothing on stderr.
    pub(crate) fn made(&self, arguments: &[&str]) -> String {
        let out = self.run(arguments);
        let errors = String::from_utf8_lossy(&out.stderr);
        assert!(out.status.success(), "{arguments:?}: {errors}");
        assert_eq!(errors, "", "{arguments:?}: quiet where stderr is no terminal");
        String::from_utf8(out.stdout).unwrap()
    }

    /// Returns the single error line of a command that must fail.
    pub(crate) fn refused(&self, arguments: &[&str]) -> String {
        let out = self.run(arguments);
        let text = String::from_utf8(out.stderr).unwrap();
        // Options that cannot be met, or a bad input.
        assert!(matches!(out.status.code(), Some(64 | 65)), "{arguments:?}: {:?} {text}", out.status);
        assert_eq!(text.trim_end().lines().count(), 1, "{text}");
        assert!(text.starts_with("ERROR: "), "{text}");
        text
    }

    /// Returns the names of the files, sorted.
    pub(crate) fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder.path()).unwrap();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

/// Returns a north-up raster of a function of map coordinates, with its upper left corner at `at`.
pub(crate) fn raster(
    (rows, cols): (usize, usize),
    at: (f64, f64),
    pixel_m: f64,
    crs: Crs,
    value: impl Fn(f64, f64) -> f64,
) -> Raster {
    let georef = GeoRef { transform: [at.0, pixel_m, 0.0, at.1, 0.0, -pixel_m], crs };
    let sample = |i: usize| {
        let (x, y) = georef.centre((i / cols) as f64, (i % cols) as f64);
        value(x, y) as f32
    };
    Raster { rows, cols, samples: (0..rows * cols).map(sample).collect(), georef: Some(georef) }
}
