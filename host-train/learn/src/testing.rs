//! Helpers of several tests.

use burn::tensor::{Device, Tensor, TensorData};
use elunar_net::weights::NetWeights;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Returns numbers between -1 and 1, always the same for a shape and a seed.
pub(crate) fn random<const D: usize>(shape: [usize; D], seed: u64, device: &Device) -> Tensor<D> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let numbers: Vec<f32> = (0..shape.iter().product()).map(|_| rng.random_range(-1.0..1.0)).collect();
    Tensor::from_data(TensorData::new(numbers, shape), device).require_grad()
}

/// Replaces arrays of zeros in weights by other numbers, because zeros pass no gradient.
pub(crate) fn without_zeros(mut weights: NetWeights) -> NetWeights {
    for array in weights.tensors.values_mut().filter(|array| array.data.iter().all(|w| *w == 0.0)) {
        (0..).zip(&mut array.data).for_each(|(i, w)| *w = 0.1 * (i as f32).sin());
    }
    weights
}
