//! What a prediction starts from: an image and a coarse DTM on one grid, without gaps, and which pixels are real.

use super::fill::fill_gaps;
use crate::illumination::Turn;
use crate::raster::align::{Interpolation, Named, onto, spacing_ratio};
use crate::raster::{GeoRef, Raster};
use crate::{Error, Result};
use elunar_core::tile::Window;

/// Image and coarse DTM on the image's grid.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Rows of the image.
    pub rows: usize,
    /// Columns of the image.
    pub cols: usize,
    /// Where the image lies.
    pub georef: GeoRef,
    /// Relative brightness, gaps filled from their nearest neighbours.
    pub image: Vec<f32>,
    /// Coarse DTM, metres, interpolated onto the image's grid, gaps filled from their nearest neighbours.
    pub coarse_m: Vec<f32>,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub coarse_px: f32,
    /// Pixels where both inputs are real.
    pub valid: Vec<bool>,
}

impl Scene {
    /// Interpolates `coarse`, which lies on its own grid, onto the grid of `image` (bicubic, through map coordinates).
    ///
    /// # Errors
    /// [`Error::Usage`] if either has no place, their reference systems differ, or no pixel has both a valid image sample and a
    /// valid coarse height.
    pub fn new(image: Named, coarse: Named) -> Result<Self> {
        let raster = image.raster;
        if raster.valid_count() == 0 {
            return Err(Error::usage(format!("{}: at least one valid pixel expected, none found", image.name)));
        }
        let placed = onto(coarse, image, Interpolation::Bicubic)?;
        let coarse_px = spacing_ratio(coarse, image)?;
        let valid: Vec<bool> =
            raster.samples.iter().zip(&placed.samples).map(|(i, z)| i.is_finite() && z.is_finite()).collect();
        if !valid.contains(&true) {
            let what =
                format!("{}: a valid height under a valid pixel of {} expected, none found", coarse.name, image.name);
            return Err(Error::usage(what));
        }
        let georef = raster.georef.clone().ok_or_else(|| Error::usage(format!("{}: no geotransform", image.name)))?;
        let (rows, cols) = (raster.rows, raster.cols);
        let (mut image, mut coarse_m) = (raster.samples.clone(), placed.samples);
        fill_gaps(&mut image, rows, cols);
        fill_gaps(&mut coarse_m, rows, cols);
        Ok(Self { rows, cols, georef, image, coarse_m, coarse_px, valid })
    }

    /// The interpolated coarse DTM as a raster, NaN where it or the image is invalid: what a prediction must beat.
    #[must_use]
    pub fn coarse_raster(&self) -> Raster {
        let samples =
            self.coarse_m.iter().zip(&self.valid).map(|(&z, &valid)| if valid { z } else { f32::NAN }).collect();
        Raster { rows: self.rows, cols: self.cols, samples, georef: Some(self.georef.clone()) }
    }

    /// The scene mirrored; its place is that of the original.
    pub(super) fn turned(&self, turn: Turn) -> Self {
        Self {
            image: turn.apply(&self.image, self.cols),
            coarse_m: turn.apply(&self.coarse_m, self.cols),
            valid: turn.apply(&self.valid, self.cols),
            georef: self.georef.clone(),
            ..*self
        }
    }

    /// Cuts `window` out of `layer`. Beyond the scene its last row and column repeat.
    pub(super) fn cut(&self, layer: &[f32], window: Window, out: &mut Vec<f32>) {
        out.clear();
        for row in window.row..window.row + window.rows {
            let line = &layer[row.min(self.rows - 1) * self.cols..][..self.cols];
            out.extend((window.col..window.col + window.cols).map(|col| line[col.min(self.cols - 1)]));
        }
    }

    /// The valid pixels of `window`; none lie beyond the scene.
    pub(super) fn cut_valid(&self, window: Window, out: &mut Vec<bool>) {
        out.clear();
        for row in window.row..window.row + window.rows {
            let inside = |col: usize| row < self.rows && col < self.cols && self.valid[row * self.cols + col];
            out.extend((window.col..window.col + window.cols).map(inside));
        }
    }
}
