//! What a run took and found, for programs.

use super::Tally;
use super::errors::Origins;
use super::neighbourhoods::Change;
use super::sigma::{CoarseSigma, TrackSigma};
use super::sun::{AngleSource, KnownFrom};
use elunar_net::illumination::{LightSource, Lighting};
use serde::Serialize;

/// A finished run, for one JSON object.
#[derive(Debug, Clone, Serialize)]
pub struct PredictionRecord {
    /// File of the image.
    pub image: String,
    /// File of the coarse DTM.
    pub coarse: String,
    /// Description of the model, with its hash.
    pub model: String,
    /// File of the DTM.
    pub output: String,
    /// The file of expected errors, if one was wanted.
    pub uncertainty: Option<ErrorsRecord>,
    /// Rows of the DTM.
    pub rows: usize,
    /// Columns of the DTM.
    pub cols: usize,
    /// Ground size of a pixel, metres.
    pub pixel_m: f32,
    /// Side of a pixel of the coarse DTM, in pixels of the image.
    pub coarse_px: f32,
    /// Lowest height, metres.
    pub lowest_m: f32,
    /// Highest height, metres.
    pub highest_m: f32,
    /// Pixels with a height.
    pub pixels_valid: usize,
    /// Pixels without a height: image or coarse DTM is invalid there.
    pub pixels_void: usize,
    /// Share of the image's valid pixels that the coarse DTM covers, 0 to 1, of the rows that were surveyed.
    pub coarse_covers: Option<f64>,
    /// Number of tiles, by their result.
    pub tiles: Tiles,
    /// The light; `None` if the network takes none.
    pub light: Option<LightRecord>,
    /// Share of the image's contrast that is relief under this light, 0 to 1; `None` if the light's direction is unknown.
    pub share_of_relief: Option<f32>,
    /// The warnings, as printed.
    pub warnings: Vec<String>,
    /// Time from start to end, seconds.
    pub seconds: f64,
    /// Of it, the phases.
    pub phases: Phases,
}

/// Times of the phases of a run, seconds. What is left of the whole is the start: inputs are opened and hashed.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Phases {
    /// Survey of the scene and warnings.
    pub survey_s: f64,
    /// Tiles, and their finished rows on disk and compressed; 0 for `join`.
    pub tiles_s: f64,
    /// The DTM is put together and hashed, its hillshade made; `join` also compresses.
    pub write_s: f64,
}

impl PredictionRecord {
    /// Returns the record as JSON. What is not a number is `null`.
    ///
    /// # Panics
    /// Never: all keys are texts.
    #[must_use]
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).expect("keys are texts")
    }
}

/// A file of expected errors.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ErrorsRecord {
    /// The file.
    pub file: String,
    /// Standard deviation of the coarse DTM's own heights, metres.
    pub coarse_sigma_m: f32,
    /// Who says so: `told`, `assumed` or `tracks`.
    pub coarse_sigma_from: &'static str,
    /// Correlation length of its errors, metres: they have a covariance of sigma^2 exp(-distance / length).
    pub coarse_correlation_m: f32,
    /// Who says so: `assumed`, `tracks`, or `tracks, at least`.
    pub coarse_correlation_from: &'static str,
    /// What was found along laser altimeter tracks, if they say so.
    pub tracks: Option<TrackSigma>,
    /// Heights that the image explains.
    pub pixels_from_image: u64,
    /// Heights that image and coarse DTM explain together.
    pub pixels_blended: u64,
    /// Heights of the coarse DTM.
    pub pixels_from_coarse: u64,
    /// Heights in shadow.
    pub pixels_in_shadow: u64,
}

impl ErrorsRecord {
    /// Makes the record of a file with these origins of heights.
    #[must_use]
    pub fn new(file: &std::path::Path, sigma: CoarseSigma, origins: &Origins) -> Self {
        let [pixels_from_image, pixels_blended, pixels_from_coarse, pixels_in_shadow, _] = *origins;
        let file = file.display().to_string();
        Self {
            file,
            coarse_sigma_m: sigma.sigma_m,
            coarse_sigma_from: sigma.from.word(),
            coarse_correlation_m: sigma.correlation_m,
            coarse_correlation_from: sigma.correlation_from(),
            tracks: sigma.from.tracks(),
            pixels_from_image,
            pixels_blended,
            pixels_from_coarse,
            pixels_in_shadow,
        }
    }
}

/// Number of tiles, by their result ([`Tally`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Tiles {
    /// Tiles of the scene.
    pub all: usize,
    /// Tiles made by an earlier run.
    pub before: usize,
    /// Tiles without contrast or relief. They keep the coarse heights.
    pub coarse: usize,
    /// Tiles without a valid pixel.
    pub empty: usize,
}

/// A light, its uncertainty and its origin.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LightRecord {
    /// `given`, `fitted` or `assumed`.
    pub source: &'static str,
    /// Azimuth of the Sun, degrees clockwise from the grid's up.
    pub azimuth_deg: f64,
    /// Standard deviation of the azimuth, degrees; 0 for a known azimuth.
    pub azimuth_sd_deg: f32,
    /// Contrast of a unit slope.
    pub strength: f32,
    /// Standard deviation of the logarithm of the strength.
    pub log_strength_sd: f32,
    /// Elevation of a Sun of this strength, degrees.
    pub elevation_deg: f64,
    /// Expected share of relief that has the right direction, 0 to 1.
    pub trust: f32,
    /// Probability that brightness follows the slopes of the coarse DTM at all, 0 to 1. Heights move towards the coarse DTM's as it falls.
    pub related: f32,
    /// Share of the contrast of waves of 2 to 8 coarse pixels that is relief under this light, 0 to 1; `None` if the scene shows no slopes.
    pub long_share: Option<f32>,
    /// Whether the azimuth is from the image's file.
    pub azimuth_from_file: bool,
    /// Whether the elevation is from the image's file.
    pub elevation_from_file: bool,
    /// Whether the azimuth is that of the image's time.
    pub azimuth_from_time: bool,
    /// Whether the elevation is that of the image's time.
    pub elevation_from_time: bool,
    /// How it changes across the scene; `None` if the scene has one light.
    pub change: Option<Change>,
}

impl LightRecord {
    /// Makes the record of a light; `None` if the network takes none.
    #[must_use]
    pub fn new(lighting: &Lighting, change: Option<Change>, sun: &KnownFrom) -> Option<Self> {
        let Lighting { light, source, trust, related, long_share, log_strength_sd, azimuth_sd_deg } = *lighting;
        let source = match source {
            LightSource::NotAsked => return None,
            LightSource::Given => "given",
            LightSource::Fitted => "fitted",
            LightSource::Assumed => "assumed",
        };
        Some(Self {
            source,
            azimuth_deg: light.azimuth_deg(),
            azimuth_sd_deg,
            strength: light.strength(),
            log_strength_sd,
            elevation_deg: light.elevation_deg(),
            trust,
            related,
            long_share,
            azimuth_from_file: sun.azimuth_from == AngleSource::File,
            elevation_from_file: sun.elevation_from == AngleSource::File,
            azimuth_from_time: sun.azimuth_from == AngleSource::Time,
            elevation_from_time: sun.elevation_from == AngleSource::Time,
            change,
        })
    }
}

impl From<&Tally> for Tiles {
    fn from(tally: &Tally) -> Self {
        let Tally { tiles, tiles_before, tiles_coarse, tiles_empty, .. } = *tally;
        Self { all: tiles, before: tiles_before, coarse: tiles_coarse, empty: tiles_empty }
    }
}
