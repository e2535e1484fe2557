//! The share of an image's contrast that is relief, octave by octave, found without any truth.
//!
//! Relief without a preferred direction, lit from one side, has contrast along the light but none across it: the power of a wave is
//! proportional to the square of the cosine of its angle with the light. Albedo, noise and stretched numbers have no such direction. So if
//! P is the power of the waves of an octave, and t their angle with the light,
//!
//! ```text
//! share = 2 sum P cos 2t / sum P
//! ```
//!
//! is 1 for relief alone and 0 for albedo alone (our choice; on real images with a DTM it follows the correlation of contrast and true
//! slope). Between the two it sets the weight of slopes in linear photoclinometry ([`Share::smoothness`]): with white noise n in the slope along
//! the light, and slopes s in every direction, the best linear estimate (Wiener) has the weight n^2 / s^2 = (1 - share) / (2 share).

use super::{LitTile, Photoclinometry, Rows, SMOOTHNESS};
use crate::mask;
use crate::norm::{Axis, DIRECTED_RELIEF, Light, NormError, Shading};
use crate::part::{item, put};
use crate::samples::Samples;
use crate::tile::Shape;
use crate::words::Words;
use core::f32::consts::PI;

/// Number of octaves: wavelengths from 2 to 512 pixels. Longer waves count with the last one.
pub const OCTAVES: usize = 8;
/// Smallest share, and so the largest weight of slopes: such an octave adds nothing visible.
const SHARE_MIN: f32 = 0.015;
/// Number of waves that the octave before is worth, as the expectation of a share (our choice). Long octaves have few waves.
const EXPECTED_WAVES: f32 = 10.0;
/// The expected share of the shortest waves.
const EXPECTED: f32 = 0.5;

/// Power of the waves of an octave, by direction.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct Power {
    /// Sum of P.
    pub(super) total: f64,
    /// Sum of P cos 2d, with d the direction of the wave from the rows' direction.
    pub(super) cos: f64,
    /// Sum of P sin 2d.
    pub(super) sin: f64,
    /// Number of independent waves.
    pub(super) waves: f64,
}

impl Power {
    /// Adds a wave of this power, and its parts P cos 2d and P sin 2d.
    #[inline(always)]
    pub(super) fn add(&mut self, power: f32, cos: f32, sin: f32) {
        self.total += f64::from(power);
        self.cos += f64::from(cos);
        self.sin += f64::from(sin);
        self.waves += 1.0;
    }

    /// Writes or reads it.
    pub(super) fn visit(&mut self, words: &mut Words<'_>) {
        let Self { total, cos, sin, waves } = self;
        [total, cos, sin, waves].into_iter().for_each(|v| words.f64(v));
    }
}

/// The contrast of an image, octave by octave and by direction; additive over tiles.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Contrast {
    octaves: [Power; OCTAVES],
    tiles: f64,
}

/// Octaves that show the axis: waves of 4 to 64 pixels. Shorter waves are noise, longer ones are few.
const AXIS_OCTAVES: core::ops::Range<usize> = 1..5;
/// Smallest number of waves of such an octave.
const AXIS_WAVES: f64 = 20.0;

impl Contrast {
    /// Makes the contrast of one tile from sums over its waves; `effective` is the share of waves that are independent, `scale` turns power
    /// into variance.
    pub(super) fn new(mut octaves: [Power; OCTAVES], effective: f64, scale: f64) -> Self {
        for Power { total, cos, sin, waves } in &mut octaves {
            (*total, *cos, *sin) = (scale * *total, scale * *cos, scale * *sin);
            *waves *= effective;
        }
        Self { octaves, tiles: 1.0 }
    }

    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        self.octaves.iter_mut().for_each(|power| power.visit(words));
        words.f64(&mut self.tiles);
    }

    /// Measures the contrast of an image alone, of this shape, row-major, at valid pixels ([`crate::mask`]). `coarse_px` is the side of a
    /// pixel of the coarse DTM in pixels of the image; `scratch` has at least [`Photoclinometry::scratch_len`] values.
    ///
    /// # Errors
    /// Those of [`Shading::new`]; [`NormError::Length`] if a buffer has another length.
    pub fn of_image(image: impl Samples, shape: Shape, coarse_px: f32, scratch: &mut [f32]) -> Result<Self, NormError> {
        crate::error::same_length(shape.pixels(), image.len())?;
        let shading = Shading::new(image, Self::ALONG_ROWS)?;
        Ok(Photoclinometry::new(shape).contrast(&Self::level(&image, shape, coarse_px, &shading), scratch)?)
    }

    /// A light of strength 1, under which slopes are contrasts.
    pub(crate) const ALONG_ROWS: Light = Light { east: 1.0, south: 0.0 };

    /// Returns an image as that of level ground.
    pub(crate) fn level<'a>(
        image: &'a impl Samples,
        shape: Shape,
        coarse_px: f32,
        shading: &'a Shading,
    ) -> LitTile<'a, impl Rows, impl Rows> {
        let brightness = move |row: usize, out: &mut [f32]| {
            image.read(row * shape.cols, out);
            out.iter_mut().for_each(|v| *v = mask::real(*v));
        };
        let level = |_: usize, out: &mut [f32]| out.fill(0.0);
        LitTile { brightness, coarse: level, shading, light: Self::ALONG_ROWS, coarse_px }
    }

    /// Adds another tile, or several.
    pub fn add(&mut self, other: &Self) {
        self.add_weighted(other, 1.0);
    }

    /// Adds another tile, or several, with a weight from 0 to 1.
    pub fn add_weighted(&mut self, other: &Self, weight: f64) {
        for (sum, octave) in self.octaves.iter_mut().zip(&other.octaves) {
            sum.total += weight * octave.total;
            sum.cos += weight * octave.cos;
            sum.sin += weight * octave.sin;
            sum.waves += weight * octave.waves;
        }
        self.tiles += weight * other.tiles;
    }

    /// Returns the share of relief under a light.
    #[must_use]
    pub fn share(&self, light: Light) -> Share {
        let (east, south) = (f64::from(light.east), f64::from(light.south));
        let square = east * east + south * south;
        // Of twice the light's direction.
        let (cos, sin) = ((east * east - south * south) / square, 2.0 * east * south / square);
        let mut share = Share { octaves: [EXPECTED; OCTAVES], variances: [0.0; OCTAVES] };
        let mut expected = EXPECTED;
        for (index, power) in self.octaves.iter().enumerate() {
            let waves = power.waves as f32;
            let found = (2.0 * (cos * power.cos + sin * power.sin) / power.total) as f32;
            if found.is_finite() {
                expected = (waves * found + EXPECTED_WAVES * expected) / (waves + EXPECTED_WAVES);
            }
            put(&mut share.octaves, index, (expected / DIRECTED_RELIEF as f32).clamp(SHARE_MIN, 1.0));
            put(&mut share.variances, index, (power.total / self.tiles) as f32);
        }
        share
    }

    /// Returns the axis of the light: relief without a preferred direction has no contrast across the light. It is the mean over octaves of
    /// the doubled direction, and the surer the more of the contrast has a direction. `None` without contrast.
    #[must_use]
    pub fn axis(&self) -> Option<Axis> {
        let (mut cos, mut sin, mut count) = (0.0f64, 0.0f64, 0.0f64);
        for power in self.octaves.get(AXIS_OCTAVES).unwrap_or_default() {
            if power.waves >= AXIS_WAVES && power.total > 0.0 {
                cos += 2.0 * power.cos / power.total;
                sin += 2.0 * power.sin / power.total;
                count += 1.0;
            }
        }
        let length = libm::hypot(cos, sin) / count;
        // No contrast has no direction, and no octave gives 0 / 0.
        if length == 0.0 || length.is_nan() {
            return None;
        }
        // A wave along the rows (direction 0) is lit from the east or the west.
        let azimuth_deg = 0.5 * libm::atan2(sin, cos).to_degrees() + 90.0;
        Some(Axis::new(azimuth_deg, length))
    }
}

/// The share of the contrast that is relief, in each octave, and what it leaves open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Share {
    /// Shares, 0.015 to 1.
    octaves: [f32; OCTAVES],
    /// Variance of the contrast, or of the slope that it was divided into.
    variances: [f32; OCTAVES],
}

/// Returns pi^2 / K^2, the square of half a wavelength in pixels, of a wave number squared; the exponent of its square root is the octave.
#[inline(always)]
fn half_wavelength_squared(wave_number_squared: f32) -> f32 {
    PI * PI / wave_number_squared
}

/// Returns the octave of a wave: 0 for 2 to 4 pixels, 1 for 4 to 8, and so on.
#[inline(always)]
pub(super) fn octave(wave_number_squared: f32) -> usize {
    let exponent = half_wavelength_squared(wave_number_squared).to_bits() >> 23;
    // The exponent is counted from 127. A diagonal wave may be shorter than two pixels.
    ((exponent.saturating_sub(127) / 2) as usize).min(OCTAVES - 1)
}

/// The weights of slopes in all octaves. Beyond the last one its weight repeats, up to a power of two: no index needs a check.
pub(super) struct Weights([f32; 2 * OCTAVES]);

impl Weights {
    /// Returns the weights ([`Share::smoothness`]) of waves side by side.
    #[inline(always)]
    pub(super) fn of<const N: usize>(&self, wave_numbers_squared: &[f32; N]) -> [f32; N] {
        const WHOLE: f32 = (1 << 23) as f32;
        let (mut below, mut part, mut weights) = ([0; N], [0.0; N], [0.0; N]);
        for i in 0..N {
            let bits = half_wavelength_squared(wave_numbers_squared[i]).to_bits();
            // Logarithm to base 2, straight between powers of two: exponent and fraction of the number itself.
            let logarithm = (bits >> 23) as f32 - 127.0 + (bits & 0x7F_FFFF) as f32 / (1 << 23) as f32;
            let place = (0.5 * logarithm - 0.5).clamp(0.0, (OCTAVES - 1) as f32);
            // The floor without a conversion, of which not every processor has vectors: beside 2^23 a float has no fraction, and its low bits
            // are the whole number.
            let near = (place + WHOLE) - WHOLE;
            let floor = if near > place { near - 1.0 } else { near };
            below[i] = (floor + WHOLE).to_bits();
            part[i] = place - floor;
        }
        for i in 0..N {
            let at = |index: u32| self.0[index as usize % (2 * OCTAVES)];
            weights[i] = at(below[i]) + part[i] * (at(below[i] + 1) - at(below[i]));
        }
        weights
    }
}

impl Share {
    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        self.octaves.iter_mut().chain(&mut self.variances).for_each(|v| words.f32(v));
    }

    /// Everything is relief.
    pub const WHOLE: Self = Self { octaves: [1.0; OCTAVES], variances: [0.0; OCTAVES] };

    /// Returns the share of an octave: 0 for wavelengths of 2 to 4 pixels, 1 for 4 to 8, and so on.
    #[must_use]
    pub fn octave(&self, index: usize) -> f32 {
        item(&self.octaves, index.min(OCTAVES - 1))
    }

    /// Returns the share of the whole contrast; 0 without contrast.
    #[must_use]
    pub fn mean(&self) -> f32 {
        let (mut sum, mut of_relief) = (0.0f32, 0.0f32);
        for (share, variance) in self.octaves.iter().zip(&self.variances) {
            sum += variance;
            of_relief += share * variance;
        }
        if sum > 0.0 { of_relief / sum } else { 0.0 }
    }

    /// Limits the shares of long waves to the one that the fit of the light has found in waves of 2 to 8 coarse pixels
    /// ([`crate::norm::LightEstimate::long_share`]): albedo with a direction of its own looks like relief, but does not follow the coarse DTM. It
    /// holds in full from 2 coarse pixels on, and not at all one octave below; between them the logarithm is interpolated (our choice).
    #[must_use]
    pub fn limited(mut self, long_share: Option<f32>, coarse_px: f32) -> Self {
        let Some(long_share) = long_share else { return self };
        let first = libm::log2f(coarse_px.max(1.0));
        for (index, share) in self.octaves.iter_mut().enumerate() {
            let part = (index as f32 - first + 1.0).clamp(0.0, 1.0);
            let limit = libm::powf(*share, 1.0 - part) * libm::powf(long_share.max(SHARE_MIN), part);
            *share = share.min(limit);
        }
        self
    }

    /// Returns the weight of slopes in an octave.
    fn of_octave(&self, index: usize) -> f32 {
        let share = self.octave(index);
        ((1.0 - share) / (2.0 * share)).max(SMOOTHNESS)
    }

    /// Returns the weights of slopes in all octaves.
    pub(super) fn weights(&self) -> Weights {
        Weights(core::array::from_fn(|index| self.of_octave(index)))
    }

    /// Returns the weight of slopes relative to the misfit, for a wave number squared: interpolated between the middles of octaves.
    #[must_use]
    pub fn smoothness(&self, wave_number_squared: f32) -> f32 {
        let [weight] = self.weights().of(&[wave_number_squared]);
        weight
    }

    /// Returns the variance of slopes in an octave, over both axes, (m/m)^2: relief without a preferred direction has half of it along the light.
    #[must_use]
    pub fn slope_variance(&self, index: usize) -> f32 {
        2.0 * self.octave(index) * item(&self.variances, index.min(OCTAVES - 1))
    }

    /// Returns the part of the variance of slopes in an octave that the image explains, 0 to 1. For relief without a preferred direction, the
    /// best linear estimate with the weight w explains 1 - sqrt(w / (1 + w)).
    #[must_use]
    pub fn explained(&self, index: usize) -> f32 {
        let weight = self.of_octave(index);
        1.0 - libm::sqrtf(weight / (1.0 + weight))
    }

    /// Returns the expected standard deviation of the slope, over both axes, that the image leaves open, metres per metre, if `trust` of what
    /// it explains is kept.
    #[must_use]
    pub fn open_slope(&self, trust: f32) -> f32 {
        let open = |index| self.slope_variance(index) * (1.0 - trust * self.explained(index));
        libm::sqrtf((0..OCTAVES).map(open).sum::<f32>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn octaves_are_those_of_wavelengths() {
        let square = |wavelength: f32| (2.0 * PI / wavelength).powi(2);
        for (wavelength, expected) in
            [(1.5, 0), (2.01, 0), (3.9, 0), (4.1, 1), (7.9, 1), (8.1, 2), (100.0, 5), (1e6, 7)]
        {
            assert_eq!(octave(square(wavelength)), expected, "{wavelength}");
        }
        assert_eq!(octave(0.0), OCTAVES - 1);
    }

    const LIGHT: Light = Light { east: 2.0, south: 0.0 };

    /// Power with a share of relief lit along the rows.
    fn power(share: f64) -> Power {
        Power { total: 1.0, cos: 0.5 * share, sin: 0.0, waves: 1e6 }
    }

    #[test]
    fn contrast_without_a_direction_shows_no_axis() {
        let axis = |share| Contrast::new([power(share); OCTAVES], 1.0, 1.0).axis();
        assert_eq!(axis(0.0), None);
        assert_eq!(axis(0.5).map(|axis| axis.azimuth_deg), Some(90.0));
    }

    #[test]
    fn smoothness_is_the_noise_between_octaves() {
        // All of it, half of it, then none.
        let mut octaves = [power(0.0); OCTAVES];
        (octaves[0], octaves[1]) = (power(DIRECTED_RELIEF), power(0.5 * DIRECTED_RELIEF));
        let share = Contrast::new(octaves, 1.0, 1.0).share(LIGHT);
        let at = |wavelength: f32| share.smoothness((2.0 * PI / wavelength).powi(2));
        assert!((share.octave(0) - 1.0).abs() < 1e-3 && (share.octave(1) - 0.5).abs() < 1e-3);
        assert_eq!(share.octave(2), SHARE_MIN);
        assert!((at(2.0) - SMOOTHNESS).abs() < 1e-3 && (at(2.8) - SMOOTHNESS).abs() < 0.03);
        // The middle of the second octave is at 5.7 pixels; halfway between the two middles is at 4.
        assert!((at(5.657) - 0.5).abs() < 0.7, "{}", at(5.657));
        assert!((at(4.0) - 0.5 * (SMOOTHNESS + 0.5)).abs() < 0.01, "{}", at(4.0));
        let most = (1.0 - SHARE_MIN) / (2.0 * SHARE_MIN);
        assert!((at(1e9) - most).abs() < 1e-3 && (at(f32::INFINITY) - most).abs() < 1e-3);
        assert!((0..100).all(|i| (SMOOTHNESS..=most).contains(&at(2.0 * 1.1f32.powi(i)))));
    }

    #[test]
    fn few_waves_follow_the_octave_before() {
        let mut octaves = [power(0.8 * DIRECTED_RELIEF); OCTAVES];
        octaves[3] = Power { waves: 2.0, ..power(-1.0) };
        octaves[4] = Power::default();
        let share = Contrast::new(octaves, 1.0, 1.0).share(LIGHT);
        assert!((share.octave(2) - 0.8).abs() < 1e-3);
        assert!((0.4..0.8).contains(&share.octave(3)));
        assert_eq!(share.octave(4), share.octave(3), "an octave without waves");
    }

    #[test]
    fn what_is_left_open_falls_with_trust() {
        let contrast = Contrast::new([Power { total: 0.5, cos: 0.225, ..power(0.0) }; OCTAVES], 1.0, 0.01);
        let share = contrast.share(LIGHT);
        assert!((share.mean() - 1.0).abs() < 1e-3);
        let open = [0.0, 0.5, 1.0].map(|trust| share.open_slope(trust));
        // Without trust: all of the slope, 2 x 8 x 0.005.
        assert!((open[0] - 0.08f32.sqrt()).abs() < 1e-3, "{open:?}");
        assert!(open[0] > open[1] && open[1] > open[2] && open[2] > 0.3 * open[0], "{open:?}");
        assert_eq!(Share::WHOLE.mean(), 0.0);
        assert_eq!(Share::WHOLE.smoothness(0.1), SMOOTHNESS);
        // Twice the same tile says the same.
        let mut twice = contrast;
        twice.add(&contrast);
        assert!((twice.share(LIGHT).open_slope(0.5) - open[1]).abs() < 1e-6);
        // With a weight of a half two of them are one.
        let mut halves = Contrast::default();
        (0..2).for_each(|_| halves.add_weighted(&contrast, 0.5));
        assert_eq!(halves, contrast);
    }

    #[test]
    fn long_waves_are_no_more_relief_than_the_fit_says() {
        let share = Share::WHOLE.limited(Some(0.2), 16.0);
        let expected = [1.0, 1.0, 1.0, 1.0, 0.2, 0.2, 0.2, 0.2];
        assert!(share.octaves.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{share:?}");
        // Halfway between two octaves: the geometric mean.
        let share = Share::WHOLE.limited(Some(0.25), 16.0 * core::f32::consts::SQRT_2);
        assert!((share.octave(4) - 0.5).abs() < 1e-6 && share.octave(5) == 0.25, "{share:?}");
        // It lowers shares alone.
        let low = Share { octaves: [0.1; OCTAVES], ..Share::WHOLE };
        assert_eq!(low.limited(Some(0.9), 16.0), low);
        assert_eq!(low.limited(None, 16.0), low);
        assert_eq!(Share::WHOLE.limited(Some(0.0), f32::NAN).octave(0), SHARE_MIN);
    }

    #[test]
    fn the_axis_is_that_of_the_waves() {
        for azimuth in [1.0f64, 40.0, 90.0, 130.0, 179.0] {
            // The direction of waves, clockwise from the rows' direction.
            let doubled = (2.0 * (azimuth - 90.0)).to_radians();
            let octave = Power { total: 1.0, cos: 0.3 * doubled.cos(), sin: 0.3 * doubled.sin(), waves: 1e3 };
            let contrast = Contrast::new([octave; OCTAVES], 1.0, 1.0);
            let axis = contrast.axis().unwrap();
            assert!((axis.azimuth_deg - azimuth).abs() < 1e-9 && (axis.sd_deg - 10.0).abs() < 1e-9, "{axis:?}");
            let lit = Light::of(azimuth + 180.0, 1.0).unwrap();
            let across = Light::of(azimuth + 90.0, 1.0).unwrap();
            assert!((contrast.share(lit).octave(2) - 0.6 / DIRECTED_RELIEF as f32).abs() < 1e-3);
            assert_eq!(contrast.share(across).octave(2), SHARE_MIN);
        }
        assert_eq!(Contrast::default().axis(), None);
        assert_eq!(Contrast::new([Power { waves: 1e3, ..Power::default() }; OCTAVES], 1.0, 1.0).axis(), None);
    }
}
