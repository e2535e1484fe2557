//! Where training tiles come from, as a run records it.

use super::sample::RawTile;
use crate::prepare::{Manifest, Split};
use elunar_net::illumination::KnownSun;
use elunar_raster::Result;
use elunar_synth::{COARSE_PIXEL_M, Moon, SynthOptions};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// A source of tiles; `index` runs without end, and the same index gives the same tile.
pub trait TileSource: Send + Sync {
    /// The tile of an index.
    ///
    /// # Errors
    /// If it cannot be made or read.
    fn tile(&self, index: u64) -> Result<RawTile>;
}

/// A source of tiles by description.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DataSpec {
    /// The synthetic Moon of a seed.
    Synth {
        /// Seed of the Moon; training and validation use different ones.
        seed: u64,
        /// Its options.
        options: SynthOptions,
    },
    /// A folder of `*_image.tif`, `*_coarse.tif`, `*_truth.tif` triples.
    Folder {
        /// The folder.
        path: PathBuf,
    },
    /// A folder written by `prepare`.
    Prepared {
        /// The folder.
        path: PathBuf,
        /// Which of its tiles.
        split: Split,
    },
}

/// The Moon that networks are trained on, wide, since what a network never saw it does not do (our choice): as most NAC DTMs every other
/// tile, finer and coarser ones between them, a Sun that is sometimes low, ground up to three times as rough and patches up to three
/// times as contrasty as usual, photometry and tones that are not the average ground's and a calibrated camera's, and coarse DTMs with
/// stripes and steps.
fn training_moon() -> SynthOptions {
    SynthOptions {
        also_pixel_m: vec![1.0, 2.0, 3.0, 2.0, 1.5, 2.0, 5.0],
        sun_elevation_deg: (7.0, 64.0),
        relief: (0.7, 3.0),
        albedo_contrast: (0.5, 3.0),
        lunar_weight_shift: (-0.3, 0.3),
        response_exponent: (0.7, 1.3),
        pedestal: (0.0, 0.2),
        coarse_stripes_m: (0.0, 1.5),
        ..SynthOptions::default()
    }
}

/// Added to a run's seed to get the seed of its validation Moon.
pub const VALIDATION_SEED: u64 = 0x5EED_0000_0000;

impl DataSpec {
    /// `None` or `synth`: the synthetic Moon of `seed`, in several pixel sizes; anything else is a folder: what `prepare` wrote, of which
    /// `split` is taken, if it has such a manifest, else one of triples.
    ///
    /// # Errors
    /// If there is a manifest that cannot be read.
    pub fn parse(data: Option<PathBuf>, seed: u64, split: Split) -> Result<Self> {
        Ok(match data {
            Some(path) if path.as_os_str() != "synth" => match Manifest::find(&path)? {
                Some(_) => Self::Prepared { path, split },
                None => Self::Folder { path },
            },
            _ => Self::Synth { seed, options: training_moon() },
        })
    }

    /// What to validate on where nothing is named: the validation tiles of a prepared folder, else a Moon of another seed, like the one
    /// trained on if that is one.
    pub fn validation(&self, seed: u64) -> Self {
        match self {
            Self::Prepared { path, .. } => Self::Prepared { path: path.clone(), split: Split::Validation },
            Self::Synth { options, .. } => Self::Synth { seed, options: options.clone() },
            _ => Self::Synth { seed, options: SynthOptions::default() },
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
