//! Each operator agrees with Burn's composition: values and all gradients, on unusual shapes.

use super::*;
use crate::testing::random;
use burn::tensor::Device;

/// Error of sums of up to a few thousand products in another order, relative to the largest value.
const TOLERANCE: f32 = 2e-5;

fn assert_close(what: &str, found: &Tensor<4>, expected: &Tensor<4>) {
    assert_eq!(found.dims(), expected.dims(), "{what}");
    let worst = found.clone().sub(expected.clone()).abs().max().into_scalar::<f32>();
    let largest = expected.clone().abs().max().into_scalar::<f32>();
    assert!(largest > 0.1 && worst <= TOLERANCE * largest, "{what}: off by {worst} of {largest}");
}

/// Compares two operators of a map and a weight, with their gradients.
fn compare(
    what: &str,
    x: [usize; 4],
    weight: [usize; 4],
    ours: impl Fn(Tensor<4>, Tensor<4>) -> Tensor<4>,
    theirs: impl Fn(Tensor<4>, Tensor<4>) -> Tensor<4>,
) {
    let device = Device::flex().autodiff();
    let (x, weight) = (random(x, 1, &device), random(weight, 2, &device));
    let (found, expected) = (ours(x.clone(), weight.clone()), theirs(x.clone(), weight.clone()));
    assert_close(what, &found, &expected);
    let other = random(expected.dims(), 3, &device);
    let [found, expected] = [found, expected].map(|y| {
        let grads = y.mul(other.clone()).sum().backward();
        (x.grad(&grads).unwrap(), weight.grad(&grads).unwrap())
    });
    assert_close(&format!("{what}: gradient of the map"), &found.0, &expected.0);
    assert_close(&format!("{what}: gradient of the weight"), &found.1, &expected.1);
}

#[test]
fn convolutions_equal_burns_with_gradients() {
    // Columns are images, channels in, channels out, rows, columns, kernel, stride, padding.
    for [b, i, o, h, w, k, stride, padding] in [
        [1, 1, 1, 5, 7, 3, 1, 1],
        [2, 3, 13, 9, 50, 3, 1, 1],
        [2, 20, 8, 33, 17, 5, 1, 2],
        [3, 2, 6, 13, 18, 11, 2, 5],
        [2, 8, 3, 12, 12, 9, 2, 4],
        [2, 5, 4, 8, 9, 1, 1, 0],
        [2, 5, 2, 8, 9, 1, 2, 0],
        [2, 1, 24, 16, 12, 4, 4, 0],
        [1, 7, 9, 6, 6, 4, 1, 0],
        [2, 24, 40, 4, 5, 3, 1, 1],
    ] {
        let what = format!("{b}x{i}x{h}x{w} to {o}, kernel {k}, stride {stride}, padding {padding}");
        let options = ConvOptions::new([stride; 2], [padding; 2], [1, 1], 1);
        compare(
            &what,
            [b, i, h, w],
            [o, i, k, k],
            |x, weight| conv2d(x, weight, stride, padding),
            |x, weight| module::conv2d(x, weight, None, options.clone()),
        );
    }
}

#[test]
fn upsampled_convolutions_equal_the_plain_order_with_gradients() {
    for [b, i, o, h, w] in [[1, 1, 1, 3, 3], [2, 3, 4, 3, 8], [2, 5, 9, 13, 18], [3, 20, 8, 6, 26]] {
        let what = format!("{b}x{i}x{h}x{w} to {o}");
        let in_one = |x, weight| Upsampled::new(x).conv5(weight);
        compare(&what, [b, i, h, w], [o, i, 5, 5], in_one, |x, weight| conv2d(up2_by_burn(x), weight, 1, 2));
    }
}

#[test]
fn last_channels_of_an_upsampled_map_are_those_of_the_map() {
    let device = Device::flex().autodiff();
    // Upsampled and convolved in one, and one after the other.
    for [h, w] in [[4, 6], [2, 3]] {
        let (all, weight) = (random([2, 5, h, w], 1, &device), random([3, 2, 5, 5], 2, &device));
        let part = all.clone().narrow(1, 3, 2);
        let found = Upsampled::new(all).last_channels(part.clone());
        assert_close("last channels", &found.conv5(weight.clone()), &Upsampled::new(part).conv5(weight));
    }
}

#[test]
fn upsampling_by_sums_equals_burns_with_gradients() {
    let device = Device::flex().autodiff();
    for shape in [[1, 4, 1, 1], [1, 2, 1, 5], [2, 1, 4, 1], [1, 1, 2, 2], [2, 3, 5, 8]] {
        let x = random(shape, 1, &device);
        let (found, expected) = (up2_by_sums(x.clone()), up2_by_burn(x.clone()));
        assert_close(&format!("{shape:?}"), &found, &expected);
        let other = random(expected.dims(), 2, &device);
        let [found, expected] =
            [found, expected].map(|y| x.grad(&y.mul(other.clone()).sum().backward()).expect("a gradient"));
        assert_close(&format!("{shape:?}: gradient"), &found, &expected);
    }
}

#[test]
fn gelu_by_erf_equals_burns_on_the_processor_with_gradients() {
    let device = Device::flex().autodiff();
    let x = random([2, 3, 5, 7], 1, &device).mul_scalar(4.0).detach().require_grad();
    let other = random([2, 3, 5, 7], 2, &device);
    let [found, expected] = [gelu_by_erf(x.clone()), gelu(x.clone())].map(|y| {
        let gradient = x.grad(&y.clone().mul(other.clone()).sum().backward()).expect("a gradient");
        (y, gradient)
    });
    assert_close("GELU", &found.0, &expected.0);
    assert_close("gradient of GELU", &found.1, &expected.1);
}

#[test]
fn batch_norm_equals_burns_with_gradients() {
    let device = Device::flex().autodiff();
    for ([b, c, h, w], with_relu) in [([2, 3, 5, 7], false), ([3, 4, 40, 33], true), ([1, 2, 4, 5], true)] {
        let what = format!("{b}x{c}x{h}x{w}, ReLU {with_relu}");
        // The mean is far from zero, to test cancellation.
        let x = random([b, c, h, w], 1, &device).mul_scalar(0.5).add_scalar(3.0).detach().require_grad();
        let (weight, bias) = (random([c], 2, &device), random([c], 3, &device));
        let other = random([b, c, h, w], 4, &device);
        let found = batch_norm_train(x.clone(), weight.clone(), bias.clone(), 1e-5, with_relu);
        let burns = module::batch_norm_train(x.clone(), weight.clone(), bias.clone(), 1e-5);
        let expected = if with_relu { relu(burns.output) } else { burns.output };
        let wide = |t: Tensor<1>| t.reshape([1, 1, 1, c]);
        assert_close(&what, &found.output, &expected);
        assert_close(&what, &wide(found.mean), &wide(burns.mean));
        assert!(found.variance.sub(burns.variance).abs().max().into_scalar::<f32>() < 1e-5, "{what}: variance");
        let [found, expected] = [found.output, expected].map(|y| {
            let grads = y.mul(other.clone()).sum().backward();
            (x.grad(&grads).unwrap(), wide(weight.grad(&grads).unwrap()), wide(bias.grad(&grads).unwrap()))
        });
        assert_close(&format!("{what}: gradient of the map"), &found.0, &expected.0);
        assert_close(&format!("{what}: gradient of the weight"), &found.1, &expected.1);
        assert_close(&format!("{what}: gradient of the bias"), &found.2, &expected.2);
    }
}

#[test]
fn views_are_read_as_they_are_seen() {
    let device = Device::flex().autodiff();
    let x = random([2, 6, 9, 8], 1, &device);
    let weight = random([3, 6, 3, 3], 2, &device);
    let turned = x.clone().swap_dims(2, 3).slice([0..2, 0..6, 1..7, 0..9]);
    let copied = Tensor::<4>::from_data(turned.to_data(), &device);
    assert_close("view", &conv2d(turned, weight.clone(), 1, 1), &conv2d(copied, weight, 1, 1));
}

#[test]
fn threads_do_not_change_the_result() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let number = |i: usize| ((i * 7919) % 1000) as f32 / 500.0 - 1.0;
            let shape = conv::ConvShape {
                images: 2,
                channels: [5, 20],
                input: [40, 37],
                output: [40, 37],
                kernel: [3, 3],
                stride: 1,
                padding: [1, 1],
            };
            let [x, weight, y] = shape.lengths().map(|n| (0..n).map(number).collect::<Vec<f32>>());
            let plain = (conv::forward(&shape, &x, &weight), conv::backward(&shape, &x, &weight, &y, [true, true]));
            let shape = up2::Up2Shape { images: 2, channels: [5, 12], small: [20, 11] };
            let [x, weight, y] = shape.lengths().map(|n| (0..n).map(number).collect::<Vec<f32>>());
            (plain, up2::forward(&shape, &x, &weight), up2::backward(&shape, &x, &weight, &y, [true, true]))
        })
    };
    assert_eq!(run(1), run(3));
}
