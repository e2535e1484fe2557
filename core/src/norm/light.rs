//! The relation of brightness to slope: from the Sun's angles, or fitted to an image and its coarse DTM.
//!
//! For small slopes and a constant albedo, brightness is linear in the slopes (our choice, after linear photoclinometry):
//!
//! ```text
//! I / mean(I) - 1 = b_x dz/dx + b_y dz/dy        x along columns, y along rows (down)
//! ```
//!
//! [`Light`] is b, the *contrast of a unit slope*. It points away from the Sun, and is longer for a lower Sun.

use crate::part::item;
use crate::terrain::PixelSize;
use crate::tile::Shape;

/// Contrast of a unit slope along columns and along rows.
///
/// ```
/// use elunar_core::norm::Light;
///
/// // A Sun in the west, 30 degrees high: ground that rises to the east faces it.
/// let light = Light::from_sun(270.0, 30.0).expect("above the horizon");
/// assert!(light.east > 1.3 && light.east < 1.5 && light.south.abs() < 1e-6);
/// assert!((light.azimuth_deg() - 270.0).abs() < 1e-3);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// b_x: contrast of ground that rises by one metre per metre along a row, to the right.
    pub east: f32,
    /// b_y: contrast of ground that rises by one metre per metre down a column.
    pub south: f32,
}

/// Smallest strength for which contrast depends on slopes: even a Sun at 80 degrees has 0.13.
const STRENGTH_MIN: f64 = 0.05;
/// Standard deviation of the logarithm of the strength for a Sun of known elevation (our choice).
const TOLD_SPREAD: f64 = 0.3;
/// Standard deviation of the logarithm of a fitted strength beyond its noise: the coarse DTM's slopes are too smooth, and albedo correlates
/// with relief.
const FITTED_SPREAD: f64 = 0.1;
/// Largest strength; beyond it most ground would be in shadow. A Sun at 3 degrees has 17.
const STRENGTH_MAX: f64 = 20.0;
/// The assumed Sun where its angles are unknown: in the north-west, at the middle elevation of the paper's training images (our choice).
const ASSUMED_AZIMUTH_DEG: f64 = 315.0;
const ASSUMED_ELEVATION_DEG: f64 = 40.0;

impl Light {
    /// Makes a light; `None` unless it is finite and its strength is between that of a Sun near the zenith and one at the horizon.
    #[must_use]
    pub fn new(east: f64, south: f64) -> Option<Self> {
        let strength = libm::hypot(east, south);
        // No range contains NaN.
        (STRENGTH_MIN..=STRENGTH_MAX).contains(&strength).then_some(Self { east: east as f32, south: south as f32 })
    }

    /// Makes the light of a Sun at an azimuth (degrees clockwise from up) and an elevation above the horizon, for ground that reflects by
    /// the Lunar-Lambert law with McEwen's L(phase), viewed from the zenith: the derivative of the reflectance by slope, divided by the
    /// reflectance of level ground. `None` if the Sun is not above the horizon.
    #[must_use]
    pub fn from_sun(azimuth_deg: f64, elevation_deg: f64) -> Option<Self> {
        if !(elevation_deg > 0.0 && elevation_deg < 90.0) {
            return None;
        }
        let (sin, cos) = (libm::sin(elevation_deg.to_radians()), libm::cos(elevation_deg.to_radians()));
        let lunar = crate::terrain::lunar_lambert_weight(90.0 - elevation_deg);
        let level = 2.0 * lunar * sin / (sin + 1.0) + (1.0 - lunar) * sin;
        let by_cosine = 2.0 * lunar / ((sin + 1.0) * (sin + 1.0)) + (1.0 - lunar);
        Self::of(azimuth_deg, by_cosine * cos / level)
    }

    /// Returns the assumed light, for ground where [`LightFit::with_sun`] finds none: a Sun 40 degrees high at the known azimuth (degrees
    /// clockwise from up), else in the north-west (our choice). [`crate::nn::Lighting`] says when it is assumed.
    #[must_use]
    pub fn assumed(azimuth_deg: Option<f64>) -> Self {
        let light =
            azimuth_deg.and_then(Self::from_azimuth_deg).or_else(|| Self::from_azimuth_deg(ASSUMED_AZIMUTH_DEG));
        // Not reached: a Sun above the horizon is always a light.
        light.unwrap_or(Self { east: 1.0, south: 1.0 })
    }

    /// Makes the light of a Sun at an azimuth and the assumed elevation.
    pub(crate) fn from_azimuth_deg(azimuth_deg: f64) -> Option<Self> {
        Self::from_sun(azimuth_deg, ASSUMED_ELEVATION_DEG)
    }

    /// Makes the light of a Sun at `azimuth_deg` with this strength.
    fn of(azimuth_deg: f64, strength: f64) -> Option<Self> {
        let (east, north) = (libm::sin(azimuth_deg.to_radians()), libm::cos(azimuth_deg.to_radians()));
        Self::new(-strength * east, strength * north)
    }

    /// Returns the strength: the contrast of a unit slope towards the Sun.
    #[must_use]
    pub fn strength(self) -> f32 {
        libm::hypotf(self.east, self.south)
    }

    /// Returns the azimuth of the Sun, degrees clockwise from up, 0 to 360.
    #[must_use]
    pub fn azimuth_deg(self) -> f64 {
        let deg = libm::atan2(-f64::from(self.east), f64::from(self.south)).to_degrees();
        if deg < 0.0 { deg + 360.0 } else { deg }
    }

    /// Returns the light in a mirrored map.
    #[must_use]
    pub fn mirrored(self, mirror: Mirror) -> Self {
        let sign = |mirrored: bool| if mirrored { -1.0 } else { 1.0 };
        Self { east: self.east * sign(mirror.cols), south: self.south * sign(mirror.rows) }
    }
}

/// A mirroring of a row-major map. A second application undoes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Mirror {
    /// Whether the order of rows is reversed.
    pub rows: bool,
    /// Whether the order of columns is reversed.
    pub cols: bool,
}

impl Mirror {
    /// Returns the mirroring that brings a Sun at this azimuth (degrees clockwise from up) into the north-west quadrant.
    #[must_use]
    pub fn from_azimuth_deg(azimuth_deg: f64) -> Self {
        let (east, north) = (libm::sin(azimuth_deg.to_radians()), libm::cos(azimuth_deg.to_radians()));
        Self { rows: north < 0.0, cols: east > 0.0 }
    }

    /// Returns whether nothing is mirrored.
    #[must_use]
    pub fn is_none(self) -> bool {
        self == Self::default()
    }

    /// Returns the index in the original map of pixel `index` of the mirrored map, both row-major and of this shape.
    #[must_use]
    pub fn source(self, index: usize, Shape { rows, cols }: Shape) -> usize {
        let cols = cols.max(1);
        let (row, col) = (index / cols, index % cols);
        let row = if self.rows { rows.saturating_sub(1).wrapping_sub(row) } else { row };
        row.wrapping_mul(cols).wrapping_add(if self.cols { cols - 1 - col } else { col })
    }

    /// Returns [`Self::source`] of the pixels from `index` on to the end of its row.
    pub(crate) fn sources(self, index: usize, shape: Shape) -> impl Iterator<Item = usize> {
        let first = self.source(index, shape);
        (0..shape.cols).map(move |i| if self.cols { first.wrapping_sub(i) } else { first + i })
    }
}

/// A fit of the light to the parts of a scene added so far, by least squares over cells about as wide as the coarse DTM's pixels. At
/// smaller scales the coarse DTM has no slopes to explain the image. Image and slopes are means over the same cells, so that both have the
/// same smoothing. The memory is fixed. A cell with a sample that is not real (see [`crate::mask`]) is left out.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LightFit {
    cells: f64,
    /// Sums over cells of brightness, slope east, slope south.
    sums: [f64; 3],
    /// Sums of products: II, Ix, Iy, xx, xy, yy.
    products: [f64; 6],
}

impl LightFit {
    /// Makes the fit to one tile: `image` (brightness in any unit) and `coarse_m` (metres), row-major, `cols` wide, at valid pixels
    /// ([`crate::mask`]). `pixel_m` is the ground size of a pixel, `coarse_px` the side of a coarse pixel in pixels of the image.
    #[must_use]
    pub fn of_tile(
        image: &[f32],
        coarse_m: &[f32],
        valid: Option<&[bool]>,
        cols: usize,
        pixel_m: f64,
        coarse_px: f32,
    ) -> Self {
        let mut fit = Self::default();
        fit.add_masked(image, coarse_m, valid, cols, PixelSize::square(pixel_m), Self::cell_px(coarse_px));
        fit
    }

    /// Returns the side of a cell, pixels, for a coarse DTM whose pixels are `coarse_px` pixels of the image wide.
    #[must_use]
    pub fn cell_px(coarse_px: f32) -> usize {
        // `as` turns NaN and negative numbers into 0.
        ((0.8 * coarse_px) as usize).clamp(4, 256)
    }

    /// Adds a rectangle: `image` (brightness in any unit) and `coarse_m` (metres), row-major, `cols` wide. Remaining rows or columns that
    /// fill no cell are left out. Does nothing if the maps differ in length.
    pub fn add(&mut self, image: &[f32], coarse_m: &[f32], cols: usize, pixel: PixelSize, cell_px: usize) {
        self.add_masked(image, coarse_m, None, cols, pixel, cell_px);
    }

    /// As [`Self::add`], without the cells in which a pixel is invalid ([`crate::mask`]).
    pub fn add_masked(
        &mut self,
        image: &[f32],
        coarse_m: &[f32],
        valid: Option<&[bool]>,
        cols: usize,
        pixel: PixelSize,
        cell_px: usize,
    ) {
        let rows = image.len().checked_div(cols).unwrap_or(0);
        if coarse_m.len() != image.len() || cell_px == 0 || rows < 3 || cols < 3 {
            return;
        }
        // A pixel's slope needs its neighbours.
        for top in (1..rows - 1).step_by(cell_px).take_while(|top| top + cell_px < rows) {
            for left in (1..cols - 1).step_by(cell_px).take_while(|left| left + cell_px < cols) {
                self.cell((image, coarse_m, valid), cols, pixel, [top, left, cell_px]);
            }
        }
    }

    fn cell(
        &mut self,
        (image, coarse_m, valid): (&[f32], &[f32], Option<&[bool]>),
        cols: usize,
        pixel: PixelSize,
        [top, left, side]: [usize; 3],
    ) {
        let z = |i: usize| item(coarse_m, i);
        let (mut mean, mut real) = ([0.0f64; 3], true);
        let pixels = (top..top + side).flat_map(|row| row * cols + left..row * cols + left + side);
        for i in pixels {
            let [west, east, north, south] = [z(i.wrapping_sub(1)), z(i + 1), z(i.wrapping_sub(cols)), z(i + cols)];
            real &= crate::mask::counts(image, valid, i)
                && [west, east, north, south].into_iter().all(crate::mask::is_real);
            mean[0] += f64::from(item(image, i));
            mean[1] += f64::from(east) - f64::from(west);
            mean[2] += f64::from(south) - f64::from(north);
        }
        if !real {
            return;
        }
        let count = (side * side) as f64;
        let [i, x, y] = [mean[0] / count, mean[1] / count / (2.0 * pixel.col_m), mean[2] / count / (2.0 * pixel.row_m)];
        self.cells += 1.0;
        for (sum, v) in self.sums.iter_mut().zip([i, x, y]) {
            *sum += v;
        }
        for (sum, v) in self.products.iter_mut().zip([i * i, i * x, i * y, x * x, x * y, y * y]) {
            *sum += v;
        }
    }

    /// Returns the covariances II, Ix, Iy, xx, xy, yy with brightness divided by its mean; `None` without cells or light.
    fn covariances(&self) -> Option<[f64; 6]> {
        let n = self.cells;
        let [i, x, y] = self.sums.map(|s| s / n);
        let [ii, ix, iy, xx, xy, yy] = self.products.map(|p| p / n);
        let found = [(ii - i * i) / (i * i), (ix - i * x) / i, (iy - i * y) / i, xx - x * x, xy - x * y, yy - y * y];
        (i > 0.0 && found.iter().all(|v| v.is_finite())).then_some(found)
    }

    /// Returns the light of the best fit; `None` if the ground was too small or without features.
    #[must_use]
    pub fn light(&self) -> Option<Light> {
        let [_, ix, iy, xx, xy, yy] = self.covariances()?;
        let determinant = xx * yy - xy * xy;
        Light::new((ix * yy - iy * xy) / determinant, (iy * xx - ix * xy) / determinant)
    }

    /// Returns the light of the best fit for a Sun at a known azimuth (degrees clockwise from up).
    #[must_use]
    pub fn light_from(&self, azimuth_deg: f64) -> Option<Light> {
        let (strength, _) = self.strength_from(azimuth_deg)?;
        if strength > 0.0 { Light::of(azimuth_deg, strength) } else { None }
    }

    /// Returns the strength of the best fit for a Sun at an azimuth, and its variance.
    fn strength_from(&self, azimuth_deg: f64) -> Option<(f64, f64)> {
        let [ii, ix, iy, xx, xy, yy] = self.covariances()?;
        let (x, y) = (-libm::sin(azimuth_deg.to_radians()), libm::cos(azimuth_deg.to_radians()));
        let slopes = xx * x * x + 2.0 * xy * x * y + yy * y * y;
        let strength = (ix * x + iy * y) / slopes;
        let unexplained = (ii - strength * strength * slopes).max(0.0);
        let variance = unexplained / (slopes * (self.cells - 2.0));
        (self.cells > 2.0 && strength.is_finite() && variance.is_finite()).then_some((strength, variance))
    }

    /// Returns the light of a Sun at a known azimuth and elevation, with its strength drawn to the fitted one. The mean of the logarithms
    /// is weighted by inverse variances (our choice), because images are not always linear in radiance, and the ground does not always
    /// follow the Lunar-Lambert law.
    fn drawn_to_fit(&self, azimuth_deg: f64, elevation_deg: f64) -> Option<Light> {
        let told = Light::from_sun(azimuth_deg, elevation_deg)?;
        let Some((fitted, variance)) = self.strength_from(azimuth_deg).filter(|(s, _)| *s > 0.0) else {
            return Some(told);
        };
        let expected = f64::from(told.strength());
        // Strengths are factors, so the mean is taken over their logarithms.
        let of_told = 1.0 / (TOLD_SPREAD * TOLD_SPREAD);
        let of_fitted = 1.0 / (variance / (fitted * fitted) + FITTED_SPREAD * FITTED_SPREAD);
        let mean = (of_told * libm::log(expected) + of_fitted * libm::log(fitted)) / (of_told + of_fitted);
        Light::of(azimuth_deg, libm::exp(mean)).or(Some(told))
    }

    /// Returns the light from the known angles of the Sun (azimuth and elevation, degrees); unknown angles are fitted. With a known
    /// elevation, too, the strength is drawn to the fitted one, if brightness depends on slope at all.
    #[must_use]
    pub fn with_sun(&self, azimuth_deg: Option<f64>, elevation_deg: Option<f64>) -> Option<Light> {
        match (azimuth_deg, elevation_deg) {
            (Some(azimuth), Some(elevation)) => self.drawn_to_fit(azimuth, elevation),
            (Some(azimuth), None) => self.light_from(azimuth),
            (None, Some(elevation)) => self.drawn_to_fit(self.light()?.azimuth_deg(), elevation),
            (None, None) => self.light(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const COLS: usize = 100;

    /// Returns rolling hills, and their image under `light`, times a brightness.
    fn scene(light: Light, brightness: f32) -> (Vec<f32>, Vec<f32>) {
        // Whole periods over the 75 x 95 pixels that cells of 5 cover: the mean slope is 0.
        let turns = |n: f32, period: f32| core::f32::consts::TAU * n / period;
        let height = |r: f32, c: f32| 4.0 * turns(r, 75.0).sin() + 3.0 * (turns(c, 95.0) + turns(r, 75.0)).cos();
        let at = |i: usize| ((i / COLS) as f32, (i % COLS) as f32);
        let heights = (0..80 * COLS).map(|i| height(at(i).0, at(i).1)).collect();
        let image = (0..80 * COLS).map(|i| {
            let (r, c) = at(i);
            let (x, y) = (height(r, c + 1.0) - height(r, c - 1.0), height(r + 1.0, c) - height(r - 1.0, c));
            brightness * (1.0 + (light.east * x + light.south * y) / 4.0)
        });
        (image.collect(), heights)
    }

    fn fit(image: &[f32], heights: &[f32]) -> LightFit {
        let mut fit = LightFit::default();
        fit.add(image, heights, COLS, PixelSize::square(2.0), 5);
        fit
    }

    proptest! {
        #[test]
        fn the_light_is_found(azimuth in 0.0f64..360.0, strength in 0.3f64..3.0, brightness in 1.0f32..5000.0) {
            let light = Light::of(azimuth, strength).unwrap();
            let (image, heights) = scene(light, brightness);
            let fit = fit(&image, &heights);
            let found = fit.light().unwrap();
            prop_assert!((found.east - light.east).abs() < 0.02 * light.strength(), "{found:?} for {light:?}");
            prop_assert!((found.south - light.south).abs() < 0.02 * light.strength(), "{found:?} for {light:?}");
            let known = fit.light_from(azimuth).unwrap();
            prop_assert!((known.strength() - light.strength()).abs() < 0.02 * light.strength());
            prop_assert!(fit.light_from(azimuth + 180.0).is_none());
        }

        #[test]
        fn turns_bring_every_sun_to_the_north_west(azimuth in 0.0f64..360.0, strength in 0.3f64..3.0) {
            let light = Light::of(azimuth, strength).unwrap();
            prop_assert!((light.azimuth_deg() - azimuth).abs() < 1e-3 || azimuth < 1e-3);
            let mirrored = light.mirrored(Mirror::from_azimuth_deg(azimuth));
            prop_assert!(mirrored.east >= -1e-6 && mirrored.south >= -1e-6, "{mirrored:?}");
        }
    }

    #[test]
    fn the_sun_sets_the_strength() {
        let strength = |elevation| Light::from_sun(10.0, elevation).unwrap().strength();
        // Lambert's cotangent, reduced by the Lunar-Lambert law.
        assert!((strength(20.0) / 2.747 - 0.85).abs() < 0.05, "{}", strength(20.0));
        assert!((strength(60.0) / 0.577 - 0.69).abs() < 0.05, "{}", strength(60.0));
        for out in [0.0, -3.0, 90.0, f64::NAN] {
            assert_eq!(Light::from_sun(10.0, out), None);
        }
        assert_eq!(Light::from_sun(f64::NAN, 30.0), None);
    }

    #[test]
    fn cells_with_masked_pixels_are_left_out() {
        let light = Light::of(300.0, 1.0).unwrap();
        let (mut image, heights) = scene(light, 7.0);
        let clean = fit(&image, &heights);
        // A wrong value under the mask, in one cell.
        let valid: Vec<bool> = (0..image.len()).map(|i| i != 20 * COLS + 20).collect();
        image[20 * COLS + 20] = 1e6;
        let masked = |valid| {
            let mut fit = LightFit::default();
            fit.add_masked(&image, &heights, valid, COLS, PixelSize::square(2.0), 5);
            fit
        };
        assert_eq!(masked(Some(&valid)).cells, clean.cells - 1.0);
        assert!((masked(Some(&valid)).light().unwrap().east - light.east).abs() < 0.02);
        assert_eq!(masked(None).cells, clean.cells);
    }

    #[test]
    fn ground_without_light_is_lit_from_the_north_west() {
        assert_eq!(Light::assumed(None), Light::from_sun(315.0, 40.0).unwrap());
        assert_eq!(Light::assumed(Some(f64::NAN)), Light::assumed(None));
        assert_eq!(Light::assumed(Some(100.0)), Light::from_sun(100.0, 40.0).unwrap());
    }

    #[test]
    fn what_is_known_is_kept_and_the_rest_fitted() {
        let truth = Light::of(300.0, 1.0).unwrap();
        let (image, heights) = scene(truth, 7.0);
        let fit = fit(&image, &heights);
        let strength = |light: Option<Light>| light.unwrap().strength();
        // With the Sun on the other side, and without any cell, there is no light to fit.
        assert_eq!(fit.with_sun(Some(120.0), Some(40.0)), Light::from_sun(120.0, 40.0));
        assert_eq!(LightFit::default().with_sun(Some(300.0), Some(40.0)), Light::from_sun(300.0, 40.0));
        assert!((fit.with_sun(Some(310.0), None).unwrap().azimuth_deg() - 310.0).abs() < 1e-3);
        assert!((fit.with_sun(None, Some(40.0)).unwrap().azimuth_deg() - 300.0).abs() < 1.0);
        // This image has no noise, so the fit has more weight than the stated elevation.
        for elevation in [10.0, 30.0, 70.0] {
            let told = strength(Light::from_sun(300.0, elevation));
            let drawn = strength(fit.with_sun(None, Some(elevation)));
            assert!((drawn - 1.0).abs() < 0.45 * (told - 1.0).abs(), "{elevation}: {drawn}, told {told}");
        }
        assert_eq!(fit.with_sun(None, None), fit.light());
    }

    #[test]
    fn featureless_gappy_and_small_scenes_have_no_light() {
        let flat = vec![1.0f32; 80 * COLS];
        let (image, heights) = scene(Light { east: 1.0, south: 0.0 }, 1.0);
        assert_eq!(fit(&flat, &flat).light(), None);
        assert_eq!(fit(&image, &flat).light(), None);
        assert_eq!(fit(&vec![0.0; 80 * COLS], &heights).light(), None);
        assert_eq!(fit(&vec![f32::NAN; 80 * COLS], &heights).light(), None);
        assert_eq!(fit(&image[..3 * COLS], &heights[..3 * COLS]).light(), None);
        assert_eq!(fit(&image[1..], &heights).light(), None);
    }

    #[test]
    fn mirrored_pixels_come_from_their_mirror_image() {
        let mirror = |rows, cols| Mirror { rows, cols };
        let order = |t: Mirror| (0..6).map(|i| t.source(i, Shape::new(2, 3))).collect::<Vec<_>>();
        assert_eq!(order(mirror(false, false)), [0, 1, 2, 3, 4, 5]);
        assert_eq!(order(mirror(false, true)), [2, 1, 0, 5, 4, 3]);
        assert_eq!(order(mirror(true, true)), [5, 4, 3, 2, 1, 0]);
    }
}
