//! How a model wants its tiles, as the header says it.

/// Whose minimum and relief normalised the truth in training.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TruthRange {
    /// The truth's own.
    Own,
    /// The coarse tile's.
    Reference,
    /// None: heights are counted in pixels about the mean of the coarse tile.
    Pixel,
}

/// Which light the network knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Illumination {
    /// The Sun anywhere.
    Any,
    /// The Sun in the north-west quadrant of the grid: tiles lit from elsewhere are mirrored, and the heights back.
    Northwest,
    /// As before, and the network is guided ([`crate::photoclinometry`]): the image is given as four maps.
    Given,
}

impl Illumination {
    /// Maps that the image is given as, side by side in every pixel: its brightness, or those of a guide.
    #[must_use]
    pub const fn image_maps(self) -> usize {
        if matches!(self, Self::Given) { crate::photoclinometry::MAPS } else { 1 }
    }
}
