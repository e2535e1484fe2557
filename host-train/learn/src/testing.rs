//! What several tests share.

use elunar_net::weights::Weights;

/// Weights with numbers in place of arrays of zeros, which let no gradient through.
pub(crate) fn without_zeros(mut weights: Weights) -> Weights {
    for array in weights.tensors.values_mut().filter(|array| array.data.iter().all(|w| *w == 0.0)) {
        (0..).zip(&mut array.data).for_each(|(i, w)| *w = 0.1 * (i as f32).sin());
    }
    weights
}
