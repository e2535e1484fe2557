//! One scene: three maps on the image's grid.

use super::list::SceneFiles;
use elunar_base::{Error, Result};
use elunar_core::norm::LightFit;
use elunar_core::terrain::PixelSize;
use elunar_core::tile::{TILE_COLS, TILE_ROWS, Window};
use elunar_picture::shading::pixel_of;
use elunar_raster::align::{Interpolation, Onto};
use elunar_raster::heights;
use elunar_raster::source::{self, Info, Source};
use elunar_raster::stated::{HeightUnit, Statements};
use std::path::Path;
use std::sync::Arc;

/// Greatest side of the area in which the Sun's azimuth is estimated, pixels. It has enough relief and is quick to read.
const AZIMUTH_PX: usize = 2048;

/// How files are read.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reading {
    pub(super) interpolation: Interpolation,
    pub(super) coarse_unit: Option<HeightUnit>,
}

/// Image, DTM and coarse DTM on the image's grid, read in windows.
pub(super) struct PreparedScene {
    image: Arc<dyn Source>,
    dtm: Onto,
    coarse: Onto,
    /// Ground size of a pixel.
    pub(super) pixel: PixelSize,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub(super) coarse_px: f32,
    /// Azimuth of the Sun, degrees clockwise from up: as listed, otherwise as estimated. `None` if neither is available.
    pub(super) sun_azimuth_deg: Option<f64>,
}

/// The three maps of one tile, row-major 256 x 320.
pub(super) struct SceneMaps {
    /// Relative brightness.
    pub(super) image: Vec<f32>,
    /// Coarse DTM, metres.
    pub(super) coarse_m: Vec<f32>,
    /// True DTM, metres.
    pub(super) truth_m: Vec<f32>,
}

impl PreparedScene {
    /// Opens the files and computes how both DTMs are put on the image's grid.
    ///
    /// # Errors
    /// If a file cannot be opened or has no georeference, the files do not overlap, or the coarse DTM is finer than the image.
    pub(super) fn open(files: &SceneFiles, reading: Reading) -> Result<Self> {
        let name = |path: &Path| path.display().to_string();
        let (image_name, dtm_name, coarse_name) = (name(&files.image), name(&files.dtm), name(&files.coarse));
        let stated = Statements { unit: reading.coarse_unit, srs: None };
        let (image, dtm, coarse): (Arc<dyn Source>, Arc<dyn Source>, Arc<dyn Source>) = (
            source::open(&files.image)?.into(),
            heights::open(&files.dtm)?.into(),
            heights::open_with(&files.coarse, stated, None)?.into(),
        );
        let pixel = pixel_of(image.as_ref(), &image_name)?;
        let coarse_px = (coarse.info().side_m(&coarse_name)? / image.info().side_m(&image_name)?) as f32;
        if coarse_px < 1.0 {
            return Err(Error::input(format!(
                "{coarse_name}: pixels no smaller than those of {image_name} expected, {coarse_px:.3} of their side found"
            )));
        }
        let onto = |source, name: &str| Onto::new(source, name, image.info(), &image_name, reading.interpolation);
        let (dtm, coarse) = (onto(dtm, &dtm_name)?, onto(coarse, &coarse_name)?);
        let pixel = PixelSize { row_m: pixel.row_m.abs(), col_m: pixel.col_m.abs() };
        let mut scene = Self { image, dtm, coarse, pixel, coarse_px, sun_azimuth_deg: files.sun_azimuth_deg };
        if scene.sun_azimuth_deg.is_none() {
            scene.sun_azimuth_deg = scene.estimate_azimuth_deg()?;
        }
        Ok(scene)
    }

    /// Estimates the azimuth in the middle of the scene, by the slopes of the true DTM.
    fn estimate_azimuth_deg(&self) -> Result<Option<f64>> {
        let Info { rows: all_rows, cols: all_cols, .. } = *self.image.info();
        let (rows, cols) = (all_rows.min(AZIMUTH_PX), all_cols.min(AZIMUTH_PX));
        let window = Window { row: (all_rows - rows) / 2, col: (all_cols - cols) / 2, rows, cols };
        let pixel_m = (self.pixel.row_m * self.pixel.col_m).sqrt();
        let (image, dtm_m) = (self.image.read(window)?, self.dtm.read(window)?);
        let fit = LightFit::of_tile(&image[..], &dtm_m, cols, pixel_m, self.coarse_px);
        Ok(fit.estimate(None, None).map(|found| found.light.azimuth_deg()))
    }

    /// Returns all whole tiles, row by row, without overlap. The rest at the right and lower edge is left out.
    pub(super) fn windows(&self) -> Vec<Window> {
        let (down, across) = (self.image.info().rows / TILE_ROWS, self.image.info().cols / TILE_COLS);
        let window = |k: usize| Window {
            row: k / across * TILE_ROWS,
            col: k % across * TILE_COLS,
            rows: TILE_ROWS,
            cols: TILE_COLS,
        };
        (0..down * across).map(window).collect()
    }

    /// Reads the maps of a tile.
    ///
    /// # Errors
    /// If a file cannot be read there.
    pub(super) fn maps(&self, window: Window) -> Result<SceneMaps> {
        Ok(SceneMaps {
            image: self.image.read(window)?,
            coarse_m: self.coarse.read(window)?,
            truth_m: self.dtm.read(window)?,
        })
    }

    /// Returns the pixel-to-map transform of a tile.
    pub(super) fn transform(&self, window: Window) -> [f64; 6] {
        let mut t = self.image.info().georef.as_ref().map_or([0.0, 1.0, 0.0, 0.0, 0.0, 1.0], |georef| georef.transform);
        let (row, col) = (window.row as f64, window.col as f64);
        t[0] += col * t[1] + row * t[2];
        t[3] += col * t[4] + row * t[5];
        t
    }

    /// Returns a short description of the reference system.
    pub(super) fn system(&self) -> String {
        self.image.info().georef.as_ref().map_or_else(String::new, |georef| georef.crs.summary())
    }
}
