//! A moment in UTC, as labels state it.

use core::fmt;
use core::str::FromStr;

/// Months that began with a leap second, after 1972-01.
const LEAP_SECONDS: [(u32, u32); 27] = [
    (1972, 7),
    (1973, 1),
    (1974, 1),
    (1975, 1),
    (1976, 1),
    (1977, 1),
    (1978, 1),
    (1979, 1),
    (1980, 1),
    (1981, 7),
    (1982, 7),
    (1983, 7),
    (1985, 7),
    (1988, 1),
    (1990, 1),
    (1991, 1),
    (1992, 7),
    (1993, 7),
    (1994, 7),
    (1996, 1),
    (1997, 7),
    (1999, 1),
    (2006, 1),
    (2009, 1),
    (2012, 7),
    (2015, 7),
    (2017, 1),
];

/// Days of [`UtcTime::from_days`] from 1900 to 2100, the last day with its end.
const DAYS: core::ops::RangeInclusive<f64> = -36_524.5..=36_889.5;

/// A moment in UTC, to a second.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct UtcTime {
    /// Days of 86,400 s since 2000-01-01T12:00:00 UTC.
    days: f64,
}

/// ISO 8601, to a second: `2009-07-16T12:34:56Z`.
impl fmt::Display for UtcTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = libm::round((self.days + 0.5 + FROM_1600_TO_2000) * 86_400.0) as u64;
        let (mut day, second) = (seconds / 86_400, seconds % 86_400);
        let mut year = 1600;
        while day >= year_days(year) {
            day -= year_days(year);
            year += 1;
        }
        let mut number = 1;
        while day >= u64::from(month(year, number).1) {
            day -= u64::from(month(year, number).1);
            number += 1;
        }
        let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
        write!(f, "{year:04}-{number:02}-{:02}T{hour:02}:{minute:02}:{second:02}Z", day + 1)
    }
}

/// Days from 1600-01-01 to 2000-01-01.
const FROM_1600_TO_2000: f64 = 146_097.0;

/// Days of a year.
fn year_days(year: u32) -> u64 {
    (month(year + 1, 1).0 - month(year, 1).0) as u64
}

/// A text that is not a moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TimeError;

impl fmt::Display for TimeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a moment in UTC from 1900 to 2100 expected, such as 2009-07-16T12:34:56 or 2009-197T12:34:56")
    }
}

impl core::error::Error for TimeError {}

impl UtcTime {
    /// Makes a moment of days of 86,400 s since 2000-01-01T12:00:00 UTC, from 1900 to 2100: the modified Julian date less 51,544.5, or seconds
    /// of Unix less 946,728,000, over 86,400.
    ///
    /// # Errors
    /// [`TimeError`] for other days, and NaN.
    pub fn from_days(days: f64) -> Result<Self, TimeError> {
        if DAYS.contains(&days) { Ok(Self { days }) } else { Err(TimeError) }
    }

    /// Days since J2000 in terrestrial time. Leap seconds after 2017 are unknown and left out; before 1972 a line is within a second of UTC.
    pub(super) fn terrestrial_days(self) -> f64 {
        let first = month(1972, 1).0 - 0.5;
        let past = LEAP_SECONDS.iter().filter(|(year, number)| month(*year, *number).0 - 0.5 <= self.days).count();
        let atomic = if self.days < first { 9.9 + 0.71 * (self.days - first) / 365.25 } else { 10.0 + past as f64 };
        self.days + (atomic + 32.184) / 86_400.0
    }
}

/// Takes digits off a text: `digits` of them.
fn number(text: &mut &[u8], digits: usize) -> Option<u32> {
    let (head, rest) = text.split_at_checked(digits)?;
    *text = rest;
    head.iter().try_fold(0u32, |sum, c| c.is_ascii_digit().then(|| sum * 10 + u32::from(c - b'0')))
}

/// Takes a character off a text.
fn sign(text: &mut &[u8], wanted: u8) -> Option<()> {
    let (first, rest) = text.split_first()?;
    *text = rest;
    (*first == wanted).then_some(())
}

/// Days from 2000-01-01 to the first day of a month, and the number of days of the month.
fn month(year: u32, month: u32) -> (f64, u32) {
    let leap = year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    let length = |month: u32| match month {
        2 => 28 + u32::from(leap),
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    };
    // Years before 2000, counted from 1600, whose calendar begins as that of 2000.
    let past = year - 1600;
    let days = past * 365 + past.div_ceil(4) - past.div_ceil(100) + past.div_ceil(400);
    let before: u32 = (1..month).map(length).sum();
    (f64::from(days + before) - FROM_1600_TO_2000, length(month))
}

/// Reads a text: ISO 8601 or the PDS's day of the year, with or without a time and its fraction, `Z` or not.
fn parse(mut text: &[u8]) -> Option<f64> {
    let year = number(&mut text, 4).filter(|year| (1900..=2100).contains(year))?;
    sign(&mut text, b'-')?;
    let by_month = text.get(2) == Some(&b'-');
    let (first, length, day) = if by_month {
        let (number_of, ()) =
            (number(&mut text, 2).filter(|number| (1..=12).contains(number))?, sign(&mut text, b'-')?);
        let (first, length) = month(year, number_of);
        (first, length, number(&mut text, 2)?)
    } else {
        let (first, next) = (month(year, 1).0, month(year + 1, 1).0);
        (first, (next - first) as u32, number(&mut text, 3)?)
    };
    if !(1..=length).contains(&day) {
        return None;
    }
    let text = text.strip_suffix(b"Z").unwrap_or(text);
    let seconds = if text.is_empty() { 0.0 } else { seconds(text)? };
    Some(first + f64::from(day - 1) - 0.5 + seconds / 86_400.0)
}

/// Reads `T12:34:56.7`; a leap second counts as the next one.
fn seconds(mut text: &[u8]) -> Option<f64> {
    match sign(&mut text, b'T') {
        Some(()) => (),
        None => return None,
    }
    let hour = number(&mut text, 2).filter(|hour| *hour < 24)?;
    sign(&mut text, b':')?;
    let minute = number(&mut text, 2).filter(|minute| *minute < 60)?;
    let mut whole = f64::from(hour * 3600 + minute * 60);
    if !text.is_empty() {
        sign(&mut text, b':')?;
        whole += f64::from(number(&mut text, 2).filter(|second| *second <= 60)?);
    }
    if !text.is_empty() {
        sign(&mut text, b'.')?;
        let mut unit = 1.0;
        for c in text {
            unit /= 10.0;
            whole += unit * f64::from(c.is_ascii_digit().then(|| c - b'0')?);
        }
    }
    Some(whole)
}

impl FromStr for UtcTime {
    type Err = TimeError;

    /// Reads a moment from 1900 to 2100: ISO 8601 or the PDS's day of the year, with or without a time, its fraction, and `Z`.
    ///
    /// # Errors
    /// [`TimeError`].
    fn from_str(text: &str) -> Result<Self, TimeError> {
        parse(text.trim().as_bytes()).map(|days| Self { days }).ok_or(TimeError)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_read() {
        let days = |text: &str| text.parse::<UtcTime>().map(|time| time.days);
        assert_eq!(days("2000-01-01T12:00:00"), Ok(0.0));
        assert_eq!(days("2000-001T12:00:00.000Z"), Ok(0.0));
        assert_eq!(days("2000-01-02"), Ok(0.5));
        assert_eq!(days(" 2000-03-01T00:00 "), Ok(59.5));
        assert_eq!(days("1999-12-31T12:00:00.5"), Ok(-1.0 + 0.5 / 86_400.0));
        assert_eq!(days("1970-01-01T00:00:00"), Ok(-10_957.5));
        assert_eq!(days("2100-12-31T00:00:00"), days("2100-365"));
        assert_eq!(days("2016-12-31T23:59:60"), days("2017-001T00:00:00"));
        for year in 1900..2100 {
            let (this, next) = (days(&format!("{year}-12-31")).unwrap(), days(&format!("{}-01-01", year + 1)).unwrap());
            assert_eq!(next - this, 1.0, "{year}");
        }
    }

    #[test]
    fn moments_are_written_as_they_are_read() {
        let texts = ["1900-01-01T00:00:00Z", "1999-12-31T23:59:59Z", "2000-02-29T12:00:01Z", "2009-08-30T12:34:56Z"];
        assert_eq!(texts.map(|text| text.parse::<UtcTime>().unwrap().to_string()), texts);
        assert_eq!("2009-242T12:34:56.6".parse::<UtcTime>().unwrap().to_string(), "2009-08-30T12:34:57Z");
    }

    #[test]
    fn days_are_those_of_texts() {
        for text in ["1900-01-01", "2009-08-30T12:00:00", "2100-12-31T23:59:60"] {
            let time: UtcTime = text.parse().unwrap();
            assert_eq!(UtcTime::from_days(time.days), Ok(time), "{text}");
        }
        assert_eq!(UtcTime::from_days(-10_957.5), "1970-01-01".parse());
        let beyond = [-36_524.6, 36_889.6, f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
        assert!(beyond.iter().all(|days| UtcTime::from_days(*days) == Err(TimeError)));
    }

    #[test]
    fn other_texts_are_refused() {
        let refused = "|x|2009|2009-|2009-13-01|2009-00-01|2009-02-29|2009-366|2009-000|2009-07-16 12:34|2009-07-16T24:00:00\
            |2009-07-16T12:60:00|2009-07-16T12:34:61|2009-07-16T12:34:56.x|2009-07-16T1|1899-01-01|2101-01-01|2009-7-16|+009-07-16";
        for text in refused.split('|') {
            assert_eq!(text.parse::<UtcTime>(), Err(TimeError), "{text}");
        }
    }
}
