//! Mare and highland: the figures in which they differ, with their sources.

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

/// Parameters of a kind of terrain.
#[derive(Debug, Clone, Copy)]
pub(super) struct Recipe {
    /// Spectrum of the terrain without craters.
    pub spectrum: Spectrum,
    /// Diameter above which there are as many craters as were ever formed, and below which as many as the equilibrium allows, metres.
    pub saturation_diameter_m: f64,
}

impl TerrainKind {
    /// Returns the recipe of this kind. The spectra are fitted so that terrain *with* craters has the structure function of the NAC DTMs in
    /// [`super::structure`]. Saturation diameters are our choice: a 3.5 Ga mare saturates up to about 120 m, older highland up to about 500
    /// m.
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
