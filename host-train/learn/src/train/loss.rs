//! The hybrid loss on Burn tensors (Eq. 5–7). `elunar_core::loss` has the same on plain slices; a test compares them.

use burn::tensor::module::conv2d;
use burn::tensor::ops::{ConvOptions, PadMode};
use burn::tensor::{Device, Tensor, TensorData};
use elunar_core::loss::PAD_EPS;

/// Elevation term of the loss. The paper's ablation replaces it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Elevation {
    /// L1 between elevations, each divided by its own tile mean (Eq. 6–7).
    MeanNormalised,
    /// Plain L1.
    L1,
}

/// The three terms without weights, each a scalar `[1]`.
pub struct LossTensors {
    /// Elevation term.
    pub elevation: Tensor<1>,
    /// L1 of the gradients.
    pub gradient: Tensor<1>,
    /// One minus the cosine between surface normals.
    pub normal: Tensor<1>,
}

/// Computes d/dx and d/dy per pixel: 3x3 Sobel over 8, replicated border, so that a constant offset costs nothing.
fn sobel(z: Tensor<4>) -> (Tensor<4>, Tensor<4>) {
    let device: Device = z.device();
    let kernel = |taps: [f32; 9]| -> Tensor<4> {
        Tensor::from_data(TensorData::new(taps.map(|t| t / 8.0).to_vec(), [1, 1, 3, 3]), &device)
    };
    let padded = z.pad([(0, 0), (0, 0), (1, 1), (1, 1)], PadMode::Edge);
    let apply = |k: Tensor<4>| conv2d(padded.clone(), k, None, ConvOptions::new([1, 1], [0, 0], [1, 1], 1));
    (
        apply(kernel([-1.0, 0.0, 1.0, -2.0, 0.0, 2.0, -1.0, 0.0, 1.0])),
        apply(kernel([-1.0, -2.0, -1.0, 0.0, 0.0, 0.0, 1.0, 2.0, 1.0])),
    )
}

/// Slope error (|∂x| + |∂y|, mean over a sample) whose factor is nearly 1. It keeps the loss as large as without factors (our choice).
const TYPICAL_ERROR: f64 = 0.09;
/// Slope error that is added to every sample's own, so that level ground has no endless weight.
const LEAST_ERROR: f64 = 0.01;

/// Returns a factor for the loss of every sample, `[B, 1, 1, 1]`, from `start`, what a residual head corrects. Truth and start are
/// `[B, 1, H, W]`, heights in pixels. It is inverse to the start's slope error, so that a tile of smooth ground counts as much as one of rough
/// ground, and lies between 0.2 and 5 (our choice). Gradients do not pass.
pub fn balance(truth: &Tensor<4>, start: Tensor<4>) -> Tensor<4> {
    let ((tx, ty), (sx, sy)) = (sobel(truth.clone().detach()), sobel(start.detach()));
    let error = tx.sub(sx).abs().add(ty.sub(sy).abs()).mean_dim(3).mean_dim(2);
    error.add_scalar(LEAST_ERROR).recip().mul_scalar(TYPICAL_ERROR).clamp(0.2, 5.0)
}

/// Computes the terms between `truth` and `prediction`, both `[B, 1, H, W]` in [0, NR]. The loss of every sample is multiplied by its factor, if
/// there are `factors` ([`balance`]).
pub fn terms(truth: Tensor<4>, prediction: Tensor<4>, kind: Elevation, factors: Option<&Tensor<4>>) -> LossTensors {
    let mean = |loss: Tensor<4>| match factors {
        Some(factors) => loss.mul(factors.clone()).mean(),
        None => loss.mean(),
    };
    let relative = |z: Tensor<4>| {
        let mean = z.clone().mean_dim(3).mean_dim(2).add_scalar(PAD_EPS);
        z.div(mean)
    };
    let elevation = match kind {
        Elevation::MeanNormalised => mean(relative(truth.clone()).sub(relative(prediction.clone())).abs()),
        Elevation::L1 => mean(truth.clone().sub(prediction.clone()).abs()),
    };
    let ((tx, ty), (px, py)) = (sobel(truth), sobel(prediction));
    let gradient = mean(tx.clone().sub(px.clone()).abs()).add(mean(ty.clone().sub(py.clone()).abs()));
    let length =
        |x: &Tensor<4>, y: &Tensor<4>| x.clone().powi_scalar(2).add(y.clone().powi_scalar(2)).add_scalar(1.0).sqrt();
    let lengths = length(&tx, &ty).mul(length(&px, &py));
    let cosine = tx.mul(px).add(ty.mul(py)).add_scalar(1.0).div(lengths);
    let normal = mean(cosine.neg().add_scalar(1.0));
    LossTensors { elevation, gradient, normal }
}

/// Weights of the three terms; the paper's are 10, 1, 1.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LossWeights {
    /// Weight of the elevation term.
    pub elevation: f32,
    /// Weight of the gradient term.
    pub gradient: f32,
    /// Weight of the normal term.
    pub normal: f32,
}

impl LossWeights {
    /// Eq. 5 with the paper's weights.
    pub const PAPER: Self = Self { elevation: 10.0, gradient: 1.0, normal: 1.0 };

    /// Returns the weighted sum (Eq. 5).
    pub fn total(&self, terms: &LossTensors) -> Tensor<1> {
        let weigh = |t: &Tensor<1>, w: f32| t.clone().mul_scalar(w);
        weigh(&terms.elevation, self.elevation)
            .add(weigh(&terms.gradient, self.gradient))
            .add(weigh(&terms.normal, self.normal))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn maps(values: impl Fn(usize, usize, usize) -> f32) -> Tensor<4> {
        let values: Vec<f32> = (0..2 * 8 * 8).map(|i| values(i / 64, i / 8 % 8, i % 8)).collect();
        Tensor::from_data(TensorData::new(values, [2, 1, 8, 8]), &Device::default())
    }

    fn value(scalar: Tensor<1>) -> f32 {
        scalar.into_data().try_to_vec::<f32>().unwrap()[0]
    }

    #[test]
    fn balanced_samples_count_by_their_share_of_the_starts_error() {
        // Planes: the start's slope is wrong by 0.05 in the first sample and by 0.5 in the second.
        let truth = maps(|sample, _, col| [0.05, 0.5][sample] * col as f32);
        let factors = balance(&truth, maps(|_, _, _| 3.0));
        let found = factors.clone().into_data().try_to_vec::<f32>().unwrap();
        // The replicated border halves the slope of two columns of eight.
        let expected = [0.05, 0.5].map(|slope: f32| 0.09 / (slope * 7.0 / 8.0 + 0.01));
        assert!(found.iter().zip(expected).all(|(f, e)| (f / e - 1.0).abs() < 1e-5), "{found:?} {expected:?}");
        // A prediction that halves both errors: with the factors both samples contribute about the same.
        let half = truth.clone().mul_scalar(0.5);
        let of = |sample: usize| {
            let one = |map: &Tensor<4>| map.clone().narrow(0, sample, 1);
            let loss =
                |factors: Option<&Tensor<4>>| value(terms(one(&truth), one(&half), Elevation::L1, factors).gradient);
            [loss(None), loss(Some(&one(&factors)))]
        };
        let ([a, a_balanced], [b, b_balanced]) = (of(0), of(1));
        assert!(
            (b / a - 10.0).abs() < 1e-3 && (1.0..1.3).contains(&(b_balanced / a_balanced)),
            "{a} {b} {a_balanced} {b_balanced}"
        );
        let both = value(terms(truth.clone(), half, Elevation::L1, Some(&factors)).gradient);
        assert!((both - 0.5 * (a_balanced + b_balanced)).abs() < 1e-6);
    }
}
