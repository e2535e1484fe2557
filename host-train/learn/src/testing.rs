//! Helpers of several tests.

use elunar_net::weights::Weights;

/// Replaces arrays of zeros in weights by other numbers, because zeros pass no gradient.
pub(crate) fn without_zeros(mut weights: Weights) -> Weights {
    for array in weights.tensors.values_mut().filter(|array| array.data.iter().all(|w| *w == 0.0)) {
        (0..).zip(&mut array.data).for_each(|(i, w)| *w = 0.1 * (i as f32).sin());
    }
    weights
}
