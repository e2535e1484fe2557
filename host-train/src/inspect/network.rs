//! Model files and tensors in words.

use crate::digest::sha256_hex;
use crate::model::weights::Weights;
use crate::{Error, Result};
use elunar_core::nn::{Dtype, Model, Tensor, required};
use std::path::Path;

/// Tensors of a safetensors file: weights, a golden case, or neither.
pub(super) fn tensors(path: &Path) -> Result<String> {
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    let weights = Weights::from_bytes(path, &bytes)?;
    let count: usize = weights.tensors.values().map(|a| a.data.len()).sum();
    let is_golden = weights.tensors.contains_key("input.image") && weights.metadata.contains_key("loss_terms");
    let kind = match (is_golden, weights.metadata.contains_key("config")) {
        (true, _) => "golden case (weights, inputs and what they give)",
        (false, true) => "float weights",
        (false, false) => "tensors without a configuration",
    };
    let mut out = format!("{kind}: {} tensors, {count} numbers\n{}\n", weights.tensors.len(), digest(&bytes));
    weights.metadata.iter().for_each(|(key, value)| out += &format!("{key}: {value}\n"));
    for (name, array) in &weights.tensors {
        out += &format!("{name:60} {:?}\n", array.shape);
    }
    Ok(out.trim_end().into())
}

/// A model file of the int8 runner.
pub(super) fn model(path: &Path) -> Result<String> {
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    let model = Model::new(&bytes).map_err(|e| Error::broken(path, e.to_string()))?;
    let (rows, cols) = model.tile();
    let mut out = format!("int8 model for tiles of {rows} x {cols}, normalised to [0, {}]", model.nr());
    out += &format!(", range widened by {}, truth range {:?}\n", model.range_margin(), model.truth_range());
    out += &format!("{}\n", digest(&bytes));
    let text: serde_json::Value = serde_json::from_str(model.text()).unwrap_or_default();
    for key in ["name", "precision", "config"] {
        out += &format!("{key}: {}\n", text[key]);
    }
    let (ram, scratch) = (required(&model), model.scratch_bytes());
    out += &format!("arena {ram} bytes, of which scratch {scratch}; constants {} bytes; ", model.constants_bytes());
    out += &format!("{} operators, {:.3} GMAC per tile\n", model.operator_count(), model.macs() as f64 / 1e9);
    out += &format!("{:>4} {:44} {:11} {:22} {:>9} {:>10}\n", "#", "name", "kind", "output", "MMAC", "at byte");
    for index in 0..model.operator_count() {
        let Some(operator) = model.operator(index) else { continue };
        let tensor = model.tensor(operator.output());
        let name = text["operators"][index].as_str().unwrap_or("");
        let macs = model.operator_macs(&operator);
        out += &format!(
            "{index:>4} {name:44} {:11} {:22} {:>9.2} {:>10}\n",
            operator.name(),
            shape(&tensor),
            macs as f64 / 1e6,
            tensor.offset
        );
    }
    Ok(out.trim_end().into())
}

fn shape(t: &Tensor) -> String {
    let dtype = match t.dtype {
        Dtype::U8 => "u8",
        Dtype::I16 => "i16",
        Dtype::F32 => "f32",
    };
    format!("[{}, {}, {}] {dtype}", t.rows, t.cols, t.channels)
}

fn digest(bytes: &[u8]) -> String {
    format!("sha256:{}", sha256_hex(bytes))
}
