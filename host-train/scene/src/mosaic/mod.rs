//! Joining of overlapping heights, as the Ames Stereo Pipeline's `dem_mosaic` does by default. The weight of a DTM grows with the distance
//! from its edges and gaps. The weighted mean is computed in `f64`.
//!
//! [`Mosaic`] joins the tiles of a prediction. [`join`] joins whole DTMs on different grids.

mod blend;
mod grid;
mod join;
mod meridian;
mod overlap;
mod weights;

pub use blend::Mosaic;
pub use grid::{Grid, GridOptions, MosaicInput};
pub use join::{JoinRules, join};
pub use overlap::{BLEND, TileWeights};
pub use weights::WeightRules;
