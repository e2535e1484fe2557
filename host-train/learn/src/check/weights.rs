//! Gradients of all weights on one backend, compared with those on flex. A backend can predict well and still learn nonsense.

use super::{GRADIENT_TOLERANCE, Line, tensor};
use crate::model::store;
use crate::train::loss::{Elevation, LossWeights, terms};
use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};
use elunar_base::{Error, Result};
use elunar_net::config::config_of;
use elunar_net::weights::NetWeights;
use std::path::Path;

/// Smallest scale of a tensor's gradient, as a share of the greatest gradient of all. Some gradients are zero but for rounding, such as those
/// of biases before a normalisation.
const FLOOR: f64 = 1e-3;

/// Compares the gradients of the paper's loss of a training step on a golden file's inputs. The error of a tensor is the greatest difference
/// over its greatest gradient (but at least [`FLOOR`]); that of the line is the greatest error, and the line names its tensor.
pub(super) fn compare_gradients(golden: &NetWeights, path: &Path, device: &Device) -> Result<Line> {
    let [expected, found] = [&Device::flex(), device].map(|device| gradients(golden, path, device));
    let (expected, found) = (expected?, found?);
    let peak = |values: &[f32]| super::peak(values);
    let floor = FLOOR * expected.iter().map(|(_, values)| peak(values)).fold(0.0, f64::max);
    let mut worst = (0.0, "");
    let names = |list: &[(String, Vec<f32>)]| list.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    if names(&expected) != names(&found) {
        let (expected, found) = (expected.len(), found.len());
        return Err(Error::input(format!(
            "gradients: expected those of {expected} tensors, as on flex, found {found}"
        )));
    }
    for ((name, expected), (_, found)) in expected.iter().zip(&found) {
        let difference: Vec<f32> = expected.iter().zip(found).map(|(a, b)| a - b).collect();
        let sound = found.iter().all(|value| value.is_finite());
        let error = if sound { peak(&difference) / peak(expected).max(floor) } else { f64::INFINITY };
        if error > worst.0 {
            worst = (error, name);
        }
    }
    let mut line = Line::new("weight gradients", worst.0, GRADIENT_TOLERANCE);
    line.note = format!("({} tensors against flex; worst: {})", expected.len(), worst.1);
    Ok(line)
}

/// Returns the gradients by the names of their weights, in the network's order.
fn gradients(golden: &NetWeights, path: &Path, device: &Device) -> Result<Vec<(String, Vec<f32>)>> {
    let device = device.clone().autodiff();
    let net = store::load(&config_of(golden, path)?, golden, path, &device)?;
    let map = |name: &str| tensor(golden, name, path, &device);
    let output = net.forward(map("input.image")?, map("input.coarse")?);
    let terms = terms(map("truth")?, output, Elevation::MeanNormalised, None);
    let found = GradientsParams::from_grads(LossWeights::PAPER.total(&terms).backward(), &net);
    let mut list = Listed { found, names: Vec::new(), each: Vec::new() };
    net.visit(&mut list);
    list.each.into_iter().map(|(name, values)| Ok((name, values.map_err(Error::input)?))).collect()
}

struct Listed {
    found: GradientsParams,
    names: Vec<String>,
    each: Vec<(String, std::result::Result<Vec<f32>, String>)>,
}

impl ModuleVisitor for Listed {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.names.push(name.into());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.names.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        // Running statistics have none.
        if let Some(gradient) = self.found.get::<D>(param.id) {
            let name = self.names.join(".");
            let values = gradient.into_data().try_to_vec::<f32>().map_err(|e| format!("gradient of {name}: {e:?}"));
            self.each.push((name, values));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_weight_has_a_gradient_that_is_compared() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/mini/case.safetensors");
        let golden = NetWeights::read(&path).unwrap();
        let line = compare_gradients(&golden, &path, &Device::flex()).unwrap();
        assert_eq!(line.error, 0.0);
        let outline = store::outline(&config_of(&golden, &path).unwrap(), &Device::flex());
        let trainable = outline.keys().filter(|name| !name.contains(".running_")).count();
        let found = gradients(&golden, &path, &Device::flex()).unwrap();
        let alive = found.iter().filter(|(_, values)| super::super::peak(values) > 0.0).count();
        assert!(found.len() == trainable && alive > trainable * 9 / 10, "{alive} of {} of {trainable}", found.len());
    }
}
