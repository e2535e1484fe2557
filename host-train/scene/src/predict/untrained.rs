//! The pipeline without training: a network that corrects nothing.

use super::network::{TileModel, TileNetwork};
use elunar_base::Result;
use elunar_core::nn::InputRules;
use elunar_core::tile::{Shape, TILE};
use elunar_net::config::{Preset, trained_network};

/// A model without weights. It returns the coarse DTM plus linear photoclinometry, as a network with a residual head does before its first
/// step of training: that head gives 0. Its input is that of the `nano` preset: maps weighed, heights in pixels. What training adds to the
/// pipeline is the difference of a network to this model.
#[derive(Debug, Clone, Copy, Default)]
pub struct Untrained;

impl Untrained {
    /// Description for metadata and results.
    pub const DESCRIPTION: &'static str =
        "coarse DTM plus photoclinometry: the pipeline with a network that corrects nothing";
}

impl TileModel for Untrained {
    fn tile(&self) -> Shape {
        TILE
    }

    fn input_rules(&self) -> InputRules {
        trained_network(Preset::Nano).input_rules()
    }

    fn description(&self) -> String {
        Self::DESCRIPTION.into()
    }

    fn worker(&self) -> Result<Box<dyn TileNetwork + '_>> {
        Ok(Box::new(Self))
    }
}

impl TileNetwork for Untrained {
    fn predict(&mut self, _: &[f32], coarse: &[f32], output: &mut [f32]) -> Result<()> {
        output.copy_from_slice(coarse);
        Ok(())
    }
}
