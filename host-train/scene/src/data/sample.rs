//! One tile as the network sees it: normalised image, coarse DTM and truth.

use crate::illumination::{self, KnownSun, Light, Turn, turned};
use crate::model::config::{Illumination, NetConfig, TargetRange};
use crate::{Error, Result};
use elunar_core::norm::{Anchor, ElevationScale, intensity};
use elunar_core::photoclinometry::{Guide, GuideInput, Photoclinometry};

/// A tile in metres and relative brightness; the source of a [`Sample`].
#[derive(Debug, Clone)]
pub struct RawTile {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Ground size of a pixel, metres.
    pub pixel_m: f32,
    /// Relative brightness.
    pub image: Vec<f32>,
    /// Coarse DTM on the image's grid, metres.
    pub coarse_m: Vec<f32>,
    /// True DTM, metres.
    pub truth_m: Vec<f32>,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub coarse_px: f32,
    /// What is known of the Sun.
    pub sun: KnownSun,
    /// How brightness answers to slope; found by [`RawTile::lit_for`].
    pub light: Option<Light>,
}

impl RawTile {
    /// The tile with a truth that a network can reach: at the wavelengths the coarse DTM resolves it has the coarse heights,
    /// errors included, since no image shows those ([`Anchor`]).
    ///
    /// # Errors
    /// [`Error::Usage`] if the maps differ in size.
    pub fn anchored(mut self) -> Result<Self> {
        let (mut difference, mut sums) =
            (vec![0.0; self.truth_m.len()], vec![0.0; Anchor::sums_len(self.rows, self.cols)]);
        Anchor::new(self.coarse_px)
            .apply(&mut self.truth_m, &self.coarse_m, self.cols, &mut difference, &mut sums)
            .map_err(|e| Error::usage(format!("tile: {e}")))?;
        Ok(self)
    }

    /// The tile mirrored so that the Sun shines from where `illumination` wants it, with its light: from what is known of the Sun,
    /// the rest fitted.
    pub fn lit_for(self, illumination: Illumination) -> Self {
        if illumination == Illumination::Any {
            return self;
        }
        let pixel_m = f64::from(self.pixel_m);
        let fit = illumination::fit_of(&self.image, &self.coarse_m, self.cols, pixel_m, self.coarse_px);
        let (turn, light) = illumination::light_for(illumination, self.sun, &fit);
        let apply = |map: &[f32]| turned(turn, map, self.cols);
        Self {
            image: apply(&self.image),
            coarse_m: apply(&self.coarse_m),
            truth_m: apply(&self.truth_m),
            // Mirrored with the ground; nobody asks again.
            sun: KnownSun::default(),
            light: Some(light),
            ..self
        }
    }
}

/// A normalised tile.
#[derive(Debug, Clone)]
pub struct Sample {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// What the network sees of the image, its maps side by side in every pixel ([`NetConfig::image_maps`]).
    pub image: Vec<f32>,
    /// Coarse DTM in [0, NR], or in pixels.
    pub coarse: Vec<f32>,
    /// Truth in the same unit: in [0, NR] (own range), about that (reference range), or in pixels.
    pub truth: Vec<f32>,
    /// How the coarse DTM was normalised: turns the network's output into metres (Eq. 8).
    pub scale: ElevationScale,
}

impl Sample {
    /// Normalises a tile as `config` wants it (Eq. 2, Sec. III-A2).
    ///
    /// # Errors
    /// [`Error::Usage`] if the tile has no relief or a constant image.
    pub fn new(config: &NetConfig, tile: &RawTile) -> Result<Self> {
        let bad = |e: &dyn std::fmt::Display| Error::usage(format!("tile cannot be normalised: {e}"));
        let n = tile.rows * tile.cols;
        let mut sample = Self {
            rows: tile.rows,
            cols: tile.cols,
            image: vec![0.0; config.image_maps() * n],
            coarse: vec![0.0; n],
            truth: vec![0.0; n],
            scale: coarse_scale(config, &tile.coarse_m, tile.pixel_m)?,
        };
        match (config.illumination, tile.light) {
            (Illumination::Given, Some(light)) => {
                let plan = Photoclinometry::new((tile.rows, tile.cols));
                let mut scratch = vec![0.0; plan.scratch_len()];
                let RawTile { image, coarse_m, coarse_px, .. } = tile;
                // Already mirrored.
                let turn = Turn::default();
                let input = GuideInput { image, coarse_m, valid: None, turn, coarse_px: *coarse_px };
                let guide = Guide::new(&plan, input, &sample.scale, light, &mut scratch);
                guide.and_then(|guide| guide.fill(&mut sample.image, &mut sample.coarse)).map_err(|e| bad(&e))?;
            }
            (Illumination::Given, None) => return Err(bad(&"expected its light, found none")),
            _ => {
                intensity::normalise(&tile.image, None, &mut sample.image).map_err(|e| bad(&e))?;
                sample.scale.normalise(&tile.coarse_m, &mut sample.coarse).map_err(|e| bad(&e))?;
            }
        }
        let truth_scale = match config.target_range {
            TargetRange::Reference | TargetRange::Pixel => sample.scale,
            TargetRange::Own => ElevationScale::from_heights(&tile.truth_m, None, config.nr).map_err(|e| bad(&e))?,
        };
        truth_scale.normalise(&tile.truth_m, &mut sample.truth).map_err(|e| bad(&e))?;
        Ok(sample)
    }

    /// A window of the normalised tile, mirrored as asked; image and heights turn together, so light and shape stay consistent.
    pub fn window(&self, [top, left]: [usize; 2], [rows, cols]: [usize; 2], turn: Turn) -> Self {
        let cut = |map: &[f32]| -> Vec<f32> {
            let maps = map.len() / (self.rows * self.cols);
            let mut out = Vec::with_capacity(maps * rows * cols);
            for i in 0..rows {
                out.extend_from_slice(&map[maps * ((top + i) * self.cols + left)..][..maps * cols]);
            }
            // Slopes have a direction; networks that are given them are never mirrored.
            if turn.is_none() { out } else { turned(turn, &out, cols) }
        };
        Self {
            rows,
            cols,
            image: cut(&self.image),
            coarse: cut(&self.coarse),
            truth: cut(&self.truth),
            scale: self.scale,
        }
    }
}

/// The scale a coarse tile is normalised with: its own range, widened by the configured margin; or pixels.
///
/// # Errors
/// [`Error::Usage`] if the tile has no relief.
pub fn coarse_scale(config: &NetConfig, coarse_m: &[f32], pixel_m: f32) -> Result<ElevationScale> {
    let scale = match config.target_range {
        TargetRange::Pixel => ElevationScale::from_pixel(coarse_m, None, pixel_m, config.nr),
        _ => ElevationScale::from_heights(coarse_m, None, config.nr).and_then(|s| s.with_margin(config.range_margin)),
    };
    scale.map_err(|e| Error::usage(format!("coarse DTM tile cannot be normalised: {e}")))
}
