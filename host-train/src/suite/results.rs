//! Results of a suite, as in `results.json`.

use elunar_base::{Error, Result, read};
use elunar_evaluate::{CoAlignment, ReliefScores, Scores, Spectral};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the file.
pub const RESULTS: &str = "results.json";
/// Name of the coarse DTM among the methods.
pub const COARSE: &str = "coarse DTM";
/// Name of the pipeline without training among the methods.
pub const UNTRAINED: &str = "untrained";
/// Name of the bound for linear methods among the methods.
pub const LINEAR_BOUND: &str = "linear-bound";
/// Name of the bound that knows the scene's own truth.
pub const LINEAR_OWN: &str = "linear-own";

/// All results of a suite.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SuiteResults {
    /// Program and version.
    pub software: String,
    /// Name of the suite.
    pub suite: String,
    /// Description of the suite.
    pub about: String,
    /// SHA-256 of the list's content. It identifies the list of the results.
    pub list_sha256: String,
    /// The methods: the coarse DTM, the pipeline without training, then the others.
    pub methods: Vec<MethodInfo>,
    /// All scenes.
    pub scenes: Vec<SceneResult>,
    /// All grounds under more than one Sun.
    pub cross: Vec<CrossResult>,
}

/// A method.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MethodInfo {
    /// Name in the tables.
    pub name: String,
    /// Model with hash, or folder.
    pub description: String,
    /// Whether its tiles keep the coarse DTM's low frequencies.
    pub anchor: bool,
    /// Co-alignment of its DTMs.
    pub co_alignment: CoAlignment,
    /// Whether the Sun's direction is given to it, if the list states it.
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
    /// Whether the scene is left out of summaries.
    pub weak_truth: bool,
    /// Rows and columns of the truth.
    pub shape: (usize, usize),
    /// Pixel of the truth (row, column), metres.
    pub pixel_m: (f64, f64),
    /// Side of the coarse DTM's pixels, metres.
    pub coarse_m: f64,
    /// Wavelength that separates long and short waves, metres.
    pub high_pass_m: f64,
    /// Azimuth and elevation of the Sun, degrees.
    pub sun_deg: (Option<f64>, Option<f64>),
    /// Number of pixels scored, and of all valid pixels.
    pub pixels: (usize, usize),
    /// Scores of each method, in the order of the methods.
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
    /// Scores of heights and slopes.
    pub heights: Scores,
    /// Scores of the relief.
    pub relief: ReliefScores,
    /// Octaves, effective resolution and offset; `None` for a scene that is too small or has too many voids.
    #[serde(default)]
    pub spectral: Option<Spectral>,
    /// Seconds of the prediction; `None` for an existing DTM.
    pub seconds: Option<f64>,
}

impl MethodScores {
    /// Returns the half-coherence wavelength, metres; `None` if there is none.
    #[must_use]
    pub fn half_coherence_m(&self) -> Option<f64> {
        Some(self.spectral.as_ref()?.half_coherence?.wavelength_m)
    }
}

/// Comparison of a method's DTMs of a ground under two Suns (Fig. 14).
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
    /// Difference and error of the waves below the high-pass wavelength, metres.
    pub high_pass_m: (Option<f64>, Option<f64>),
}

impl CrossResult {
    /// Returns difference over error: 0 if both DTMs are equal, √2 if their errors are independent.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        self.difference_m / self.rmse_m
    }
}

impl SuiteResults {
    /// Reads the results of a folder.
    ///
    /// # Errors
    /// If the file is missing or malformed.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(RESULTS);
        let text = read::bytes(&path, read::MOST_BYTES)?;
        serde_json::from_slice(&text).map_err(|e| Error::broken(&path, format!("results of a suite: {e}")))
    }

    /// Writes the results into a folder.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let path = folder.join(RESULTS);
        let text = serde_json::to_vec_pretty(self).map_err(|e| Error::broken(&path, e.to_string()))?;
        elunar_base::atomic_write(&path, &text)
    }
}
