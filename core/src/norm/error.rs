//! Errors of normalisation.

use crate::error::LengthError;
use core::fmt;

/// Largest relief, in metres, that counts as flat: heights of some kilometres have a rounding error of a millimetre in `f32` (our choice;
/// the paper does not mention flat tiles).
pub const RELIEF_EPS_M: f32 = 0.01;

/// Largest relief, in metres (our choice: hundreds of times the Moon's diameter). With more, heights of a network could be infinite.
pub const RELIEF_MAX_M: f32 = 1e9;

/// The reason why values cannot be normalised or recovered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NormError {
    /// Buffers of different lengths.
    Length(LengthError),
    /// Fewer valid pixels than [`crate::mask::MIN_VALID_PX`].
    TooFewValid {
        /// Valid pixels found.
        found: usize,
    },
    /// Maximum minus minimum that is not above [`crate::norm::RELIEF_EPS_M`], or larger than [`crate::norm::RELIEF_MAX_M`].
    Relief {
        /// The relief found, metres.
        relief_m: f32,
    },
    /// All valid pixels of the image have the same value, or their range is not finite.
    ConstantImage,
    /// An NR that is not finite and above 0.
    Range {
        /// The NR found.
        nr: f32,
    },
    /// A margin that is not finite, or negative.
    Margin {
        /// The share found.
        share: f32,
    },
}

impl From<LengthError> for NormError {
    fn from(e: LengthError) -> Self {
        Self::Length(e)
    }
}

impl fmt::Display for NormError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length(e) => e.fmt(f),
            Self::TooFewValid { found } => {
                write!(f, "expected at least {} valid pixels, found {found}", crate::mask::MIN_VALID_PX)
            }
            Self::Relief { relief_m } => {
                let (above, most) = (RELIEF_EPS_M, RELIEF_MAX_M);
                write!(f, "expected a relief above {above} m and at most {most} m, found {relief_m} m")
            }
            Self::ConstantImage => f.write_str("expected an image with contrast, found one constant value"),
            Self::Range { nr } => write!(f, "expected a normalised range NR that is finite and above 0, found {nr}"),
            Self::Margin { share } => write!(f, "expected a margin that is finite and at least 0, found {share}"),
        }
    }
}

impl core::error::Error for NormError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_one_line_and_name_expected_and_found() {
        let length = LengthError { expected: 4, found: 3 };
        for text in [
            NormError::from(length).to_string(),
            NormError::TooFewValid { found: 1 }.to_string(),
            NormError::Relief { relief_m: 0.0 }.to_string(),
            NormError::ConstantImage.to_string(),
            NormError::Range { nr: 0.0 }.to_string(),
            NormError::Margin { share: -1.0 }.to_string(),
        ] {
            assert!(text.starts_with("expected") && text.contains("found") && !text.contains('\n'), "{text}");
        }
    }
}
