//! What a file is understood as, in words: raster, PDS3 label, table of laser points, model, weights or golden case; or why not.

mod network;
mod raster;
mod text;

use crate::raster::format::{Format, head};
use crate::raster::{pds3, source};
use crate::{Error, Result};
use elunar_core::nn::format::MAGIC;
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
    if head.starts_with(&MAGIC) || extension == "eld" {
        return network::model(path);
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

fn is_safetensors(head: &[u8]) -> bool {
    // Their library refuses headers from 100 MB on.
    let length = head.first_chunk().map(|&length| u64::from_le_bytes(length));
    length.is_some_and(|length| (2..100_000_000).contains(&length))
        && head.get(SAFETENSORS_HEAD_BYTES - 1) == Some(&b'{')
}

#[cfg(test)]
mod tests;
