//! A test suite as a file: its scenes, and the known facts about them.

use crate::toml_file;
use elunar_base::digest::sha256_hex;
use elunar_base::{Error, Result, read};
use elunar_net::sun::{check_azimuth, check_elevation};
use elunar_raster::Crs;
use elunar_synth::SynthOptions;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Scenes of a test suite.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct List {
    /// Name of the suite.
    pub name: String,
    /// Description of the suite and its purpose, for the report.
    #[serde(default)]
    pub about: String,
    /// The scenes.
    pub scene: Vec<SuiteScene>,
}

/// One scene: a synthetic one (`synth`), or files. Of the files, only `truth` is required. A missing image is rendered from the truth (with
/// the Sun given), and a missing coarse DTM is averaged from it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SuiteScene {
    /// Name of the scene: letters, digits, `-`, `_` and `.`, because it becomes part of file names.
    pub name: String,
    /// Kind of ground or of data. Scenes of one kind are summarised together.
    #[serde(default = "any")]
    pub kind: String,
    /// Name that scenes of one ground under different Suns share. They also share a grid.
    pub ground: Option<String>,
    /// Remarks for the reader of the results.
    #[serde(default)]
    pub remarks: String,
    /// A scene of the synthetic Moon.
    pub synth: Option<SynthEntry>,
    /// Orbiter image.
    pub image: Option<PathBuf>,
    /// Coarse DTM on its own grid, metres.
    pub coarse: Option<PathBuf>,
    /// True DTM, metres.
    pub truth: Option<PathBuf>,
    /// Without `coarse`: side of the blocks over which the truth is averaged, in its pixels [default: as near to 59 m as possible].
    pub coarse_px: Option<usize>,
    /// Reference system of all files, if they do not state it.
    pub srs: Option<String>,
    /// Azimuth of the Sun, degrees clockwise from the grid's up.
    pub sun_azimuth_deg: Option<f64>,
    /// Elevation of the Sun, degrees.
    pub sun_elevation_deg: Option<f64>,
    /// Waves shorter than this are the fine relief [default: 60 m, or the coarse DTM's pixel where that is wider].
    pub high_pass_m: Option<f64>,
    /// Wavelength that the truth resolves, metres: all DTMs are smoothed alike by a Gaussian that halves such waves [default: as they are].
    pub truth_resolution_m: Option<f64>,
    /// Whether the truth has long waves only. Such a scene is left out of summaries.
    #[serde(default)]
    pub weak_truth: bool,
}

/// A scene of a synthetic Moon.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SynthEntry {
    /// Seed of the Moon.
    pub seed: u64,
    /// Number of the scene.
    #[serde(default)]
    pub index: u64,
    /// Options of the Moon. Rows and columns are the scene's.
    #[serde(default)]
    pub options: SynthOptions,
}

fn any() -> String {
    "any".into()
}

/// The built-in suite.
const HELD_OUT: &str = include_str!("../../suites/held-out.toml");

impl List {
    /// Returns the built-in list: synthetic scenes of Moons that no model is trained, validated or calibrated on.
    ///
    /// # Errors
    /// Only if this program was built with a broken list.
    pub fn built_in() -> Result<Self> {
        Self::parse(Path::new("held-out.toml"), HELD_OUT)
    }

    /// Reads a list. Its paths are relative to its folder.
    ///
    /// # Errors
    /// [`Error::Io`] if the list cannot be read, [`Error::Broken`] with the entry that is wrong.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(path, &read::text(path, read::MOST_SETTINGS_BYTES)?)
    }

    /// Returns the SHA-256 of the list's content.
    #[must_use]
    pub fn sha256(&self) -> String {
        sha256_hex(format!("{self:?}").as_bytes())
    }

    fn parse(path: &Path, text: &str) -> Result<Self> {
        let mut list: Self = toml_file::parse(path, text)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut names = BTreeSet::new();
        for entry in &mut list.scene {
            entry.check().map_err(|what| Error::broken(path, format!("scene {}: {what}", entry.name)))?;
            if !names.insert(entry.name.clone()) {
                return Err(Error::broken(
                    path,
                    format!("scene {}: expected names to differ, found it twice", entry.name),
                ));
            }
            for file in [&mut entry.image, &mut entry.coarse, &mut entry.truth].into_iter().flatten() {
                *file = folder.join(&file);
            }
        }
        if list.scene.is_empty() {
            return Err(Error::broken(path, "expected at least one [[scene]], found none"));
        }
        Ok(list)
    }
}

/// Returns whether `name` can be part of a file name.
#[must_use]
pub fn is_plain(name: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    !name.is_empty() && !name.starts_with('.') && name.chars().all(plain)
}

impl SuiteScene {
    /// Makes an entry without scene, files or Sun.
    pub(super) fn named(name: String) -> Self {
        Self {
            name,
            kind: any(),
            ground: None,
            remarks: String::new(),
            synth: None,
            image: None,
            coarse: None,
            truth: None,
            coarse_px: None,
            srs: None,
            sun_azimuth_deg: None,
            sun_elevation_deg: None,
            high_pass_m: None,
            truth_resolution_m: None,
            weak_truth: false,
        }
    }

    fn check(&self) -> std::result::Result<(), String> {
        if !is_plain(&self.name) {
            return Err("expected a name of letters, digits, '-', '_' and '.'".into());
        }
        let files = self.image.is_some() || self.coarse.is_some() || self.truth.is_some();
        if files == self.synth.is_some() || (files && self.truth.is_none()) {
            return Err("expected either synth or truth (with image and coarse, if there are any)".into());
        }
        let sun = (self.sun_azimuth_deg, self.sun_elevation_deg);
        if self.synth.is_some() && sun != (None, None) {
            return Err("expected the Sun of a synthetic scene among its options".into());
        }
        if self.truth.is_some() && self.image.is_none() && (sun.0.is_none() || sun.1.is_none()) {
            return Err("expected sun_azimuth_deg and sun_elevation_deg to render the image with".into());
        }
        sun.0.map_or(Ok(()), |deg| check_azimuth("sun_azimuth_deg", deg)).map_err(|e| e.to_string())?;
        sun.1.map_or(Ok(()), |deg| check_elevation("sun_elevation_deg", deg)).map_err(|e| e.to_string())?;
        if self.coarse_px.is_some_and(|px| px < 2 || self.coarse.is_some()) {
            return Err("expected coarse_px of at least 2, and no coarse beside it".into());
        }
        if self.high_pass_m.is_some_and(|m| m.is_nan() || m <= 0.0) {
            return Err("expected high_pass_m above 0".into());
        }
        if self.truth_resolution_m.is_some_and(|m| m.is_nan() || m <= 0.0) {
            return Err("expected truth_resolution_m above 0".into());
        }
        self.crs().map(drop)
    }

    /// Returns the stated reference system.
    ///
    /// # Errors
    /// If the system is not supported.
    pub(super) fn crs(&self) -> std::result::Result<Option<Crs>, String> {
        self.srs.as_deref().map(Crs::parse).transpose().map_err(|e| e.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_suite_has_grounds_under_two_suns_and_both_kinds() {
        let list = List::built_in().unwrap();
        let kinds: BTreeSet<&str> = list.scene.iter().map(|s| s.kind.as_str()).collect();
        assert!(kinds.contains("mare") && kinds.contains("highland"), "{kinds:?}");
        let twice =
            |s: &SuiteScene| s.ground.is_some() && list.scene.iter().filter(|o| o.ground == s.ground).count() >= 2;
        assert!(list.scene.iter().filter(|s| twice(s)).count() >= 4);
        for entry in &list.scene {
            // Training uses small seeds. Validation and tours use other ranges.
            assert!(entry.synth.as_ref().is_some_and(|s| (400_000..1_000_000).contains(&s.seed)), "{}", entry.name);
        }
    }

    #[test]
    fn paths_are_relative_to_the_list_and_mistakes_are_named() {
        let parse = |scene: &str| List::parse(Path::new("/lists/a.toml"), &format!("name = \"n\"\n[[scene]]\n{scene}"));
        let good = parse("name = \"a\"\ntruth = \"t.tif\"\nimage = \"/else/i.tif\"").unwrap();
        assert_eq!(good.scene[0].truth, Some(PathBuf::from("/lists/t.tif")));
        assert_eq!(good.scene[0].image, Some(PathBuf::from("/else/i.tif")));
        for (scene, expected) in [
            ("name = \"a\"\ntruht = \"t.tif\"", "line 4"),
            ("name = \"a\"", "either synth or truth"),
            ("name = \"a/b\"\ntruth = \"t\"", "letters"),
            ("name = \"a\"\ntruth = \"t\"", "sun_azimuth_deg"),
            (
                "name = \"a\"\ntruth = \"t\"\nimage = \"i\"\nsun_azimuth_deg = nan",
                "-360 to 360 degrees expected, found NaN",
            ),
            (
                "name = \"a\"\ntruth = \"t\"\nimage = \"i\"\nsun_elevation_deg = -1",
                "below 90 degrees expected, found -1",
            ),
            ("name = \"a\"\ntruth = \"t\"\nimage = \"i\"\nsun_elevation_deg = 1e300", "below 90 degrees expected"),
            ("name = \"a\"\ntruth = \"t\"\nimage = \"i\"\nsrs = \"nonsense\"", "nonsense"),
            ("name = \"a\"\nsynth = { seed = 1, options = { row = 3 } }", "row"),
            ("name = \"a\"\nsynth = { seed = 1 }\n[[scene]]\nname = \"a\"\nsynth = { seed = 2 }", "twice"),
        ] {
            let refused = parse(scene).unwrap_err().to_string();
            assert!(refused.contains(expected) && refused.contains("a.toml"), "{refused}");
        }
    }
}
