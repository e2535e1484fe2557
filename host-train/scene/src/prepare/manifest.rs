//! What is in a prepared folder, and how it came there.

use super::list::SceneFiles;
use elunar_raster::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the manifest in its folder.
pub const MANIFEST: &str = "manifest.json";

/// What the field `format` of a manifest says.
pub const FORMAT: &str = "elunar prepared tiles 1";

/// What a tile is used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// Training.
    Train,
    /// Choosing weights during training.
    Validation,
    /// Nothing until the end.
    Test,
}

impl Split {
    /// All, in order.
    pub const ALL: [Self; 3] = [Self::Train, Self::Validation, Self::Test];

    /// As in file names.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Validation => "validation",
            Self::Test => "test",
        }
    }
}

/// Why a tile was left out; the first that applies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// Image or a DTM has a gap in it.
    Nulls,
    /// All pixels of the image are alike.
    ConstantImage,
    /// Too many pixels at the brightest value, or more than a quarter at the darkest.
    SaturatedImage,
    /// One of the DTMs is level.
    NoRelief,
    /// Image and true DTM lie too far apart.
    Offset,
    /// The reliefs of true and coarse DTM differ beyond 3 sigma (Eq. 9–10).
    ThreeSigma,
    /// It lies across the border between two splits.
    BetweenSplits,
}

/// What was asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    /// How both DTMs were put on the image's grid: `bicubic`, `bilinear` or `cubicspline`.
    pub interpolation: String,
    /// Unit of the coarse DTM's heights, where the file does not say it: `m` or `km`; `None` for metres that have to look like it.
    pub coarse_unit: Option<String>,
    /// Largest offset between image and true DTM, pixels.
    pub max_offset_px: f64,
    /// How far an offset is looked for each way, pixels.
    pub search_px: usize,
    /// Least correlation between image and hillshade at which an offset counts as measured.
    pub min_correlation: f64,
    /// Largest share of pixels at the brightest value of a tile.
    pub max_saturated: f64,
    /// Shares of training, validation and test wanted; they sum to one.
    pub shares: [f64; 3],
    /// Tiles in a shard.
    pub shard_tiles: usize,
    /// Seed of what is drawn at random: the order of equal sites, and the contact sheet.
    pub seed: u64,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            interpolation: "bicubic".into(),
            coarse_unit: None,
            max_offset_px: 2.0,
            search_px: 8,
            min_correlation: 0.3,
            max_saturated: 0.01,
            shares: [0.8, 0.1, 0.1],
            shard_tiles: 64,
            seed: 0,
        }
    }
}

/// The 3-sigma rule (Eq. 9–10) as it was applied.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ThreeSigma {
    /// μ: mean of ΔZ_N − ΔZ_S, metres.
    pub mean_m: f64,
    /// σ: standard deviation of ΔZ_N − ΔZ_S, metres.
    pub sigma_m: f64,
}

/// One scene of the set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneRecord {
    /// Its files.
    #[serde(flatten)]
    pub files: SceneFiles,
    /// SHA-256 of image, DTM and coarse DTM.
    pub sha256: [String; 3],
    /// Reference system of image and tiles, in words.
    pub system: String,
    /// Ground size of a pixel from row to row and from column to column, metres.
    pub pixel_m: [f64; 2],
    /// Side of a pixel of the coarse DTM, in pixels of the image.
    pub coarse_px: f32,
    /// Azimuth of the Sun that was used, degrees clockwise from up.
    pub azimuth_used_deg: Option<f64>,
    /// Median offset of the true DTM from the image over the tiles where it was measured: pixels downwards, pixels to the right.
    pub offset_px: Option<[f64; 2]>,
    /// Tiles where the offset was measured.
    pub offset_measured: usize,
    /// Whole tiles.
    pub tiles: usize,
    /// Tiles kept.
    pub kept: usize,
    /// Tiles left out, by reason.
    pub dropped: BTreeMap<Reason, usize>,
}

/// One file of a split.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ShardRecord {
    /// Its name in the folder.
    pub file: String,
    /// Tiles in it.
    pub tiles: usize,
    /// SHA-256 of the file.
    pub sha256: String,
}

/// One split.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, Default)]
pub struct SplitRecord {
    /// Tiles in all its shards.
    pub tiles: usize,
    /// Sites it has tiles of.
    pub sites: Vec<String>,
    /// Its shards, in order.
    pub shards: Vec<ShardRecord>,
}

/// A prepared folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`FORMAT`].
    pub format: String,
    /// Program and version that made it.
    pub made_by: String,
    /// Rows and columns of a tile.
    pub tile: [usize; 2],
    /// What was asked for.
    pub parameters: Parameters,
    /// NR (Eq. 1): harmonic mean of the true relief of the training tiles, metres; of all tiles where none is for training.
    pub nr: f32,
    /// The 3-sigma rule as it was applied.
    pub three_sigma: ThreeSigma,
    /// Whole tiles of all scenes.
    pub tiles: usize,
    /// Tiles kept.
    pub kept: usize,
    /// Tiles left out, by reason.
    pub dropped: BTreeMap<Reason, usize>,
    /// How the ground was divided: by site, or in blocks along an axis of the map.
    pub divided_by: String,
    /// Training, validation and test.
    pub splits: BTreeMap<Split, SplitRecord>,
    /// The scenes, in order; tiles name them by their number.
    pub scenes: Vec<SceneRecord>,
}

impl Manifest {
    /// The manifest of a folder; `None` if it has none, or one of something else.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read, [`Error::Broken`] if it says it is one of these and is not.
    pub fn find(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(MANIFEST);
        let bytes = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(Error::Io { path, source: e }),
        };
        let Ok(value) = serde_json::from_slice::<serde_json::Value>(&bytes) else { return Ok(None) };
        if value["format"] != FORMAT {
            return Ok(None);
        }
        serde_json::from_value(value).map(Some).map_err(|e| Error::broken(&path, e.to_string()))
    }
}
