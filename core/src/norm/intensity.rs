//! Image normalisation: (I − I_min) / (I_max − I_min) over the tile (Sec. III-A2).
//!
//! Orthorectified NAC products contain relative brightness only, so the range comes from the tile itself.

use crate::error::same_length;
use crate::mask::{self, Extent};
use crate::norm::NormError;

/// The range that an image is normalised by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IntensityRange {
    /// Darkest valid pixel, in the image's unit.
    pub min: f32,
    /// Brightest valid pixel; above `min`.
    pub max: f32,
}

impl IntensityRange {
    /// Returns the range of the valid pixels (see [`mask`]).
    ///
    /// # Errors
    /// [`NormError::TooFewValid`], [`NormError::ConstantImage`] if all valid pixels are equal: such a tile shows nothing.
    pub fn of(image: &[f32], valid: Option<&[bool]>) -> Result<Self, NormError> {
        Self::of_extent(mask::extent(image, valid))
    }

    /// As [`Self::of`], of an extent.
    pub(crate) fn of_extent(extent: Extent) -> Result<Self, NormError> {
        let (min, max) = extent.range().map_err(|found| NormError::TooFewValid { found })?;
        let span = max - min;
        if span.is_finite() && span > 0.0 { Ok(Self { min, max }) } else { Err(NormError::ConstantImage) }
    }

    /// Returns the brightness of a valid pixel, normalised to [0, 1].
    #[inline]
    pub(crate) fn normalised(&self, brightness: f32) -> f32 {
        (brightness - self.min) / (self.max - self.min)
    }
}

/// Normalises the valid pixels (see [`mask`]) to [0, 1]; all others become 0.
///
/// ```
/// let mut out = [0.0; 3];
/// elunar_core::norm::intensity::normalise(&[10.0, f32::NAN, 30.0], None, &mut out)?;
/// assert_eq!(out, [0.0, 0.0, 1.0]);
/// # Ok::<(), elunar_core::norm::NormError>(())
/// ```
///
/// # Errors
/// [`NormError::Length`] if image, mask and output differ in length, and those of [`IntensityRange::of`].
pub fn normalise(image: &[f32], valid: Option<&[bool]>, out: &mut [f32]) -> Result<IntensityRange, NormError> {
    same_length(image.len(), out.len())?;
    if let Some(mask) = valid {
        same_length(image.len(), mask.len())?;
    }
    let range = IntensityRange::of(image, valid)?;
    for (i, out) in out.iter_mut().enumerate() {
        *out = if mask::counts(image, valid, i) { range.normalised(image[i]) } else { 0.0 };
    }
    Ok(range)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn masked_pixels_become_zero_and_do_not_set_the_range() {
        let mut out = [9.0; 4];
        let range = normalise(&[5.0, 100.0, 7.0, 9.0], Some(&[true, false, true, true]), &mut out).unwrap();
        assert_eq!(range, IntensityRange { min: 5.0, max: 9.0 });
        assert_eq!(out, [0.0, 0.0, 0.5, 1.0]);
    }

    #[test]
    fn refuses_constant_empty_and_mismatched_images() {
        let mut out = [0.0; 2];
        assert_eq!(normalise(&[4.0, 4.0], None, &mut out), Err(NormError::ConstantImage));
        assert_eq!(normalise(&[-3e38, 3e38], None, &mut out), Err(NormError::TooFewValid { found: 0 }), "voids");
        assert_eq!(normalise(&[4.0, f32::NAN], None, &mut out), Err(NormError::TooFewValid { found: 1 }));
        assert!(matches!(normalise(&[1.0], None, &mut out), Err(NormError::Length(_))));
        assert!(matches!(normalise(&[1.0, 2.0], Some(&[true]), &mut out), Err(NormError::Length(_))));
    }

    proptest! {
        #[test]
        fn output_fills_zero_to_one_and_keeps_the_order(image in proptest::collection::vec(-3e4f32..3e4, 2..60)) {
            let mut out = vec![9.0; image.len()];
            if normalise(&image, None, &mut out).is_ok() {
                prop_assert!(out.contains(&0.0) && out.contains(&1.0));
                for (a, b) in image.iter().zip(&out) {
                    for (c, d) in image.iter().zip(&out) {
                        prop_assert!(a > c || b <= d);
                    }
                }
            }
        }
    }
}
