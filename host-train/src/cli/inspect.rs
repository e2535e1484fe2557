//! `host-train inspect`: what a model or weights file is.

use crate::model::weights::Weights;
use crate::{Error, Result};
use elunar_core::nn::{Dtype, Model, Tensor, required};
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// Options of `inspect`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  host-train inspect nano.eld")]
pub struct Args {
    /// Model file (.eld) or float weights (.safetensors).
    #[arg(value_name = "M")]
    pub file: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// If the file cannot be read or is broken.
pub fn run(args: Args) -> Result<()> {
    let bytes = std::fs::read(&args.file).map_err(Error::io(&args.file))?;
    let digest: String = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
    let text = match args.file.extension().and_then(|e| e.to_str()) {
        Some("eld") => model(&args.file, &bytes)?,
        Some("safetensors") => weights(&args.file, &bytes)?,
        _ => return Err(Error::unsupported(&args.file, "expected a file with extension .eld or .safetensors")),
    };
    println!("{}: {} bytes, sha256:{digest}\n{text}", args.file.display(), bytes.len());
    Ok(())
}

fn weights(path: &Path, bytes: &[u8]) -> Result<String> {
    let weights = Weights::from_bytes(path, bytes)?;
    let count: usize = weights.tensors.values().map(|a| a.data.len()).sum();
    let mut out = format!("float weights: {} tensors, {count} numbers\n", weights.tensors.len());
    weights.metadata.iter().for_each(|(key, value)| out += &format!("{key}: {value}\n"));
    for (name, array) in &weights.tensors {
        out += &format!("{name:60} {:?}\n", array.shape);
    }
    Ok(out.trim_end().into())
}

fn model(path: &Path, bytes: &[u8]) -> Result<String> {
    let model = Model::new(bytes).map_err(|e| Error::broken(path, e.to_string()))?;
    let (rows, cols) = model.tile();
    let mut out = format!("int8 model for tiles of {rows} x {cols}, normalised to [0, {}]", model.nr());
    out += &format!(", range widened by {}, truth range {:?}\n", model.range_margin(), model.truth_range());
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
