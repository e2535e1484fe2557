//! What the tile loop needs of a network, float or int8.

use crate::Result;
use crate::model::config::{Illumination, TargetRange};
use elunar_core::nn::InputRules;

/// How a model wants its tiles normalised, and how its output turns back into metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Normalisation {
    /// Upper end of the normalised elevation range, NR (Eq. 1).
    pub nr: f32,
    /// Share of the coarse relief by which the range is widened below and above; 0 is the paper's Eq. 2.
    pub range_margin: f32,
    /// Whose range normalised the truth in training.
    pub target_range: TargetRange,
    /// Which light the network knows.
    pub illumination: Illumination,
}

impl Normalisation {
    /// The same, as `core` says it.
    #[must_use]
    pub fn input_rules(&self) -> InputRules {
        let (truth_range, illumination) = (self.target_range.into(), self.illumination.into());
        InputRules { nr: self.nr, range_margin: self.range_margin, truth_range, illumination }
    }

    /// Samples of the image in every pixel.
    #[must_use]
    pub fn image_maps(&self) -> usize {
        if self.illumination == Illumination::Given { elunar_core::photoclinometry::MAPS } else { 1 }
    }
}

/// A loaded model: immutable, shared by all threads.
pub trait Model: Sync {
    /// Tile rows and columns the model takes.
    fn tile(&self) -> (usize, usize);
    /// How tiles are normalised.
    fn normalisation(&self) -> Normalisation;
    /// One line for file metadata: kind, name, SHA-256 of the model file.
    fn description(&self) -> String;
    /// A worker with its own scratch memory; one per thread.
    ///
    /// # Errors
    /// If the worker's memory cannot be set up.
    fn worker(&self) -> Result<Box<dyn TileNetwork + '_>>;
}

/// One thread's instance of a model.
pub trait TileNetwork {
    /// Predicts one tile. `image` in [0, 1] (or a guide's maps, four in every pixel), `coarse` in [0, NR] (or pixels), `output` in the same
    /// units as `coarse` (a residual head may leave the range slightly); all row-major `rows * cols`.
    ///
    /// # Errors
    /// If the network reports a fault.
    fn predict(&mut self, image: &[f32], coarse: &[f32], output: &mut [f32]) -> Result<()>;
}
