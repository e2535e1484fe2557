//! Mare and highland: the numbers in which they differ, each with its source.

use super::field::Spectrum;
use serde::{Deserialize, Serialize};

/// The two terrains of the Moon.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum TerrainKind {
    /// Basalt plains: smooth, dark.
    Mare,
    /// Old crust: rough, bright.
    Highland,
}

/// What a kind of terrain is made of.
#[derive(Debug, Clone, Copy)]
pub(super) struct Recipe {
    /// Spectral terrain, craters not included.
    pub spectrum: Spectrum,
    /// Diameter above which craters are as many as were ever formed, and below which as many as equilibrium allows, metres.
    pub saturation_diameter_m: f64,
}

impl TerrainKind {
    /// The recipe of this kind. The spectra are fitted so that terrain *with* craters has the structure function of the
    /// NAC DTMs in [`super::structure`]. Saturation diameters: our choice, a 3.5 Ga mare saturates up to about 120 m, older
    /// highland up to about 500 m.
    pub(super) fn recipe(self) -> Recipe {
        match self {
            Self::Mare => Recipe {
                spectrum: Spectrum { corner_rms_m: 0.19, corner_m: 100.0, hurst_long: 1.20, hurst_short: 1.4 },
                saturation_diameter_m: 120.0,
            },
            Self::Highland => Recipe {
                spectrum: Spectrum { corner_rms_m: 0.61, corner_m: 100.0, hurst_long: 1.17, hurst_short: 1.1 },
                saturation_diameter_m: 500.0,
            },
        }
    }
}
