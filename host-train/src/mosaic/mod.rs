//! Joining overlapping tiles, as the Ames Stereo Pipeline's `dem_mosaic` does by default: each tile weighs most where it is far
//! from its edges and gaps, and the weighted mean is taken in `f64`.

mod blend;
mod overlap;
mod weights;

pub use blend::Mosaic;
pub use overlap::OverlapWeights;
pub use weights::{Blend, tile_weights};
