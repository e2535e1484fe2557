//! Interface between the tile loop and a network, float or integer.

use elunar_base::Result;
use elunar_core::nn::InputRules;
use elunar_core::tile::Shape;
use std::sync::Arc;

/// A loaded model. It is immutable; all threads share it.
pub trait TileModel: Sync {
    /// Returns the rows and columns of the model's tile.
    fn tile(&self) -> Shape;
    /// Returns the rules by which tiles are normalised.
    fn input_rules(&self) -> InputRules;
    /// Returns one line for file metadata: kind, name, SHA-256 of the model file.
    fn description(&self) -> String;
    /// Makes a worker with its own scratch memory. Each thread needs one.
    ///
    /// # Errors
    /// If the worker's memory cannot be set up.
    fn worker(&self) -> Result<Box<dyn TileNetwork + '_>>;
}

/// A model that several jobs share.
impl<M: TileModel + Send> TileModel for Arc<M> {
    fn tile(&self) -> Shape {
        self.as_ref().tile()
    }

    fn input_rules(&self) -> InputRules {
        self.as_ref().input_rules()
    }

    fn description(&self) -> String {
        self.as_ref().description()
    }

    fn worker(&self) -> Result<Box<dyn TileNetwork + '_>> {
        self.as_ref().worker()
    }
}

/// The instance of a model for one thread.
pub trait TileNetwork {
    /// Predicts one tile. `image` is in [0, 1] (or a guide's maps, all of them in every pixel), `coarse` in [0, NR] (or pixels). `output` has the
    /// units of `coarse` (a residual head may exceed the range slightly). All are row-major `rows * cols`.
    ///
    /// # Errors
    /// If the network reports a fault.
    fn predict(&mut self, image: &[f32], coarse: &[f32], output: &mut [f32]) -> Result<()>;
}
