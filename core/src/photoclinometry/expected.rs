//! The errors that heights and slopes of a tile are expected to have.

use super::share::{OCTAVES, Share};
use crate::norm::LightEstimate;
use core::f32::consts::TAU;

/// Length in coarse pixels beyond which heights are those of the coarse DTM: half of the squared error of such waves remains (our choice).
const HELD_COARSE_PX: f32 = 2.5;

/// Standard deviations of errors.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Errors {
    /// Of the height, metres, without the coarse DTM's own error.
    pub height_m: f32,
    /// Of the slope along either axis, metres per metre.
    pub slope: f32,
    /// Share of the relief between the coarse DTM's pixels that the image explains, 0 to 1.
    pub explained: f32,
    /// 1 where the pixel is dark, otherwise 0.
    pub dark: f32,
}

impl Errors {
    /// Those of a void: all are NaN.
    pub const VOID: Self = Self { height_m: f32::NAN, slope: f32::NAN, explained: f32::NAN, dark: f32::NAN };

    /// Returns the origin of a height with these errors.
    #[must_use]
    pub fn origin(&self) -> Origin {
        Origin::of(self.explained, self.dark)
    }
}

/// The origin of a height. The codes are those of files and of flight software.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Origin {
    /// The image explains at least half of the relief between the coarse DTM's pixels.
    Image = 0,
    /// It explains a tenth to a half.
    Blended = 1,
    /// It explains less: the height is that of the coarse DTM.
    Coarse = 2,
    /// The pixel is dark. Its height is that of its surroundings and of the coarse DTM.
    Shadow = 3,
    /// There is no height, because image or coarse DTM is void.
    Void = 4,
}

impl Origin {
    /// Returns the origin of a height with these errors, which may be means over tiles; NaN stands for a void (our choice of limits).
    #[must_use]
    pub fn of(explained: f32, dark: f32) -> Self {
        match explained {
            e if e.is_nan() => Self::Void,
            _ if dark >= 0.5 => Self::Shadow,
            e if e >= 0.5 => Self::Image,
            e if e >= 0.1 => Self::Blended,
            _ => Self::Coarse,
        }
    }
}

/// The errors that a tile's heights and slopes are expected to have: what the image leaves open ([`Share`]), what the light's uncertainty
/// adds, and what the coarse DTM does not hold. All are standard deviations.
///
/// Of the slopes' variance S in an octave, the image explains the part e of the best linear estimate. If it is kept with the trust T (times
/// [`LightEstimate::related`]), and the logarithm of the light's strength and its azimuth (radians) have the standard deviations s and a, the open part is
///
/// ```text
/// S (1 - T e (1 - s^2 - a^2))
/// ```
///
/// Its height is the slope over the wave number. Waves beyond 2.5 coarse pixels are those of the coarse DTM and do not count. No factor is
/// fitted (our choice).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ExpectedErrors {
    lit: Errors,
    dark: Errors,
    /// Brightness below which a pixel is dark.
    dark_below: f32,
}

impl ExpectedErrors {
    /// Number of values of [`Self::to_values`].
    pub const VALUES: usize = 6;
    /// Nothing is known: all are NaN.
    pub const UNKNOWN: Self = Self::from_values([f32::NAN, f32::NAN, f32::NAN, f32::NAN, f32::NAN, f32::NEG_INFINITY]);

    /// Returns them as values for memory that is kept: errors of heights and slopes and the share explained, for lit ground; errors of heights
    /// and slopes for dark pixels; and the brightness below which a pixel is dark.
    #[must_use]
    pub fn to_values(&self) -> [f32; Self::VALUES] {
        let Self { lit, dark, dark_below } = *self;
        [lit.height_m, lit.slope, lit.explained, dark.height_m, dark.slope, dark_below]
    }

    /// Returns those of [`Self::to_values`].
    #[must_use]
    pub const fn from_values(
        [height_m, slope, explained, dark_m, dark_slope, dark_below]: [f32; Self::VALUES],
    ) -> Self {
        let lit = Errors { height_m, slope, explained, dark: 0.0 };
        Self { lit, dark: Errors { height_m: dark_m, slope: dark_slope, explained: 0.0, dark: 1.0 }, dark_below }
    }

    /// Returns those of a tile with this share of relief under a light. `pixel_m` is the ground size of a pixel, `coarse_px` the side of a
    /// coarse pixel in pixels of the image, `dark_below` the brightness below which a pixel is dark.
    #[must_use]
    pub fn of_share(share: &Share, light: &LightEstimate, pixel_m: f32, coarse_px: f32, dark_below: f32) -> Self {
        let azimuth_sd = light.azimuth_sd_deg.to_radians();
        let spoiled = (light.log_strength_sd * light.log_strength_sd + azimuth_sd * azimuth_sd).min(1.0);
        let trust = light.trust * light.related * (1.0 - spoiled);
        let with = |trust| open(share, trust, pixel_m, coarse_px);
        Self { lit: with(trust), dark: Errors { explained: 0.0, dark: 1.0, ..with(0.0) }, dark_below }
    }

    /// Returns those of a tile whose coarse heights are kept: of its image nothing is known. Its fine slopes are taken to be as large as those
    /// of the coarse DTM, and its fine heights those of waves of two coarse pixels (our choice). `coarse_m` is row-major, `cols` wide, metres.
    #[must_use]
    pub fn of_coarse(coarse_m: &[f32], cols: usize, pixel_m: f32, coarse_px: f32) -> Self {
        let (mut sum, mut count) = (0.0f64, 0.0f64);
        let lines = coarse_m.chunks_exact(cols.max(1));
        for (line, below) in lines.clone().zip(lines.skip(1)) {
            for ((z, right), down) in line.iter().zip(line.iter().skip(1)).zip(below) {
                let (east, south) = (f64::from(right - z), f64::from(down - z));
                if (east + south).is_finite() {
                    sum += east * east + south * south;
                    count += 2.0;
                }
            }
        }
        let slope = if count > 0.0 { libm::sqrt(sum / count) as f32 / pixel_m } else { 0.0 };
        let height_m = core::f32::consts::SQRT_2 * slope * pixel_m * 2.0 * coarse_px / TAU;
        Self::from_values([height_m, slope, 0.0, height_m, slope, f32::NEG_INFINITY])
    }

    /// Returns those of lit ground.
    #[must_use]
    pub fn lit(&self) -> Errors {
        self.lit
    }

    /// Returns whether a pixel of this brightness shows no slope.
    #[must_use]
    pub fn is_dark(&self, brightness: f32) -> bool {
        brightness < self.dark_below
    }

    /// Returns those of a pixel of this brightness.
    #[must_use]
    pub fn at(&self, brightness: f32) -> Errors {
        self.of(self.is_dark(brightness))
    }

    /// Returns those of a pixel that is dark, or is not ([`Self::is_dark`]).
    #[must_use]
    pub fn of(&self, dark: bool) -> Errors {
        if dark { self.dark } else { self.lit }
    }
}

/// Returns what is left open with this trust.
fn open(share: &Share, trust: f32, pixel_m: f32, coarse_px: f32) -> Errors {
    let (mut slopes, mut heights, mut all) = (0.0f32, 0.0f32, 0.0f32);
    for octave in 0..OCTAVES {
        // The middle of the octave.
        let wavelength_px = core::f32::consts::SQRT_2 * (2 << octave) as f32;
        let wave_number = TAU / wavelength_px;
        let ratio = wavelength_px / (HELD_COARSE_PX * coarse_px.max(1.0));
        let square = ratio * ratio;
        let fine = share.slope_variance(octave) / (1.0 + square * square);
        let left = fine * (1.0 - trust * share.explained(octave));
        slopes += left;
        heights += left / (wave_number * wave_number);
        all += fine;
    }
    let explained = if all > 0.0 { (1.0 - slopes / all).clamp(0.0, 1.0) } else { 0.0 };
    Errors { height_m: libm::sqrtf(heights) * pixel_m, slope: libm::sqrtf(0.5 * slopes), explained, dark: 0.0 }
}

#[cfg(test)]
mod tests {
    use super::super::Contrast;
    use super::super::share::Power;
    use super::*;
    use crate::norm::Light;

    const LIGHT: Light = Light { east: 2.0, south: 0.0 };
    const SURE: LightEstimate = LightEstimate {
        light: LIGHT,
        trust: 1.0,
        related: 1.0,
        long_share: None,
        log_strength_sd: 0.0,
        azimuth_sd_deg: 0.0,
    };
    const PIXEL_M: f32 = 2.0;
    const COARSE_PX: f32 = 30.0;

    /// The share of ground whose slopes have the variance `slope_variance` in the octave of 4 to 8 pixels alone.
    fn share(slope_variance: f64) -> Share {
        let mut octaves = [Power::default(); OCTAVES];
        let total = 0.5 * slope_variance;
        octaves[1] = Power { total, cos: 0.5 * total, sin: 0.0, waves: 1e9 };
        Contrast::new(octaves, 1.0, 1.0).share(LIGHT)
    }

    #[test]
    fn nothing_trusted_leaves_all_open() {
        let none = LightEstimate { trust: 0.0, ..SURE };
        let errors = ExpectedErrors::of_share(&share(0.02), &none, PIXEL_M, COARSE_PX, 10.0);
        let Errors { height_m, slope, explained, .. } = errors.lit();
        // sqrt(0.02 / 2) along either axis; the height of waves of 5.7 pixels of 2 m.
        assert!((slope - 0.1).abs() < 1e-3, "{slope}");
        assert!((height_m - 2.0 * 0.02f32.sqrt() * 5.657 / TAU).abs() < 1e-3, "{height_m}");
        assert_eq!(explained, 0.0);
        assert_eq!(errors.at(5.0), Errors { dark: 1.0, ..errors.at(50.0) });
    }

    #[test]
    fn level_ground_leaves_nothing_open() {
        let errors = ExpectedErrors::of_share(&share(0.0), &SURE, PIXEL_M, COARSE_PX, 10.0).lit();
        assert_eq!((errors.height_m, errors.slope, errors.explained), (0.0, 0.0, 0.0));
    }

    #[test]
    fn the_surer_the_light_the_smaller_the_errors() {
        let of = |doubt| ExpectedErrors::of_share(&share(0.02), &doubt, PIXEL_M, COARSE_PX, 10.0).lit();
        let sure = of(SURE);
        let doubts = [
            LightEstimate { trust: 0.8, ..SURE },
            LightEstimate { log_strength_sd: 0.4, ..SURE },
            LightEstimate { azimuth_sd_deg: 25.0, ..SURE },
        ];
        for doubt in doubts {
            let found = of(doubt);
            assert!(found.slope > 1.02 * sure.slope && found.height_m > 1.02 * sure.height_m, "{doubt:?}");
            assert!(found.explained < sure.explained);
        }
        // More uncertainty than anything can have explains nothing, and never less.
        let lost = of(LightEstimate { log_strength_sd: 3.0, azimuth_sd_deg: 180.0, ..SURE });
        assert_eq!(lost, of(LightEstimate { trust: 0.0, ..SURE }));
    }

    #[test]
    fn dark_pixels_show_nothing() {
        let errors = ExpectedErrors::of_share(&share(0.02), &SURE, PIXEL_M, COARSE_PX, 10.0);
        assert!(errors.is_dark(9.0) && !errors.is_dark(11.0) && !errors.is_dark(f32::NAN));
        assert_eq!(ExpectedErrors::from_values(errors.to_values()), errors);
        assert!(errors.at(0.0).slope > 1.2 * errors.at(100.0).slope && errors.at(0.0).explained == 0.0);
    }

    #[test]
    fn origins_follow_what_the_image_explains() {
        for (explained, dark, origin) in [
            (0.9, 0.0, Origin::Image),
            (0.5, 0.4, Origin::Image),
            (0.3, 0.0, Origin::Blended),
            (0.05, 0.0, Origin::Coarse),
            (0.0, 1.0, Origin::Shadow),
            (f32::NAN, 1.0, Origin::Void),
            (f32::NAN, f32::NAN, Origin::Void),
        ] {
            assert_eq!(Origin::of(explained, dark), origin, "{explained} {dark}");
            assert_eq!(Errors { explained, dark, ..Errors::default() }.origin(), origin);
        }
        assert_eq!(Errors::VOID.origin(), Origin::Void);
    }

    #[test]
    fn long_waves_are_the_coarse_dtms() {
        let near = ExpectedErrors::of_share(&share(0.02), &SURE, 2.0, 30.0, 0.1).lit();
        let finer = ExpectedErrors::of_share(&share(0.02), &SURE, 2.0, 2.0, 0.1).lit();
        assert!(finer.slope < 0.7 * near.slope && finer.height_m < 0.7 * near.height_m);
    }

    #[test]
    fn kept_coarse_heights_err_as_their_slopes() {
        // One metre per pixel of 2 m, to the east.
        let ramp: Vec<f32> = (0..64).map(|i| (i % 8) as f32).collect();
        let found = ExpectedErrors::of_coarse(&ramp, 8, PIXEL_M, COARSE_PX);
        assert!((found.lit().slope - 0.5f32.sqrt() * 0.5).abs() < 1e-6);
        assert!((found.lit().height_m - 0.5 * 2.0 * 60.0 / TAU).abs() < 1e-3);
        assert_eq!(found.at(-1.0), found.lit());
        assert_eq!(ExpectedErrors::of_coarse(&[], 0, PIXEL_M, COARSE_PX).lit(), Errors::default());
        assert_eq!(ExpectedErrors::of_coarse(&[f32::NAN; 9], 3, PIXEL_M, COARSE_PX).lit(), Errors::default());
    }
}
