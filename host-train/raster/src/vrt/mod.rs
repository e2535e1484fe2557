//! GDAL's virtual rasters (VRT): an XML file that puts pieces of other files side by side, pixel for pixel.

mod describe;
mod pieces;

#[cfg(test)]
mod tests;

use super::binary::Sample;
use super::nodata::{self, Nodata};
use super::source::{self, Info, Source, check_window};
use super::unit::{self, Conversion};
use super::xml::{self, Element};
use super::{content, format::Format};
use describe::{Mosaic, describe};
use elunar_base::{Error, Result};
use elunar_core::tile::Window;
use pieces::{Opened, Piece};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Most VRTs within each other (our choice).
const MOST_NESTED: usize = 3;

/// Most warnings of files that are passed on.
const MOST_WARNINGS: usize = 5;

/// Opens the VRT at `path`: one band of `SimpleSource`, and `ComplexSource` that has no more than `NODATA`, without resampling.
///
/// Stored numbers are those of the files. Where no file lies, samples are NaN if `NoDataValue` is stated, otherwise that of 0, as in GDAL. Voids of the
/// files are NaN. `Scale`, `Offset` and `UnitType` apply as GDAL has them.
///
/// # Errors
/// [`Error::Io`] if a file cannot be read; [`Error::Broken`] for defects of the XML; [`Error::Unsupported`] for everything else that a VRT can do,
/// with the command that converts it; as [`source::open`] about the files.
pub fn open(path: &Path) -> Result<Box<dyn Source>> {
    open_with(path, None, 0)
}

/// Returns the VRT, the files that it names and theirs, each once.
///
/// # Errors
/// As [`open`].
pub(crate) fn files(path: &Path, nested: usize) -> Result<Vec<PathBuf>> {
    let mut all = vec![path.to_path_buf()];
    let mosaic = read_mosaic(path, nested)?;
    for file in mosaic.files(path) {
        match Format::of(&file)? {
            Format::Vrt => all.extend(files(&file, nested + 1)?),
            _ => all.extend(content::files_of_raster(&file)?),
        }
    }
    all.extend(super::mask::beside(path));
    let mut seen = HashSet::new();
    all.retain(|file| seen.insert(file.clone()));
    Ok(all)
}

fn read_mosaic(path: &Path, nested: usize) -> Result<Mosaic> {
    if nested > MOST_NESTED {
        return Err(Error::unsupported(path, format!("VRTs at most {MOST_NESTED} deep expected, found more")));
    }
    let text = xml::text(path)?;
    let tree = xml::tree(path, &text)?;
    describe(Element(tree.root_element())).map_err(|refusal| refusal.of(path))
}

/// Opens a VRT as [`open`] does, `nested` in so many others. Samples stored as `nodata` are invalid, too.
pub(crate) fn open_with(path: &Path, nodata: Option<f64>, nested: usize) -> Result<Box<dyn Source>> {
    let mosaic = read_mosaic(path, nested)?;
    let files = mosaic.files(path);
    let (mut first, mut warnings, mut rule) = (None, vec![], None);
    for (index, file) in files.iter().enumerate() {
        let opened = pieces::open_file(file, nested)?;
        let info = opened.info();
        mosaic.check(path, file, index, info)?;
        let found = Converted::of(&mosaic, info)
            .map_err(|what| Error::unsupported(path, format!("{}: {what}", file.display())))?;
        if rule.get_or_insert_with(|| found.clone()) != &found {
            let what = format!("{}: unit, scale and offset of the first file expected, found others", file.display());
            return Err(Error::unsupported(path, what));
        }
        warnings.extend(info.warnings.iter().map(|warning| format!("{}: {warning}", file.display())));
        first.get_or_insert_with(|| info.clone());
    }
    warnings.truncate(MOST_WARNINGS);
    let alone = first.as_ref().filter(|_| mosaic.pieces.len() == 1);
    let rule = rule.unwrap_or_else(|| Converted::alone(&mosaic));
    let Converted { conversion, unit_in_file, .. } = &rule;
    let info = Info {
        rows: mosaic.rows,
        cols: mosaic.cols,
        georef: mosaic.georef.clone(),
        unit: conversion.unit.clone(),
        unit_in_file: unit_in_file.clone(),
        applied: conversion.applied(),
        format: format!("VRT, {}, of {}", mosaic.sample.name(), counted(files.len())),
        sun: mosaic.sun.or(alone.map(|info| info.sun).unwrap_or_default()),
        warnings,
    };
    let voids: Vec<f64> = mosaic.nodata.into_iter().chain(nodata).collect();
    let voids = Nodata::of_floats(voids.into_iter().map(|value| rule.already(value)), 32);
    let fill = if mosaic.nodata.is_some() { f32::NAN } else { nodata::sample(conversion.offset) };
    let pieces = mosaic.pieces.iter().map(|piece| piece.converted(|value| rule.already(value))).collect();
    Ok(Box::new(Vrt { info, pieces, files: Opened::new(files, nested), voids, rule, fill }))
}

fn counted(files: usize) -> String {
    format!("{files} file{}", if files == 1 { "" } else { "s" })
}

/// How the files' samples become those of the VRT.
#[derive(Debug, Clone, PartialEq)]
struct Converted {
    conversion: Conversion,
    unit_in_file: Option<String>,
    /// Whether the files' samples have the conversion already.
    is_done: bool,
}

impl Converted {
    /// Compares what the VRT states with what was applied to a file's samples.
    fn of(mosaic: &Mosaic, file: &Info) -> std::result::Result<Self, String> {
        let unit_in_file = mosaic.unit.clone().or_else(|| file.unit_in_file.clone());
        let conversion = mosaic.conversion(unit_in_file.as_deref());
        let applied = file.applied.unwrap_or((1.0, 0.0));
        let same = |a: f64, b: f64| (a - b).abs() <= 1e-12 * a.abs().max(b.abs());
        let is_done = same(conversion.scale, applied.0) && same(conversion.offset, applied.1);
        if !is_done && file.applied.is_some() {
            return Err(format!(
                "scale {} and offset {} of the VRT expected, found {} and {}; {}",
                conversion.scale,
                conversion.offset,
                applied.0,
                applied.1,
                describe::CONVERT
            ));
        }
        Ok(Self { conversion, unit_in_file, is_done })
    }

    /// Returns the conversion of a VRT without files.
    fn alone(mosaic: &Mosaic) -> Self {
        let conversion = mosaic.conversion(mosaic.unit.as_deref());
        Self { conversion, unit_in_file: mosaic.unit.clone(), is_done: false }
    }

    /// Returns a stored number as the files' samples have it.
    fn already(&self, stored: f64) -> f64 {
        if self.is_done { stored * self.conversion.scale + self.conversion.offset } else { stored }
    }

    fn finish(&self, sample: f32) -> f32 {
        if self.is_done {
            return sample;
        }
        nodata::sample(f64::from(sample) * self.conversion.scale + self.conversion.offset)
    }
}

/// An open VRT.
struct Vrt {
    info: Info,
    pieces: Vec<Piece>,
    files: Opened,
    /// Samples of the files that are void.
    voids: Nodata,
    rule: Converted,
    /// Where no file lies.
    fill: f32,
}

impl Source for Vrt {
    fn info(&self) -> &Info {
        &self.info
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        check_window(window, self.info.rows, self.info.cols)?;
        let mut samples = vec![self.fill; window.rows * window.cols];
        for piece in &self.pieces {
            let Some(part) = piece.within(window) else { continue };
            let found = self.files.get(piece.file)?.read(part.from)?;
            for (row, line) in found.chunks_exact(part.from.cols.max(1)).enumerate() {
                let out = &mut samples[(part.row + row) * window.cols + part.col..][..line.len()];
                for (out, &sample) in out.iter_mut().zip(line) {
                    if !piece.lets_through(sample) {
                        let void = self.voids.has_float(f64::from(sample));
                        *out = if void { f32::NAN } else { self.rule.finish(sample) };
                    }
                }
            }
        }
        Ok(samples)
    }
}
