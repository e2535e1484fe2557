//! Conversion between the Burn modules and named arrays, with parameter names and layouts of the reference implementation.

use super::elunar::ELunarDtmNet;
use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Device, Tensor, TensorData};
use elunar_base::{Error, Result};
use elunar_net::config::NetConfig;
use elunar_net::fit::check_fit;
use elunar_net::weights::{Array, NetWeights};
use std::collections::BTreeMap;
use std::path::Path;

/// Makes the network with these weights on `device`. Messages call the weights `path`.
///
/// # Errors
/// [`Error::Broken`], with a list of all misfits, if names or shapes do not fit the configuration.
pub fn load(config: &NetConfig, weights: &NetWeights, path: &Path, device: &Device) -> Result<ELunarDtmNet> {
    config.check().map_err(|what| Error::broken(path, what))?;
    put(ELunarDtmNet::new(config, device), weights, path, device)
}

/// Replaces a module's weights. Messages call the new weights `path`.
///
/// # Errors
/// As [`load`].
pub fn put<M: Module>(module: M, weights: &NetWeights, path: &Path, device: &Device) -> Result<M> {
    let expected = arrays(&module).tensors.into_iter().map(|(name, array)| (name, array.shape)).collect();
    check_fit(&expected, weights, path)?;
    Ok(module.map(&mut Loader { weights, walk: Walk::default(), device: device.clone() }))
}

/// Returns the network's weights and buffers, with `config` in the metadata.
pub fn save(config: &NetConfig, net: &ELunarDtmNet) -> NetWeights {
    // `valid` applies pending running statistics.
    let mut weights = arrays(&net.valid());
    let text = serde_json::to_string(config).expect("a plain struct");
    weights.metadata.insert("config".into(), text);
    weights
}

/// Returns a module's weights and buffers.
pub fn arrays<M: Module>(module: &M) -> NetWeights {
    let mut saver = Saver::default();
    module.visit(&mut saver);
    saver.weights
}

/// Returns every expected tensor with its shape, zero-filled.
pub fn shapes(config: &NetConfig, device: &Device) -> NetWeights {
    save(config, &ELunarDtmNet::new(config, device))
}

/// Returns every expected tensor's name and shape, in PyTorch's layouts, without allocating the tensors.
pub fn outline(config: &NetConfig, device: &Device) -> BTreeMap<String, Vec<usize>> {
    let mut outline = Outline::default();
    ELunarDtmNet::new(config, device).visit(&mut outline);
    outline.shapes
}

/// Position of a walk through the modules.
#[derive(Default)]
struct Walk {
    names: Vec<String>,
    kinds: Vec<String>,
}

impl Walk {
    fn enter(&mut self, name: &str, kind: &str) {
        self.names.push(name.into());
        self.kinds.push(kind.into());
    }

    fn exit(&mut self) {
        self.names.pop();
        self.kinds.pop();
    }

    /// Returns the interchange name of the current parameter. Burn's layer norm calls weight and bias gamma and beta.
    fn name(&self) -> String {
        let joined = self.names.join(".");
        match joined.rsplit_once('.') {
            Some((module, "gamma")) => format!("{module}.weight"),
            Some((module, "beta")) => format!("{module}.bias"),
            _ => joined,
        }
    }

    /// Returns whether the parameter is transposed: Burn stores linear weights as `[in, out]`, PyTorch as `[out, in]`.
    fn transposed(&self) -> bool {
        self.kinds.last().is_some_and(|k| k == "Struct:Linear") && self.names.last().is_some_and(|n| n == "weight")
    }
}

fn transpose(data: &[f32], rows: usize, cols: usize) -> Vec<f32> {
    (0..rows * cols).map(|i| data[(i % rows) * cols + i / rows]).collect()
}

#[derive(Default)]
struct Saver {
    walk: Walk,
    weights: NetWeights,
}

impl ModuleVisitor for Saver {
    fn enter_module(&mut self, name: &str, kind: &str) {
        self.walk.enter(name, kind);
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.walk.exit();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let tensor = param.val();
        let mut shape = tensor.dims().to_vec();
        let mut data = tensor.into_data().try_to_vec::<f32>().expect("the network is f32");
        if self.walk.transposed() {
            data = transpose(&data, shape[0], shape[1]);
            shape.reverse();
        }
        self.weights.tensors.insert(self.walk.name(), Array { shape, data });
    }
}

#[derive(Default)]
struct Outline {
    walk: Walk,
    shapes: BTreeMap<String, Vec<usize>>,
}

impl ModuleVisitor for Outline {
    fn enter_module(&mut self, name: &str, kind: &str) {
        self.walk.enter(name, kind);
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.walk.exit();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let mut shape = param.lazy_shape().to_vec();
        if self.walk.transposed() {
            shape.reverse();
        }
        self.shapes.insert(self.walk.name(), shape);
    }
}

struct Loader<'a> {
    weights: &'a NetWeights,
    walk: Walk,
    device: Device,
}

impl ModuleMapper for Loader<'_> {
    fn enter_module(&mut self, name: &str, kind: &str) {
        self.walk.enter(name, kind);
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.walk.exit();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let name = self.walk.name();
        let array = &self.weights.tensors[&name];
        let mut shape = array.shape.clone();
        let mut data = array.data.clone();
        if self.walk.transposed() {
            data = transpose(&data, shape[0], shape[1]);
            shape.reverse();
        }
        let data = TensorData::new(data, shape);
        param.map(|old| Tensor::from_data(data, &self.device).set_require_grad(old.is_require_grad()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_base::read::MOST_WEIGHTS_BYTES;
    use elunar_net::config::Preset;

    #[test]
    fn weights_of_the_paper_can_be_read() {
        let shapes = outline(&NetConfig::preset(Preset::Paper), &Device::flex());
        let bytes = 4 * shapes.values().map(|shape| shape.iter().product::<usize>() as u64).sum::<u64>();
        assert!((1 << 30..MOST_WEIGHTS_BYTES * 9 / 10).contains(&bytes), "{bytes}");
    }
}
