//! Values of a label, right of the equals sign.

use std::fmt;

/// A value with the unit that follows it, if one does.
#[derive(Debug, Clone, PartialEq)]
pub struct Value {
    /// The value itself.
    pub kind: ValueKind,
    /// The text in angle brackets behind the value, verbatim: `KM`, `METERS/PIXEL`.
    pub unit: Option<String>,
}

/// Kinds of values in PVL.
#[derive(Debug, Clone, PartialEq)]
pub enum ValueKind {
    /// A decimal integer.
    Integer(i128),
    /// `2#1010#`, `16#FF7FFFFB#`. A separate kind, because for real samples such a number is a bit pattern.
    Based {
        /// 2 to 16.
        radix: u32,
        /// The number.
        value: i128,
    },
    /// A real number; also an integer beyond 128 bits.
    Real(f64),
    /// A date, a time or both, as written: `1990-158T15:24:12Z`.
    Time(String),
    /// `"..."`, lines kept.
    Text(String),
    /// `'...'`, or an unquoted word: `MSB_INTEGER`, `N/A`.
    Symbol(String),
    /// `( , )`: ordered.
    Sequence(Vec<Value>),
    /// `{ , }`: unordered.
    Set(Vec<Value>),
    /// Nothing: the next keyword follows the equals sign. Not PVL, but in labels of Chang'E.
    Empty,
}

impl Value {
    /// Returns the number; `None` for other kinds.
    #[must_use]
    pub fn number(&self) -> Option<f64> {
        match self.kind {
            ValueKind::Integer(value) | ValueKind::Based { value, .. } => Some(value as f64),
            ValueKind::Real(value) => Some(value),
            _ => None,
        }
    }

    /// Returns the text of a text or symbol, without surrounding blanks.
    #[must_use]
    pub fn text(&self) -> Option<&str> {
        match &self.kind {
            ValueKind::Text(text) | ValueKind::Symbol(text) => Some(text.trim()),
            _ => None,
        }
    }

    /// Returns whether there is no value, or a word for that: `N/A`, `UNK`, `NULL`, and their long forms.
    #[must_use]
    pub fn is_absent(&self) -> bool {
        let absent = ["N/A", "NA", "UNK", "NULL", "NONE", "NOT APPLICABLE", "UNKNOWN", ""];
        self.kind == ValueKind::Empty
            || self.text().is_some_and(|text| absent.iter().any(|word| text.eq_ignore_ascii_case(word)))
    }

    /// Returns the members of a sequence or set, otherwise the value itself.
    #[must_use]
    pub fn members(&self) -> &[Value] {
        match &self.kind {
            ValueKind::Sequence(members) | ValueKind::Set(members) => members,
            _ => std::slice::from_ref(self),
        }
    }
}

impl fmt::Display for Value {
    /// Writes the value as in a label, with the lines of texts joined.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |f: &mut fmt::Formatter<'_>, open: char, members: &[Value], close: char| {
            write!(f, "{open}")?;
            for (index, member) in members.iter().enumerate() {
                write!(f, "{}{member}", if index == 0 { "" } else { ", " })?;
            }
            write!(f, "{close}")
        };
        match &self.kind {
            ValueKind::Integer(value) => write!(f, "{value}")?,
            ValueKind::Based { radix, value } => write!(f, "{value} (stated to base {radix})")?,
            ValueKind::Real(value) => write!(f, "{value}")?,
            ValueKind::Time(text) => f.write_str(text)?,
            ValueKind::Text(text) | ValueKind::Symbol(text) => {
                f.write_str(&text.split_whitespace().collect::<Vec<_>>().join(" "))?;
            }
            ValueKind::Sequence(members) => list(f, '(', members, ')')?,
            ValueKind::Set(members) => list(f, '{', members, '}')?,
            ValueKind::Empty => {}
        }
        self.unit.as_ref().map_or(Ok(()), |unit| write!(f, " <{unit}>"))
    }
}

/// Returns the meaning of an unquoted word, or the reason why it has none.
pub(super) fn classify(word: &str) -> Result<ValueKind, String> {
    if word.contains('#') {
        return based(word);
    }
    let digits = word.strip_prefix(['+', '-']).unwrap_or(word);
    if !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit()) {
        return Ok(word.parse().map_or_else(|_| ValueKind::Real(word.parse().unwrap_or(f64::NAN)), ValueKind::Integer));
    }
    let numeric = |b: u8| b.is_ascii_digit() || b"+-.eE".contains(&b);
    if digits.starts_with(|c: char| c.is_ascii_digit() || c == '.')
        && word.bytes().all(numeric)
        && let Ok(value) = word.parse()
    {
        return Ok(ValueKind::Real(value));
    }
    if is_time(word) {
        return Ok(ValueKind::Time(word.into()));
    }
    // Words of ISIS may be paths: $lro/kernels/spk/a.bsp.
    if word.starts_with(|c: char| c.is_ascii_alphanumeric() || "_$/".contains(c)) {
        return Ok(ValueKind::Symbol(word.into()));
    }
    Err(format!("a value expected, found {word:?}"))
}

fn based(word: &str) -> Result<ValueKind, String> {
    let refuse = || format!("an integer such as 16#FF# expected, found {word:?}");
    let (negative, rest) = match word.strip_prefix(['+', '-']) {
        Some(rest) => (word.starts_with('-'), rest),
        None => (false, word),
    };
    let (radix, digits) = rest.split_once('#').ok_or_else(refuse)?;
    let digits = digits.strip_suffix('#').ok_or_else(refuse)?;
    let radix = radix.parse().ok().filter(|radix| (2..=16).contains(radix)).ok_or_else(refuse)?;
    let value = i128::from_str_radix(digits, radix).map_err(|_| refuse())?;
    Ok(ValueKind::Based { radix, value: if negative { -value } else { value } })
}

/// Returns whether the word is `date`, `time` or `dateTtime`. Dates are year-month-day or year-day. Times may end in `Z` or a zone offset.
fn is_time(word: &str) -> bool {
    match word.split_once(['T', 't']) {
        Some((date, time)) => is_date(date) && is_clock(time),
        None => is_date(word) || is_clock(word),
    }
}

/// Returns whether the text is a number with one of the given lengths, within the range.
fn field(text: &str, lengths: std::ops::RangeInclusive<usize>, range: std::ops::RangeInclusive<u32>) -> bool {
    let digits = text.bytes().all(|b| b.is_ascii_digit());
    digits && lengths.contains(&text.len()) && text.parse().is_ok_and(|value| range.contains(&value))
}

fn is_date(text: &str) -> bool {
    let parts: Vec<&str> = text.split('-').collect();
    match parts[..] {
        [year, day] => field(year, 4..=4, 0..=9999) && field(day, 3..=3, 1..=366),
        [year, month, day] => field(year, 4..=4, 0..=9999) && field(month, 2..=2, 1..=12) && field(day, 2..=2, 1..=31),
        _ => false,
    }
}

fn is_clock(text: &str) -> bool {
    let (clock, zone) = match text.find(['Z', 'z', '+', '-']) {
        Some(at) => text.split_at(at),
        None => (text, ""),
    };
    let zone_is_right = match zone.split_at_checked(1) {
        None => true,
        Some(("Z" | "z", rest)) => rest.is_empty(),
        Some((_, offset)) => {
            let (hours, minutes) = offset.split_once(':').unwrap_or((offset, "00"));
            field(hours, 1..=2, 0..=14) && field(minutes, 2..=2, 0..=59)
        }
    };
    let mut parts = clock.split(':');
    let (hours, minutes) = (parts.next().unwrap_or(""), parts.next().unwrap_or(""));
    let seconds = parts.next().unwrap_or("00");
    let (whole, fraction) = seconds.split_once('.').unwrap_or((seconds, ""));
    // A leap second has number 60.
    zone_is_right
        && parts.next().is_none()
        && field(hours, 2..=2, 0..=24)
        && field(minutes, 2..=2, 0..=59)
        && field(whole, 2..=2, 0..=60)
        && fraction.bytes().all(|b| b.is_ascii_digit())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_told_apart() {
        let integer = |word: &str| matches!(classify(word), Ok(ValueKind::Integer(_)));
        assert!(["0", "-89", "+7", "170141183460469231731687303715884105727"].into_iter().all(integer));
        let real = |word: &str| matches!(classify(word), Ok(ValueKind::Real(_)));
        assert!(["0.0", "123.", "+1234.56", "-.9981", "1.5E-3", "1.e5", &"9".repeat(60)].into_iter().all(real));
        let time = |word: &str| matches!(classify(word), Ok(ValueKind::Time(_)));
        let times = [
            "1990-07-04",
            "1990-158",
            "12:00",
            "12:00:45.4571",
            "15:24:12Z",
            "01:12:22+7",
            "2001-001T01:10:39.457591+07",
        ];
        assert!(times.into_iter().all(time));
        let symbol = |word: &str| matches!(classify(word), Ok(ValueKind::Symbol(_)));
        let symbols = [
            "MSB_INTEGER",
            "N/A",
            "inf",
            "nan",
            "1/270649237:07208",
            "1990-13-04",
            "25:00",
            "12:61",
            "1e",
            "1990-158Tx",
        ];
        for word in symbols {
            assert!(symbol(word), "{word}: {:?}", classify(word));
        }
        for word in ["#", "-", ".", "*", "&x", "2#12#", "2#10", "1#0#", "17#0#", "#10#", "2##"] {
            assert!(classify(word).is_err(), "{word}: {:?}", classify(word));
        }
    }

    #[test]
    fn based_integers_have_their_value() {
        assert_eq!(classify("16#FF7FFFFB#"), Ok(ValueKind::Based { radix: 16, value: 0xFF7F_FFFB }));
        assert_eq!(classify("-2#101#"), Ok(ValueKind::Based { radix: 2, value: -5 }));
        assert_eq!(classify("16#-4b#"), Ok(ValueKind::Based { radix: 16, value: -75 }));
    }
}
