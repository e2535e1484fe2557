//! One tile: normalise, run the network, recover metres.

use super::Options;
use super::network::{Normalisation, TileNetwork};
use super::scene::{Band, Scene};
use crate::illumination::{Light, Turn, turned};
use crate::model::config::{Illumination, TargetRange};
use crate::mosaic::{Blend, OverlapWeights};
use crate::{Error, Result};
use elunar_core::error::NormError;
use elunar_core::norm::{Anchor, ElevationScale, intensity};
use elunar_core::photoclinometry::{Guide, GuideInput, MAPS, Photoclinometry};
use elunar_core::tile::Window;

/// What became of a tile.
pub(crate) enum Outcome {
    /// Heights, metres, and their weights in the mosaic.
    Predicted { heights_m: Vec<f32>, weights: Vec<f64> },
    /// The image has no contrast or the coarse DTM no relief here, so there is nothing for the network to work with: the coarse heights
    /// stand.
    Coarse { heights_m: Vec<f32>, weights: Vec<f64> },
    /// No valid pixel.
    Empty,
}

/// What all tiles of a job have in common.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rules {
    pub(super) normalisation: Normalisation,
    /// Rows and columns of the scene.
    pub(super) scene: (usize, usize),
    /// How tiles are mirrored before the network and back after it.
    pub(super) turn: Turn,
    /// How brightness answers to slope in a mirrored tile.
    pub(super) light: Light,
    /// Ground size of a pixel, metres.
    pub(super) pixel_m: f32,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub(super) coarse_px: f32,
    pub(super) blend: Blend,
    pub(super) anchor: Option<Anchor>,
}

impl Rules {
    pub(super) fn new(
        normalisation: Normalisation,
        (turn, light): (Turn, Light),
        scene: &Scene,
        options: &Options,
    ) -> Self {
        let anchor = options.anchor.then(|| Anchor::new(scene.coarse_px));
        let (pixel_m, coarse_px, blend) = (scene.pixel_m, scene.coarse_px, options.blend);
        Self { normalisation, scene: (scene.rows, scene.cols), turn, light, pixel_m, coarse_px, blend, anchor }
    }
}

/// A thread's network and what it keeps between tiles.
pub(super) struct TileWorker<'a> {
    network: Box<dyn TileNetwork + 'a>,
    rules: Rules,
    sums: Vec<f64>,
    weights: OverlapWeights,
}

/// A tile as the network sees it, and the way back.
struct Normalised {
    image: Vec<f32>,
    coarse: Vec<f32>,
    scale: ElevationScale,
}

impl<'a> TileWorker<'a> {
    pub(super) fn new(network: Box<dyn TileNetwork + 'a>, rules: Rules) -> Self {
        let weights = OverlapWeights::new(rules.scene, rules.blend);
        Self { network, rules, sums: vec![], weights }
    }

    /// Predicts `window` of the scene, of which `band` holds the rows.
    ///
    /// # Errors
    /// If the network fails, or gives a height that is not finite.
    pub(super) fn run(&mut self, band: &Band, window: Window) -> Result<Outcome> {
        let valid = band.cut_valid(window);
        if !valid.contains(&true) {
            return Ok(Outcome::Empty);
        }
        let (image, coarse_m) = (band.cut(&band.image, window), band.cut(&band.coarse_m, window));
        let weights = self.weights(&valid, window);
        let turn = self.rules.turn;
        let mirrored = |map: Vec<f32>| if turn.is_none() { map } else { turned(turn, &map, window.cols) };
        let (image, coarse_m) = (mirrored(image), mirrored(coarse_m));
        let heights_m = match normalised(&self.rules, &image, &coarse_m, window.cols)? {
            Some(tile) => self.predicted(tile, &coarse_m, window)?,
            None => return Ok(Outcome::Coarse { heights_m: mirrored(coarse_m), weights }),
        };
        Ok(Outcome::Predicted { heights_m: mirrored(heights_m), weights })
    }

    /// Heights of a normalised tile, metres.
    fn predicted(&mut self, tile: Normalised, coarse_m: &[f32], window: Window) -> Result<Vec<f32>> {
        let Normalised { image, coarse, scale } = tile;
        let mut normalised = vec![0.0; coarse.len()];
        self.network.predict(&image, &coarse, &mut normalised)?;
        let mut heights_m = coarse;
        scale.recover(&normalised, &mut heights_m).map_err(|e| Error::usage(e.to_string()))?;
        if let Some(height) = heights_m.iter().find(|z| !z.is_finite()) {
            let (row, col) = (window.row, window.col);
            let what = format!("the model gave {height} in the tile at row {row}, column {col}");
            return Err(Error::usage(format!("{what}; a finite height expected")));
        }
        if let Some(anchor) = self.rules.anchor {
            self.sums.resize(Anchor::sums_len(window.rows, window.cols), 0.0);
            // The normalised heights have served; their room does for the difference.
            anchor
                .apply(&mut heights_m, coarse_m, window.cols, &mut normalised, &mut self.sums)
                .map_err(|e| Error::usage(e.to_string()))?;
        }
        Ok(heights_m)
    }

    fn weights(&mut self, valid: &[bool], window: Window) -> Vec<f64> {
        let weight = |(&weight, &valid): (&f64, &bool)| if valid { weight } else { 0.0 };
        self.weights.of(window).iter().zip(valid).map(weight).collect()
    }
}

/// Image in [0, 1], coarse DTM in [0, NR] (Eq. 2 and Sec. III-A2, by the tile's own ranges), or a guide's maps, and the way back to
/// metres. `None` for a tile without contrast or relief.
fn normalised(rules: &Rules, image: &[f32], coarse_m: &[f32], cols: usize) -> Result<Option<Normalised>> {
    let rule = &rules.normalisation;
    let nothing_to_see = |e: NormError| match e {
        NormError::ConstantImage | NormError::Relief { .. } | NormError::TooFewValid { .. } => Ok(None),
        other => Err(Error::usage(other.to_string())),
    };
    // Filled pixels count: they hold values of real neighbours, so they widen no range by much and need no clamping.
    let scale = match rule.target_range {
        TargetRange::Pixel => ElevationScale::from_pixel(coarse_m, None, rules.pixel_m, rule.nr),
        _ => ElevationScale::from_heights(coarse_m, None, rule.nr).and_then(|s| s.with_margin(rule.range_margin)),
    };
    let scale = match scale {
        Ok(scale) => scale,
        Err(e) => return nothing_to_see(e),
    };
    let made = match rule.illumination {
        Illumination::Given => guided(rules, (image, coarse_m), &scale, cols),
        _ => ranged(image, coarse_m, &scale),
    };
    match made {
        Ok((image, coarse)) => Ok(Some(Normalised { image, coarse, scale })),
        Err(e) => nothing_to_see(e),
    }
}

type Maps = (Vec<f32>, Vec<f32>);

fn ranged(image: &[f32], coarse_m: &[f32], scale: &ElevationScale) -> std::result::Result<Maps, NormError> {
    let (mut bright, mut coarse) = (vec![0.0; image.len()], vec![0.0; coarse_m.len()]);
    intensity::normalise(image, None, &mut bright)?;
    scale.normalise(coarse_m, &mut coarse)?;
    Ok((bright, coarse))
}

fn guided(
    rules: &Rules,
    (image, coarse_m): (&[f32], &[f32]),
    scale: &ElevationScale,
    cols: usize,
) -> std::result::Result<Maps, NormError> {
    let plan = Photoclinometry::new((image.len() / cols, cols));
    let mut scratch = vec![0.0; plan.scratch_len()];
    // Already mirrored.
    let turn = Turn::default();
    let input = GuideInput { image, coarse_m, valid: None, turn, coarse_px: rules.coarse_px };
    let guide = Guide::new(&plan, input, scale, rules.light, &mut scratch)?;
    let (mut maps, mut coarse) = (vec![0.0; MAPS * image.len()], vec![0.0; coarse_m.len()]);
    guide.fill(&mut maps, &mut coarse)?;
    Ok((maps, coarse))
}
