//! The form in which a model takes its tiles, as its header says.

/// The range that normalised the truth in training.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TruthRange {
    /// The range of the truth.
    Own,
    /// The range of the coarse tile.
    Reference,
    /// None: heights are counted in pixels about the mean of the coarse tile.
    Pixel,
}

/// The normalisation that a model was trained with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InputRules {
    /// Upper end of the normalised elevation range, NR (Eq. 1).
    pub nr: f32,
    /// Share of the coarse relief by which the range is widened below and above; 0 is the paper's Eq. 2.
    pub range_margin: f32,
    /// The range that normalised the truth in training.
    pub truth_range: TruthRange,
    /// The light that the network knows.
    pub illumination: Illumination,
}

/// The light that the network knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Illumination {
    /// Sun at any azimuth.
    Any,
    /// Sun in the north-west quadrant of the grid: tiles with another Sun are mirrored, and the heights are mirrored back.
    Northwest,
    /// As `Northwest`, and the image is given as the four maps of a guide ([`crate::photoclinometry`]).
    Given,
    /// As `Given`, and the guide is weighed by the trust in the light, and by the share of the contrast that is relief
    /// ([`crate::photoclinometry::Share`]).
    Weighed,
    /// As `Weighed`, with four more maps: the slopes of coarse DTM plus relief, and the direction of the light.
    Sloped,
}

impl Illumination {
    /// Returns whether the image is given as the maps of a guide. Voids of its image are left void, because what fills them is no evidence of
    /// relief; other networks need them filled.
    #[must_use]
    pub const fn is_guided(self) -> bool {
        matches!(self, Self::Given | Self::Weighed | Self::Sloped)
    }

    /// Returns whether the guide is weighed.
    #[must_use]
    pub const fn is_weighed(self) -> bool {
        matches!(self, Self::Weighed | Self::Sloped)
    }

    /// Number of maps for the image, side by side in every pixel: brightness alone, or the maps of a guide.
    #[must_use]
    pub const fn image_maps(self) -> usize {
        match self {
            Self::Any | Self::Northwest => 1,
            Self::Given | Self::Weighed => crate::photoclinometry::MAPS,
            Self::Sloped => crate::photoclinometry::SLOPED_MAPS,
        }
    }
}
