//! What a job needs of a network.

use crate::nn::{Progress, RunError, Runner};

/// An input of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputMap {
    /// The image's maps, side by side in every pixel.
    Image,
    /// The coarse DTM.
    Coarse,
}

/// A network that runs a tile in bounded pieces.
pub trait Network {
    /// What can go wrong.
    type Fault;

    /// Drops the tile before and prepares for the rows of the next. `checked` is [`super::TileRules::checked`].
    ///
    /// # Errors
    /// The network's fault.
    fn begin(&mut self, checked: bool) -> Result<(), Self::Fault>;

    /// Takes a row of an input. `samples` writes samples from a row-major index on, within the row; it asks for multiples of the number of maps.
    ///
    /// # Errors
    /// The network's fault.
    fn load_row(&mut self, map: InputMap, row: usize, samples: impl Fn(usize, &mut [f32])) -> Result<(), Self::Fault>;

    /// Starts the tile whose rows have been taken.
    ///
    /// # Errors
    /// The network's fault.
    fn start(&mut self) -> Result<(), Self::Fault>;

    /// Works until `budget` multiply-accumulates are spent or the tile is done.
    ///
    /// # Errors
    /// The network's fault; then the tile is lost.
    fn step(&mut self, budget: u64) -> Result<Progress, Self::Fault>;

    /// Writes the output of the finished tile, row-major, in the units of the coarse DTM; the same in every call.
    ///
    /// # Errors
    /// The network's fault.
    fn output(&self, out: &mut [f32]) -> Result<(), Self::Fault>;
}

impl Network for Runner<'_, '_> {
    type Fault = RunError;

    fn begin(&mut self, checked: bool) -> Result<(), RunError> {
        self.check_products(checked);
        self.prepare()
    }

    fn load_row(&mut self, map: InputMap, row: usize, samples: impl Fn(usize, &mut [f32])) -> Result<(), RunError> {
        match map {
            InputMap::Image => self.load_row(self.model().image_tensor(), row, samples),
            InputMap::Coarse => self.load_row(self.model().coarse_tensor(), row, samples),
        }
    }

    fn start(&mut self) -> Result<(), RunError> {
        Runner::start(self);
        Ok(())
    }

    fn step(&mut self, budget: u64) -> Result<Progress, RunError> {
        Runner::step(self, budget)
    }

    fn output(&self, out: &mut [f32]) -> Result<(), RunError> {
        Runner::output(self, out)
    }
}
