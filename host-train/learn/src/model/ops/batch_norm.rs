//! Batch normalisation with an optional ReLU, on slices. Forward and backward each take two passes over the map.
//!
//! Sums over a thousand numbers use vectors. Sums of these sums use double precision, plane by plane. The number of threads does not change
//! them.

use pulp::Arch;
use rayon::prelude::*;

/// Number of values summed in single precision.
const RUN: usize = 1024;
/// Number of parallel sums, so that vectors can hold them.
const LANES: usize = 32;

/// Sizes of a map `[images, channels, pixels]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NormShape {
    /// Images.
    pub(super) images: usize,
    /// Channels.
    pub(super) channels: usize,
    /// Pixels of a plane.
    pub(super) pixels: usize,
}

/// Normalisation of a channel: `scale * (x - mean) + bias`, with `scale = weight / sqrt(variance + epsilon)`.
#[derive(Debug, Clone, Copy)]
struct Channel {
    mean: f32,
    /// Equals 1 / sqrt(variance + epsilon).
    shrink: f32,
    weight: f32,
    bias: f32,
}

/// The parameters of all channels.
pub(super) struct NormParameters<'a> {
    /// Mean and (biased) variance, `[2, channels]`.
    pub(super) statistics: &'a [f32],
    /// Weight, `[channels]`.
    pub(super) weight: &'a [f32],
    /// Bias, `[channels]`.
    pub(super) bias: &'a [f32],
    /// Added to the variance.
    pub(super) epsilon: f32,
    /// Whether negative results become zero.
    pub(super) relu: bool,
}

impl NormParameters<'_> {
    fn channel(&self, c: usize) -> Channel {
        let (mean, variance) = self.statistics.split_at(self.weight.len());
        let shrink = 1.0 / (variance[c] + self.epsilon).sqrt();
        Channel { mean: mean[c], shrink, weight: self.weight[c], bias: self.bias[c] }
    }
}

impl NormShape {
    /// Adds per-plane sums to sums per channel.
    fn per_channel<const N: usize>(&self, of_plane: impl Fn(usize) -> [f64; N] + Send + Sync) -> Vec<[f64; N]> {
        let planes: Vec<[f64; N]> = (0..self.images * self.channels).into_par_iter().map(of_plane).collect();
        let mut sums = vec![[0.0; N]; self.channels];
        for (i, plane) in planes.iter().enumerate() {
            sums[i % self.channels].iter_mut().zip(plane).for_each(|(sum, plane)| *sum += plane);
        }
        sums
    }

    fn samples(&self) -> f64 {
        (self.images * self.pixels) as f64
    }
}

/// Sums `N` figures of each number (and of its partner in `b`, which has the same length) over a plane.
#[inline(always)]
fn sums<const N: usize>(a: &[f32], b: &[f32], figures: impl Fn(f32, f32) -> [f32; N]) -> [f64; N] {
    let mut total = [0.0; N];
    for (a, b) in a.chunks(RUN).zip(b.chunks(RUN)) {
        let mut lanes = [[0.0f32; LANES]; N];
        let ((a, last_a), (b, last_b)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
        for (a, b) in a.iter().zip(b) {
            for i in 0..LANES {
                let values = figures(a[i], b[i]);
                for n in 0..N {
                    lanes[n][i] += values[n];
                }
            }
        }
        for (i, (&a, &b)) in last_a.iter().zip(last_b).enumerate() {
            let values = figures(a, b);
            for n in 0..N {
                lanes[n][i] += values[n];
            }
        }
        for n in 0..N {
            total[n] += f64::from(lanes[n].iter().sum::<f32>());
        }
    }
    total
}

/// Returns mean and biased variance of every channel: `[2, channels]`.
pub(super) fn statistics(shape: &NormShape, x: &[f32]) -> Vec<f32> {
    let arch = Arch::new();
    let totals = shape.per_channel(|i| {
        let plane = &x[i * shape.pixels..][..shape.pixels];
        // Squares of each run are around its own mean, while it is in the cache. The rest is in double precision.
        plane.chunks(RUN).fold([0.0, 0.0], |[sum, squares], run| {
            let [of_run] = arch.dispatch(|| sums(run, run, |x, _| [x]));
            let mean = of_run / run.len() as f64;
            let around = mean as f32;
            let [rest, spread] = arch.dispatch(|| sums(run, run, |x, _| [x - around, (x - around) * (x - around)]));
            let around = f64::from(around);
            [sum + of_run, squares + spread + 2.0 * around * rest + around * around * run.len() as f64]
        })
    });
    let means = totals.iter().map(|[sum, _]| sum / shape.samples());
    let variances =
        totals.iter().zip(means.clone()).map(|([_, squares], mean)| squares / shape.samples() - mean * mean);
    means.clone().chain(variances.map(|variance| variance.max(0.0))).map(|figure| figure as f32).collect()
}

/// Returns the normalised map.
pub(super) fn forward(shape: &NormShape, x: &[f32], parameters: &NormParameters) -> Vec<f32> {
    let arch = Arch::new();
    let mut out = vec![0.0; x.len()];
    let planes = out.par_chunks_mut(shape.pixels).zip(x.par_chunks(shape.pixels)).enumerate();
    planes.for_each(|(i, (out, x))| {
        let Channel { mean, shrink, weight, bias } = parameters.channel(i % shape.channels);
        let scale = shrink * weight;
        arch.dispatch(|| {
            if parameters.relu {
                out.iter_mut().zip(x).for_each(|(out, x)| *out = (scale * (x - mean) + bias).max(0.0));
            } else {
                out.iter_mut().zip(x).for_each(|(out, x)| *out = scale * (x - mean) + bias);
            }
        });
    });
    out
}

/// Returns the gradients of the map, the weight and the bias, from the output's gradient. The statistics count as functions of the map.
pub(super) fn backward(shape: &NormShape, x: &[f32], parameters: &NormParameters, gradient: &[f32]) -> [Vec<f32>; 3] {
    let arch = Arch::new();
    let relu = parameters.relu;
    // The part of the gradient that passed the ReLU. The expression is the same as in `forward`, so that the sign is the same.
    let passed = |x: f32, g: f32, c: &Channel| {
        let out = c.shrink * c.weight * (x - c.mean) + c.bias;
        if relu && out <= 0.0 { 0.0 } else { g }
    };
    let totals = shape.per_channel(|i| {
        let c = parameters.channel(i % shape.channels);
        let [x, g] = [x, gradient].map(|map| &map[i * shape.pixels..][..shape.pixels]);
        arch.dispatch(|| {
            sums(x, g, |x, g| {
                let g = passed(x, g, &c);
                [g, g * (x - c.mean) * c.shrink]
            })
        })
    });
    let mut out = vec![0.0; x.len()];
    let planes =
        out.par_chunks_mut(shape.pixels).zip(x.par_chunks(shape.pixels)).zip(gradient.par_chunks(shape.pixels));
    planes.enumerate().for_each(|(i, ((out, x), g))| {
        let c = parameters.channel(i % shape.channels);
        let [of_bias, of_weight] = totals[i % shape.channels].map(|total| (total / shape.samples()) as f32);
        arch.dispatch(|| {
            for ((out, &x), &g) in out.iter_mut().zip(x).zip(g) {
                let normalised = (x - c.mean) * c.shrink;
                *out = c.shrink * c.weight * (passed(x, g, &c) - of_bias - normalised * of_weight);
            }
        });
    });
    let [of_bias, of_weight] = [0, 1].map(|n| totals.iter().map(|total| total[n] as f32).collect());
    [out, of_weight, of_bias]
}
