//! Float weights as a model for the tile loop.

use crate::model::backend::Backend;
use crate::model::elunar::ELunarDtmNet;
use crate::model::store;
use crate::train::feed::side_by_side;
use burn::tensor::Device;
use elunar_base::digest::sha256_hex;
use elunar_base::{Error, Result, read};
use elunar_core::nn::InputRules;
use elunar_core::tile::{Shape, TILE};
use elunar_net::config::{NetConfig, config_of};
use elunar_net::shipped;
use elunar_net::weights::NetWeights;
use elunar_scene::predict::int8;
use elunar_scene::predict::network::{TileModel, TileNetwork};
use std::path::Path;

/// Opens a model of either kind: a `.safetensors` file is a float network, run on `backend`; an `.eld` file or a shipped
/// model is one for the int8 runner.
///
/// # Errors
/// [`Error::Unsupported`] for another extension; otherwise as [`open`] and [`int8::open`].
pub fn open_any(path: &Path, backend: Backend) -> Result<Box<dyn TileModel>> {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("safetensors") => Ok(Box::new(open(path, backend)?)),
        None if shipped::find(path).is_some() => Ok(Box::new(int8::open(path)?.in_large_steps()?)),
        Some("eld") => Ok(Box::new(int8::open(path)?.in_large_steps()?)),
        _ => Err(Error::unsupported(
            path,
            "expected a model with extension .eld or .safetensors, or one of this program: ground, nano",
        )),
    }
}

/// Returns whether a file has the extension of float weights.
#[must_use]
pub fn is_float(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "safetensors")
}

/// A float network loaded from a `.safetensors` file.
pub struct FloatModel {
    config: NetConfig,
    net: ELunarDtmNet,
    device: Device,
    description: String,
}

/// Opens float weights on a backend.
///
/// # Errors
/// If the file cannot be read, is broken, has no configuration, or its tensors do not fit it.
pub fn open(path: &Path, backend: Backend) -> Result<FloatModel> {
    let bytes = read::bytes(path, read::MOST_WEIGHTS_BYTES)?;
    let hash = sha256_hex(&bytes);
    let weights = NetWeights::from_bytes(path, &bytes)?;
    let config = config_of(&weights, path)?;
    let device = backend.device()?;
    let net = store::load(&config, &weights, path, &device)?;
    let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    Ok(FloatModel { config, net, device, description: format!("float network {name} sha256:{hash}") })
}

impl TileModel for FloatModel {
    fn tile(&self) -> Shape {
        TILE
    }

    fn input_rules(&self) -> InputRules {
        self.config.input_rules()
    }

    fn description(&self) -> String {
        self.description.clone()
    }

    fn worker(&self) -> Result<Box<dyn TileNetwork + '_>> {
        Ok(Box::new(Worker { model: self }))
    }
}

struct Worker<'a> {
    model: &'a FloatModel,
}

impl TileNetwork for Worker<'_> {
    fn predict(&mut self, image: &[f32], coarse: &[f32], output: &mut [f32]) -> Result<()> {
        let Shape { rows, cols } = self.model.tile();
        let maps = self.model.config.image_maps();
        for (name, maps, found) in
            [("image", maps, image.len()), ("coarse DTM", 1, coarse.len()), ("output", 1, output.len())]
        {
            if found != maps * rows * cols {
                return Err(Error::input(format!("{name} tile: expected {maps}x{rows}x{cols} samples, found {found}")));
            }
        }
        let tensor = |data: &[f32]| side_by_side(data.to_vec(), [1, rows, cols], &self.model.device);
        let found = self.model.net.forward(tensor(image), tensor(coarse)).into_data().try_to_vec::<f32>();
        output.copy_from_slice(&found.map_err(|e| Error::input(format!("network output: {e:?}")))?);
        Ok(())
    }
}
