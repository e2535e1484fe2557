//! Truth and candidates on the truth's grid, read by windows, so that the memory does not grow with the scene.

use super::lowpass::LowPass;
use super::scores::{Band, Scores, TakeBand, scored};
use elunar_base::{Error, Result};
use elunar_core::terrain::PixelSize;
use elunar_core::tile::Window;
use elunar_picture::{ErrorLimits, ErrorMap};
use elunar_raster::align::{Interpolation, Onto};
use elunar_raster::source::Source;
use image::RgbImage;
use std::sync::Arc;

/// Samples of all maps that are kept instead of being read again: 128 MiB.
const KEPT_SAMPLES: usize = 1 << 25;
/// Samples of a map in one band, or in one window of the low-pass.
const BAND_SAMPLES: usize = 1 << 22;
/// Rows and columns that the low-pass makes at once, at least.
const SMOOTHED_PX: usize = 256;

/// A raster with its name in messages.
pub type NamedSource = (String, Arc<dyn Source>);

/// Truth and candidates.
pub struct EvaluatedMaps {
    truth: NamedSource,
    candidates: Vec<(String, Onto)>,
    rows: usize,
    cols: usize,
    pixel: PixelSize,
    resolution_m: Option<f64>,
    common: Common,
}

/// What the maps have in common.
struct Common {
    /// Valid pixels of the truth.
    truth_pixels: usize,
    /// Pixels valid in all maps.
    pixels: usize,
    /// Smallest window that holds these.
    bounds: Window,
    /// Heights at the first of them, metres, truth first.
    first_m: Vec<f32>,
}

impl EvaluatedMaps {
    /// Places candidates on the truth's grid. `resolution_m` is the wavelength that the truth resolves, metres, if it is known.
    ///
    /// # Errors
    /// [`Error::Input`] if a raster has no place, reference systems differ, a pixel size is unknown, or no pixel is valid in all;
    /// [`Error::Usage`] if the resolution does not fit the truth. Errors of reading are passed on.
    pub fn new(
        truth: NamedSource,
        candidates: Vec<(NamedSource, Interpolation)>,
        resolution_m: Option<f64>,
    ) -> Result<Self> {
        let info = truth.1.info();
        let (rows, cols) = (info.rows, info.cols);
        let place = |((name, source), interpolation): (NamedSource, Interpolation)| {
            let onto = Onto::new(source, &name, info, &truth.0, interpolation)?;
            Ok((name, onto))
        };
        let candidates = candidates.into_iter().map(place).collect::<Result<Vec<_>>>()?;
        let size = info.georef.as_ref().and_then(|georef| georef.pixel_m(rows, cols));
        let (row_m, col_m) = size.ok_or_else(|| Error::input(format!("{}: pixel size in metres unknown", truth.0)))?;
        super::check_resolution(resolution_m, (rows as f64 * row_m).max(cols as f64 * col_m))?;
        let bounds = Window { row: 0, col: 0, rows: 0, cols: 0 };
        let common = Common { truth_pixels: 0, pixels: 0, bounds, first_m: vec![] };
        let mut maps = Self { truth, candidates, rows, cols, pixel: PixelSize { row_m, col_m }, resolution_m, common };
        maps.common = maps.in_common()?;
        Ok(maps)
    }

    /// Returns the truth's name.
    #[must_use]
    pub fn truth_name(&self) -> &str {
        &self.truth.0
    }

    /// Returns the names of the candidates.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.candidates.iter().map(|(name, _)| name.as_str())
    }

    /// Returns the truth.
    #[must_use]
    pub fn truth(&self) -> &dyn Source {
        self.truth.1.as_ref()
    }

    /// Ground size of the truth's pixels.
    #[must_use]
    pub fn pixel(&self) -> PixelSize {
        self.pixel
    }

    /// Number of rows and columns of the truth.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        (self.rows, self.cols)
    }

    /// Number of valid pixels of the truth, and of pixels that are valid in all maps.
    #[must_use]
    pub fn pixels(&self) -> (usize, usize) {
        (self.common.truth_pixels, self.common.pixels)
    }

    /// Smallest window that holds the common pixels.
    pub(super) fn bounds(&self) -> Window {
        self.common.bounds
    }

    /// Wavelength that the truth resolves, metres, if it is known.
    #[must_use]
    pub fn resolution_m(&self) -> Option<f64> {
        self.resolution_m
    }

    /// Returns the maps as they are.
    ///
    /// # Errors
    /// Errors of reading are passed on.
    pub fn as_they_are(&self) -> Result<View<'_>> {
        self.view(None)
    }

    /// Returns the maps smoothed to the truth's resolution; as they are if that is not known.
    ///
    /// # Errors
    /// Errors of reading are passed on.
    pub fn at_resolution(&self) -> Result<View<'_>> {
        let pixel_m = (self.pixel.row_m, self.pixel.col_m);
        self.view(self.resolution_m.map(|wavelength_m| LowPass::new(wavelength_m, pixel_m)))
    }

    fn view(&self, filter: Option<LowPass>) -> Result<View<'_>> {
        let mut view = View { maps: self, filter, kept: None };
        if self.rows * self.cols * (1 + self.candidates.len()) <= KEPT_SAMPLES {
            view.kept = Some(view.read(Window { row: 0, col: 0, rows: self.rows, cols: self.cols })?);
        }
        Ok(view)
    }

    /// Returns bands of rows, from top to bottom.
    fn bands(&self) -> impl Iterator<Item = std::ops::Range<usize>> + use<> {
        let (all, rows) = (self.rows, (BAND_SAMPLES / self.cols.max(1)).clamp(1, 1024));
        (0..all).step_by(rows).map(move |first| first..(first + rows).min(all))
    }

    /// Reads a window of all maps, truth first; NaN where any is void.
    fn read(&self, window: Window) -> Result<Vec<Vec<f32>>> {
        let mut maps = vec![self.truth.1.read(window)?];
        for (_, onto) in &self.candidates {
            maps.push(onto.read(window)?);
        }
        for i in 0..window.rows * window.cols {
            if maps.iter().any(|map| !map[i].is_finite()) {
                maps.iter_mut().for_each(|map| map[i] = f32::NAN);
            }
        }
        Ok(maps)
    }

    fn in_common(&self) -> Result<Common> {
        let (mut truth_pixels, mut pixels, mut first_m) = (0, 0, vec![]);
        let (mut top, mut bottom, mut left, mut right) = (self.rows, 0, self.cols, 0);
        for rows in self.bands() {
            let window = Window { row: rows.start, col: 0, rows: rows.len(), cols: self.cols };
            truth_pixels += self.truth.1.read(window)?.iter().filter(|z| z.is_finite()).count();
            let maps = self.read(window)?;
            for i in (0..maps[0].len()).filter(|i| maps[0][*i].is_finite()) {
                let (row, col) = (rows.start + i / self.cols, i % self.cols);
                if pixels == 0 {
                    first_m = maps.iter().map(|map| map[i]).collect();
                }
                (top, bottom, left, right) = (top.min(row), bottom.max(row + 1), left.min(col), right.max(col + 1));
                pixels += 1;
            }
        }
        if pixels == 0 {
            let names: Vec<&str> = self.names().collect();
            return Err(super::nothing_common(&self.truth.0, &names));
        }
        let bounds = Window { row: top, col: left, rows: bottom - top, cols: right - left };
        Ok(Common { truth_pixels, pixels, bounds, first_m })
    }
}

/// Maps at one resolution.
pub struct View<'a> {
    pub(super) maps: &'a EvaluatedMaps,
    filter: Option<LowPass>,
    /// All samples, if they are few.
    kept: Option<Vec<Vec<f32>>>,
}

impl View<'_> {
    /// Reads a window of all maps, truth first, NaN off the common pixels. A value does not depend on the window.
    pub(super) fn read(&self, window: Window) -> Result<Vec<Vec<f32>>> {
        if let Some(kept) = &self.kept {
            return Ok(kept.iter().map(|map| cut(map, self.maps.cols, window)).collect());
        }
        let Some(filter) = &self.filter else { return self.maps.read(window) };
        let mut out = vec![vec![f32::NAN; window.rows * window.cols]; 1 + self.maps.candidates.len()];
        let (reach_rows, reach_cols) = filter.reach();
        // As wide as the memory allows, so that little is read twice.
        let high = SMOOTHED_PX + 2 * reach_rows.min(self.maps.rows);
        let cols = (BAND_SAMPLES / high).saturating_sub(2 * reach_cols).max(SMOOTHED_PX);
        for row in (0..window.rows).step_by(SMOOTHED_PX) {
            for col in (0..window.cols).step_by(cols) {
                let (rows, cols) = (SMOOTHED_PX.min(window.rows - row), cols.min(window.cols - col));
                let part = Window { row: window.row + row, col: window.col + col, rows, cols };
                for (out, part) in out.iter_mut().zip(self.smoothed(filter, part)?) {
                    for (k, line) in part.chunks_exact(cols).enumerate() {
                        out[(row + k) * window.cols + col..][..cols].copy_from_slice(line);
                    }
                }
            }
        }
        Ok(out)
    }

    /// Reads a window and all around it that the low-pass reaches, and smooths it.
    fn smoothed(&self, filter: &LowPass, window: Window) -> Result<Vec<Vec<f32>>> {
        let (reach_rows, reach_cols) = filter.reach();
        let (row, col) = (window.row.saturating_sub(reach_rows), window.col.saturating_sub(reach_cols));
        let rows = (window.row + window.rows).saturating_add(reach_rows).min(self.maps.rows) - row;
        let cols = (window.col + window.cols).saturating_add(reach_cols).min(self.maps.cols) - col;
        let maps = self.maps.read(Window { row, col, rows, cols })?;
        let inner = Window { row: window.row - row, col: window.col - col, ..window };
        let bases = &self.maps.common.first_m;
        let smooth = |(map, base): (Vec<f32>, &f32)| {
            let (smooth, _) = filter.smooth(&map, (rows, cols), f64::from(*base));
            cut(&smooth, cols, inner)
        };
        Ok(maps.into_iter().zip(bases).map(smooth).collect())
    }

    /// Wavelength to which the maps are smoothed, metres.
    pub(super) fn resolution_m(&self) -> Option<f64> {
        self.filter.as_ref().and(self.maps.resolution_m)
    }

    /// Gives all rows, band by band, with a row above and below.
    pub(super) fn each_band(&self, take: TakeBand<'_, Vec<f32>>) -> Result<()> {
        for rows in self.maps.bands() {
            let first = rows.start.saturating_sub(1);
            let end = (rows.end + 1).min(self.maps.rows);
            let cols = self.maps.cols;
            let maps = self.read(Window { row: first, col: 0, rows: end - first, cols })?;
            let inner = rows.start - first..rows.end - first;
            take(&Band { maps: &maps, cols, row: first, inner })?;
        }
        Ok(())
    }

    /// Scores every candidate, in their order.
    ///
    /// # Errors
    /// Errors of reading are passed on.
    pub fn scores(&self) -> Result<Vec<Scores>> {
        let EvaluatedMaps { rows, cols, pixel, .. } = *self.maps;
        scored(self.maps.candidates.len(), rows * cols, pixel, &mut |take| self.each_band(take))
    }
}

impl View<'_> {
    /// Draws the errors of the first candidate, coloured by their limits.
    ///
    /// # Errors
    /// [`Error::Usage`] if the scene is too large for a picture. Errors of reading are passed on.
    pub fn error_map(&self) -> Result<RgbImage> {
        let (rows, cols) = self.maps.size();
        let mut picture = ErrorMap::new(rows, cols, ErrorLimits::PAPER)?;
        self.each_band(&mut |band| {
            let [Some(truth), Some(dtm)] = [band.maps.first(), band.maps.get(1)] else {
                return Err(Error::input("evaluate: a DTM expected, none found"));
            };
            let inner = band.inner.start * cols..band.inner.end * cols;
            let errors: Vec<f32> = dtm[inner.clone()].iter().zip(&truth[inner]).map(|(z, t)| z - t).collect();
            picture.add(&errors);
            Ok(())
        })?;
        Ok(picture.finish())
    }
}

/// Returns a window of a map of `cols` columns.
fn cut(map: &[f32], cols: usize, window: Window) -> Vec<f32> {
    let line = |row: usize| &map[row * cols + window.col..][..window.cols];
    (window.row..window.row + window.rows).flat_map(|row| line(row).iter().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Candidate, compare, spectral};
    use elunar_core::sun::Body;
    use elunar_raster::align::Named;
    use elunar_raster::source::InMemory;
    use elunar_raster::{Crs, GeoRef, Raster};

    fn raster((rows, cols): (usize, usize), place: [f64; 6], height: impl Fn(f64, f64) -> f64) -> Raster {
        let georef = GeoRef { transform: place, crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0) };
        let sample = |i: usize| {
            let (x, y) = georef.centre((i / cols) as f64, (i % cols) as f64);
            height(x, y) as f32
        };
        Raster { rows, cols, samples: (0..rows * cols).map(sample).collect(), georef: Some(georef) }
    }

    fn hills(x: f64, y: f64) -> f64 {
        -1900.0 + 9.0 * (x * 0.05).sin() * (y * 0.031).cos() + 2.0 * (x * 0.4 + y * 0.3).sin()
    }

    /// Truth, DTM and coarse DTM on grids of their own, with voids. The scene is higher than a band.
    fn rasters() -> [Raster; 3] {
        let mut truth = raster((1500, 70), [0.0, 2.0, 0.0, 0.0, 0.0, -2.0], hills);
        let dtm = |x: f64, y: f64| 1.03 * hills(x, y) + 60.0 + (x * 0.9).sin();
        let mut dtm = raster((1510, 66), [5.0, 2.0, 0.0, 3.0, 0.0, -2.0], dtm);
        let coarse = raster((120, 10), [-20.0, 26.0, 0.0, 40.0, 0.0, -26.0], |x, y| {
            9.0 * (x * 0.05).sin() * (y * 0.031).cos() - 1900.0
        });
        (0..70).for_each(|i| truth.samples[i * 70 * 11 + i] = f32::NAN);
        dtm.samples[300 * 66..330 * 66].iter_mut().step_by(3).for_each(|z| *z = f32::NAN);
        [truth, dtm, coarse]
    }

    fn maps([truth, dtm, coarse]: &[Raster; 3], resolution_m: Option<f64>) -> Result<EvaluatedMaps> {
        let named = |name: &str, raster: &Raster| -> NamedSource {
            (name.into(), Arc::new(InMemory::new(raster.clone(), None, "memory")))
        };
        let candidates =
            vec![(named("dtm", dtm), Interpolation::Bilinear), (named("coarse", coarse), Interpolation::Bicubic)];
        EvaluatedMaps::new(named("truth", truth), candidates, resolution_m)
    }

    /// Window by window, all figures are those of whole rasters, to the last bit.
    #[test]
    fn windows_give_the_figures_of_whole_rasters() {
        let rasters = rasters();
        let [truth, dtm, coarse] = &rasters;
        for resolution_m in [None, Some(40.0), Some(900.0)] {
            let candidates = [Candidate::fine("dtm", dtm), Candidate::coarse("coarse", coarse)];
            let whole = compare(Named::new("truth", truth), &candidates, resolution_m).unwrap();
            let maps = maps(&rasters, resolution_m).unwrap();
            assert_eq!(maps.pixels(), (whole.truth_pixels, whole.common_pixels));
            let mut view = maps.at_resolution().unwrap();
            let expected: Vec<Scores> = whole.scored.iter().map(|scored| scored.scores).collect();
            let spectra: Vec<_> = whole.scored.iter().map(|scored| spectral(&whole, scored)).collect();
            for is_kept in [true, false] {
                if !is_kept {
                    assert!(view.kept.take().is_some());
                }
                assert_eq!(view.scores().unwrap(), expected, "{resolution_m:?} {is_kept}");
                assert_eq!(view.spectra().unwrap(), spectra, "{resolution_m:?} {is_kept}");
                let errors = &whole.scored[0].error_m;
                let picture =
                    elunar_picture::error_map(&errors.samples, errors.rows, errors.cols, ErrorLimits::PAPER).unwrap();
                assert_eq!(view.error_map().unwrap(), picture);
            }
        }
    }

    #[test]
    fn misfits_and_resolutions_that_no_truth_has_are_named() {
        let mut rasters = rasters();
        for wrong in [0.0, -1.0, f64::NAN, 1e300, 1e-300] {
            let text = maps(&rasters, Some(wrong)).err().unwrap();
            assert!(
                matches!(text, Error::Usage { .. }) && text.to_string().contains("metres from 0.001 to 3000.0"),
                "{text}"
            );
        }
        rasters[1].samples.fill(f32::NAN);
        let text = maps(&rasters, None).err().unwrap().to_string();
        assert_eq!(text, "truth: pixels that are valid there and in dtm and coarse expected, none found");
    }
}
