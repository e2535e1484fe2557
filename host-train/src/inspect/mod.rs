//! What a file is understood as, in words: raster, PDS3 label, table of laser points, model, weights or golden case; or why not.

pub mod model;
mod network;
mod raster;
mod text;
pub mod timing;

use crate::raster::format::{Format, head};
use crate::raster::{pds3, source};
use crate::{Error, Result};
use elunar_core::nn::Kernel;
use elunar_core::nn::file::MAGIC;
use model::Plan;
use std::path::Path;

/// Length of a safetensors header, then the `{` it begins with.
const SAFETENSORS_HEAD_BYTES: usize = 9;

/// Describes a file, in several lines without the last line's end. Where a label is sound but its image is not, `aside` gets the label.
///
/// # Errors
/// Why the file is not understood.
pub fn describe(path: &Path, aside: impl FnOnce(String)) -> Result<String> {
    let head = head(path)?;
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    if is_model(&head, path) {
        return plan(path, None).map(|plan| network::model(&plan));
    }
    if is_safetensors(&head) || extension == "safetensors" {
        return network::tensors(path);
    }
    let format = Format::of_head(&head);
    if let Some(line) = text::heading(&head)
        && matches!(format, Format::Unknown(_))
    {
        return text::points(path, &line);
    }
    match source::open(path) {
        Ok(source) => raster::describe(&*source),
        Err(error) if format == Format::Pds3 => {
            let label = pds3::read_label(path)?;
            let has_image = text::label_points_at_image(&label);
            let description = text::label(&label);
            if has_image {
                aside(description);
                return Err(error);
            }
            Ok(description)
        }
        Err(Error::Unsupported { path, what }) if matches!(format, Format::Unknown(_)) => {
            let more = "; nor is it a model, weights, or a table with a heading of longitude, latitude and height";
            Err(Error::unsupported(path, what + more))
        }
        Err(error) => Err(error),
    }
}

/// The plan of a model file; with a kernel and a number of tiles, measured.
///
/// # Errors
/// [`Error::Usage`] if it is no model, or its self test fails; [`Error::Broken`] if it is a damaged one.
pub fn plan(path: &Path, time: Option<(Kernel, usize)>) -> Result<Plan> {
    if !is_model(&head(path)?, path) {
        let what = "expected a model (.eld), the only kind of file that has a plan";
        return Err(Error::usage(format!("{}: {what}", path.display())));
    }
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    let model = elunar_core::nn::Model::new(&bytes).map_err(|e| Error::broken(path, e.to_string()))?;
    let mut plan = Plan::of(&model);
    if let Some((kernel, tiles)) = time {
        plan.set_times(timing::measure(kernel, model, tiles)?);
    }
    Ok(plan)
}

/// A plan in words, in several lines without the last line's end.
pub fn plan_text(plan: &Plan) -> String {
    network::model(plan)
}

fn is_model(head: &[u8], path: &Path) -> bool {
    head.starts_with(&MAGIC) || path.extension().is_some_and(|e| e == "eld")
}

fn is_safetensors(head: &[u8]) -> bool {
    // Their library refuses headers from 100 MB on.
    let length = head.first_chunk().map(|&length| u64::from_le_bytes(length));
    length.is_some_and(|length| (2..100_000_000).contains(&length))
        && head.get(SAFETENSORS_HEAD_BYTES - 1) == Some(&b'{')
}

#[cfg(test)]
mod tests;
