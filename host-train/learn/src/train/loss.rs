//! The hybrid loss on Burn tensors (Eq. 5–7). `elunar_core::loss` has the same on plain slices; a test compares them.

use burn::tensor::module::conv2d;
use burn::tensor::ops::{ConvOptions, PadMode};
use burn::tensor::{Device, Tensor, TensorData};
use elunar_core::loss::PAD_EPS;

/// Elevation term of the loss. The paper's ablation replaces it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Elevation {
    /// L1 between elevations, each divided by its own tile mean (Eq. 6–7).
    MeanNormalised,
    /// Plain L1.
    L1,
}

/// The three terms without weights, each a scalar `[1]`.
pub struct Terms {
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

/// Computes the terms between `truth` and `prediction`, both `[B, 1, H, W]` in [0, NR].
pub fn terms(truth: Tensor<4>, prediction: Tensor<4>, kind: Elevation) -> Terms {
    let relative = |z: Tensor<4>| {
        let mean = z.clone().mean_dim(3).mean_dim(2).add_scalar(PAD_EPS);
        z.div(mean)
    };
    let elevation = match kind {
        Elevation::MeanNormalised => relative(truth.clone()).sub(relative(prediction.clone())).abs().mean(),
        Elevation::L1 => truth.clone().sub(prediction.clone()).abs().mean(),
    };
    let ((tx, ty), (px, py)) = (sobel(truth), sobel(prediction));
    let gradient = tx.clone().sub(px.clone()).abs().mean().add(ty.clone().sub(py.clone()).abs().mean());
    let length =
        |x: &Tensor<4>, y: &Tensor<4>| x.clone().powi_scalar(2).add(y.clone().powi_scalar(2)).add_scalar(1.0).sqrt();
    let lengths = length(&tx, &ty).mul(length(&px, &py));
    let cosine = tx.mul(px).add(ty.mul(py)).add_scalar(1.0).div(lengths);
    let normal = cosine.neg().add_scalar(1.0).mean();
    Terms { elevation, gradient, normal }
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

    /// Weights for heights in pixels with the plain L1 term (our choice). Gradients are then slopes. They have most weight, because an
    /// image shows the shape of the ground.
    pub const PIXELS: Self = Self { elevation: 0.1, gradient: 4.0, normal: 4.0 };

    /// Returns the weighted sum (Eq. 5).
    pub fn total(&self, terms: &Terms) -> Tensor<1> {
        let weigh = |t: &Tensor<1>, w: f32| t.clone().mul_scalar(w);
        weigh(&terms.elevation, self.elevation)
            .add(weigh(&terms.gradient, self.gradient))
            .add(weigh(&terms.normal, self.normal))
    }
}
