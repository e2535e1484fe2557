//! Mixed precision: matrix products and convolutions in 16 bits, everything else in 32.
//!
//! The trained weights stay `f32`. A step uses the network of [`TrainingPrecision::of`]. Its weights are casts of the trained weights, so that
//! gradients flow back through the cast. Computations that add up many numbers stay `f32`: batch and layer normalisation, softmax, the sum
//! with the coarse DTM, the loss, the optimiser. `bf16` has the exponent of `f32`, so the loss is not scaled.

use super::backend::computes_in_bf16;
use super::elunar::ELunarDtmNet;
use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{DType, Device, Tensor};
use serde::{Deserialize, Serialize};

/// Precision of training.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum TrainingPrecision {
    /// 32 bits throughout.
    #[default]
    F32,
    /// Products and convolutions in bfloat16. It is fast only on a GPU with tensor cores.
    Bf16,
}

impl TrainingPrecision {
    /// Returns whether the device computes in this precision.
    #[must_use]
    pub fn runs_on(self, device: &Device) -> bool {
        self == Self::F32 || computes_in_bf16(device)
    }

    /// Returns `net` in this precision, on the same graph. Gradients of its output are gradients of `net`'s own weights.
    pub fn of(self, net: &ELunarDtmNet) -> ELunarDtmNet {
        match self {
            Self::F32 => net.clone(),
            Self::Bf16 => net.clone().map(&mut Halve::default()),
        }
    }
}

/// Modules whose weights stay `f32`.
const NORMS: [&str; 2] = ["Struct:BatchNorm2d", "Struct:LayerNorm"];

/// Casts all weights except those of the normalisations.
#[derive(Default)]
struct Halve {
    kinds: Vec<String>,
}

impl ModuleMapper for Halve {
    fn enter_module(&mut self, _: &str, kind: &str) {
        self.kinds.push(kind.into());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.kinds.pop();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        if self.kinds.iter().any(|kind| NORMS.contains(&kind.as_str())) {
            return param;
        }
        let (id, value, mapper) = param.consume();
        Param::from_mapped_value(id, value.cast(DType::BF16), mapper)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::backend::Backend;
    use crate::model::init::initial_weights;
    use crate::model::store;
    use crate::testing::without_zeros;
    use burn::optim::GradientsParams;
    use burn::tensor::TensorData;
    use elunar_net::config::{DecoderKind, Illumination, ImageEncoderKind, NetConfig, miniature_network};
    use std::path::Path;

    fn map(maps: usize, device: &Device) -> Tensor<4> {
        let data: Vec<f32> = (0..2 * maps * 64 * 96).map(|i| (i as f32 * 0.37).sin()).collect();
        Tensor::from_data(TensorData::new(data, [2, maps, 64, 96]), device)
    }

    fn numbers<const D: usize>(x: Tensor<D>) -> Vec<f32> {
        x.into_data().try_into_vec::<f32>().expect("f32")
    }

    fn dot(a: &[f32], b: &[f32]) -> f64 {
        a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
    }

    /// Returns the length of the difference of two lists over the length of the first.
    fn apart(a: &[f32], b: &[f32]) -> f64 {
        let difference: Vec<f32> = a.iter().zip(b).map(|(a, b)| a - b).collect();
        (dot(&difference, &difference) / dot(a, a)).sqrt()
    }

    #[test]
    fn half_precision_gives_nearly_the_same_map_and_gradients_to_the_f32_weights() {
        let device = Backend::Flex.device().unwrap().autodiff();
        let upb = NetConfig {
            image_encoder: ImageEncoderKind::Resnet,
            decoder_kind: DecoderKind::Upb,
            illumination: Illumination::Any,
            ..miniature_network()
        };
        for config in [miniature_network(), upb] {
            let weights = without_zeros(initial_weights(&config, 1));
            let net = store::load(&config, &weights, Path::new("w"), &device).unwrap();
            let found = [TrainingPrecision::F32, TrainingPrecision::Bf16].map(|precision| {
                let output = precision.of(&net).forward(map(config.image_maps(), &device), map(1, &device));
                assert_eq!(output.dtype(), DType::F32);
                let gradients = output.clone().powi_scalar(2).mean().backward();
                let gradients = GradientsParams::from_grads(gradients, &net);
                let mut list = Listed { gradients, each: Vec::new(), missing: 0 };
                net.visit(&mut list);
                (numbers(output), list.each, list.missing)
            });
            let [(exact, exact_slopes, missing), (half, half_slopes, half_missing)] = found;
            assert_eq!(missing, half_missing, "weights without a gradient");
            let map = apart(&exact, &half);
            // The head's weight and bias come last. They are one layer away from the loss.
            let head: Vec<f64> =
                exact_slopes.iter().zip(&half_slopes).rev().take(2).map(|(a, b)| apart(a, b)).collect();
            let (a, b) = (exact_slopes.concat(), half_slopes.concat());
            let cosine = dot(&a, &b) / (dot(&a, &a) * dot(&b, &b)).sqrt();
            println!("{:?}: map {map:.4} apart, head {head:.4?}, cosine of all {cosine:.4}", config.image_encoder);
            // Eight bits of mantissa are an error of up to 0.4 % of each number, through some dozen layers. On the way back, statistics
            // over the few pixels of the deepest maps enlarge it.
            assert!(map > 1e-5 && map < 0.02, "map {map} apart");
            assert!(head.iter().all(|apart| *apart < 0.04), "head's gradients {head:?} apart");
            assert!(cosine > 0.95, "cosine {cosine}");
        }
    }

    /// All gradients, in the network's order.
    struct Listed {
        gradients: GradientsParams,
        each: Vec<Vec<f32>>,
        missing: usize,
    }

    impl burn::module::ModuleVisitor for Listed {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            match self.gradients.get::<D>(param.id) {
                Some(gradient) => self.each.push(numbers(gradient)),
                None => self.missing += 1,
            }
        }
    }
}
