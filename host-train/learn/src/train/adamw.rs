//! AdamW with each parameter's gradient clipped by its norm, for all parameters of a module at once.
//!
//! The moments are two long tensors ([`flat`](super::flat)). On the processor each parameter is updated in one pass. On a GPU AdamW's
//! operators on hundreds of parameters would be thousands of small kernels. There the parameters are one long tensor, too, and only putting it
//! together and taking it apart costs kernels for each parameter.

use super::flat::{Layout, Part, Rows, parts, replaced};
use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor, TensorData};
use elunar_base::{Error, Result};
use elunar_net::weights::{Array, NetWeights};
use pulp::Arch;
use rayon::prelude::*;
use std::path::Path;

/// Added to the root of the second moment.
const EPSILON: f32 = 1e-8;
/// Number of values of a piece of work.
const CHUNK: usize = 1 << 14;
/// Number of parallel sums, so that vectors can hold them.
const LANES: usize = 16;
/// Names of the moments in a file.
const MOMENTS: [&str; 2] = ["moment_1", "moment_2"];
/// Name of the number of steps in a file.
const TIME: &str = "steps";

/// Constants of the optimiser.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rule {
    /// Shares of the old moments.
    pub(super) betas: [f32; 2],
    pub(super) weight_decay: f32,
    /// Gradients of a greater norm are scaled to it, parameter by parameter. Infinite: none are.
    pub(super) clip_norm: f32,
}

/// The optimiser of a training.
pub(super) struct AdamW {
    rule: Rule,
    /// Number of steps done.
    time: usize,
    /// First and second moment, unless no step is done.
    moments: Option<[Tensor<1>; 2]>,
    /// For steps on a GPU.
    rows: Option<Rows>,
}

impl AdamW {
    pub(super) fn new(rule: Rule) -> Self {
        Self { rule, time: 0, moments: None, rows: None }
    }

    /// Does a step of this learning rate.
    ///
    /// # Errors
    /// If the moments are those of other parameters.
    pub(super) fn step<M: Module>(&mut self, rate: f64, module: M, gradients: GradientsParams) -> Result<M> {
        let parts = parts(&module, gradients);
        let one_by_one = parts.iter().all(|part| part.weights.device() == Device::flex());
        let weights = self.updated(rate, &parts, one_by_one)?;
        Ok(replaced(module, &parts, weights))
    }

    /// Returns the new weights: made one by one, or all at once.
    fn updated(&mut self, rate: f64, parts: &[Part], one_by_one: bool) -> Result<Vec<Tensor<1>>> {
        let Some(first) = parts.first() else { return Ok(Vec::new()) };
        let (layout, device) = (Layout::of(parts), first.weights.device());
        let moments = self.moments.take().unwrap_or_else(|| {
            let zeros = Tensor::zeros([layout.len()], &device);
            [zeros.clone(), zeros]
        });
        let found = moments[0].dims()[0];
        if found != layout.len() {
            return Err(Error::input(format!(
                "optimiser: expected moments of {} numbers, found {found}",
                layout.len()
            )));
        }
        self.time += 1;
        let rate = Rate::new(&self.rule, rate, self.time);
        let (weights, moments) = if one_by_one {
            self.one_by_one(&rate, &layout, parts, moments)
        } else {
            self.at_once(&rate, layout, parts, moments)
        };
        self.moments = Some(moments);
        Ok(weights)
    }

    fn one_by_one(
        &self,
        rate: &Rate,
        layout: &Layout,
        parts: &[Part],
        moments: [Tensor<1>; 2],
    ) -> (Vec<Tensor<1>>, [Tensor<1>; 2]) {
        let device = Device::flex();
        let tensor = |numbers: Vec<f32>| {
            let count = numbers.len();
            Tensor::from_data(TensorData::new(numbers, [count]), &device)
        };
        let [mut first, mut second] = moments.map(numbers);
        let update = |(part, values): (&Part, std::ops::Range<usize>)| {
            let mut weights = numbers(part.weights.clone());
            let moments = [&mut first[values.clone()], &mut second[values]];
            update(&self.rule, rate, &mut weights, &numbers(part.gradient.clone()), moments);
            tensor(weights)
        };
        let weights = parts.iter().zip(layout.values()).map(update).collect();
        (weights, [first, second].map(tensor))
    }

    fn at_once(
        &mut self,
        rate: &Rate,
        layout: Layout,
        parts: &[Part],
        [first, second]: [Tensor<1>; 2],
    ) -> (Vec<Tensor<1>>, [Tensor<1>; 2]) {
        let device = first.device();
        let rows = self.rows.take().filter(|rows| rows.layout == layout).unwrap_or_else(|| Rows::new(layout, &device));
        let mut gradient = rows.layout.join(parts.iter().map(|part| part.gradient.clone()), &device);
        if self.rule.clip_norm.is_finite() {
            let norms = rows.sums_of_squares(gradient.clone()).sqrt().add_scalar(f32::MIN_POSITIVE);
            gradient = rows.scaled(gradient, norms.recip().mul_scalar(self.rule.clip_norm).clamp_max(1.0));
        }
        let [old_1, old_2] = self.rule.betas;
        let first = first.mul_scalar(old_1).add(gradient.clone().mul_scalar(1.0 - old_1));
        let second = second.mul_scalar(old_2).add(gradient.square().mul_scalar(1.0 - old_2));
        let [scale_1, scale_2] = rate.scales;
        let root = second.clone().div_scalar(scale_2).sqrt().add_scalar(EPSILON);
        let change = first.clone().div_scalar(scale_1).div(root).mul_scalar(rate.rate);
        let weights = rows.layout.join(parts.iter().map(|part| part.weights.clone()), &device);
        let weights = rows.layout.split(&weights.mul_scalar(rate.kept).sub(change));
        self.rows = Some(rows);
        (weights, [first, second])
    }

    /// Returns moments and number of steps as the bytes of a safetensors file.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let moments = MOMENTS.iter().zip(self.moments.iter().flatten());
        let tensors = moments.map(|(name, moment)| {
            let data = numbers(moment.clone());
            (name.to_string(), Array { shape: vec![data.len()], data })
        });
        NetWeights { tensors: tensors.collect(), metadata: [(TIME.into(), self.time.to_string())].into() }.to_bytes()
    }

    /// Sets moments and number of steps from the bytes of a file, which messages call `path`.
    ///
    /// # Errors
    /// If they are not those of an optimiser.
    pub(super) fn restore(&mut self, path: &Path, bytes: &[u8], device: &Device) -> Result<()> {
        let NetWeights { tensors, metadata } = NetWeights::from_bytes(path, bytes)?;
        let time = metadata.get(TIME).and_then(|text| text.parse().ok());
        let moments = MOMENTS.map(|name| tensors.get(name));
        let (time, moments) = match (time, moments) {
            (Some(0), [None, None]) => (0, None),
            (Some(time @ 1..), [Some(first), Some(second)]) if first.data.len() == second.data.len() => {
                let tensor = |array: &Array| {
                    Tensor::from_data(TensorData::new(array.data.clone(), [array.data.len()]), device).inner()
                };
                (time, Some([first, second].map(tensor)))
            }
            _ => return Err(Error::broken(path, format!("expected {TIME} and two moments of an optimiser"))),
        };
        (self.time, self.moments) = (time, moments);
        Ok(())
    }
}

/// Numbers of a step.
struct Rate {
    /// Share of a weight that decay leaves.
    kept: f32,
    rate: f32,
    /// What the moments are divided by, because they began at 0.
    scales: [f32; 2],
}

impl Rate {
    /// `time` counts from 1.
    fn new(rule: &Rule, rate: f64, time: usize) -> Self {
        let kept = (1.0 - rate * f64::from(rule.weight_decay)) as f32;
        Self { kept, rate: rate as f32, scales: rule.betas.map(|beta| 1.0 - beta.powi(time as i32)) }
    }
}

/// Updates a parameter and its moments in one pass.
fn update(rule: &Rule, rate: &Rate, weights: &mut [f32], gradient: &[f32], moments: [&mut [f32]; 2]) {
    let arch = Arch::new();
    let squares: Vec<f64> = gradient.par_chunks(CHUNK).map(|part| arch.dispatch(|| squares(part))).collect();
    let norm = squares.iter().sum::<f64>().sqrt() as f32;
    let clip = (rule.clip_norm / (norm + f32::MIN_POSITIVE)).min(1.0);
    let ([old_1, old_2], [scale_1, scale_2]) = (rule.betas, rate.scales);
    let [first, second] = moments.map(|moment| moment.par_chunks_mut(CHUNK));
    let parts = weights.par_chunks_mut(CHUNK).zip(gradient.par_chunks(CHUNK)).zip(first).zip(second);
    parts.for_each(|(((weights, gradient), first), second)| {
        arch.dispatch(|| {
            let values = weights.iter_mut().zip(gradient).zip(&mut *first).zip(&mut *second);
            for (((w, g), m), v) in values {
                let g = clip * g;
                *m = old_1 * *m + (1.0 - old_1) * g;
                *v = old_2 * *v + (1.0 - old_2) * (g * g);
                *w = rate.kept * *w - rate.rate * ((*m / scale_1) / ((*v / scale_2).sqrt() + EPSILON));
            }
        });
    });
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
fn numbers(tensor: Tensor<1>) -> Vec<f32> {
    tensor.into_data().try_into_vec().expect("a tensor of f32")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::random;
    use burn::grad_clipping::GradientClippingConfig;
    use burn::nn::{Linear, LinearConfig};
    use burn::optim::{AdamWConfig, ModuleOptimizer};

    const RULE: Rule = Rule { betas: [0.9, 0.999], weight_decay: 0.1, clip_norm: 1.0 };

    /// Layers whose parameters fill rows, do not, or are shorter than one.
    fn layers() -> Vec<Linear> {
        let device = Device::flex().autodiff();
        [[40, 530], [16, 16], [530, 3]].map(|[from, to]| LinearConfig::new(from, to).init(&device)).into()
    }

    /// Gradients of this size for all parameters but one bias.
    fn gradients(layers: &[Linear], seed: u64, size: f32) -> GradientsParams {
        let device = Device::flex().autodiff();
        let mut gradients = GradientsParams::new();
        for (layer, seed) in layers.iter().zip(seed..) {
            let [from, to] = layer.weight.dims();
            let random_of = |shape| random(shape, seed, &device).inner().mul_scalar(size);
            gradients.register(layer.weight.id, random_of([from, to]));
            if let Some(bias) = layer.bias.as_ref().filter(|_| to != 16) {
                gradients.register(bias.id, random_of([1, to]).reshape::<1, _>([to]));
            }
        }
        gradients
    }

    fn all_numbers(layers: &[Linear]) -> Vec<f32> {
        let of = |layer: &Linear| {
            let bias = layer.bias.as_ref().unwrap().val();
            [layer.weight.val().reshape([-1]), bias].map(|tensor| numbers(tensor.inner())).concat()
        };
        layers.iter().flat_map(of).collect()
    }

    /// Four steps with gradients of which some are clipped, and some are not.
    fn trained(mut layers: Vec<Linear>, mut step: impl FnMut(Vec<Linear>, GradientsParams) -> Vec<Linear>) -> Vec<f32> {
        for (seed, size) in [(1, 1.0), (4, 1e-4), (7, 1e-3), (10, 0.5)] {
            let gradients = gradients(&layers, seed, size);
            layers = step(layers, gradients);
        }
        all_numbers(&layers)
    }

    #[test]
    fn steps_are_those_of_burns_optimiser() {
        let config =
            AdamWConfig::new().with_beta_1(0.9).with_beta_2(0.999).with_epsilon(EPSILON).with_weight_decay(0.1);
        for clip_norm in [1.0, f32::INFINITY] {
            let clip = clip_norm.is_finite().then_some(GradientClippingConfig::Norm(clip_norm));
            let mut burns: ModuleOptimizer = config.clone().with_grad_clipping(clip).init();
            let start = layers();
            let expected = trained(start.clone(), |layers, gradients| burns.step(1e-2, layers, gradients));
            let changed = expected.iter().zip(all_numbers(&start)).filter(|(a, b)| **a != *b).count();
            assert_eq!(changed, expected.len() - 16, "a bias without a gradient stays");
            for one_by_one in [true, false] {
                let mut ours = AdamW::new(Rule { clip_norm, ..RULE });
                let found = trained(start.clone(), |layers, gradients| {
                    let parts = parts(&layers, gradients);
                    let weights = ours.updated(1e-2, &parts, one_by_one).unwrap();
                    replaced(layers, &parts, weights)
                });
                let worst = found.iter().zip(&expected).fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs()));
                // Norms are sums of twenty thousand squares in another order; a step is 0.01.
                assert!(worst <= 1e-6, "one by one {one_by_one}, clipped to {clip_norm}: off by {worst}");
            }
        }
    }

    #[test]
    fn parameters_stay_what_they_are() {
        let device = Device::flex().autodiff().gradient_checkpointing();
        let layers: Vec<Linear> = vec![LinearConfig::new(3, 3).with_bias(false).init(&device)];
        let after = AdamW::new(RULE).step(1e-2, layers.clone(), gradients(&layers, 1, 1.0)).unwrap();
        let [before, after] = [&layers, &after].map(|layers| layers[0].weight.val());
        assert!(after.is_require_grad());
        assert_eq!(after.gradient_checkpointing_strategy(), before.gradient_checkpointing_strategy());
        assert_eq!(after.device(), before.device());
    }

    #[test]
    fn a_file_goes_on_and_a_broken_one_is_refused() {
        let (start, path, device) = (layers(), Path::new("optimiser"), Device::flex().autodiff());
        let mut whole = AdamW::new(RULE);
        let expected = trained(start.clone(), |layers, gradients| whole.step(1e-2, layers, gradients).unwrap());
        // Another optimiser for every step.
        let mut bytes = AdamW::new(RULE).to_bytes();
        let found = trained(start.clone(), |layers, gradients| {
            let mut ours = AdamW::new(RULE);
            ours.restore(path, &bytes, &device).unwrap();
            let layers = ours.step(1e-2, layers, gradients).unwrap();
            bytes = ours.to_bytes();
            layers
        });
        assert!(found == expected && bytes == whole.to_bytes());

        let mut other = AdamW::new(RULE);
        other.restore(path, &bytes, &device).unwrap();
        let few = start[..1].to_vec();
        let refused = other.step(1e-2, few.clone(), gradients(&few, 1, 1.0)).unwrap_err().to_string();
        assert!(refused.contains("expected moments of"), "{refused}");
        let broken = |change: &dyn Fn(&mut NetWeights)| {
            let mut file = NetWeights::from_bytes(path, &bytes).unwrap();
            change(&mut file);
            AdamW::new(RULE).restore(path, &file.to_bytes(), &device).unwrap_err().to_string()
        };
        let changes: [&dyn Fn(&mut NetWeights); 4] = [
            &|file| file.metadata.clear(),
            &|file| drop(file.metadata.insert(TIME.into(), "0".into())),
            &|file| drop(file.tensors.remove("moment_2")),
            &|file| drop(file.tensors.insert("moment_1".into(), Array { shape: vec![1], data: vec![0.0] })),
        ];
        for change in changes {
            assert!(broken(change).contains("two moments"));
        }
    }
}
