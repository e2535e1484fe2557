//! Errors of terrain maps that are computed line by line.

use crate::error::LengthError;
use core::fmt;

/// The reason why terrain maps cannot be computed line by line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TerrainError {
    /// A line, a map or the lent memory of another length.
    Length(LengthError),
    /// A pixel size that is not finite and above 0.
    Pixel {
        /// The size found, metres.
        found_m: f64,
    },
    /// A footprint's radius outside 1 to [`crate::terrain::MAX_RADIUS_PX`].
    Radius {
        /// The radius found, pixels.
        found_px: usize,
    },
    /// A limit of the slope that is not above 0 and at most 90 degrees.
    SlopeLimit {
        /// The limit found, degrees.
        found_deg: f32,
    },
    /// A limit of the roughness that is not finite and above 0.
    RoughnessLimit {
        /// The limit found, metres.
        found_m: f32,
    },
    /// A number of standard deviations that is not finite, or negative.
    Sigmas {
        /// The number found.
        found: f32,
    },
    /// A line of the next grid before all lines of the last grid were returned.
    Unfinished {
        /// Lines not returned yet.
        lines: u64,
    },
}

impl From<LengthError> for TerrainError {
    fn from(e: LengthError) -> Self {
        Self::Length(e)
    }
}

impl fmt::Display for TerrainError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Length(e) => e.fmt(f),
            Self::Pixel { found_m } => {
                write!(f, "expected a pixel size that is finite and above 0 m, found {found_m} m")
            }
            Self::Radius { found_px } => {
                write!(f, "expected a radius of 1 to {} pixels, found {found_px}", crate::terrain::MAX_RADIUS_PX)
            }
            Self::SlopeLimit { found_deg } => {
                write!(f, "expected a slope limit above 0 and at most 90 degrees, found {found_deg}")
            }
            Self::RoughnessLimit { found_m } => {
                write!(f, "expected a roughness limit that is finite and above 0 m, found {found_m} m")
            }
            Self::Sigmas { found } => {
                write!(f, "expected a number of standard deviations that is finite and at least 0, found {found}")
            }
            Self::Unfinished { lines } => {
                write!(f, "expected all lines to be out before the next grid, found {lines} still to come")
            }
        }
    }
}

impl core::error::Error for TerrainError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_one_line_and_name_expected_and_found() {
        let length = LengthError { expected: 4, found: 3 };
        for text in [
            TerrainError::from(length).to_string(),
            TerrainError::Pixel { found_m: 0.0 }.to_string(),
            TerrainError::Radius { found_px: 0 }.to_string(),
            TerrainError::SlopeLimit { found_deg: 91.0 }.to_string(),
            TerrainError::RoughnessLimit { found_m: -1.0 }.to_string(),
            TerrainError::Sigmas { found: -1.0 }.to_string(),
            TerrainError::Unfinished { lines: 2 }.to_string(),
        ] {
            assert!(text.starts_with("expected") && text.contains("found") && !text.contains('\n'), "{text}");
        }
    }
}
