//! Contents and provenance of a prepared folder.

use super::list::SceneFiles;
use elunar_base::{Error, Result, read};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the manifest in its folder.
pub const MANIFEST: &str = "manifest.json";

/// Value of a manifest's field `format`.
pub const FORMAT: &str = "elunar prepared tiles 1";

/// Value of a manifest's field `made_by`.
pub const MADE_BY: &str = concat!("host-train ", env!("CARGO_PKG_VERSION"));

/// Use of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// Training.
    Train,
    /// Choice of weights during training.
    Validation,
    /// Final evaluation only.
    Test,
}

impl Split {
    /// All splits, in order.
    pub const ALL: [Self; 3] = [Self::Train, Self::Validation, Self::Test];

    /// Returns the name as in file names.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Validation => "validation",
            Self::Test => "test",
        }
    }
}

/// Reason for dropping a tile. If several apply, it is the first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// Image or a DTM has a gap.
    Nulls,
    /// All pixels of the image are equal.
    ConstantImage,
    /// Too many pixels at the brightest value, or more than a quarter at the darkest.
    SaturatedImage,
    /// One of the DTMs is constant.
    NoRelief,
    /// The offset between image and true DTM is too large.
    Offset,
    /// The reliefs of true and coarse DTM differ beyond 3 sigma (Eq. 9–10).
    ThreeSigma,
    /// The tile lies across the border between two splits.
    BetweenSplits,
}

/// Options of a preparation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PrepareOptions {
    /// Interpolation of both DTMs onto the image's grid: `bicubic`, `bilinear` or `cubicspline`.
    pub interpolation: String,
    /// Unit of the coarse DTM's heights, if the file does not state it: `m` or `km`. `None` means metres; heights that look like kilometres
    /// are then refused.
    pub coarse_unit: Option<String>,
    /// Largest offset between image and true DTM, pixels.
    pub max_offset_px: f64,
    /// Greatest offset that is searched in each direction, pixels.
    pub search_px: usize,
    /// Least correlation between image and hillshade for a valid offset.
    pub min_correlation: f64,
    /// Largest share of pixels at the brightest value of a tile.
    pub max_saturated: f64,
    /// Desired shares of training, validation and test. Their sum is 1.
    pub shares: [f64; 3],
    /// Number of tiles in a shard.
    pub shard_tiles: usize,
    /// Seed of random choices: the order of equal sites, and the contact sheet.
    pub seed: u64,
}

impl Default for PrepareOptions {
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
    /// Files of the scene.
    #[serde(flatten)]
    pub files: SceneFiles,
    /// SHA-256 of image, DTM and coarse DTM.
    pub sha256: [String; 3],
    /// Description of the reference system of image and tiles.
    pub system: String,
    /// Ground size of a pixel from row to row and from column to column, metres.
    pub pixel_m: [f64; 2],
    /// Side of a pixel of the coarse DTM, in pixels of the image.
    pub coarse_px: f32,
    /// Azimuth of the Sun that was used, degrees clockwise from up.
    pub azimuth_used_deg: Option<f64>,
    /// Median offset of the true DTM from the image, over tiles with a measured offset: pixels down, pixels to the right.
    pub offset_px: Option<[f64; 2]>,
    /// Number of tiles with a measured offset.
    pub offset_measured: usize,
    /// Number of whole tiles.
    pub tiles: usize,
    /// Number of tiles kept.
    pub kept: usize,
    /// Number of tiles dropped, by reason.
    pub dropped: BTreeMap<Reason, usize>,
}

/// One file of a split.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ShardRecord {
    /// File name within the folder.
    pub file: String,
    /// Number of tiles in the file.
    pub tiles: usize,
    /// SHA-256 of the file.
    pub sha256: String,
}

/// One split.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, Default)]
pub struct SplitRecord {
    /// Number of tiles in all its shards.
    pub tiles: usize,
    /// Sites with tiles in the split.
    pub sites: Vec<String>,
    /// Its shards, in order.
    pub shards: Vec<ShardRecord>,
}

/// A prepared folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainingSetManifest {
    /// [`FORMAT`].
    pub format: String,
    /// Program and version that made the folder.
    pub made_by: String,
    /// Rows and columns of a tile.
    pub tile: [usize; 2],
    /// Options of the preparation.
    pub parameters: PrepareOptions,
    /// NR (Eq. 1): harmonic mean of the true relief of the training tiles, metres. Without training tiles, of all tiles.
    pub nr: f32,
    /// The 3-sigma rule as it was applied.
    pub three_sigma: ThreeSigma,
    /// Number of whole tiles of all scenes.
    pub tiles: usize,
    /// Number of tiles kept.
    pub kept: usize,
    /// Number of tiles dropped, by reason.
    pub dropped: BTreeMap<Reason, usize>,
    /// Division of the ground: by site, or in blocks along an axis of the map.
    pub divided_by: String,
    /// The three splits.
    pub splits: BTreeMap<Split, SplitRecord>,
    /// The scenes, in order. Tiles refer to them by number.
    pub scenes: Vec<SceneRecord>,
}

impl TrainingSetManifest {
    /// Reads the manifest of a folder; `None` if there is none, or one of another program.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read, [`Error::Broken`] if it has this format's name and is not valid.
    pub fn find(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(MANIFEST);
        let bytes = match read::bytes(&path, read::MOST_BYTES) {
            Ok(bytes) => bytes,
            Err(Error::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(error),
        };
        let Ok(value) = serde_json::from_slice::<serde_json::Value>(&bytes) else { return Ok(None) };
        if value["format"] != FORMAT {
            return Ok(None);
        }
        serde_json::from_value(value).map(Some).map_err(|e| Error::broken(&path, e.to_string()))
    }
}
