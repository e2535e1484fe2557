//! AdamW with each parameter's gradient clipped by its norm: Burn's optimiser, for `f32` on the processor in one pass over each tensor.
//!
//! The moments are those of Burn's [`AdamW`], so a checkpoint of either is read by the other.

use burn::grad_clipping::GradientClippingConfig;
use burn::optim::{AdamW, AdamWConfig, AdamWState, AdaptiveMomentumState, LearningRate, Optimizer};
use burn::tensor::{DType, Device, Tensor, TensorData};
use pulp::Arch;
use rayon::prelude::*;

/// Shares of the old moments; the defaults of PyTorch and of Burn.
const BETAS: [f32; 2] = [0.9, 0.999];
/// Added to the root of the second moment.
const EPSILON: f32 = 1e-8;
/// Number of values of a piece of work.
const CHUNK: usize = 1 << 14;
/// Number of parallel sums, so that vectors can hold them.
const LANES: usize = 16;

/// The optimiser of a training.
#[derive(Clone)]
pub(super) struct ClippedAdamW {
    burns: AdamW,
    weight_decay: f32,
    clip_norm: f32,
}

impl ClippedAdamW {
    /// Makes the optimiser. Gradients of a greater norm than `clip_norm` are scaled to it, parameter by parameter.
    pub(super) fn new(weight_decay: f32, clip_norm: f32) -> Self {
        let config = AdamWConfig::new().with_beta_1(BETAS[0]).with_beta_2(BETAS[1]);
        let burns = config.with_weight_decay(weight_decay).with_epsilon(EPSILON).build();
        Self { burns, weight_decay, clip_norm }
    }

    /// Updates a parameter and its moments in one pass. `time` counts from 1.
    fn update(&self, rate: f64, time: usize, parameter: &mut [f32], gradient: &[f32], moments: [&mut [f32]; 2]) {
        let arch = Arch::new();
        let squares: Vec<f64> = gradient.par_chunks(CHUNK).map(|part| arch.dispatch(|| squares(part))).collect();
        let norm = squares.iter().sum::<f64>().sqrt() as f32;
        let clip = (self.clip_norm / (norm + f32::MIN_POSITIVE)).min(1.0);
        let [old_1, old_2] = BETAS;
        let [scale_1, scale_2] = BETAS.map(|beta| 1.0 - beta.powi(time as i32));
        let (kept, rate) = ((1.0 - rate * f64::from(self.weight_decay)) as f32, rate as f32);
        let [first, second] = moments.map(|moment| moment.par_chunks_mut(CHUNK));
        let parts = parameter.par_chunks_mut(CHUNK).zip(gradient.par_chunks(CHUNK)).zip(first).zip(second);
        parts.for_each(|(((parameter, gradient), first), second)| {
            arch.dispatch(|| {
                let values = parameter.iter_mut().zip(gradient).zip(&mut *first).zip(&mut *second);
                for (((w, g), m), v) in values {
                    let g = clip * g;
                    *m = old_1 * *m + (1.0 - old_1) * g;
                    *v = old_2 * *v + (1.0 - old_2) * (g * g);
                    *w = kept * *w - rate * ((*m / scale_1) / ((*v / scale_2).sqrt() + EPSILON));
                }
            });
        });
    }
}

/// Returns the sum of squares.
#[inline(always)]
fn squares(numbers: &[f32]) -> f64 {
    let (body, last) = numbers.as_chunks::<LANES>();
    let mut lanes = [0.0f32; LANES];
    for x in body {
        for i in 0..LANES {
            lanes[i] += x[i] * x[i];
        }
    }
    lanes.iter().copied().map(f64::from).sum::<f64>() + last.iter().map(|x| f64::from(x * x)).sum::<f64>()
}

/// Returns the numbers of a tensor of `f32`.
fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_into_vec().expect("a tensor of f32")
}

impl Optimizer for ClippedAdamW {
    type State<const D: usize> = AdamWState<D>;

    fn step<const D: usize>(
        &self,
        rate: LearningRate,
        tensor: Tensor<D>,
        gradient: Tensor<D>,
        state: Option<Self::State<D>>,
    ) -> (Tensor<D>, Option<Self::State<D>>) {
        let (device, shape) = (tensor.device(), tensor.dims());
        if device != Device::flex() || [&tensor, &gradient].iter().any(|t| t.dtype() != DType::F32) {
            let clipped = GradientClippingConfig::Norm(self.clip_norm).init().clip_gradient(gradient);
            return self.burns.step(rate, tensor, clipped, state);
        }
        let (time, moments) = match state {
            Some(AdamWState { momentum }) => (momentum.time + 1, [momentum.moment_1, momentum.moment_2].map(numbers)),
            None => (1, std::array::from_fn(|_| vec![0.0; shape.iter().product()])),
        };
        let (mut parameter, [mut first, mut second]) = (numbers(tensor), moments);
        self.update(rate, time, &mut parameter, &numbers(gradient), [&mut first, &mut second]);
        let tensor = |data| Tensor::from_data(TensorData::new(data, shape), &device);
        let momentum = AdaptiveMomentumState::new(time, tensor(first), tensor(second));
        (tensor(parameter), Some(AdamWState::new(momentum)))
    }

    fn to_device<const D: usize>(state: Self::State<D>, device: &Device) -> Self::State<D> {
        AdamW::to_device(state, device)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::random;

    #[test]
    fn one_pass_equals_burns_operators() {
        let device = Device::flex().autodiff();
        let ours = ClippedAdamW::new(0.1, 1.0);
        let clip = GradientClippingConfig::Norm(1.0).init();
        let start = random([40, 530], 1, &device).inner();
        let (mut found, mut expected) = ((start.clone(), None), (start, None));
        // Gradients that are clipped, and some that are not.
        for (step, size) in [1.0, 1e-4, 1e-3, 0.5].into_iter().enumerate() {
            let gradient = random([40, 530], 2 + step as u64, &device).inner().mul_scalar(size);
            found = ours.step(1e-2, found.0, gradient.clone(), found.1);
            expected = ours.burns.step(1e-2, expected.0, clip.clip_gradient(gradient), expected.1);
            let (ours, theirs) = (&found.1.as_ref().unwrap().momentum, &expected.1.as_ref().unwrap().momentum);
            assert_eq!(ours.time, theirs.time);
            let pairs =
                [(&found.0, &expected.0), (&ours.moment_1, &theirs.moment_1), (&ours.moment_2, &theirs.moment_2)];
            for (found, expected) in pairs {
                let [found, expected] = [found, expected].map(|t| numbers(t.clone()));
                let largest = expected.iter().fold(0.0f32, |a, b| a.max(b.abs()));
                let worst = found.iter().zip(&expected).fold(0.0f32, |a, (b, c)| a.max((b - c).abs()));
                // The norm is a sum of twenty thousand squares in another order.
                assert!(largest > 0.0 && worst <= 1e-5 * largest, "step {step}: off by {worst} of {largest}");
            }
        }
    }
}
