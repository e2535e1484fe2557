//! What a suite found, as it is kept in `results.json`.

use elunar_raster::{Error, Result};
use elunar_scene::evaluate::{CoAlignment, ReliefScores, Scores};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the file.
pub const RESULTS: &str = "results.json";
/// What the coarse DTM is called among the methods.
pub const COARSE: &str = "coarse DTM";

/// All of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// Program and version.
    pub software: String,
    /// Name of the suite.
    pub suite: String,
    /// What it is.
    pub about: String,
    /// SHA-256 of all that its list says: results of another list are others.
    pub list_sha256: String,
    /// What was scored, the coarse DTM first.
    pub methods: Vec<MethodInfo>,
    /// Every scene.
    pub scenes: Vec<SceneResult>,
    /// Every ground that was seen under more than one Sun.
    pub cross: Vec<CrossResult>,
}

/// A method.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MethodInfo {
    /// Name in the tables.
    pub name: String,
    /// Model with hash, or folder.
    pub description: String,
    /// Whether its tiles kept the coarse DTM's low frequencies.
    pub anchor: bool,
    /// How its DTMs were aligned afterwards.
    pub co_alignment: CoAlignment,
    /// Whether it was told where the Sun stands, where the list knows it.
    pub sun_told: bool,
}

/// A scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneResult {
    /// Name.
    pub name: String,
    /// Kind.
    pub kind: String,
    /// Remarks of the list.
    pub remarks: String,
    /// Left out of sums.
    pub weak_truth: bool,
    /// Rows and columns of the truth.
    pub shape: (usize, usize),
    /// Pixel of the truth (row, column), metres.
    pub pixel_m: (f64, f64),
    /// Side of the coarse DTM's pixels, metres.
    pub coarse_m: f64,
    /// Where long and short waves part, metres.
    pub high_pass_m: f64,
    /// Sun: azimuth, elevation, degrees.
    pub sun_deg: (Option<f64>, Option<f64>),
    /// Pixels scored, of so many valid ones.
    pub pixels: (usize, usize),
    /// One per method, in their order.
    #[serde(rename = "judged")]
    pub scored: Vec<MethodScores>,
    /// Pictures in the suite's folder: file, caption.
    pub pictures: Vec<(String, String)>,
}

/// A method on a scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MethodScores {
    /// The method.
    pub method: String,
    /// Heights and slopes.
    pub heights: Scores,
    /// Relief.
    pub relief: ReliefScores,
    /// Seconds that the prediction took; `None` where the DTM was there.
    pub seconds: Option<f64>,
}

/// A ground under several Suns (Fig. 14): how far apart a method's DTMs of it are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CrossResult {
    /// The ground.
    pub ground: String,
    /// The method.
    pub method: String,
    /// The two scenes.
    pub scenes: (String, String),
    /// Root mean square difference of the two DTMs, metres.
    pub difference_m: f64,
    /// Root mean square error of both against the truth, metres.
    pub rmse_m: f64,
    /// The same of the waves below the high-pass wavelength: difference and error.
    pub high_pass_m: (Option<f64>, Option<f64>),
}

impl CrossResult {
    /// Difference over error: 0 if both Suns tell the same, √2 if their errors have nothing in common.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        self.difference_m / self.rmse_m
    }
}

impl Results {
    /// Reads those of a folder.
    ///
    /// # Errors
    /// If the file is missing or malformed.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(RESULTS);
        let text = std::fs::read(&path).map_err(Error::io(&path))?;
        serde_json::from_slice(&text).map_err(|e| Error::broken(&path, format!("results of a suite: {e}")))
    }

    /// Writes them into a folder.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let path = folder.join(RESULTS);
        let text = serde_json::to_vec_pretty(self).map_err(|e| Error::broken(&path, e.to_string()))?;
        elunar_raster::atomic_write(&path, &text)
    }
}
