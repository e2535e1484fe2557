//! Which pixels are valid.
//!
//! One rule everywhere: a pixel is valid if the mask, where there is one, says so **and** its value is neither NaN nor [`VOID_FROM`] or more from
//! zero. So a forgotten mask cannot bring a nodata value into a mean.

use crate::words::Words;

/// No height in metres and no brightness is this far from zero (our choice). Heights above a body's sphere have eight digits at most; programs
/// write voids of 3e38 and more (ISIS NULL is -3.4028226550889045e38), which rounding, a scale or a unit may change a little.
pub const VOID_FROM: f32 = 1e30;

/// 16-bit samples at or below this value are special: -32768 NULL, -32767 LRS, -32766 LIS, -32765 HIS, -32764 HRS.
pub const INT16_SPECIAL_MAX: i16 = -32764;

/// Smallest number of valid pixels that can be normalised: a single height has no relief (our choice).
pub const MIN_VALID_PX: usize = 2;

/// Returns whether a float sample is a measurement.
///
/// ```
/// use elunar_core::mask::is_real;
/// assert!(is_real(-1907.5));
/// assert!(!is_real(f32::from_bits(0xFF7F_FFFB))); // ISIS NULL
/// assert!(!is_real(-1e32) && !is_real(1e30));
/// assert!(!is_real(f32::NAN));
/// ```
#[inline]
pub fn is_real(sample: f32) -> bool {
    sample.abs() < VOID_FROM
}

/// Returns a sample that is real, and NaN for others.
#[inline]
pub(crate) fn real(sample: f32) -> f32 {
    if is_real(sample) { sample } else { f32::NAN }
}

/// Returns whether a 16-bit sample of a PDS3 image is a measurement.
pub fn is_real_i16(sample: i16) -> bool {
    sample > INT16_SPECIAL_MAX
}

/// Returns whether the pixel at `index` is valid. Pixels beyond the end of a mask are not.
#[inline]
pub fn counts(samples: &[f32], valid: Option<&[bool]>, index: usize) -> bool {
    samples.get(index).is_some_and(|&v| is_real(v)) && valid.is_none_or(|m| m.get(index) == Some(&true))
}

/// Minimum, maximum and number of the samples that are real, as they come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Extent {
    pub(crate) low: f32,
    pub(crate) high: f32,
    pub(crate) found: usize,
}

impl Extent {
    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        words.f32(&mut self.low);
        words.f32(&mut self.high);
        words.usize(&mut self.found);
    }

    pub(crate) const NONE: Self = Self { low: f32::INFINITY, high: f32::NEG_INFINITY, found: 0 };

    /// Adds a sample, if it is real.
    #[inline]
    pub(crate) fn add(&mut self, sample: f32) {
        if is_real(sample) {
            self.low = self.low.min(sample);
            self.high = self.high.max(sample);
            self.found += 1;
        }
    }

    /// Returns minimum and maximum. The error is the number of samples if there are fewer than [`MIN_VALID_PX`].
    pub(crate) fn range(self) -> Result<(f32, f32), usize> {
        if self.found < MIN_VALID_PX { Err(self.found) } else { Ok((self.low, self.high)) }
    }
}

/// Sum and number of the samples that are real and not below a limit, as they come.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Mean {
    pub(crate) sum: f64,
    pub(crate) count: usize,
}

impl Mean {
    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        words.f64(&mut self.sum);
        words.usize(&mut self.count);
    }

    /// Adds a sample, if it is real and not below `least`.
    #[inline]
    pub(crate) fn add(&mut self, sample: f32, least: f32) {
        if is_real(sample) && sample >= least {
            self.sum += f64::from(sample);
            self.count += 1;
        }
    }

    /// Returns the mean; NaN without a sample.
    #[inline]
    pub(crate) fn value(self) -> f32 {
        (self.sum / self.count as f64) as f32
    }
}

/// Returns the extent of the valid pixels.
pub(crate) fn extent(samples: &[f32], valid: Option<&[bool]>) -> Extent {
    let mut extent = Extent::NONE;
    for (i, &sample) in samples.iter().enumerate() {
        if counts(samples, valid, i) {
            extent.add(sample);
        }
    }
    extent
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn specials_of_every_family_are_not_real() {
        for bits in 0xFF7F_FFFAu32..=0xFF7F_FFFF {
            assert!(!is_real(f32::from_bits(bits)), "{bits:#x}");
        }
        for void in [f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30, 1.701_41e38, -1e32] {
            assert!(!is_real(void), "{void}");
        }
        assert!(is_real(-1e6) && is_real(9.9e29) && is_real(-9.9e29));
        for special in -32768..=-32764 {
            assert!(!is_real_i16(special));
        }
        assert!(is_real_i16(-32763));
    }

    #[test]
    fn extent_needs_two_pixels_that_count() {
        let samples = [f32::NAN, 3.0, 9.0, -3.4028235e38, 5.0];
        assert_eq!(extent(&samples, None).range(), Ok((3.0, 9.0)));
        assert_eq!(extent(&samples, Some(&[true, true, false, true, true])).range(), Ok((3.0, 5.0)));
        assert_eq!(extent(&samples, Some(&[true, true, false, true, false])).range(), Err(1));
        assert_eq!(extent(&[], None).range(), Err(0));
    }
}
