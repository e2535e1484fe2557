//! How long the elevation term is trained alone.

use serde::{Deserialize, Serialize};

/// First steps of a run, which use the elevation term alone. A whole number is a count of steps and a number
/// with a decimal point is a share of all steps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "Number", into = "Number")]
pub enum ElevationOnly {
    /// A count (the paper: 5,000, whatever the length of the run).
    Steps(usize),
    /// A share of all steps, in 0..=1.
    Share(f64),
}

/// The two forms in a file.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Number {
    Whole(usize),
    Point(f64),
}

impl From<Number> for ElevationOnly {
    fn from(number: Number) -> Self {
        match number {
            Number::Whole(steps) => Self::Steps(steps),
            // Older programs wrote all numbers with a decimal point. None is none in both forms.
            Number::Point(0.0) => Self::Steps(0),
            Number::Point(share) => Self::Share(share),
        }
    }
}

impl From<ElevationOnly> for Number {
    fn from(of: ElevationOnly) -> Self {
        match of {
            ElevationOnly::Steps(steps) => Self::Whole(steps),
            ElevationOnly::Share(share) => Self::Point(share),
        }
    }
}

impl ElevationOnly {
    /// Returns whether a step, counted from 0, of `steps` is one of them.
    #[must_use]
    pub fn has(self, step: usize, steps: usize) -> bool {
        match self {
            Self::Steps(first) => step < first,
            Self::Share(share) => (step as f64) < share * steps as f64,
        }
    }

    /// Checks the number.
    ///
    /// # Errors
    /// What was expected and found, if a share is not in 0..=1.
    pub fn check(self) -> Result<(), String> {
        match self {
            Self::Share(share) if !(0.0..=1.0).contains(&share) => {
                Err(format!("elevation only: expected a share in 0.0..=1.0 or a whole number of steps, found {share}"))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_shares_are_read_and_written() {
        for (text, expected) in [
            ("5000", ElevationOnly::Steps(5_000)),
            ("0.25", ElevationOnly::Share(0.25)),
            ("1.0", ElevationOnly::Share(1.0)),
            ("0", ElevationOnly::Steps(0)),
            ("0.0", ElevationOnly::Steps(0)),
        ] {
            assert_eq!(serde_json::from_str::<ElevationOnly>(text).unwrap(), expected);
            let again = serde_json::to_string(&expected).unwrap();
            assert_eq!(serde_json::from_str::<ElevationOnly>(&again).unwrap(), expected);
        }
        for text in ["-1", "1.5"] {
            assert!(serde_json::from_str::<ElevationOnly>(text).unwrap().check().is_err());
        }
        assert!(serde_json::from_str::<ElevationOnly>("\"some\"").is_err());
    }

    #[test]
    fn a_count_does_not_grow_with_the_run() {
        let [count, share] = [ElevationOnly::Steps(5), ElevationOnly::Share(0.5)];
        let length = |of: ElevationOnly, steps: usize| (0..steps).filter(|step| of.has(*step, steps)).count();
        assert_eq!([10, 20].map(|steps| length(count, steps)), [5, 5]);
        assert_eq!([10, 20].map(|steps| length(share, steps)), [5, 10]);
    }
}
