//! Which pixels are valid.
//!
//! One rule everywhere: a pixel is valid if the mask, where there is one, says so **and** its value is neither NaN nor [`VOID_FROM`] or more from
//! zero. So a forgotten mask cannot bring a nodata value into a mean.

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
pub fn is_real(sample: f32) -> bool {
    sample.abs() < VOID_FROM
}

/// Returns whether a 16-bit sample of a PDS3 image is a measurement.
pub fn is_real_i16(sample: i16) -> bool {
    sample > INT16_SPECIAL_MAX
}

/// Returns whether the pixel at `index` is valid. Pixels beyond the end of a mask are not.
pub fn counts(samples: &[f32], valid: Option<&[bool]>, index: usize) -> bool {
    samples.get(index).is_some_and(|&v| is_real(v)) && valid.is_none_or(|m| m.get(index) == Some(&true))
}

/// Returns minimum and maximum of the valid pixels. The error is their number if there are fewer than [`MIN_VALID_PX`].
pub(crate) fn extent(samples: &[f32], valid: Option<&[bool]>) -> Result<(f32, f32), usize> {
    let (mut low, mut high, mut found) = (f32::INFINITY, f32::NEG_INFINITY, 0);
    for (i, &sample) in samples.iter().enumerate() {
        if counts(samples, valid, i) {
            low = low.min(sample);
            high = high.max(sample);
            found += 1;
        }
    }
    if found < MIN_VALID_PX { Err(found) } else { Ok((low, high)) }
}

/// Returns the mean of the valid pixels that are not below `least`; NaN if there are none.
pub(crate) fn mean(samples: &[f32], valid: Option<&[bool]>, least: f32) -> f32 {
    let (mut sum, mut count) = (0.0f64, 0usize);
    for (i, &sample) in samples.iter().enumerate() {
        if counts(samples, valid, i) && sample >= least {
            sum += f64::from(sample);
            count += 1;
        }
    }
    (sum / count as f64) as f32
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
        assert_eq!(extent(&samples, None), Ok((3.0, 9.0)));
        assert_eq!(extent(&samples, Some(&[true, true, false, true, true])), Ok((3.0, 5.0)));
        assert_eq!(extent(&samples, Some(&[true, true, false, true, false])), Err(1));
        assert_eq!(extent(&[], None), Err(0));
    }
}
