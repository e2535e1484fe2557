//! One small `Copy` error per operation; each prints as one lower-case line.

use core::fmt;

/// A buffer does not have the length its partner or its shape demands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LengthError {
    /// Samples demanded.
    pub expected: usize,
    /// Samples found.
    pub found: usize,
}

impl fmt::Display for LengthError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "expected a buffer of {} samples, found {}", self.expected, self.found)
    }
}

impl core::error::Error for LengthError {}

/// Checks that `found` samples are `expected` samples.
pub(crate) fn same_length(expected: usize, found: usize) -> Result<(), LengthError> {
    if expected == found { Ok(()) } else { Err(LengthError { expected, found }) }
}

/// Why values could not be normalised or recovered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NormError {
    /// Buffers of different lengths.
    Length(LengthError),
    /// Fewer valid pixels than [`crate::mask::MIN_VALID_PX`].
    TooFewValid {
        /// Valid pixels found.
        found: usize,
    },
    /// Maximum minus minimum is not above [`crate::norm::RELIEF_EPS_M`] (or not finite).
    Relief {
        /// The relief found, metres.
        relief_m: f32,
    },
    /// All valid pixels of the image have one value, or their range is not finite.
    ConstantImage,
    /// NR must be finite and above 0.
    Range {
        /// The NR found.
        nr: f32,
    },
    /// A margin must be finite and not negative.
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
                write!(f, "expected a finite relief above {} m, found {relief_m} m", crate::norm::RELIEF_EPS_M)
            }
            Self::ConstantImage => f.write_str("expected an image with contrast, found one constant value"),
            Self::Range { nr } => write!(f, "expected a normalised range NR that is finite and above 0, found {nr}"),
            Self::Margin { share } => write!(f, "expected a margin that is finite and at least 0, found {share}"),
        }
    }
}

impl core::error::Error for NormError {}

/// Why a scene could not be cut into tiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TileError {
    /// The scene is smaller than one tile.
    SceneTooSmall {
        /// Scene rows and columns.
        scene: (usize, usize),
        /// Tile rows and columns.
        tile: (usize, usize),
    },
    /// Tiles must have at least one row and one column, and overlap by less than either.
    Overlap {
        /// The overlap asked for, pixels.
        overlap_px: usize,
        /// Tile rows and columns.
        tile: (usize, usize),
    },
}

impl fmt::Display for TileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::SceneTooSmall { scene, tile } => write!(
                f,
                "expected a scene of at least {} x {} pixels (rows x columns, one tile), found {} x {}",
                tile.0, tile.1, scene.0, scene.1
            ),
            Self::Overlap { overlap_px, tile } => {
                write!(f, "expected an overlap below the tile's {} x {} pixels, found {overlap_px}", tile.0, tile.1)
            }
        }
    }
}

impl core::error::Error for TileError {}

/// Why a loss could not be computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LossError {
    /// Buffers of different lengths.
    Length(LengthError),
    /// The mask leaves no pixel (or, for the terms with a 3 x 3 stencil, no complete stencil).
    NothingValid,
    /// A mean plus [`crate::loss::PAD_EPS`] is exactly zero, so Eq. 6–7 divide by zero.
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

/// Why terrain maps could not be computed line by line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TerrainError {
    /// A line, a map or the lent memory of another length.
    Length(LengthError),
    /// Pixel sizes must be finite and above 0.
    Pixel {
        /// The size found, metres.
        found_m: f64,
    },
    /// A footprint's radius outside 1 to [`crate::terrain::MAX_RADIUS_PX`].
    Radius {
        /// The radius found, pixels.
        found_px: usize,
    },
    /// A limit of the slope must be above 0 and at most 90 degrees.
    SlopeLimit {
        /// The limit found, degrees.
        found_deg: f32,
    },
    /// A limit of the roughness must be finite and above 0.
    RoughnessLimit {
        /// The limit found, metres.
        found_m: f32,
    },
    /// A line of the next grid while lines of the last one are still to be asked for.
    Unfinished {
        /// Lines still to come.
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
            length.to_string(),
            NormError::from(length).to_string(),
            NormError::TooFewValid { found: 1 }.to_string(),
            NormError::Relief { relief_m: 0.0 }.to_string(),
            NormError::ConstantImage.to_string(),
            NormError::Range { nr: 0.0 }.to_string(),
            NormError::Margin { share: -1.0 }.to_string(),
            TileError::SceneTooSmall { scene: (9, 9), tile: (256, 320) }.to_string(),
            TileError::Overlap { overlap_px: 400, tile: (256, 320) }.to_string(),
            LossError::from(length).to_string(),
            LossError::NothingValid.to_string(),
            LossError::ZeroMean.to_string(),
            TerrainError::from(length).to_string(),
            TerrainError::Pixel { found_m: 0.0 }.to_string(),
            TerrainError::Radius { found_px: 0 }.to_string(),
            TerrainError::SlopeLimit { found_deg: 91.0 }.to_string(),
            TerrainError::RoughnessLimit { found_m: -1.0 }.to_string(),
            TerrainError::Unfinished { lines: 2 }.to_string(),
        ] {
            assert!(text.starts_with("expected") && text.contains("found") && !text.contains('\n'), "{text}");
        }
    }
}
