//! What files and command lines call two enums of `core`, which knows neither.

use elunar_core::nn::{Illumination, TruthRange};
use serde::{Deserialize, Serialize};

/// Whose minimum and relief normalise the true DTM.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(remote = "TruthRange", rename_all = "lowercase")]
pub(crate) enum TruthRangeName {
    /// The truth's own (Sec. III-A1). Recovery by the coarse range (Eq. 8) then shrinks relief by 6 to 10 %.
    Own,
    /// The coarse tile's, widened by the range margin on both sides, for both DTMs: recovery is exact (our choice).
    Reference,
    /// None: both DTMs are counted in pixels of the image about the mean of the coarse one, so that slopes are slopes (our choice).
    Pixel,
}

/// Which light the network knows.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(remote = "Illumination", rename_all = "lowercase")]
pub(crate) enum IlluminationName {
    /// The Sun anywhere (the paper's).
    Any,
    /// The Sun in the north-west quadrant of the grid; scenes are mirrored to make that so (our choice).
    Northwest,
    /// As northwest, and the change of brightness with slope is given: linear photoclinometry makes a first estimate, which the network
    /// corrects (our choice).
    Given,
}

#[cfg(feature = "clap")]
mod options {
    use super::{Illumination, IlluminationName, TruthRange, TruthRangeName};
    use clap::builder::{EnumValueParser, TypedValueParser};

    /// Reads an option's value.
    pub(crate) fn truth_range() -> impl TypedValueParser<Value = TruthRange> {
        EnumValueParser::<TruthRangeName>::new().map(|name| match name {
            TruthRangeName::Own => TruthRange::Own,
            TruthRangeName::Reference => TruthRange::Reference,
            TruthRangeName::Pixel => TruthRange::Pixel,
        })
    }

    /// Reads an option's value.
    pub(crate) fn illumination() -> impl TypedValueParser<Value = Illumination> {
        EnumValueParser::<IlluminationName>::new().map(|name| match name {
            IlluminationName::Any => Illumination::Any,
            IlluminationName::Northwest => Illumination::Northwest,
            IlluminationName::Given => Illumination::Given,
        })
    }
}

#[cfg(feature = "clap")]
pub(crate) use options::{illumination, truth_range};
