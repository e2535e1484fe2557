//! Names of two enums of `core` in files. `core` itself has no such names.

use elunar_core::nn::{Illumination, TruthRange};
use serde::{Deserialize, Serialize};

/// Which DTM's minimum and relief normalise the true DTM.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(remote = "TruthRange", rename_all = "lowercase")]
pub(crate) enum TruthRangeName {
    /// The truth's own (Sec. III-A1). Scale recovery by the coarse range (Eq. 8) then shrinks relief by 6 to 10 %.
    Own,
    /// The coarse tile's, widened by the range margin on both sides, for both DTMs. Scale recovery is exact (our choice).
    Reference,
    /// None. Both DTMs are in pixels of the image, relative to the mean of the coarse DTM, so that their slopes are true slopes (our
    /// choice).
    Pixel,
}

/// Light for which the network is trained.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(remote = "Illumination", rename_all = "lowercase")]
pub(crate) enum IlluminationName {
    /// The Sun in any direction (the paper's).
    Any,
    /// The Sun in the north-west quadrant of the grid. Scenes are mirrored accordingly (our choice).
    Northwest,
    /// As northwest. In addition, the change of brightness with slope is given. Linear photoclinometry makes a first estimate, and the
    /// network corrects it (our choice).
    Given,
    /// As given. In addition, the first estimate is weighed by the trust in the light, and by the share of the contrast that is relief (our
    /// choice).
    Weighed,
    /// As weighed. In addition, the network is given the slopes of the first estimate and the direction of the light (our choice).
    Sloped,
}
