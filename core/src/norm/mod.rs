//! Bringing a tile's image and elevations to the ranges the network works in, and heights back to metres (Sec. III-A).

pub mod anchor;
pub mod elevation;
mod error;
pub mod intensity;
pub mod light;
pub mod shading;

pub use anchor::Anchor;
pub use elevation::{ElevationScale, NR, RELIEF_EPS_M, nr_from_reliefs};
pub use error::NormError;
pub use light::{Light, LightFit, Mirror};
pub use shading::Shading;
