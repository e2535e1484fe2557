//! Errors of losses.

use crate::error::LengthError;
use core::fmt;

/// The reason why a loss cannot be computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LossError {
    /// Buffers of different lengths.
    Length(LengthError),
    /// No valid pixel (or, for the terms with a 3 x 3 stencil, no complete stencil).
    NothingValid,
    /// A mean plus [`crate::loss::PAD_EPS`] that is exactly zero, so that Eq. 6–7 divide by zero.
    ZeroMean,
}

impl From<LengthError> for LossError {
    fn from(e: LengthError) -> Self {
        Self::Length(e)
    }
}

impl fmt::Display for LossError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length(e) => e.fmt(f),
            Self::NothingValid => f.write_str("expected at least one valid pixel, found none"),
            Self::ZeroMean => f.write_str("expected a mean elevation to divide by, found zero"),
        }
    }
}

impl core::error::Error for LossError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_one_line_and_name_expected_and_found() {
        let length = LengthError { expected: 4, found: 3 };
        for text in
            [LossError::from(length).to_string(), LossError::NothingValid.to_string(), LossError::ZeroMean.to_string()]
        {
            assert!(text.starts_with("expected") && text.contains("found") && !text.contains('\n'), "{text}");
        }
    }
}
