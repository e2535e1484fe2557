//! Published Swin checkpoints as weights of the image encoder.
//!
//! Two namings are supported: timm's (patch merging begins a stage: `layers.1.downsample`) and the original one (patch merging ends the
//! stage before: `layers.0.downsample`). Classifier heads and index buffers are left out. An RGB patch embedding is summed to one channel,
//! which equals an input of the same grey value three times.

use crate::weights::{Array, NetWeights};
use elunar_base::{Error, Result};
use std::path::Path;

const PREFIX: &str = "image_encoder.swin.";

/// Copies every Swin tensor of `published` into `weights`. Messages call the checkpoint `path`.
///
/// # Errors
/// [`Error::Broken`], with a list of all misfits, if a tensor that the encoder needs is absent or has another shape. Classification
/// checkpoints have no layer norms on the four outputs; these keep their values.
pub fn load_swin(weights: &mut NetWeights, published: &NetWeights, path: &Path) -> Result<()> {
    let original = published.tensors.contains_key("layers.0.downsample.reduction.weight");
    let mut misfits = Vec::new();
    for (name, array) in &mut weights.tensors {
        let Some(local) = name.strip_prefix(PREFIX) else { continue };
        let found = published.tensors.get(&published_name(local, original));
        match found.map(|a| if local == "patch_embed.proj.weight" { one_channel(a) } else { a.clone() }) {
            Some(found) if found.shape == array.shape => *array = found,
            Some(found) => misfits.push(format!("{local}: expected {:?}, found {:?}", array.shape, found.shape)),
            None if is_output_norm(local) => {}
            None => misfits.push(format!("{local}: expected {:?}, found none", array.shape)),
        }
    }
    if misfits.is_empty() {
        return Ok(());
    }
    let what = format!("the checkpoint does not fit the encoder ({} misfits): {}", misfits.len(), misfits.join("; "));
    Err(Error::broken(path, what))
}

/// Returns whether the name is `norm0`..`norm3`, but not a norm inside a block.
fn is_output_norm(local: &str) -> bool {
    local.starts_with("norm") && !local.starts_with("norm.")
}

fn published_name(local: &str, original: bool) -> String {
    let stage = local.strip_prefix("layers.").and_then(|rest| rest.split_once(".downsample."));
    match stage.and_then(|(stage, field)| Some((stage.parse::<usize>().ok()?, field))) {
        Some((stage, field)) if original && stage > 0 => format!("layers.{}.downsample.{field}", stage - 1),
        _ => local.into(),
    }
}

/// Sums `[C, in, 4, 4]` over `in`.
fn one_channel(a: &Array) -> Array {
    let [out, input, kh, kw] = a.shape[..] else { return a.clone() };
    let taps = kh * kw;
    let data =
        (0..out * taps).map(|i| (0..input).map(|c| a.data[(i / taps * input + c) * taps + i % taps]).sum()).collect();
    Array { shape: vec![out, 1, kh, kw], data }
}
