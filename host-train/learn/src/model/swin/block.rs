//! One Swin block: windowed attention and a two-layer perceptron, each after a layer norm and with a residual connection.

use super::attention::WindowAttention;
use super::depth::{BlockFactors, scaled};
use super::windows::{WindowPlan, merge, partition};
use crate::model::ops::{layer_norm, perceptron};
use burn::module::Module;
use burn::nn::{LayerNorm, LayerNormConfig, Linear, LinearConfig};
use burn::tensor::ops::PadMode;
use burn::tensor::{Device, Tensor};

/// Two linear layers with GELU. The hidden layer is four times as wide.
#[derive(Module, Debug)]
pub struct Mlp {
    fc1: Linear,
    fc2: Linear,
}

/// Swin block. After `norm1` it pads right and bottom to whole windows (padded tokens are zeros and are not masked, as in published
/// segmentation code), then shifts, attends, shifts back and crops.
#[derive(Module, Debug)]
pub struct Block {
    norm1: LayerNorm,
    attn: WindowAttention,
    norm2: LayerNorm,
    mlp: Mlp,
    window: usize,
    shift: usize,
}

impl Block {
    /// Makes a block of `dim` channels; `shift` is 0 or half a window.
    pub fn new(dim: usize, window: usize, heads: usize, shift: usize, device: &Device) -> Self {
        let mlp = Mlp {
            fc1: LinearConfig::new(dim, 4 * dim).init(device),
            fc2: LinearConfig::new(4 * dim, dim).init(device),
        };
        Self {
            norm1: LayerNormConfig::new(dim).init(device),
            attn: WindowAttention::new(dim, window, heads, device),
            norm2: LayerNormConfig::new(dim).init(device),
            mlp,
            window,
            shift,
        }
    }

    /// Maps `[B, H, W, C]` to the same shape. `factors` multiply the residual branches of every sample; `None` leaves them as they are.
    pub fn forward(&self, x: Tensor<4>, factors: Option<&BlockFactors>) -> Tensor<4> {
        let [_, h, w, _] = x.dims();
        let plan = WindowPlan::new(h, w, self.window, self.shift);
        let weigh = |branch: usize, x: Tensor<4>, sum: Tensor<4>| match factors {
            Some(both) => x.clone().add(scaled(sum.sub(x), &both[branch])),
            None => sum,
        };
        let sum = match self.attn.in_one(&self.norm1, plan, &x) {
            Some(sum) => sum,
            None => x.clone().add(self.attend(layer_norm(&self.norm1, x.clone()), plan)),
        };
        let x = weigh(0, x, sum);
        let sum = perceptron(&self.norm2, [&self.mlp.fc1, &self.mlp.fc2], x.clone());
        weigh(1, x, sum)
    }

    fn attend(&self, y: Tensor<4>, plan: WindowPlan) -> Tensor<4> {
        let [b, h, w, _] = y.dims();
        let [hp, wp] = plan.padded;
        let [sy, sx] = plan.shift.map(|s| s as i64);
        let mut y = if [hp, wp] == [h, w] {
            y
        } else {
            y.pad([(0, 0), (0, hp - h), (0, wp - w), (0, 0)], PadMode::Constant(0.0))
        };
        if plan.shifted() {
            y = y.roll(&[-sy, -sx], &[1, 2]);
        }
        let mask = plan.mask(&y.device());
        let mut y = merge(self.attn.forward(partition(y, self.window), mask), self.window, [b, hp, wp]);
        if plan.shifted() {
            y = y.roll(&[sy, sx], &[1, 2]);
        }
        if [hp, wp] == [h, w] { y } else { y.slice([0..b, 0..h, 0..w]) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::random;
    use burn::module::{ModuleMapper, ModuleVisitor, Param};
    use burn::optim::GradientsParams;
    use burn::tensor::activation::gelu;

    /// Makes all weights random.
    struct Randomise(u64);

    impl ModuleMapper for Randomise {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            self.0 += 1;
            param.map(|old| random(old.dims(), self.0, &old.device()).mul_scalar(0.5).detach().require_grad())
        }
    }

    /// All gradients with their parameters' shapes, in the block's order.
    struct Listed(GradientsParams, Vec<(Vec<usize>, Vec<f32>)>);

    impl ModuleVisitor for Listed {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let gradient = self.0.get::<D>(param.id).expect("a gradient");
            self.1.push((gradient.dims().into(), numbers(gradient)));
        }
    }

    fn numbers<const D: usize>(x: Tensor<D>) -> Vec<f32> {
        x.into_data().try_into_vec().expect("f32")
    }

    fn assert_close(what: &str, found: &[f32], expected: &[f32]) {
        assert_eq!(found.len(), expected.len(), "{what}");
        let largest = expected.iter().fold(0.0f32, |a, b| a.max(b.abs()));
        let worst = found.iter().zip(expected).fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs()));
        // Error of sums of up to a few thousand products in another order.
        assert!(largest > 1e-3 && worst <= 2e-5 * largest, "{what}: off by {worst} of {largest}");
    }

    #[test]
    fn blocks_equal_burns_operators_with_gradients() {
        let device = Device::flex().autodiff();
        // Images, rows, columns, channels, heads, window, shift: with and without padding and shift, channels that fill no vector.
        for [b, h, w, c, heads, window, shift] in [
            [2, 8, 12, 24, 2, 4, 0],
            [2, 7, 9, 24, 1, 4, 2],
            [1, 5, 4, 20, 4, 8, 0],
            [3, 14, 15, 40, 2, 7, 3],
            [1, 3, 3, 48, 3, 3, 1],
        ] {
            let what = format!("{b}x{h}x{w}x{c}, {heads} heads, window {window}, shift {shift}");
            let block = Block::new(c, window, heads, shift, &device).map(&mut Randomise(7));
            let (x, other) = (random([b, h, w, c], 1, &device), random([b, h, w, c], 2, &device));
            let composed = {
                let plan = WindowPlan::new(h, w, window, shift);
                let x = x.clone().add(block.attend(block.norm1.forward(x.clone()), plan));
                let hidden = gelu(block.mlp.fc1.forward(block.norm2.forward(x.clone())));
                x.add(block.mlp.fc2.forward(hidden))
            };
            let [found, expected] = [block.forward(x.clone(), None), composed].map(|y| {
                let gradients = y.clone().mul(other.clone()).sum().backward();
                let of_x = numbers(x.grad(&gradients).expect("a gradient"));
                let mut list = Listed(GradientsParams::from_grads(gradients, &block), Vec::new());
                block.visit(&mut list);
                (numbers(y), of_x, list.1)
            });
            assert_close(&what, &found.0, &expected.0);
            assert_close(&format!("{what}: gradient of the tokens"), &found.1, &expected.1);
            assert_eq!(found.2.len(), 13);
            for ((shape, found), (_, expected)) in found.2.iter().zip(&expected.2) {
                assert_close(&format!("{what}: gradient of a weight {shape:?}"), found, expected);
            }
        }
    }

    #[test]
    fn layer_norm_equals_burns_with_gradients() {
        let device = Device::flex().autodiff();
        let norm = LayerNormConfig::new(21).init(&device).map(&mut Randomise(7));
        let (x, other) = (random([2, 3, 5, 21], 1, &device), random([2, 3, 5, 21], 2, &device));
        let [found, expected] = [layer_norm(&norm, x.clone()), norm.forward(x.clone())].map(|y| {
            let gradients = y.clone().mul(other.clone()).sum().backward();
            let of_x = numbers(x.grad(&gradients).expect("a gradient"));
            let mut list = Listed(GradientsParams::from_grads(gradients, &norm), Vec::new());
            norm.visit(&mut list);
            (numbers(y), of_x, list.1)
        });
        assert_close("layer norm", &found.0, &expected.0);
        assert_close("gradient of the tokens", &found.1, &expected.1);
        for ((_, found), (_, expected)) in found.2.iter().zip(&expected.2) {
            assert_close("gradient of a weight", found, expected);
        }
    }
}
