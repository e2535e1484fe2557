//! What several tests share.

pub(crate) use elunar_testing::{mutate, rasterio, shared_folder};

use crate::model::config::{NetConfig, Preset};
use crate::model::weights::Weights;
use crate::train::recipe::trained_network;

/// A network small enough to train in a test, with every part of the shipped ones.
pub(crate) fn miniature_network() -> NetConfig {
    NetConfig {
        embed: 8,
        depths: [1, 2, 1, 1],
        heads: [1, 1, 2, 2],
        window: 4,
        stem: 4,
        dtm: [4, 4, 4, 4, 8],
        decoder: [8, 8, 8, 4, 4],
        ..trained_network(Preset::Nano)
    }
}

/// Weights with numbers in place of arrays of zeros, which let no gradient through.
pub(crate) fn without_zeros(mut weights: Weights) -> Weights {
    for array in weights.tensors.values_mut().filter(|array| array.data.iter().all(|w| *w == 0.0)) {
        (0..).zip(&mut array.data).for_each(|(i, w)| *w = 0.1 * (i as f32).sin());
    }
    weights
}
