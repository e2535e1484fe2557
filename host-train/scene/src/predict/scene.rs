//! Input of a prediction: an image and a coarse DTM on one grid, read one band of rows at a time.

use super::neighbourhoods::{Parts, SceneLight};
use super::run::TileProgress;
use super::survey::{ImageBrightness, Survey};
use elunar_base::{Error, Result};
use elunar_core::fill::fill_gaps;
use elunar_core::nn::Illumination;
use elunar_core::norm::LightFit;
use elunar_core::photoclinometry::{Contrast, Photoclinometry};
use elunar_core::samples::Samples;
use elunar_core::terrain::PixelSize;
use elunar_core::tile::{Shape, TILE_COLS, TILE_ROWS, Window};
use elunar_net::illumination::{KnownSun, Lighting};
use elunar_raster::align::{Interpolation, Onto};
use elunar_raster::source::{InMemory, Source};
use elunar_raster::stated::Statements;
use elunar_raster::{Crs, GeoRef, Raster, heights};
use rayon::prelude::*;
use std::ops::{ControlFlow, Range};
use std::sync::Arc;

/// A raster open for reading, with its name in messages.
#[derive(Clone)]
pub struct NamedRaster {
    /// File name, or a description of the raster.
    pub name: String,
    /// The raster.
    pub source: Arc<dyn Source>,
}

impl NamedRaster {
    /// Opens an image. A stated system replaces that of the file. Samples stored as `nodata` are invalid, too.
    ///
    /// # Errors
    /// As [`elunar_raster::source::open`] and [`Statements::of`].
    pub fn image(path: &std::path::Path, srs: Option<Crs>, nodata: Option<f64>) -> Result<Self> {
        let name = path.display().to_string();
        let source = Statements { srs, unit: None }.of(&name, elunar_raster::source::open_with(path, nodata)?)?;
        Ok(Self { name, source: source.into() })
    }

    /// Opens a raster of heights. The user's statements replace those of the file. Samples stored as `nodata` are invalid, too.
    ///
    /// # Errors
    /// As [`elunar_raster::heights::open_with`].
    pub fn heights(path: &std::path::Path, stated: Statements, nodata: Option<f64>) -> Result<Self> {
        Ok(Self { name: path.display().to_string(), source: heights::open_with(path, stated, nodata)?.into() })
    }

    /// Makes an input from a raster in memory.
    #[must_use]
    pub fn in_memory(name: impl Into<String>, raster: Raster) -> Self {
        Self { name: name.into(), source: Arc::new(InMemory::new(raster, None, "memory")) }
    }
}

/// Image and coarse DTM on the image's grid, from files or memory.
pub struct Scene {
    /// Rows of the image.
    pub rows: usize,
    /// Columns of the image.
    pub cols: usize,
    /// Georeference of the image.
    pub georef: GeoRef,
    /// Ground size of a pixel of the image, metres.
    pub pixel_m: f32,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub coarse_px: f32,
    pub(super) image: NamedRaster,
    pub(super) coarse_name: String,
    pub(super) coarse: Onto,
}

/// Some whole rows of a scene; gaps are not finite.
#[derive(Debug, Clone)]
pub struct Band {
    /// First row in the scene.
    pub first: usize,
    /// Rows.
    pub rows: usize,
    /// Columns: those of the scene, or of a part of it.
    pub cols: usize,
    /// Relative brightness.
    pub image: Vec<f32>,
    /// Coarse DTM, metres.
    pub coarse_m: Vec<f32>,
}

/// Maps of a tile, row-major, and which of its pixels are valid.
pub(crate) struct Cutout {
    /// Relative brightness. Gaps are filled from their nearest neighbours within the tile.
    pub(crate) image: Vec<f32>,
    /// Coarse DTM, metres. Gaps are filled.
    pub(crate) coarse_m: Vec<f32>,
    /// Pixels where both inputs are valid. Pixels beyond the scene are never valid.
    pub(crate) valid: Vec<bool>,
}

/// Rows that a survey reads at once, and the greatest number of such blocks. Long strips are sampled, because a scene has one light.
const SURVEY_ROWS: usize = 960;
const SURVEY_BLOCKS: usize = 16;

impl Scene {
    /// Pairs an image with a coarse DTM. The coarse DTM is interpolated onto the image's grid (bicubic, through map coordinates) when it is
    /// read.
    ///
    /// # Errors
    /// [`Error::Input`] if either has no georeference, their reference systems differ, or a pixel size is unknown.
    pub fn new(image: NamedRaster, coarse: NamedRaster) -> Result<Self> {
        let georef = place(&image)?.clone();
        place(&coarse)?;
        let side_m = |input: &NamedRaster| input.source.info().side_m(&input.name);
        let pixel_m = side_m(&image)?;
        let coarse_px = (side_m(&coarse)? / pixel_m) as f32;
        let (rows, cols) = (image.source.info().rows, image.source.info().cols);
        if coarse_px < 1.0 {
            let what = format!("{}: expected a DTM coarser than {}", coarse.name, image.name);
            let info = coarse.source.info();
            let doubt = info.georef.as_ref().and_then(|georef| georef.doubt(info.rows, info.cols));
            let or = doubt.map_or_else(String::new, |doubt| format!(" Or: {doubt}"));
            return Err(Error::input(format!(
                "{what}, found pixels {coarse_px:.2} times as wide as the image's: were the two exchanged?{or}"
            )));
        }
        let info = image.source.info();
        let placed = Onto::new(coarse.source, &coarse.name, info, &image.name, Interpolation::Bicubic)?;
        let (pixel_m, coarse_name) = (pixel_m as f32, coarse.name);
        Ok(Self { rows, cols, georef, pixel_m, coarse_px, image, coarse_name, coarse: placed })
    }

    /// Reads rows `first..first + rows`.
    ///
    /// # Errors
    /// If rows lie outside the scene or a file cannot be read there.
    pub fn band(&self, first: usize, rows: usize) -> Result<Band> {
        let window = Window { row: first, col: 0, rows, cols: self.cols };
        let (image, coarse_m) = (self.image.source.read(window)?, self.coarse.read(window)?);
        Ok(Band { first, rows, cols: self.cols, image, coarse_m })
    }

    /// Reads rows as [`Self::band`] does, but those that the band `before` has, which begins above them, are taken from it.
    ///
    /// # Errors
    /// As [`Self::band`].
    pub(super) fn band_after(&self, before: Option<&Band>, first: usize, rows: usize) -> Result<Band> {
        let end = |band: &Band| band.first + band.rows;
        let Some(band) = before.filter(|band| band.first <= first && first < end(band)) else {
            return self.band(first, rows);
        };
        let kept = (end(band) - first).min(rows);
        let of_kept = |map: &[f32]| map[(first - band.first) * self.cols..][..kept * self.cols].to_vec();
        let [mut image, mut coarse_m] = [&band.image, &band.coarse_m].map(|map| of_kept(map));
        if kept < rows {
            let rest = self.band(first + kept, rows - kept)?;
            image.extend(rest.image);
            coarse_m.extend(rest.coarse_m);
        }
        Ok(Band { first, rows, cols: self.cols, image, coarse_m })
    }

    /// Returns the error for a scene without valid pixels.
    #[must_use]
    pub fn nothing_valid(&self) -> Error {
        let (coarse, image) = (&self.coarse_name, &self.image.name);
        Error::input(format!("{coarse}: expected valid heights under valid pixels of {image}, found none"))
    }

    /// Returns the interpolated coarse DTM as a raster, NaN where it or the image is invalid. It is the baseline of a prediction.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn coarse_raster(&self) -> Result<Raster> {
        let band = self.band(0, self.rows)?;
        let samples = band.valid().zip(&band.coarse_m).map(|(valid, &z)| if valid { z } else { f32::NAN }).collect();
        Ok(Raster { rows: self.rows, cols: self.cols, samples, georef: Some(self.georef.clone()) })
    }

    /// Returns the scene's light for a network that expects `illumination`. Unknown parts of the Sun's direction are fitted to the scene.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn light_for(&self, illumination: Illumination, sun: KnownSun) -> Result<SceneLight> {
        let survey = if Lighting::wants_fit(illumination, sun) { self.survey()? } else { Survey::default() };
        Ok(survey.light(illumination, sun))
    }

    /// Surveys all rows of a small scene, or evenly spread rows of a long one.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn survey(&self) -> Result<Survey> {
        self.survey_with(&mut |_, _| ControlFlow::Continue(()))
    }

    /// Surveys as [`Self::survey`] does. `progress` receives the blocks of rows that are done, and all; it can stop the survey between them.
    ///
    /// # Errors
    /// [`Error::Stopped`] if it does; otherwise as [`Self::survey`].
    pub fn survey_with(&self, progress: TileProgress) -> Result<Survey> {
        let (mut light, mut range) = (LightFit::default(), (f32::INFINITY, f32::NEG_INFINITY));
        let (mut brightness, mut covered_pixels) = (ImageBrightness::default(), 0);
        let mut contrast = Contrast::default();
        let mut parts = Parts::new(self.coarse_px);
        let (pixel, cell_px) = (PixelSize::square(f64::from(self.pixel_m)), LightFit::cell_px(self.coarse_px));
        let blocks = self.rows.div_ceil(SURVEY_ROWS).min(SURVEY_BLOCKS);
        let rows = self.rows.min(SURVEY_ROWS);
        // Evenly spread, with the last block at the end.
        let read = |block: usize| self.band((self.rows - rows) * block / (blocks - 1).max(1), rows);
        let mut ahead = (blocks > 0).then(|| read(0));
        for block in 0..blocks {
            if progress(block, blocks).is_break() {
                return Err(Error::stopped(format!("stopped in the survey, after {block} of {blocks} blocks of rows")));
            }
            let Some(band) = ahead.take().transpose()? else { break };
            let of_pixels = || {
                for (&z, is_valid) in band.coarse_m.iter().zip(band.valid()) {
                    // Without a branch, so that the compiler can use vectors.
                    covered_pixels += u64::from(is_valid);
                    range.0 = if is_valid { range.0.min(z) } else { range.0 };
                    range.1 = if is_valid { range.1.max(z) } else { range.1 };
                }
                brightness.add(&band.image);
                // Cells with a void are left out.
                light.add(&band.image[..], &band.coarse_m, self.cols, pixel, cell_px);
            };
            let of_parts = || {
                band.add_contrast(&mut contrast, self.coarse_px);
                parts.add(&band, pixel);
            };
            // The next block is read meanwhile.
            let next = || (block + 1 < blocks).then(|| read(block + 1));
            (ahead, _) = rayon::join(next, || rayon::join(of_pixels, of_parts));
        }
        let (row_m, col_m) = self.georef.pixel_m(self.rows, self.cols).unwrap_or((0.0, 0.0));
        Ok(Survey {
            light: light.with_axis(contrast.axis()),
            contrast,
            parts,
            brightness,
            covered_pixels,
            lowest_m: range.0,
            highest_m: range.1,
            extent_m: (rows as f64 * row_m).max(self.cols as f64 * col_m),
        })
    }
}

/// Returns the georeference of `input`, which must be complete.
fn place(input: &NamedRaster) -> Result<&GeoRef> {
    input.source.info().place(&input.name).map_err(|error| {
        let unnamed = input.source.info().georef.as_ref().is_some_and(|georef| georef.crs.is_empty());
        let hint = if unnamed { "; state one with --image-srs or --coarse-srs" } else { "" };
        Error::input(format!("{error}{hint}"))
    })
}

/// Returns where parts of a length begin that cover a whole: as few as can, evenly spread, so that a mirrored image is divided alike.
fn spread(whole: usize, part: usize) -> Vec<usize> {
    let gaps = whole.div_ceil(part.max(1)).saturating_sub(1);
    (0..=gaps).map(|i| (whole - part) * i / gaps.max(1)).collect()
}

/// Returns a rectangle of a map.
fn cut(map: &[f32], width: usize, rows: Range<usize>, cols: Range<usize>) -> Vec<f32> {
    let mut part = Vec::with_capacity(rows.len() * cols.len());
    rows.for_each(|row| part.extend_from_slice(&map[row * width..][cols.clone()]));
    part
}

/// Fills the gaps of a map.
fn close_gap(map: &mut [f32], cols: usize) {
    fill_gaps(map, cols, &mut vec![0.0; map.len()]).expect("whole rows, and a queue of their length");
}

impl Band {
    /// Adds the contrast of the band's image, tile by tile. Tiles overlap as far as they must to cover the band, and count for its area.
    /// Voids have no contrast.
    pub(super) fn add_contrast(&self, contrast: &mut Contrast, coarse_px: f32) {
        let tile = Shape::new(TILE_ROWS.min(self.rows), TILE_COLS.min(self.cols));
        let (tops, lefts) = (spread(self.rows, tile.rows), spread(self.cols, tile.cols));
        let corners: Vec<(usize, usize)> =
            tops.iter().flat_map(|&top| lefts.iter().map(move |&left| (top, left))).collect();
        let weight = (self.rows * self.cols) as f64 / (corners.len() * tile.pixels()).max(1) as f64;
        let scratch = || vec![0.0; Photoclinometry::new(tile).scratch_len()];
        let of_tile = |scratch: &mut Vec<f32>, &(top, left): &(usize, usize)| {
            let image = cut(&self.image, self.cols, top..top + tile.rows, left..left + tile.cols);
            // Darkness and sameness have no contrast.
            Contrast::of_image(&image[..], tile, coarse_px, scratch).ok()
        };
        let found: Vec<Option<Contrast>> = corners.par_iter().map_init(scratch, of_tile).collect();
        // In order, so that the sum does not depend on the number of threads.
        found.iter().flatten().for_each(|found| contrast.add_weighted(found, weight));
    }

    /// Returns a rectangle of the band.
    pub(super) fn part(&self, rows: Range<usize>, cols: Range<usize>) -> Self {
        let [image, coarse_m] =
            [&self.image, &self.coarse_m].map(|map| cut(map, self.cols, rows.clone(), cols.clone()));
        Self { first: self.first + rows.start, rows: rows.len(), cols: cols.len(), image, coarse_m }
    }

    /// Returns whether both inputs are valid, pixel by pixel.
    pub(crate) fn valid(&self) -> impl Iterator<Item = bool> {
        self.image.iter().zip(&self.coarse_m).map(|(i, z)| i.is_finite() && z.is_finite())
    }

    /// Returns image and coarse heights of `window` (of the scene). Beyond the band, its last row and column repeat.
    pub(crate) fn tile(&self, window: Window) -> [BandTile<'_>; 2] {
        let first = window.row - self.first;
        [&self.image, &self.coarse_m].map(|map| BandTile { map, first, window, rows: self.rows, cols: self.cols })
    }

    /// Returns the rows and columns of `window` that lie in the band.
    pub(crate) fn inside(&self, window: Window) -> Shape {
        Shape::new(self.rows - (window.row - self.first), self.cols - window.col)
    }

    /// Cuts `window` (of the scene) out of the band and fills its gaps; `None` if it has no valid pixel.
    pub(crate) fn cut(&self, window: Window) -> Option<Cutout> {
        let ([image, coarse_m], inside) = (self.tile(window), self.inside(window));
        let [mut image, mut coarse_m] =
            [image, coarse_m].map(|map| (0..map.len()).map(|i| map.at(i)).collect::<Vec<f32>>());
        let is_inside = |i: usize| i / window.cols < inside.rows && i % window.cols < inside.cols;
        let real = |(i, (v, z)): (usize, (&f32, &f32))| is_inside(i) && v.is_finite() && z.is_finite();
        let valid: Vec<bool> = image.iter().zip(&coarse_m).enumerate().map(real).collect();
        if !valid.contains(&true) {
            return None;
        }
        close_gap(&mut coarse_m, window.cols);
        close_gap(&mut image, window.cols);
        Some(Cutout { image, coarse_m, valid })
    }
}

/// The samples of a tile in a band.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BandTile<'b> {
    map: &'b [f32],
    /// First row of the tile in the band.
    first: usize,
    window: Window,
    rows: usize,
    cols: usize,
}

impl Samples for BandTile<'_> {
    fn len(&self) -> usize {
        self.window.shape().pixels()
    }

    fn at(&self, index: usize) -> f32 {
        let (row, col) = (self.first + index / self.window.cols, self.window.col + index % self.window.cols);
        self.map[row.min(self.rows - 1) * self.cols + col.min(self.cols - 1)]
    }

    fn read(&self, first: usize, out: &mut [f32]) {
        let row = (self.first + first / self.window.cols).min(self.rows - 1);
        let line = &self.map[row * self.cols..][..self.cols];
        let col = (self.window.col + first % self.window.cols).min(self.cols);
        let (inside, beyond) = out.split_at_mut(out.len().min(self.cols - col));
        inside.copy_from_slice(&line[col..][..inside.len()]);
        beyond.fill(line[self.cols - 1]);
    }
}
