//! Descriptions of model files and files of tensors.

pub mod model;
mod network;
pub mod timing;

pub use network::{model as plan_text, tensors};

use crate::shipped;
use elunar_base::{Error, Result};
use elunar_core::nn::Kernel;
use elunar_core::nn::file::MAGIC;
use model::ModelFigures;
use std::path::Path;

/// Length field of a safetensors header, and its first byte `{`.
const SAFETENSORS_HEAD_BYTES: usize = 9;

/// Returns the plan of a model file whose first bytes are `head`. With a kernel and a number of tiles, the plan has measured times.
///
/// # Errors
/// [`Error::Input`] if the file is not a model, or its self test fails; [`Error::Broken`] if the model is damaged.
pub fn plan(path: &Path, head: &[u8], time: Option<(Kernel, usize)>) -> Result<ModelFigures> {
    if !is_model(head, path) {
        let what = "expected a model (.eld), the only kind of file that has a plan";
        return Err(Error::input(format!("{}: {what}", path.display())));
    }
    let (_, bytes) = shipped::model(path)?;
    let model = elunar_core::nn::Model::new(&bytes).map_err(|e| Error::broken(path, e.to_string()))?;
    let mut plan = ModelFigures::of(&model);
    if let Some((kernel, tiles)) = time {
        plan.set_times(timing::measure(kernel, model, tiles)?);
    }
    Ok(plan)
}

/// Returns whether a file that begins with `head` is a model, or has a model's extension.
pub fn is_model(head: &[u8], path: &Path) -> bool {
    head.starts_with(&MAGIC) || path.extension().is_some_and(|e| e == "eld")
}

/// Returns whether a file that begins with `head` is a safetensors file.
pub fn is_safetensors(head: &[u8]) -> bool {
    // The safetensors library refuses headers from 100 MB on.
    let length = head.first_chunk().map(|&length| u64::from_le_bytes(length));
    length.is_some_and(|length| (2..100_000_000).contains(&length))
        && head.get(SAFETENSORS_HEAD_BYTES - 1) == Some(&b'{')
}
