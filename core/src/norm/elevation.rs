//! Elevation normalisation and scale recovery (Eq. 1, 2 and 8).

use crate::error::same_length;
use crate::mask::{self, Extent, Mean};
use crate::norm::{NormError, RELIEF_EPS_M, RELIEF_MAX_M};
use crate::words::Words;

/// Upper end of the normalised elevation range in the paper, whose Eq. 1 gave 50 over its training tiles.
pub const NR: f32 = 50.0;

/// Returns NR from the reliefs ΔZ of a set of tiles, in metres: their harmonic mean (Eq. 1), NR = N / Σ 1/ΔZ.
///
/// The harmonic mean is dominated by the flat tiles, so that they do not fill only a small part of the range.
///
/// ```
/// use elunar_core::norm::nr_from_reliefs;
/// assert_eq!(nr_from_reliefs([30.0, 60.0])?, 40.0);
/// # Ok::<(), elunar_core::norm::NormError>(())
/// ```
///
/// # Errors
/// [`NormError::Relief`] at the first relief that is not above [`RELIEF_EPS_M`] and at most [`RELIEF_MAX_M`]; [`NormError::TooFewValid`] if there is no
/// relief.
pub fn nr_from_reliefs(reliefs_m: impl IntoIterator<Item = f32>) -> Result<f32, NormError> {
    let (mut count, mut inverse_sum) = (0usize, 0.0f64);
    for relief_m in reliefs_m {
        inverse_sum += 1.0 / f64::from(check_relief(relief_m)?);
        count += 1;
    }
    if count == 0 { Err(NormError::TooFewValid { found: 0 }) } else { Ok((count as f64 / inverse_sum) as f32) }
}

/// The relation between a tile's normalised elevations and metres: lowest height, relief, and NR.
///
/// The relief of an `ElevationScale` is always above [`RELIEF_EPS_M`] and at most [`RELIEF_MAX_M`]. Recovery (Eq. 8) needs exactly the values that normalised
/// the tile, so there is no free function that takes a minimum and a maximum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElevationScale {
    min_m: f32,
    relief_m: f32,
    nr: f32,
}

impl ElevationScale {
    /// A scale of nothing, for words of an absent one.
    pub(crate) const NONE: Self = Self { min_m: 0.0, relief_m: 1.0, nr: 1.0 };

    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        let Self { min_m, relief_m, nr } = self;
        [min_m, relief_m, nr].into_iter().for_each(|v| words.f32(v));
    }

    /// Makes the scale of a tile from its heights in metres above the 1737.4 km sphere.
    ///
    /// Invalid pixels (see [`mask`]) are ignored. `nr` is the upper end of the normalised range: [`NR`] in the paper, 1 for its max–min
    /// ablation.
    ///
    /// # Errors
    /// [`NormError::Length`] if the mask has another length, [`NormError::TooFewValid`], [`NormError::Relief`] for flat
    /// tiles, [`NormError::Range`] for an `nr` that is not finite and positive.
    pub fn from_heights(heights_m: &[f32], valid: Option<&[bool]>, nr: f32) -> Result<Self, NormError> {
        if let Some(mask) = valid {
            same_length(heights_m.len(), mask.len())?;
        }
        Self::of_extent(mask::extent(heights_m, valid), nr)
    }

    /// As [`Self::from_heights`], of an extent.
    pub(crate) fn of_extent(extent: Extent, nr: f32) -> Result<Self, NormError> {
        if !(nr.is_finite() && nr > 0.0) {
            return Err(NormError::Range { nr });
        }
        let (low, high) = extent.range().map_err(|found| NormError::TooFewValid { found })?;
        Ok(Self { min_m: low, relief_m: check_relief(high - low)?, nr })
    }

    /// Returns the same scale with the range widened, below and above, by `share` of the relief, so that detail finer than the coarse DTM
    /// still fits into [0, NR] (our choice; 0 is the paper's Eq. 2).
    ///
    /// # Errors
    /// [`NormError::Margin`] if `share` is negative or not finite, [`NormError::Relief`] if the relief becomes larger than [`RELIEF_MAX_M`].
    pub fn with_margin(self, share: f32) -> Result<Self, NormError> {
        if !(share.is_finite() && share >= 0.0) {
            return Err(NormError::Margin { share });
        }
        let min_m = self.min_m - share * self.relief_m;
        let relief_m = check_relief(self.relief_m * (1.0 + 2.0 * share))?;
        if min_m.is_finite() { Ok(Self { min_m, relief_m, ..self }) } else { Err(NormError::Margin { share }) }
    }

    /// Makes a scale whose unit is the ground size of a pixel, about the mean of the tile's heights (our choice): slopes of the normalised
    /// heights equal slopes of the ground for every relief. The relief that normalises to `nr` is `nr` pixels.
    ///
    /// # Errors
    /// As [`Self::from_heights`], with [`NormError::Relief`] if `nr` pixels are not a relief within these limits; level ground is
    /// not an error.
    pub fn from_pixel(heights_m: &[f32], valid: Option<&[bool]>, pixel_m: f32, nr: f32) -> Result<Self, NormError> {
        if let Some(mask) = valid {
            same_length(heights_m.len(), mask.len())?;
        }
        let mut mean = Mean::default();
        for (i, &z) in heights_m.iter().enumerate() {
            if mask::counts(heights_m, valid, i) {
                mean.add(z, f32::NEG_INFINITY);
            }
        }
        Self::of_mean(mean, pixel_m, nr)
    }

    /// As [`Self::from_pixel`], about a mean.
    pub(crate) fn of_mean(mean: Mean, pixel_m: f32, nr: f32) -> Result<Self, NormError> {
        if !(nr.is_finite() && nr > 0.0) {
            return Err(NormError::Range { nr });
        }
        if mean.count < mask::MIN_VALID_PX {
            return Err(NormError::TooFewValid { found: mean.count });
        }
        Ok(Self { min_m: mean.value(), relief_m: check_relief(nr * pixel_m)?, nr })
    }

    /// Makes the scale again from its stored parts ([`Self::min_m`], [`Self::relief_m`], [`Self::nr`]).
    ///
    /// # Errors
    /// [`NormError::Range`] or [`NormError::Relief`] for values that no scale has.
    pub fn from_parts(min_m: f32, relief_m: f32, nr: f32) -> Result<Self, NormError> {
        if !(nr.is_finite() && nr > 0.0) {
            return Err(NormError::Range { nr });
        }
        if min_m.is_finite() {
            Ok(Self { min_m, relief_m: check_relief(relief_m)?, nr })
        } else {
            Err(NormError::Relief { relief_m: min_m })
        }
    }

    /// Normalises heights in metres (Eq. 2): z* = NR (Z − Z_min) / ΔZ.
    ///
    /// The map is linear, without clamping: heights outside the tile's own range leave [0, NR]. Pixels that are not real (see
    /// [`mask::is_real`]) become 0, because one NaN would spread over the whole tile.
    ///
    /// # Errors
    /// [`NormError::Length`] if the buffers differ in length.
    pub fn normalise(&self, heights_m: &[f32], out: &mut [f32]) -> Result<(), NormError> {
        same_length(heights_m.len(), out.len())?;
        for (out, &height_m) in out.iter_mut().zip(heights_m) {
            *out = self.normalised(height_m);
        }
        Ok(())
    }

    /// Normalises one height as [`Self::normalise`] does.
    #[inline]
    pub(crate) fn normalised(&self, height_m: f32) -> f32 {
        // The difference comes first: it is small and (almost) exact for every height above the sphere.
        if mask::is_real(height_m) { (height_m - self.min_m) / self.relief_m * self.nr } else { 0.0 }
    }

    /// Recovers one height as [`Self::recover`] does.
    #[inline]
    pub(crate) fn recovered_m(&self, normalised: f32) -> f32 {
        normalised / self.nr * self.relief_m + self.min_m
    }

    /// Recovers heights in metres (Eq. 8): Z = z* ΔZ / NR + Z_min.
    ///
    /// # Errors
    /// [`NormError::Length`] if the buffers differ in length.
    pub fn recover(&self, normalised: &[f32], out_m: &mut [f32]) -> Result<(), NormError> {
        same_length(normalised.len(), out_m.len())?;
        for (out_m, &z) in out_m.iter_mut().zip(normalised) {
            *out_m = self.recovered_m(z);
        }
        Ok(())
    }

    /// Returns the height, in metres, that normalises to 0.
    pub fn min_m(&self) -> f32 {
        self.min_m
    }

    /// Returns the relief ΔZ, in metres, that normalises to NR; above [`RELIEF_EPS_M`].
    pub fn relief_m(&self) -> f32 {
        self.relief_m
    }

    /// Returns the upper end of the normalised range.
    pub fn nr(&self) -> f32 {
        self.nr
    }

    /// Returns the metres per normalised unit, ΔZ / NR.
    pub fn metres_per_unit(&self) -> f32 {
        self.relief_m / self.nr
    }
}

fn check_relief(relief_m: f32) -> Result<f32, NormError> {
    if relief_m > RELIEF_EPS_M && relief_m <= RELIEF_MAX_M { Ok(relief_m) } else { Err(NormError::Relief { relief_m }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn scale(heights: &[f32]) -> ElevationScale {
        ElevationScale::from_heights(heights, None, NR).unwrap()
    }

    #[test]
    fn reliefs_beyond_the_limit_are_refused() {
        let of = |relief_m: f32| ElevationScale::from_heights(&[-relief_m, -relief_m / 2.0, 0.0], None, NR);
        let refused =
            |relief_m: f32| matches!(of(relief_m), Err(NormError::Relief { relief_m: found }) if found == relief_m);
        assert!(of(RELIEF_MAX_M).is_ok() && refused(1.1 * RELIEF_MAX_M) && refused(9e29));
        assert!(of(RELIEF_MAX_M).unwrap().with_margin(0.1).is_err());
        assert!(ElevationScale::from_pixel(&[0.0, 1.0, 2.0], None, 1e8, NR).is_err());
        assert!(ElevationScale::from_parts(0.0, 1.1 * RELIEF_MAX_M, NR).is_err());
        // The largest outputs of a model are heights.
        for nr in [1e-30, 1.0, NR, 1e25] {
            let scale = ElevationScale::from_parts(-1e38, RELIEF_MAX_M, nr).unwrap();
            for sign in [-1.0, 1.0] {
                assert!(scale.recovered_m(sign * nr * crate::nn::file::MAX_OUTPUT as f32).is_finite());
            }
        }
    }

    #[test]
    fn lowest_is_zero_and_highest_is_nr() {
        let heights = [-2000.0, -1975.0, -1900.0];
        let mut out = [9.0; 3];
        scale(&heights).normalise(&heights, &mut out).unwrap();
        assert_eq!(out, [0.0, 12.5, 50.0]);
    }

    #[test]
    fn masked_and_nodata_pixels_do_not_widen_the_range() {
        let heights = [f32::NAN, -3.4028227e38, 0.0, 10.0, 9999.0];
        let valid = [true, true, true, true, false];
        let scale = ElevationScale::from_heights(&heights, Some(&valid), NR).unwrap();
        assert_eq!((scale.min_m(), scale.relief_m(), scale.nr()), (0.0, 10.0, 50.0));
        let mut out = [7.0; 5];
        scale.normalise(&heights, &mut out).unwrap();
        assert_eq!(out, [0.0, 0.0, 0.0, 50.0, 49995.0]);
    }

    #[test]
    fn margin_widens_both_sides() {
        let wide = scale(&[100.0, 140.0]).with_margin(0.25).unwrap();
        assert_eq!((wide.min_m(), wide.relief_m()), (90.0, 60.0));
        assert_eq!(wide.metres_per_unit(), 1.2);
        assert_eq!(wide.with_margin(0.0).unwrap(), wide);
    }

    #[test]
    fn in_pixels_slopes_are_slopes() {
        let heights = [100.0, 102.0, f32::NAN, 110.0];
        let scale = ElevationScale::from_pixel(&heights, None, 4.0, NR).unwrap();
        let mut out = [9.0; 4];
        scale.normalise(&heights, &mut out).unwrap();
        assert_eq!(out, [-1.0, -0.5, 0.0, 1.5]);
        assert_eq!((scale.metres_per_unit(), scale.min_m()), (4.0, 104.0));
        assert!(ElevationScale::from_pixel(&[5.0; 3], None, 2.0, NR).is_ok());
        assert!(matches!(ElevationScale::from_pixel(&heights, None, 0.0, NR), Err(NormError::Relief { .. })));
        assert!(matches!(ElevationScale::from_pixel(&heights, None, 2.0, -1.0), Err(NormError::Range { .. })));
        assert!(matches!(ElevationScale::from_pixel(&heights[..1], None, 2.0, NR), Err(NormError::TooFewValid { .. })));
    }

    #[test]
    fn refuses_what_it_cannot_prove() {
        let err = |h: &[f32], nr| ElevationScale::from_heights(h, None, nr).unwrap_err();
        assert_eq!(err(&[5.0, 5.0], NR), NormError::Relief { relief_m: 0.0 });
        assert_eq!(err(&[-9e29, 9e29], NR), NormError::Relief { relief_m: 1.8e30 });
        assert_eq!(err(&[f32::NAN; 4], NR), NormError::TooFewValid { found: 0 });
        assert_eq!(err(&[1.0, 2.0], 0.0), NormError::Range { nr: 0.0 });
        assert!(matches!(err(&[1.0, 2.0], f32::NAN), NormError::Range { .. }));
        assert!(matches!(ElevationScale::from_heights(&[1.0, 2.0], Some(&[true]), NR), Err(NormError::Length(_))));
        let good = scale(&[1.0, 2.0]);
        assert_eq!(good.with_margin(-0.1), Err(NormError::Margin { share: -0.1 }));
        assert!(good.with_margin(f32::INFINITY).is_err());
        assert!(good.with_margin(3e38).is_err());
        assert!(matches!(good.normalise(&[1.0], &mut []), Err(NormError::Length(_))));
        assert!(matches!(good.recover(&[], &mut [1.0]), Err(NormError::Length(_))));
    }

    #[test]
    fn parts_make_the_same_scale_again() {
        let scale = scale(&[100.0, 140.0]).with_margin(0.25).unwrap();
        assert_eq!(ElevationScale::from_parts(scale.min_m(), scale.relief_m(), scale.nr()), Ok(scale));
        for (min_m, relief_m, nr) in
            [(f32::NAN, 60.0, NR), (90.0, 0.0, NR), (90.0, f32::INFINITY, NR), (90.0, 60.0, -1.0)]
        {
            assert!(ElevationScale::from_parts(min_m, relief_m, nr).is_err(), "{min_m} {relief_m} {nr}");
        }
    }

    #[test]
    fn nr_is_the_harmonic_mean_and_refuses_flat_tiles() {
        assert_eq!(nr_from_reliefs([50.0; 7]), Ok(50.0));
        assert_eq!(nr_from_reliefs([]), Err(NormError::TooFewValid { found: 0 }));
        assert_eq!(nr_from_reliefs([50.0, 0.0]), Err(NormError::Relief { relief_m: 0.0 }));
    }

    proptest! {
        #[test]
        fn scale_recovery_inverts_normalisation(
            base in -9000.0f32..11000.0, relief in proptest::collection::vec(0.0f32..3000.0, 2..50),
            nr in prop_oneof![Just(NR), Just(1.0), 0.5f32..200.0], margin in prop_oneof![Just(0.0f32), 0.0f32..2.0],
        ) {
            let heights: Vec<f32> = relief.iter().map(|r| base + r).collect();
            let Ok(scale) = ElevationScale::from_heights(&heights, None, nr) else { return Ok(()) };
            let scale = scale.with_margin(margin).unwrap();
            let (mut z, mut back) = (vec![0.0; heights.len()], vec![0.0; heights.len()]);
            scale.normalise(&heights, &mut z).unwrap();
            scale.recover(&z, &mut back).unwrap();
            // Each of the six operations rounds once, at the magnitude of the relief or of the height.
            let tolerance_m = 6.0 * f32::EPSILON * (scale.relief_m() + scale.min_m().abs());
            for ((&z, &h), &b) in z.iter().zip(&heights).zip(&back) {
                prop_assert!((h - b).abs() <= tolerance_m, "{h} came back as {b}");
                prop_assert!((0.0..=nr * 1.000_001).contains(&z));
            }
        }

        #[test]
        fn harmonic_mean_lies_within_the_reliefs_and_below_the_arithmetic_mean(
            reliefs in proptest::collection::vec(0.02f32..5000.0, 1..40),
        ) {
            let nr = nr_from_reliefs(reliefs.iter().copied()).unwrap();
            let low = reliefs.iter().copied().fold(f32::INFINITY, f32::min);
            let mean = reliefs.iter().sum::<f32>() / reliefs.len() as f32;
            prop_assert!(nr >= low * 0.9999 && nr <= mean * 1.0001);
        }
    }
}
