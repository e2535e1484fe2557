//! Bilinear x2 followed by a 5x5 convolution, computed on the small grid.
//!
//! Both steps are linear. Along one axis, output pixel 2y + p (p = 0, 1) sees five upsampled pixels, which are mixtures of four
//! small ones: y - 2 .. y + 1 for p = 0, y - 1 .. y + 2 for p = 1. So each of the four phases (p, q) is a 4x4 convolution of
//! the small map with `T_p W T_q^T`: 16 taps instead of 25, and no upsampled map. Training spends most of its time here, and
//! the weight gradient over the small grid copies a sixth of the memory.
//!
//! Two pixels along each border differ, because the upsampling repeats the edge while the convolution pads with zeros beyond
//! it. They are computed the plain way.

use super::conv::up2;
use burn::tensor::module::conv2d;
use burn::tensor::ops::{ConvOptions, PadMode};
use burn::tensor::{Device, Tensor, TensorData};

/// Smallest side of the map for which folding pays; below it the border is most of the map.
const MIN_SIDE: usize = 12;

/// `T[p][t][k]`: what small pixel y - 2 + p + t contributes to upsampled pixel 2y + p + k - 2.
const T: [[[f32; 5]; 4]; 2] = [
    [
        [0.25, 0.0, 0.0, 0.0, 0.0],
        [0.75, 0.75, 0.25, 0.0, 0.0],
        [0.0, 0.25, 0.75, 0.75, 0.25],
        [0.0, 0.0, 0.0, 0.25, 0.75],
    ],
    [
        [0.75, 0.25, 0.0, 0.0, 0.0],
        [0.25, 0.75, 0.75, 0.25, 0.0],
        [0.0, 0.0, 0.25, 0.75, 0.75],
        [0.0, 0.0, 0.0, 0.0, 0.25],
    ],
];

/// `x` `[B, I, h, w]`, `weight` `[O, I, 5, 5]` to `[B, O, 2h, 2w]`; zero padding of two.
pub fn up2_conv5(x: Tensor<4>, weight: Tensor<4>) -> Tensor<4> {
    let [b, _, h, w] = x.dims();
    if h.min(w) < MIN_SIDE {
        return plain(up2(x), weight, [2, 2, 2, 2]);
    }
    let o = weight.dims()[0];
    let inner = phases(x.clone(), weight.clone()).slice([0..b, 0..o, 2..2 * h - 2, 2..2 * w - 2]);
    // Strips of two output pixels need four upsampled ones, which come from three small ones.
    let strip = |axis: usize, start: usize, skip: usize, pads: [usize; 4]| {
        let up = up2(x.clone().narrow(axis, start, 3)).narrow(axis, skip, 4);
        plain(up, weight.clone(), pads)
    };
    let top = strip(2, 0, 0, [2, 0, 2, 2]);
    let bottom = strip(2, h - 3, 2, [0, 2, 2, 2]);
    let left = strip(3, 0, 0, [2, 2, 2, 0]).narrow(2, 2, 2 * h - 4);
    let right = strip(3, w - 3, 2, [2, 2, 0, 2]).narrow(2, 2, 2 * h - 4);
    Tensor::cat(vec![top, Tensor::cat(vec![left, inner, right], 3), bottom], 2)
}

/// The four phases interleaved, right except along the border.
fn phases(x: Tensor<4>, weight: Tensor<4>) -> Tensor<4> {
    let [b, i, h, w] = x.dims();
    let o = weight.dims()[0];
    // [O·I, 25] x [25, (p, q, row, col)] -> [(p, q), O, I, 4, 4]
    let folded = weight.reshape([o * i, 25]).matmul(folding(&x.device()));
    let folded: Tensor<4> = folded.reshape([o, i, 4, 16]).permute([2, 0, 1, 3]).reshape([4 * o, i, 4, 4]);
    let padded = x.pad([(0, 0), (0, 0), (2, 2), (2, 2)], PadMode::Edge);
    // Position s along an axis holds the window s - 2 .. s + 1: phase 0 of y is s = y, phase 1 is s = y + 1.
    let all = conv2d(padded, folded, None, ConvOptions::new([1, 1], [0, 0], [1, 1], 1));
    let phase = |p: usize, q: usize| -> Tensor<5> {
        let at = (2 * p + q) * o;
        all.clone().slice([0..b, at..at + o, p..p + h, q..q + w]).unsqueeze_dim::<5>(4)
    };
    let row = |p: usize| -> Tensor<5> {
        let cols = Tensor::cat(vec![phase(p, 0), phase(p, 1)], 4);
        cols.reshape([b, o, h, 1, 2 * w])
    };
    Tensor::cat(vec![row(0), row(1)], 3).reshape([b, o, 2 * h, 2 * w])
}

/// `T_p W T_q^T` for all phases as one matrix: `[25, 64]`, columns ordered (p, q, row, column).
fn folding(device: &Device) -> Tensor<2> {
    let mut data = Vec::with_capacity(25 * 64);
    for (ky, kx) in (0..25).map(|k| (k / 5, k % 5)) {
        for (p, q) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            for (row, col) in (0..16).map(|t| (t / 4, t % 4)) {
                data.push(T[p][row][ky] * T[q][col][kx]);
            }
        }
    }
    Tensor::from_data(TensorData::new(data, [25, 64]), device)
}

/// A plain convolution with zero padding `[top, bottom, left, right]`.
fn plain(x: Tensor<4>, weight: Tensor<4>, [top, bottom, left, right]: [usize; 4]) -> Tensor<4> {
    let x = x.pad([(0, 0), (0, 0), (top, bottom), (left, right)], PadMode::Constant(0.0));
    conv2d(x, weight, None, ConvOptions::new([1, 1], [0, 0], [1, 1], 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Distribution;

    /// Sums of a few hundred products in another order.
    const TOLERANCE: f32 = 2e-4;

    fn worst(a: &Tensor<4>, b: &Tensor<4>) -> f32 {
        a.clone().sub(b.clone()).abs().max().into_scalar::<f32>()
    }

    #[test]
    fn folded_equals_upsample_then_convolve_with_gradients() {
        let device = Device::default().autodiff();
        let random = |shape: [usize; 4]| -> Tensor<4> {
            Tensor::random(shape, Distribution::Uniform(-1.0, 1.0), &device).require_grad()
        };
        let (x, weight, other) = (random([2, 3, 13, 18]), random([4, 3, 5, 5]), random([2, 4, 26, 36]));
        let direct = plain(up2(x.clone()), weight.clone(), [2, 2, 2, 2]);
        let folded = up2_conv5(x.clone(), weight.clone());
        assert!(worst(&direct, &folded) < TOLERANCE);
        let gradients = [direct, folded].map(|y| {
            let grads = y.mul(other.clone()).sum().backward();
            (x.grad(&grads).unwrap(), weight.grad(&grads).unwrap())
        });
        assert!(worst(&gradients[0].0, &gradients[1].0) < TOLERANCE);
        // Weight gradients sum over 1872 pixels.
        assert!(worst(&gradients[0].1, &gradients[1].1) < 10.0 * TOLERANCE);
    }
}
