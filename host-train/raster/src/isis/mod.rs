//! ISIS cubes (version 3): a label in PVL, then one band of samples, row after row or in tiles. The label may also be a file beside its cube.

mod place;

#[cfg(test)]
mod tests;

use super::binary::{Binary, Layout, Meaning, Sample};
use super::pds3::sun::{first, moment};
use super::pds3::units::{finite, whole};
use super::pds3::{Defect, LabelBlock, LabelItem, Refusal, read_label, resolve};
use super::relabelled::{Meant, Relabelled, is_tiff};
use super::source::{Info, Source};
use super::sun::StatedSun;
use super::unit::Conversion;
use super::{GeoRef, unit};
use elunar_base::{Error, Result, read};
use std::path::{Path, PathBuf};

/// What a label says.
struct Cube {
    /// File with the samples; `None` for the label's own file.
    file: Option<String>,
    /// `Format = GeoTIFF`: the samples are those of a TIFF beside the label.
    is_tiff: bool,
    layout: Layout,
    missing: Vec<f64>,
    conversion: Conversion,
    georef: Option<GeoRef>,
    sun: StatedSun,
}

/// Opens the cube whose label is at `path`, attached or detached.
///
/// Samples are stored number * Multiplier + Base. They are NaN where ISIS has a special pixel: Null, and saturation of the instrument or of
/// the number, low and high. Formats are Tile, BandSequential and GeoTIFF, numbers UnsignedByte, SignedWord, UnsignedWord, UnsignedInteger,
/// Real and Double. The time of the image is StartTime of its Instrument group.
///
/// # Errors
/// [`Error::Io`] if a file cannot be read; [`Error::Broken`] for defects of the label, and if the file is too short for it;
/// [`Error::Unsupported`] for several bands, other formats and numbers, and map projections that are not read.
pub fn open(path: &Path) -> Result<Box<dyn Source>> {
    open_with(path, None)
}

/// Returns the file with the samples that a label describes: perhaps the label's own.
///
/// # Errors
/// As [`open`].
pub(crate) fn image_of(label: &Path) -> Result<PathBuf> {
    let cube = describe(&read_label(label)?).map_err(|refusal| refusal.of(label))?;
    cube.file.map_or_else(|| Ok(label.to_path_buf()), |name| resolve(label, "^Core", &name))
}

/// Opens a cube as [`open`] does. Samples stored as `nodata` are invalid, too.
pub(crate) fn open_with(path: &Path, nodata: Option<f64>) -> Result<Box<dyn Source>> {
    let mut cube = describe(&read_label(path)?).map_err(|refusal| refusal.of(path))?;
    cube.missing.extend(nodata);
    let data = cube.file.as_ref().map_or_else(|| Ok(path.to_path_buf()), |name| resolve(path, "^Core", name))?;
    let Cube { layout, missing, conversion, georef, sun, .. } = cube;
    let Layout { rows, cols, sample, .. } = layout;
    if cube.is_tiff {
        if !is_tiff(&data)? {
            return Err(Error::broken(path, format!("a TIFF as ^Core expected, found {}", data.display())));
        }
        let format = "ISIS label";
        let (unit_in_file, warnings) = (None, vec![]);
        let meant = Meant { rows, cols, missing, conversion, unit_in_file, georef, sun, warnings, format };
        return Ok(Box::new(Relabelled::new(path, &data, meant)?));
    }
    let file = read::file(&data)?;
    let found = file.metadata().map_err(Error::io(&data))?.len();
    if layout.end().is_none_or(|end| found < end) {
        let needed = layout.end().map_or_else(|| "more than 2^64".into(), |end| end.to_string());
        let image = format!("{rows} lines of {cols} {} samples from byte {} on", sample.name(), layout.start);
        return Err(Error::broken(path, format!("{image}, {needed} bytes in all, expected, found {found} bytes")));
    }
    let meaning = Meaning::new(sample, missing, conversion.scale, conversion.offset);
    let format = format!("ISIS cube, {}", layout.stored());
    let applied = conversion.applied();
    let info = Info { rows, cols, georef, unit: conversion.unit, applied, format, sun, ..Info::default() };
    Ok(Box::new(Binary::new(data, file, layout, meaning, info)))
}

fn describe(label: &LabelBlock) -> std::result::Result<Cube, Refusal> {
    let cube = inner(label, "Object", "IsisCube")?;
    let core = inner(cube, "Object", "Core")?;
    let (sizes, pixels) = (inner(core, "Group", "Dimensions")?, inner(core, "Group", "Pixels")?);
    let bands = count(sizes, "Bands")?;
    if bands != 1 {
        let what = format!("Bands = {bands} found, 1 expected; take one out: gdal_translate -b 1 FILE.cub FILE.tif");
        return Err(Refusal::Unsupported(what));
    }
    let (rows, cols) = (size(sizes, "Lines")?, size(sizes, "Samples")?);
    let (sample, special) = sample(pixels)?;
    let (tile, is_tiff) = tile(core)?;
    let width = tile.map_or(cols, |(_, cols)| cols) as u64;
    let Some(row_bytes) = width.checked_mul(sample.bytes() as u64) else {
        return Err(Defect::missing(format!("rows of less than 2^64 bytes expected, found {width} samples")).into());
    };
    let file = find(core, "^Core")?.map(text).transpose()?;
    let start = if is_tiff { 0 } else { start(core, file.is_some())? };
    if is_tiff && file.is_none() {
        return Err(Defect::missing("^Core with the name of the TIFF expected, found none").into());
    }
    let layout = Layout { sample, big_endian: big_endian(pixels, sample)?, rows, cols, start, row_bytes, tile };
    let georef = cube.block("MAPPING").map(place::georef).transpose()?;
    let radius_m = georef.as_ref().and_then(|georef| georef.crs.sphere_radius_m());
    let (scale, offset) = (number(pixels, "Multiplier", 1.0)?, number(pixels, "Base", 0.0)?);
    if scale == 0.0 {
        return Err(Defect::missing("a Multiplier other than 0 expected, found 0").into());
    }
    let conversion = unit::conversion(None, scale, offset, radius_m);
    let time = cube.block("INSTRUMENT").and_then(|group| moment(first(group, "STARTTIME")?));
    let sun = StatedSun { time, ..StatedSun::default() };
    Ok(Cube { file, is_tiff, layout, missing: special.to_vec(), conversion, georef, sun })
}

/// Returns the block of that name within another one.
fn inner<'a>(block: &'a LabelBlock, kind: &str, name: &str) -> std::result::Result<&'a LabelBlock, Defect> {
    let wanted = name.to_ascii_uppercase();
    let found = block.blocks.iter().find(|inner| inner.name == wanted);
    found.ok_or_else(|| Defect::missing(format!("{kind} = {name} expected, found none")))
}

/// Returns the item of `key`, as ISIS spells it.
fn find<'a>(block: &'a LabelBlock, key: &str) -> std::result::Result<Option<&'a LabelItem>, Defect> {
    block.find(&key.to_ascii_uppercase())
}

/// Returns the item of `key`, which must be there.
fn required<'a>(block: &'a LabelBlock, key: &str) -> std::result::Result<&'a LabelItem, Defect> {
    find(block, key)?.ok_or_else(|| Defect::missing(format!("{key} in {} expected, found none", block.name)))
}

fn count(block: &LabelBlock, key: &str) -> std::result::Result<u64, Defect> {
    whole(required(block, key)?)
}

/// Returns a number of rows or columns.
fn size(block: &LabelBlock, key: &str) -> std::result::Result<usize, Defect> {
    let item = required(block, key)?;
    let found = whole(item)?;
    let size = usize::try_from(found).ok().filter(|&size| size > 0);
    size.ok_or_else(|| Defect::at(item.line, format!("at least 1 as {key} expected, found {found}")))
}

fn number(block: &LabelBlock, key: &str, default: f64) -> std::result::Result<f64, Defect> {
    find(block, key)?.map_or(Ok(default), finite)
}

fn text(item: &LabelItem) -> std::result::Result<String, Defect> {
    let text = item.value.text().map(str::to_owned);
    text.ok_or_else(|| Defect::at(item.line, format!("a word as {} expected, found {:?}", item.key, item.value.kind)))
}

/// Returns rows and columns of a tile if there are tiles, and whether the samples are those of a TIFF.
fn tile(core: &LabelBlock) -> std::result::Result<(Option<(usize, usize)>, bool), Refusal> {
    let item = required(core, "Format")?;
    match text(item)?.to_ascii_lowercase().as_str() {
        "tile" => Ok((Some((size(core, "TileLines")?, size(core, "TileSamples")?)), false)),
        "bandsequential" => Ok((None, false)),
        "geotiff" => Ok((None, true)),
        found => Err(Refusal::Unsupported(format!(
            "line {}: Tile, BandSequential or GeoTIFF as Format expected, found {found}",
            item.line
        ))),
    }
}

/// Returns the offset of the first sample. Bytes are counted from 1.
fn start(core: &LabelBlock, detached: bool) -> std::result::Result<u64, Defect> {
    let item = required(core, "StartByte")?;
    let least = if detached { 1 } else { 2 };
    let found = whole(item)?;
    if found < least {
        return Err(Defect::at(item.line, format!("StartByte from {least} on expected, found {found}")));
    }
    Ok(found - 1)
}

/// Returns the type of the samples and its special pixels, as ISIS has them (`SpecialPixel.h`). Those of signed words and of reals are voids of
/// every format: [`elunar_core::mask`].
fn sample(pixels: &LabelBlock) -> std::result::Result<(Sample, &'static [f64]), Refusal> {
    let item = required(pixels, "Type")?;
    let name = text(item)?;
    Ok(match name.to_ascii_lowercase().as_str() {
        "unsignedbyte" => (Sample::U8, &[0.0, 255.0]),
        "signedword" => (Sample::I16, &[]),
        "unsignedword" => (Sample::U16, &[0.0, 1.0, 2.0, 65534.0, 65535.0]),
        "unsignedinteger" => (Sample::U32, &[0.0, 1.0, 2.0, 4_294_967_294.0, 4_294_967_295.0]),
        "real" => (Sample::F32, &[]),
        "double" => (Sample::F64, &[]),
        _ => {
            let read = "UnsignedByte, SignedWord, UnsignedWord, UnsignedInteger, Real or Double";
            return Err(Refusal::Unsupported(format!("line {}: {read} as Type expected, found {name}", item.line)));
        }
    })
}

fn big_endian(pixels: &LabelBlock, sample: Sample) -> std::result::Result<bool, Defect> {
    if sample.bytes() == 1 {
        return Ok(false);
    }
    let item = required(pixels, "ByteOrder")?;
    match text(item)?.to_ascii_lowercase().as_str() {
        "lsb" => Ok(false),
        "msb" => Ok(true),
        found => Err(Defect::at(item.line, format!("Lsb or Msb as ByteOrder expected, found {found}"))),
    }
}
