//! Stored numbers that are no measurements.
//!
//! A file names some of them (nodata values). Others no height and no brightness can be: [`elunar_core::mask::is_real`].

use elunar_core::mask::is_real;
use std::ops::RangeInclusive;

/// Floats this far from a nodata value equal it, relative to the sum of both, as in GDAL (`ARE_REAL_EQUAL`): files hold the value rounded to
/// `f32`, or converted from `f32`, and its text rounded once more.
const SAME: f64 = 2.0 * f32::EPSILON as f64;

/// The same for floats of 16 bits: one step, since GDAL cuts digits off when it writes them.
const SAME_F16: f64 = 0.5 / 1024.0;

/// Nodata values of one type of samples.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Nodata {
    values: Vec<f64>,
    /// Greatest difference of floats that are equal, relative to their sum.
    same: f64,
}

impl Nodata {
    /// Makes the nodata values of integers within `range`. As in GDAL, a value beyond it equals no sample, and a fraction is cut off.
    pub(crate) fn of_integers(values: impl IntoIterator<Item = f64>, range: &RangeInclusive<f64>) -> Self {
        Self { values: values.into_iter().filter(|v| range.contains(v)).map(f64::trunc).collect(), same: 0.0 }
    }

    /// Makes the nodata values of floats of so many bits.
    pub(crate) fn of_floats(values: impl IntoIterator<Item = f64>, bits: u32) -> Self {
        // Samples of 32 bits hold the value rounded.
        let stored = |value: f64| if bits == 32 { f64::from(value as f32) } else { value };
        let same = if bits == 16 { SAME_F16 } else { SAME };
        Self { values: values.into_iter().map(stored).collect(), same }
    }

    /// Returns whether an integer is a nodata value.
    pub(crate) fn has_integer(&self, stored: f64) -> bool {
        self.values.contains(&stored)
    }

    /// Returns whether a float is a nodata value, or cannot be a measurement.
    pub(crate) fn has_float(&self, stored: f64) -> bool {
        let same = |&value: &f64| stored == value || (stored - value).abs() < self.same * (stored + value).abs();
        !is_real(stored as f32) || self.values.iter().any(same)
    }
}

/// Returns the sample of a number, NaN if it cannot be a measurement.
pub(crate) fn sample(value: f64) -> f32 {
    let sample = value as f32;
    if is_real(sample) { sample } else { f32::NAN }
}

/// Returns the range of integers with or without sign.
pub(crate) fn range_of(signed: bool, bits: u32) -> RangeInclusive<f64> {
    let half = 2_f64.powi(bits as i32 - 1);
    if signed { -half..=half - 1.0 } else { 0.0..=2.0 * half - 1.0 }
}

/// Returns the number at the beginning of a text, as GDAL reads nodata values (`CPLAtofM`): a point or a comma before the fraction, the NaN
/// and infinity of Windows programs (`1.#QNAN`, `-1.#IND`, `-1.#INF`), and anything behind the number. `None` if there is no number, where
/// GDAL takes 0.
pub(crate) fn number(text: &str) -> Option<f64> {
    let text = text.trim_start().to_ascii_lowercase();
    let (negative, rest) = match text.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, text.strip_prefix('+').unwrap_or(&text)),
    };
    let starts = |words: &[&str]| words.iter().any(|word| rest.starts_with(word));
    if starts(&["nan", "1.#qnan", "1.#snan", "1.#ind", "1.#nan"]) {
        return Some(f64::NAN);
    }
    if starts(&["inf", "1.#inf"]) {
        return Some(if negative { f64::NEG_INFINITY } else { f64::INFINITY });
    }
    let digits = |from: usize| rest[from..].bytes().take_while(u8::is_ascii_digit).count();
    let whole = digits(0);
    let fraction = if rest[whole..].starts_with(['.', ',']) { 1 + digits(whole + 1) } else { 0 };
    if whole + fraction.saturating_sub(1) == 0 {
        return None;
    }
    let mut end = whole + fraction;
    if rest[end..].starts_with('e') {
        let sign = usize::from(rest[end + 1..].starts_with(['+', '-']));
        let exponent = digits(end + 1 + sign);
        end += if exponent > 0 { 1 + sign + exponent } else { 0 };
    }
    let value: f64 = rest[..end].replace(',', ".").parse().ok()?;
    Some(if negative { -value } else { value })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_numbers_up_to_where_they_are() {
        for (text, value) in [
            ("-9999", -9999.0),
            (" -9999,000000", -9999.0),
            ("-9999 -8888", -9999.0),
            ("\t-9999\r\n", -9999.0),
            ("-9999,-8888", -9999.0),
            ("1,234.5", 1.234),
            ("+5;", 5.0),
            (".5", 0.5),
            ("5.", 5.0),
            ("-1e4", -1e4),
            ("-1e", -1.0),
            ("-3.4E+38m", -3.4e38),
            ("0x10", 0.0),
            ("1e999", f64::INFINITY),
            ("-1.#INF", f64::NEG_INFINITY),
            ("Infinity", f64::INFINITY),
        ] {
            assert_eq!(number(text), Some(value), "{text:?}");
        }
        for text in ["nan", "-nan", "NaN", "-nan(ind)", "1.#QNAN", "-1.#IND", "1.#IND00"] {
            assert!(number(text).is_some_and(f64::is_nan), "{text:?}");
        }
        for text in ["", "none", "-", ".", ",", "e5", "n/a", "\u{e9}5"] {
            assert_eq!(number(text), None, "{text:?}");
        }
    }

    #[test]
    fn floats_equal_within_the_precision_of_the_file() {
        let nodata = Nodata::of_floats([-9999.9, f64::NAN], 64);
        assert!(nodata.has_float(f64::from(-9999.9_f32)) && nodata.has_float(-9999.9));
        assert!(!nodata.has_float(-9999.0) && !nodata.has_float(0.0));
        assert!(
            nodata.has_float(-2e30) && nodata.has_float(1e30) && !nodata.has_float(9e29) && nodata.has_float(f64::NAN)
        );
        let half = Nodata::of_floats([-9999.0], 16);
        assert!(half.has_float(-10000.0) && half.has_float(-9992.0) && !half.has_float(-9984.0));
        let zero = Nodata::of_floats([0.0], 32);
        assert!(zero.has_float(-0.0) && !zero.has_float(1e-40));
        assert!(sample(1e30).is_nan() && sample(-1.5) == -1.5);
    }

    #[test]
    fn integers_beyond_their_range_are_never_equal() {
        let of = |value: f64, signed, bits| Nodata::of_integers([value], &range_of(signed, bits));
        assert!(of(7.5, false, 8).has_integer(7.0) && of(-9999.5, true, 16).has_integer(-9999.0));
        assert!(of(4_294_967_295.0, false, 32).has_integer(4_294_967_295.0));
        for (value, signed, bits) in [(255.4, false, 8), (-1.0, false, 32), (32768.0, true, 16), (f64::NAN, true, 16)] {
            assert_eq!(of(value, signed, bits), Nodata::default());
        }
    }
}
