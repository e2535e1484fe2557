//! Joining overlapping heights, as the Ames Stereo Pipeline's `dem_mosaic` does by default: each part weighs most where it is far
//! from its edges and gaps, and the weighted mean is taken in `f64`.
//!
//! [`Mosaic`] joins the tiles of a prediction, [`join`] whole DTMs on grids of their own.

mod blend;
mod grid;
mod join;
mod overlap;
mod weights;

pub use blend::Mosaic;
pub use grid::{Grid, GridOptions, Input};
pub use join::{JoinRules, join};
pub use overlap::OverlapWeights;
pub use weights::{Blend, WeightRules, tile_weights};
