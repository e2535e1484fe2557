//! One tile: normalise, run the network, recover metres.

use super::Options;
use super::neighbourhoods::SceneLight;
use super::network::{Model, TileNetwork};
use super::scene::{Band, Cutout, Scene};
use crate::mosaic::OverlapWeights;
use elunar_base::{Error, Result};
use elunar_core::nn::{InputRules, Lighting, TileInput, TileLight};
use elunar_core::norm::Anchor;
use elunar_core::photoclinometry::{Errors, ExpectedErrors};
use elunar_core::tile::{Shape, Window};
use elunar_net::input::InputMaps;

/// Farthest that a network's height may lie outside the coarse heights of its tile, metres (our choice: more than any relief of a body).
const MOST_CHANGE_M: f32 = 1e6;

/// Result of a tile.
pub(crate) enum Outcome {
    /// Maps, and their weights in the mosaic.
    Predicted { maps: TileResult, weights: Vec<f64> },
    /// The image has no contrast or the coarse DTM has no relief here. The network cannot use such a tile, so the coarse heights are kept.
    Coarse { maps: TileResult, weights: Vec<f64> },
    /// No valid pixel.
    Empty,
}

/// The maps that a tile contributes to the scene: heights, metres; and if wanted the parts of [`Errors`].
pub(crate) struct TileResult(pub(crate) Vec<Vec<f32>>);

impl TileResult {
    /// Number of maps with expected errors.
    pub(crate) const LAYERS: usize = 5;

    /// Returns heights with their expected errors under an image; NaN where nothing is known.
    fn expecting(heights_m: Vec<f32>, image: &[f32], errors: &ExpectedErrors) -> Self {
        let at = |part: fn(Errors) -> f32| image.iter().map(|v| part(errors.at(*v))).collect();
        Self(vec![heights_m, at(|e| e.height_m), at(|e| e.slope), at(|e| e.explained), at(|e| e.dark)])
    }
}

impl From<Vec<f32>> for TileResult {
    fn from(heights_m: Vec<f32>) -> Self {
        Self(vec![heights_m])
    }
}

/// Settings that all tiles of a job share.
#[derive(Debug, Clone)]
pub(super) struct Rules {
    pub(super) input: InputRules,
    /// Rows and columns of the scene.
    pub(super) scene: Shape,
    /// The light of the scene.
    pub(super) light: SceneLight,
    /// Ground size of a pixel, metres.
    pub(super) pixel_m: f32,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub(super) coarse_px: f32,
    pub(super) anchor: Option<Anchor>,
    pub(super) expected_errors: bool,
    /// What messages call the model.
    pub(super) model: String,
}

impl Rules {
    /// Makes the rules for a model, a scene and its light.
    pub(super) fn new(model: &dyn Model, light: SceneLight, scene: &Scene, options: &Options) -> Self {
        let (input, model) = (model.input_rules(), model.description());
        let anchor = options.anchor.then(|| Anchor::new(scene.coarse_px));
        let (pixel_m, coarse_px) = (scene.pixel_m, scene.coarse_px);
        Self {
            input,
            scene: Shape::new(scene.rows, scene.cols),
            light,
            pixel_m,
            coarse_px,
            anchor,
            expected_errors: options.expected_errors,
            model,
        }
    }
}

/// A thread's network and its buffers.
pub(super) struct TileWorker<'a> {
    network: Box<dyn TileNetwork + 'a>,
    rules: Rules,
    sums: Vec<f64>,
    scratch: Vec<f32>,
    weights: OverlapWeights,
}

impl<'a> TileWorker<'a> {
    pub(super) fn new(network: Box<dyn TileNetwork + 'a>, rules: Rules) -> Self {
        let weights = OverlapWeights::new(rules.scene);
        Self { network, rules, sums: vec![], scratch: vec![], weights }
    }

    /// Predicts `window` of the scene. `band` holds the window's rows.
    ///
    /// # Errors
    /// If the network fails, or returns a height that is not finite or far outside the coarse heights.
    pub(super) fn run(&mut self, band: &Band, window: Window) -> Result<Outcome> {
        let Some(Cutout { image, coarse_m, valid }) = band.cut(window, self.rules.input.illumination.is_guided())
        else {
            return Ok(Outcome::Empty);
        };
        let weights = self.weights(&valid, window);
        let light = self.rules.light.of(window);
        match self.maps(&image, &coarse_m, window, light)? {
            Some(tile) => {
                let errors = tile.expected.unwrap_or(ExpectedErrors::UNKNOWN);
                let heights_m = self.predicted(tile, &coarse_m, window, light)?;
                Ok(Outcome::Predicted { maps: self.result(heights_m, &image, &errors), weights })
            }
            None => {
                let Rules { pixel_m, coarse_px, .. } = self.rules;
                let errors = if self.rules.input.illumination.is_weighed() {
                    ExpectedErrors::of_coarse(&coarse_m, window.cols, pixel_m, coarse_px)
                } else {
                    ExpectedErrors::UNKNOWN
                };
                Ok(Outcome::Coarse { maps: self.result(coarse_m, &image, &errors), weights })
            }
        }
    }

    fn result(&self, heights_m: Vec<f32>, image: &[f32], errors: &ExpectedErrors) -> TileResult {
        if self.rules.expected_errors { TileResult::expecting(heights_m, image, errors) } else { heights_m.into() }
    }

    /// Prepares a tile; `None` for one without contrast or relief.
    fn maps(&mut self, image: &[f32], coarse_m: &[f32], window: Window, light: Lighting) -> Result<Option<InputMaps>> {
        let Rules { input, pixel_m, coarse_px, .. } = self.rules;
        let light = TileLight::Scene(light);
        // Filled pixels count in the ranges. They hold values of valid neighbours, so they hardly widen a range and need no clamping.
        let tile = TileInput { image, coarse_m, valid: None, pixel_m, coarse_px, light };
        match InputMaps::new(&input, window.shape(), &tile, &mut self.scratch) {
            Ok(maps) => Ok(Some(maps)),
            Err(e) if e.nothing_to_see() => Ok(None),
            Err(e) => Err(Error::input(e.to_string())),
        }
    }

    /// Returns the heights of a normalised tile, metres.
    fn predicted(&mut self, tile: InputMaps, coarse_m: &[f32], window: Window, light: Lighting) -> Result<Vec<f32>> {
        let InputMaps { image, coarse, scale, .. } = tile;
        let mut heights_m = vec![0.0; coarse.len()];
        self.network.predict(&image, &coarse, &mut heights_m)?;
        scale.recover(window.shape(), &mut heights_m);
        self.check(&heights_m, coarse_m, window)?;
        if let Some(anchor) = self.rules.anchor {
            self.sums.resize(Anchor::sums_len(window.rows, window.cols), 0.0);
            // The normalised heights are no longer needed. Their memory is used for the difference.
            let mut difference = coarse;
            anchor
                .apply(&mut heights_m, coarse_m, window.cols, &mut difference, &mut self.sums)
                .and_then(|()| scale.fine.apply(&mut heights_m, coarse_m, window.cols, &mut difference, &mut self.sums))
                .map_err(|e| Error::input(e.to_string()))?;
        }
        if self.rules.input.illumination.is_weighed() {
            light.settle(&mut heights_m, coarse_m);
        }
        Ok(heights_m)
    }

    /// Refuses heights that no ground has: the weights are broken, or overflow.
    fn check(&self, heights_m: &[f32], coarse_m: &[f32], window: Window) -> Result<()> {
        let range = |(low, high): (f32, f32), z: &f32| (low.min(*z), high.max(*z));
        let (low, high) = coarse_m.iter().fold((f32::INFINITY, f32::NEG_INFINITY), range);
        let (low, high) = (low - MOST_CHANGE_M, high + MOST_CHANGE_M);
        let Some(height) = heights_m.iter().find(|z| !(low..=high).contains(*z)) else { return Ok(()) };
        let (model, row, col) = (&self.rules.model, window.row, window.col);
        let what = format!("heights of {low} to {high} m expected in the tile at row {row}, column {col}");
        Err(Error::input(format!("{model}: {what}, {height} found")))
    }

    fn weights(&mut self, valid: &[bool], window: Window) -> Vec<f64> {
        let weight = |(&weight, &valid): (&f64, &bool)| if valid { weight } else { 0.0 };
        self.weights.of(window).iter().zip(valid).map(weight).collect()
    }
}
