//! PDS4 images: an XML label that describes an array in a file beside it. Heights are written so, too.

mod array;
mod place;
mod write;

#[cfg(test)]
mod tests;
#[cfg(test)]
mod write_tests;

pub use write::{Product, holds, note, samples_path, write};

use super::GeoRef;
use super::binary::{Binary, Layout, Meaning};
use super::pds3::{Defect, Refusal, resolve};
use super::relabelled::{Meant, Relabelled, is_tiff};
use super::source::{Info, Source};
use super::sun::StatedSun;
use super::unit::{self, Conversion};
use super::xml::{self, Element};
use elunar_base::{Error, Result, read};
use std::path::{Path, PathBuf};

/// Name of the outermost element of labels that are read.
pub(crate) const PRODUCT: &str = "Product_Observational";

/// What a label says about its first image.
struct Image {
    /// File with the samples.
    file: String,
    layout: Layout,
    missing: Vec<f64>,
    conversion: Conversion,
    unit_in_file: Option<String>,
    georef: Option<GeoRef>,
    sun: StatedSun,
    warnings: Vec<String>,
}

/// Opens the first image of the label at `path`: an `Array_2D` (`_Image`, `_Map`) of lines and samples, or an `Array_3D` (`_Image`) of one
/// band.
///
/// Samples are stored number * `scaling_factor` + `value_offset`; lengths become metres. They are NaN where they equal a special constant of
/// the label. The place is that of `cart:Cartography`, the time is `start_date_time`. If the label's file is a TIFF, it is read as a TIFF, and
/// the label supplies what the TIFF does not state.
///
/// # Errors
/// [`Error::Io`] if a file cannot be read; [`Error::Broken`] for defects of the label, and if the file is too short for it;
/// [`Error::Unsupported`] for several bands, other arrays and numbers, and map projections that are not read; [`Error::Input`] if the file that
/// the label names does not exist.
pub fn open(path: &Path) -> Result<Box<dyn Source>> {
    open_with(path, None)
}

/// Returns the file with the samples that a label describes.
///
/// # Errors
/// As [`open`].
pub(crate) fn image_of(label: &Path) -> Result<PathBuf> {
    resolve(label, "file_name", &image(label)?.file)
}

/// Opens an image as [`open`] does. Samples stored as `nodata` are invalid, too.
pub(crate) fn open_with(path: &Path, nodata: Option<f64>) -> Result<Box<dyn Source>> {
    let mut image = image(path)?;
    image.missing.extend(nodata);
    let data = resolve(path, "file_name", &image.file)?;
    let Image { layout, missing, conversion, unit_in_file, georef, sun, warnings, .. } = image;
    let Layout { rows, cols, sample, start, .. } = layout;
    if is_tiff(&data)? {
        let format = "PDS4 label";
        let meant = Meant { rows, cols, missing, conversion, unit_in_file, georef, sun, warnings, format };
        return Ok(Box::new(Relabelled::new(path, &data, meant)?));
    }
    let file = read::file(&data)?;
    let found = file.metadata().map_err(Error::io(&data))?.len();
    if layout.end().is_none_or(|end| found < end) {
        let needed = layout.end().map_or_else(|| "more than 2^64".into(), |end| end.to_string());
        let image =
            format!("{rows} lines of {cols} {} samples from byte {start} on, {needed} bytes in all,", sample.name());
        return Err(Error::broken(path, format!("{image} expected, found {found} bytes of {}", data.display())));
    }
    let meaning = Meaning::new(sample, missing, conversion.scale, conversion.offset);
    let format = format!("PDS4, {}", layout.stored());
    let applied = conversion.applied();
    let info = Info { rows, cols, georef, unit: conversion.unit, unit_in_file, applied, format, sun, warnings };
    Ok(Box::new(Binary::new(data, file, layout, meaning, info)))
}

fn image(label: &Path) -> Result<Image> {
    let text = xml::text(label)?;
    let tree = xml::tree(label, &text)?;
    describe(Element(tree.root_element())).map_err(|refusal| refusal.of(label))
}

fn describe(product: Element) -> std::result::Result<Image, Refusal> {
    if product.name() != PRODUCT {
        let what = format!("{PRODUCT} as outermost element expected, found {}", product.name());
        return Err(Refusal::Unsupported(what));
    }
    let found = array::find(product)?;
    let array::Found { area, array, others } = found;
    let file = area.required("File")?.required("file_name")?.text().to_owned();
    let layout = array::layout(array)?;
    refuse_turned(product)?;
    let georef = product.inside("Cartography").map(|cart| place::georef(cart, &layout)).transpose()?.flatten();
    let elements = array.required("Element_Array")?;
    let number = |name: &str, default: f64| elements.child(name).map_or(Ok(default), Element::number);
    let (scale, offset) = (number("scaling_factor", 1.0)?, number("value_offset", 0.0)?);
    if scale == 0.0 {
        return Err(Defect::at(elements.line(), "a scaling_factor other than 0 expected, found 0").into());
    }
    let unit_in_file = elements.child("unit").map(|unit| unit.text().to_owned()).filter(|unit| !unit.is_empty());
    let radius_m = georef.as_ref().and_then(|georef| georef.crs.sphere_radius_m());
    let conversion = unit::conversion(unit_in_file.as_deref(), scale, offset, radius_m);
    let time = product.inside("start_date_time").and_then(|time| time.text().parse().ok());
    let sun = StatedSun { time, ..StatedSun::default() };
    let more = || format!("{others} more arrays in the label; the first, {}, is read", array.name());
    let warnings = if others > 0 { vec![more()] } else { vec![] };
    let missing = array::missing(array, layout.sample)?;
    Ok(Image { file, layout, missing, conversion, unit_in_file, georef, sun, warnings })
}

/// Refuses images that are stored from the bottom up or from right to left.
fn refuse_turned(product: Element) -> std::result::Result<(), Refusal> {
    let stated = [("vertical_display_direction", "Top to Bottom"), ("horizontal_display_direction", "Left to Right")];
    for (name, wanted) in stated {
        if let Some(found) = product.inside(name).filter(|found| !found.text().eq_ignore_ascii_case(wanted)) {
            let convert = "convert it first: gdal_translate -of GTiff FILE.xml FILE.tif";
            return Err(Refusal::Unsupported(format!(
                "line {}: {name} {}; {wanted} expected; {convert}",
                found.line(),
                found.text()
            )));
        }
    }
    Ok(())
}
