//! One tile: normalise, run the network, recover metres.

use super::Options;
use super::network::{Normalisation, TileNetwork};
use super::scene::Scene;
use crate::mosaic::{Blend, tile_weights};
use crate::{Error, Result};
use elunar_core::error::NormError;
use elunar_core::norm::{Anchor, ElevationScale, intensity};
use elunar_core::tile::Window;

/// What became of a tile.
pub(super) enum Outcome {
    /// Heights, metres, and their weights in the mosaic.
    Predicted { heights_m: Vec<f32>, weights: Vec<f64> },
    /// The image has no contrast or the coarse DTM no relief here, so there is nothing for the network to work with: the coarse heights
    /// stand.
    Coarse { heights_m: Vec<f32>, weights: Vec<f64> },
    /// No valid pixel.
    Empty,
}

/// A tile as the network sees it, and the way back.
struct Normalised {
    image: Vec<f32>,
    coarse: Vec<f32>,
    scale: ElevationScale,
}

/// A thread's network and the buffers of one tile.
pub(super) struct TileWorker<'a> {
    pub(super) scene: &'a Scene,
    pub(super) network: Box<dyn TileNetwork + 'a>,
    pub(super) normalisation: Normalisation,
    blend: Blend,
    anchor: Option<Anchor>,
    sums: Vec<f64>,
    image: Vec<f32>,
    coarse_m: Vec<f32>,
    valid: Vec<bool>,
    /// Weights of a tile without gaps: nearly all tiles, so they are made once.
    full_weights: Vec<f64>,
}

impl<'a> TileWorker<'a> {
    pub(super) fn new(
        scene: &'a Scene,
        network: Box<dyn TileNetwork + 'a>,
        normalisation: Normalisation,
        options: &Options,
    ) -> Self {
        let (image, coarse_m, valid, sums, full_weights) = (vec![], vec![], vec![], vec![], vec![]);
        let anchor = options.anchor.then(|| Anchor::new(scene.coarse_px));
        Self { scene, network, normalisation, blend: options.blend, anchor, sums, image, coarse_m, valid, full_weights }
    }

    /// Predicts `window` of the scene.
    ///
    /// # Errors
    /// If the network fails, or gives a height that is not finite.
    pub(super) fn run(&mut self, window: Window) -> Result<Outcome> {
        self.scene.cut_valid(window, &mut self.valid);
        if !self.valid.contains(&true) {
            return Ok(Outcome::Empty);
        }
        self.scene.cut(&self.scene.image, window, &mut self.image);
        self.scene.cut(&self.scene.coarse_m, window, &mut self.coarse_m);
        let weights = self.weights(window);
        let Some(Normalised { image, coarse, scale }) = self.normalised()? else {
            return Ok(Outcome::Coarse { heights_m: self.coarse_m.clone(), weights });
        };
        let mut normalised = vec![0.0; image.len()];
        self.network.predict(&image, &coarse, &mut normalised)?;
        let mut heights_m = coarse;
        scale.recover(&normalised, &mut heights_m).map_err(|e| Error::usage(e.to_string()))?;
        if let Some(i) = heights_m.iter().position(|z| !z.is_finite()) {
            let (row, col) = (window.row + i / window.cols, window.col + i % window.cols);
            return Err(Error::usage(format!(
                "the model gave {} at row {row}, column {col}; a finite height expected",
                heights_m[i]
            )));
        }
        if let Some(anchor) = self.anchor {
            self.sums.resize(Anchor::sums_len(window.rows, window.cols), 0.0);
            // The normalised heights have served; their room does for the difference.
            anchor
                .apply(&mut heights_m, &self.coarse_m, window.cols, &mut normalised, &mut self.sums)
                .map_err(|e| Error::usage(e.to_string()))?;
        }
        Ok(Outcome::Predicted { heights_m, weights })
    }

    fn weights(&mut self, window: Window) -> Vec<f64> {
        let (rows, cols) = (window.rows, window.cols);
        if self.valid.contains(&false) {
            return tile_weights(&self.valid, rows, cols, self.blend);
        }
        if self.full_weights.len() != self.valid.len() {
            self.full_weights = tile_weights(&self.valid, rows, cols, self.blend);
        }
        self.full_weights.clone()
    }

    /// Image in [0, 1], coarse DTM in [0, NR] (Eq. 2 and Sec. III-A2, by the tile's own ranges), and the way back to metres. `None` for
    /// a tile without contrast or relief.
    fn normalised(&self) -> Result<Option<Normalised>> {
        let nothing_to_see = |e: NormError| match e {
            NormError::ConstantImage | NormError::Relief { .. } | NormError::TooFewValid { .. } => Ok(None),
            other => Err(Error::usage(other.to_string())),
        };
        // Filled pixels count: they hold values of real neighbours, so they widen no range by much and need no clamping.
        let Normalisation { nr, range_margin, .. } = self.normalisation;
        let scale =
            ElevationScale::from_heights(&self.coarse_m, None, nr).and_then(|scale| scale.with_margin(range_margin));
        let scale = match scale {
            Ok(scale) => scale,
            Err(e) => return nothing_to_see(e),
        };
        let (mut image, mut coarse) = (vec![0.0; self.image.len()], vec![0.0; self.coarse_m.len()]);
        if let Err(e) = intensity::normalise(&self.image, None, &mut image) {
            return nothing_to_see(e);
        }
        scale.normalise(&self.coarse_m, &mut coarse).map_err(|e| Error::usage(e.to_string()))?;
        Ok(Some(Normalised { image, coarse, scale }))
    }
}
