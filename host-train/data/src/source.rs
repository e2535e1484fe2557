//! Sources of training tiles, as a run records them.

use super::sample::RawTile;
use crate::prepare::{Split, TrainingSetManifest};
use elunar_base::Result;
use elunar_net::illumination::KnownSun;
use elunar_net::preset::Preset;
use elunar_synth::{COARSE_PIXEL_M, Moon, SynthOptions};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// A source of tiles. `index` has no upper end. The same index always gives the same tile.
pub trait TileSource: Send + Sync {
    /// Returns the tile of an index.
    ///
    /// # Errors
    /// If the tile cannot be made or read.
    fn tile(&self, index: u64) -> Result<RawTile>;

    /// Returns the number of different tiles; `None` if they never end.
    fn count(&self) -> Option<usize> {
        None
    }

    /// Returns the images that give no tile.
    fn unused(&self) -> &[PathBuf] {
        &[]
    }
}

/// Description of a source of tiles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[expect(clippy::large_enum_variant, reason = "a run has two of them")]
pub enum DataSpec {
    /// The synthetic Moon of a seed.
    Synth {
        /// Seed of the Moon. Training and validation use different seeds.
        seed: u64,
        /// Options of the Moon.
        options: SynthOptions,
    },
    /// A folder of `*_image.tif`, `*_coarse.tif`, `*_truth.tif` triples.
    Folder {
        /// The folder.
        path: PathBuf,
    },
    /// A folder that `prepare` wrote.
    Prepared {
        /// The folder.
        path: PathBuf,
        /// The split of its tiles.
        split: Split,
    },
}

/// Options of the Moon for training: those of the presets (`host-train/models/presets/paper.toml`).
fn training_moon() -> SynthOptions {
    match Preset::Paper.table("data") {
        DataSpec::Synth { options, .. } => options,
        DataSpec::Folder { .. } | DataSpec::Prepared { .. } => SynthOptions::default(),
    }
}

/// The seed of the validation Moon is the run's seed plus this number.
pub const VALIDATION_SEED: u64 = 0x5EED_0000_0000;

impl DataSpec {
    /// Reads a description. `None` or `synth` means the synthetic Moon of `seed`, in several pixel sizes. Anything else is a folder. With a
    /// manifest of `prepare`, the source is its `split`; without one, the folder holds triples.
    ///
    /// # Errors
    /// If the manifest exists and cannot be read.
    pub fn parse(data: Option<PathBuf>, seed: u64, split: Split) -> Result<Self> {
        Ok(match data {
            Some(path) if path.as_os_str() != "synth" => match TrainingSetManifest::find(&path)? {
                Some(_) => Self::Prepared { path, split },
                None => Self::Folder { path },
            },
            _ => Self::Synth { seed, options: training_moon() },
        })
    }

    /// Returns the validation source for a run that names none: the validation tiles of a prepared folder, otherwise a Moon of another
    /// seed. If the training source is a Moon, the validation Moon has its options.
    pub fn validation(&self, seed: u64) -> Self {
        match self {
            Self::Prepared { path, .. } => Self::Prepared { path: path.clone(), split: Split::Validation },
            Self::Synth { options, .. } => Self::Synth { seed, options: options.clone() },
            _ => Self::Synth { seed, options: SynthOptions::default() },
        }
    }

    /// Returns the NR of a prepared folder (Eq. 1: harmonic mean of its training tiles' relief, metres); `None` for other sources.
    ///
    /// # Errors
    /// If the folder's manifest cannot be read.
    pub fn nr(&self) -> Result<Option<f32>> {
        match self {
            Self::Prepared { path, .. } => Ok(TrainingSetManifest::find(path)?.map(|manifest| manifest.nr)),
            _ => Ok(None),
        }
    }

    /// Opens the source.
    ///
    /// # Errors
    /// If options are out of range, or the folder holds no readable triple.
    pub fn open(&self) -> Result<Arc<dyn TileSource>> {
        Ok(match self {
            Self::Synth { seed, options } => Arc::new(SynthSource(Moon::new(*seed, options.clone())?)),
            Self::Folder { path } => Arc::new(super::folder::FolderSource::open(path)?),
            Self::Prepared { path, split } => Arc::new(super::prepared::PreparedSource::open(path, *split)?),
        })
    }
}

/// Tiles of the synthetic Moon.
struct SynthSource(Moon);

impl TileSource for SynthSource {
    fn tile(&self, index: u64) -> Result<RawTile> {
        let tile = self.0.tile(index);
        Ok(RawTile {
            rows: tile.rows,
            cols: tile.cols,
            pixel_m: tile.pixel_m as f32,
            image: tile.image,
            coarse_m: tile.coarse_m,
            truth_m: tile.truth_m,
            coarse_px: (COARSE_PIXEL_M / tile.pixel_m) as f32,
            sun: KnownSun { azimuth_deg: Some(tile.sun_azimuth_deg), elevation_deg: Some(tile.sun_elevation_deg) },
        })
    }
}
