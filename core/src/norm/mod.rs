//! Normalisation of a tile's image and elevations, and recovery of heights in metres (Sec. III-A).

pub mod anchor;
pub mod elevation;
mod error;
pub mod fine;
pub mod intensity;
pub mod light;
pub mod light_fit;
pub mod shading;

pub use anchor::Anchor;
pub use elevation::{ElevationScale, NR, nr_from_reliefs};
pub use error::{NormError, RELIEF_EPS_M, RELIEF_MAX_M};
pub use fine::FineWaves;
pub use light::{Light, Mirror};
pub(crate) use light_fit::DIRECTED_RELIEF;
pub use light_fit::{Axis, LightEstimate, LightFit};
pub use shading::Shading;
