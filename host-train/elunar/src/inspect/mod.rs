//! Descriptions of files: raster, PDS3 label, table of laser points, model, weights or golden case.

mod raster;
mod text;

use elunar_base::{Error, Result};
use elunar_core::nn::Kernel;
use elunar_core::nn::file::MAGIC;
use elunar_net::inspect::model::ModelFigures;
use elunar_net::inspect::{self as network, is_model, is_safetensors};
use elunar_net::shipped;
use elunar_raster::format::{Format, head};
use elunar_raster::{pds3, source};
use std::path::Path;

/// Describes a file in several lines, without a newline at the end. If a label is valid but its image is not, `aside` gets the label.
///
/// # Errors
/// If the file is of no known kind, or broken.
pub fn describe(path: &Path, aside: impl FnOnce(String)) -> Result<String> {
    let head = first_bytes(path)?;
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    if is_model(&head, path) {
        return network::plan(path, &head, None).map(|plan| network::plan_text(&plan));
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

/// Returns the first bytes of a file or of a shipped model.
fn first_bytes(path: &Path) -> Result<Vec<u8>> {
    shipped::find(path).map_or_else(|| head(path), |(_, bytes)| Ok(bytes[..MAGIC.len()].to_vec()))
}

/// Returns the plan of a model, a shipped one or a file. With a kernel and a number of tiles, the plan has measured times.
///
/// # Errors
/// As [`elunar_net::inspect::plan`], or if the file cannot be read.
pub fn plan(path: &Path, time: Option<(Kernel, usize)>) -> Result<ModelFigures> {
    network::plan(path, &first_bytes(path)?, time)
}

#[cfg(test)]
mod tests;
