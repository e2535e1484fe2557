//! The hybrid loss on Burn tensors (Eq. 5–7). `elunar_core::loss` holds the same on plain slices; a test ties the two together.

use burn::tensor::module::conv2d;
use burn::tensor::ops::{ConvOptions, PadMode};
use burn::tensor::{Device, Tensor, TensorData};
use elunar_core::loss::PAD_EPS;

/// Which elevation term leads (the paper's ablation swaps it).
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Elevation {
    /// L1 between elevations, each divided by its own tile mean (Eq. 6–7).
    MeanNormalised,
    /// Plain L1.
    L1,
}

/// The three terms before weighting, each a scalar `[1]`.
pub struct Terms {
    /// Elevation term.
    pub elevation: Tensor<1>,
    /// L1 of the gradients.
    pub gradient: Tensor<1>,
    /// One minus the cosine between surface normals.
    pub normal: Tensor<1>,
}

/// d/dx and d/dy per pixel: 3x3 Sobel over 8, replicated border, so that a constant offset costs nothing.
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

/// The terms between `truth` and `prediction`, both `[B, 1, H, W]` in [0, NR].
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

    /// The weighted sum (Eq. 5).
    pub fn total(&self, terms: &Terms) -> Tensor<1> {
        let weigh = |t: &Tensor<1>, w: f32| t.clone().mul_scalar(w);
        weigh(&terms.elevation, self.elevation)
            .add(weigh(&terms.gradient, self.gradient))
            .add(weigh(&terms.normal, self.normal))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_core::loss::Pair;
    use elunar_core::loss::hybrid::{self, ElevationTerm, Weights};
    use rand::{Rng, SeedableRng};

    const ROWS: usize = 12;
    const COLS: usize = 16;
    /// f32 tensors against f64 slices: a few hundred roundings of 2^-24.
    const PARITY: f64 = 1e-4;

    fn tile(seed: u64) -> Vec<f32> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        (0..ROWS * COLS).map(|i| 20.0 + 0.8 * (i % COLS) as f32 + rng.random_range(-3.0..3.0f32)).collect()
    }

    fn tensor(data: &[f32], device: &Device) -> Tensor<4> {
        Tensor::from_data(TensorData::new(data.to_vec(), [1, 1, ROWS, COLS]), device)
    }

    #[test]
    fn autodiff_matches_the_analytic_loss_and_gradient() {
        let device = Device::default().autodiff();
        let (truth, predicted) = (tile(1), tile(2));
        for (kind, core_kind) in
            [(Elevation::MeanNormalised, ElevationTerm::MeanNormalised), (Elevation::L1, ElevationTerm::L1)]
        {
            let prediction = tensor(&predicted, &device).require_grad();
            let terms = terms(tensor(&truth, &device), prediction.clone(), kind);
            let total = LossWeights::PAPER.total(&terms);
            let grads = total.backward();
            let found = prediction.grad(&grads).unwrap().into_data().try_to_vec::<f32>().unwrap();

            let pair = Pair::new(&truth, &predicted, None, (ROWS, COLS)).unwrap();
            let mut expected = vec![0.0f32; ROWS * COLS];
            let slices = hybrid::add_gradient(&pair, core_kind, Weights::default(), &mut expected).unwrap();
            let total = f64::from(total.into_scalar::<f32>());
            let wanted = slices.total(Weights::default());
            assert!((total - wanted).abs() <= PARITY * wanted, "{kind:?}: loss {total} against {wanted}");
            let peak = expected.iter().fold(0.0f32, |m, g| m.max(g.abs()));
            for (i, (f, e)) in found.iter().zip(&expected).enumerate() {
                assert!((f - e).abs() <= PARITY as f32 * peak, "{kind:?}: gradient at {i}: {f} against {e}");
            }
        }
    }
}
