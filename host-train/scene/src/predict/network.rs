//! What the tile loop needs of a network, float or int8.

use elunar_core::nn::InputRules;
use elunar_core::tile::Shape;
use elunar_raster::Result;

/// A loaded model: immutable, shared by all threads.
pub trait Model: Sync {
    /// Tile rows and columns the model takes.
    fn tile(&self) -> Shape;
    /// How tiles are normalised.
    fn input_rules(&self) -> InputRules;
    /// One line for file metadata: kind, name, SHA-256 of the model file.
    fn description(&self) -> String;
    /// A worker with its own scratch memory; one per thread.
    ///
    /// # Errors
    /// If the worker's memory cannot be set up.
    fn worker(&self) -> Result<Box<dyn TileNetwork + '_>>;
}

/// One thread's instance of a model.
pub trait TileNetwork {
    /// Predicts one tile. `image` in [0, 1] (or a guide's maps, four in every pixel), `coarse` in [0, NR] (or pixels), `output` in the same
    /// units as `coarse` (a residual head may leave the range slightly); all row-major `rows * cols`.
    ///
    /// # Errors
    /// If the network reports a fault.
    fn predict(&mut self, image: &[f32], coarse: &[f32], output: &mut [f32]) -> Result<()>;
}
