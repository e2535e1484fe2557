//! The image that a label describes.

use super::super::GeoRef;
use super::super::binary::{Binary, Layout, Meaning, Sample};
use super::super::relabelled::{Meant, Relabelled, is_tiff};
use super::super::source::{Info, Source};
use super::super::unit::Conversion;
use super::label::LabelBlock;
use super::pointer::{Found, Pointer, resolve};
use super::units::{self, Radius};
use super::value::{Value, ValueKind};
use super::{Defect, Refusal, place, read_label, sun, units::whole};
use elunar_base::{Error, Result, read};
use std::path::Path;

/// Greatest number of keywords in a warning.
const MOST_NAMED: usize = 5;

/// Description of an image in its label.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Description {
    /// File with the samples; `None` for the label's own file.
    pub(super) file: Option<String>,
    pub(super) layout: Layout,
    /// Stored numbers that mean "no measurement".
    missing: Vec<f64>,
    conversion: Conversion,
    unit_in_file: Option<String>,
    pub(super) georef: Option<GeoRef>,
    /// Length of a record, bytes; 1 if there are none.
    record_bytes: u64,
    /// Offsets of all other objects that the label points at in the image's file.
    others: Vec<u64>,
}

/// Opens the image that the label at `path` describes, attached or detached.
///
/// Samples are stored number * SCALING_FACTOR + OFFSET; lengths become metres. An OFFSET equal to the radius of the sphere is left out, since
/// heights here are above the sphere. Samples are NaN if they equal a special constant of the label (MISSING_CONSTANT, CORE_NULL and similar
/// ones), are 1e30 or more from zero or not finite, or are special pixels: at or below -32764 in signed 16-bit samples. If
/// the label points at a TIFF, the file is read as a TIFF, and the label supplies what the TIFF does not state.
///
/// # Errors
/// [`Error::Io`] if a file cannot be read; [`Error::Broken`] for defects of the label, and if label and file disagree in size;
/// [`Error::Unsupported`] for several bands, packed images, VAX reals and unsupported map projections; [`Error::Input`] if the file that
/// the label names does not exist.
pub fn open(path: &Path) -> Result<Box<dyn Source>> {
    open_with(path, None)
}

/// Returns the file with the samples that a label describes: perhaps the label's own.
///
/// # Errors
/// As [`open`].
pub(crate) fn image_of(label: &Path) -> Result<std::path::PathBuf> {
    let description = describe(&read_label(label)?).map_err(|refusal| refusal.of(label))?;
    description.file.map_or_else(|| Ok(label.to_path_buf()), |name| resolve(label, "^IMAGE", &name))
}

/// Opens an image as [`open`] does. Samples stored as `nodata` are invalid, too.
pub(crate) fn open_with(path: &Path, nodata: Option<f64>) -> Result<Box<dyn Source>> {
    let label = read_label(path)?;
    let mut description = describe(&label).map_err(|refusal| refusal.of(path))?;
    description.missing.extend(nodata);
    let data = match &description.file {
        Some(name) => resolve(path, "^IMAGE", name)?,
        None => path.to_path_buf(),
    };
    let file = read::file(&data)?;
    if description.file.is_some() && is_tiff(&data)? {
        let (rows, cols) = (description.layout.rows, description.layout.cols);
        let Description { missing, conversion, unit_in_file, georef, .. } = description;
        let sun = sun::stated(&label, georef.is_some());
        let warnings = warnings(&label);
        let meant =
            Meant { rows, cols, missing, conversion, unit_in_file, georef, sun, warnings, format: "PDS3 label" };
        return Ok(Box::new(Relabelled::new(path, &data, meant)?));
    }
    let file_bytes = file.metadata().map_err(Error::io(&data))?.len();
    description.check_size(path, &data, file_bytes)?;
    let meaning = description.meaning();
    let warnings = warnings(&label);
    let Description { file: named, layout, conversion, unit_in_file, georef, .. } = description;
    let kind = if named.is_some() { "detached" } else { "attached" };
    let format = format!("PDS3, {}, {kind} label", layout.stored());
    let sun = sun::stated(&label, georef.is_some());
    let (rows, cols, applied, unit) = (layout.rows, layout.cols, conversion.applied(), conversion.unit);
    let info = Info { rows, cols, georef, unit, unit_in_file, applied, format, sun, warnings };
    Ok(Box::new(Binary::new(data, file, layout, meaning, info)))
}

/// Returns a line about keywords without a value, if there are any.
fn warnings(label: &LabelBlock) -> Vec<String> {
    let empty = label.empty();
    let mut names: Vec<String> = empty.iter().map(|item| format!("{} (line {})", item.key, item.line)).collect();
    if names.len() > MOST_NAMED {
        names.truncate(MOST_NAMED);
        names.push(format!("{} more", empty.len() - MOST_NAMED));
    }
    let line = || format!("keywords without a value, read as empty: {}", names.join(", "));
    if empty.is_empty() { vec![] } else { vec![line()] }
}

impl Description {
    fn meaning(&self) -> Meaning {
        let Conversion { scale, offset, .. } = self.conversion;
        Meaning::new(self.layout.sample, self.missing.iter().copied(), scale, offset)
    }

    fn check_size(&self, label: &Path, data: &Path, file_bytes: u64) -> Result<()> {
        let Layout { rows, cols, sample, start, .. } = self.layout;
        let image = format!("{rows} lines of {cols} {} samples from byte {start} on", sample.name());
        let broken = |what: String| {
            let file = if data == label { String::new() } else { format!(" of {}", data.display()) };
            Err(Error::broken(label, format!("{image} expected, found {what}{file}")))
        };
        let Some(end) = self.layout.end() else { return broken(format!("{file_bytes} bytes")) };
        if file_bytes < end {
            return broken(format!("{file_bytes} bytes where {end} are needed"));
        }
        // A file is padded to whole records and may hold more objects. Any other data behind the image mean that the image has another
        // size.
        let padding = self.record_bytes.max(self.layout.row_bytes);
        if file_bytes - end >= padding && !self.others.iter().any(|&start| start >= end) {
            return broken(format!("{} bytes more than that, with no pointer to them,", file_bytes - end));
        }
        Ok(())
    }
}

/// Evaluates the whole label before any other file is opened.
pub(super) fn describe(label: &LabelBlock) -> std::result::Result<Description, Refusal> {
    let Some(found) = Found::in_label(label)? else { return Err(no_image(label)) };
    let record_bytes = match found.nearest("RECORD_BYTES")? {
        Some(item) => Some(whole(item)?),
        None => None,
    };
    let mut pointer = Pointer::parse(found.item, record_bytes)?;
    // A label of several files states their names beside their pointers.
    let file_block = found.around.iter().find(|block| block.name.ends_with("FILE"));
    if let (None, Some(block)) = (&pointer.file, file_block) {
        pointer.file = block.find("FILE_NAME")?.and_then(|item| item.value.text()).map(str::to_owned);
    }
    if pointer.file.is_none() && pointer.start == 0 {
        return Err(Defect::at(found.item.line, "^IMAGE behind the label expected, found the label itself").into());
    }
    let Some(image) = found.object("IMAGE") else {
        return Err(Defect::missing("OBJECT = IMAGE for ^IMAGE expected, found none").into());
    };
    let layout = layout(image, pointer.start)?;
    let projection = label.block("IMAGE_MAP_PROJECTION");
    let radius = projection.map(Radius::of).transpose()?.flatten();
    let (unit_in_file, conversion) = units::heights(image, radius)?;
    let missing = missing(image, layout.sample)?;
    let georef = projection.map(|block| place::georef(block, &layout)).transpose()?;
    let mut others = Vec::new();
    collect_others(label, record_bytes, &pointer, &mut others);
    Ok(Description {
        file: pointer.file,
        layout,
        missing,
        conversion,
        unit_in_file,
        georef,
        record_bytes: record_bytes.unwrap_or(1),
        others,
    })
}

fn no_image(label: &LabelBlock) -> Refusal {
    if label.block("COMPRESSED_FILE").is_some() {
        let what = "a packed image (COMPRESSED_FILE); unpack it first: gdal_translate -of GTiff FILE.JP2 FILE.tif";
        return Refusal::Unsupported(what.into());
    }
    let mut pointers: Vec<&str> =
        label.items.iter().map(|item| item.key.as_str()).filter(|key| key.starts_with('^')).collect();
    pointers.truncate(5);
    let found = if pointers.is_empty() { "no pointer".into() } else { pointers.join(", ") };
    Refusal::Unsupported(format!("a label with an ^IMAGE expected, found {found}"))
}

/// Collects the offsets of all other objects in the image's own file.
fn collect_others(block: &LabelBlock, record_bytes: Option<u64>, image: &Pointer, out: &mut Vec<u64>) {
    for item in block.items.iter().filter(|item| item.key.starts_with('^') && item.key != "^IMAGE") {
        out.extend(Pointer::parse(item, record_bytes).ok().filter(|p| p.same_file(image)).map(|p| p.start));
    }
    block.blocks.iter().for_each(|inner| collect_others(inner, record_bytes, image, out));
}

fn layout(image: &LabelBlock, start: u64) -> std::result::Result<Layout, Refusal> {
    let count = |key: &str, default: Option<u64>| -> std::result::Result<u64, Defect> {
        match (image.find(key)?, default) {
            (Some(item), _) => whole(item),
            (None, Some(default)) => Ok(default),
            (None, None) => Err(Defect::missing(format!("{key} of the IMAGE expected, found none"))),
        }
    };
    let bands = count("BANDS", Some(1))?;
    if bands != 1 {
        let what = format!("{bands} bands found, one expected; take one out: gdal_translate -b 1 FILE.LBL FILE.tif");
        return Err(Refusal::Unsupported(what));
    }
    if let Some(item) = image.find("ENCODING_TYPE")? {
        // Kaguya's images say how they were packed on their way to the ground: DCT_DECOMPRESSED.
        let packing = item.value.text().unwrap_or("?").to_owned();
        let plain = ["DECOMPRESSED", "UNCOMPRESSED"];
        if !plain.iter().any(|word| packing.to_ascii_uppercase().ends_with(word)) {
            return Err(Refusal::Unsupported(format!("samples packed as {packing}; plain samples expected")));
        }
    }
    let (sample, big_endian) = sample(image, count("SAMPLE_BITS", None)?)?;
    let (rows, cols) = (count("LINES", None)?, count("LINE_SAMPLES", None)?);
    let (prefix, suffix) = (count("LINE_PREFIX_BYTES", Some(0))?, count("LINE_SUFFIX_BYTES", Some(0))?);
    let samples = cols.checked_mul(sample.bytes() as u64);
    let row_bytes = samples.and_then(|bytes| bytes.checked_add(prefix)?.checked_add(suffix));
    let size = |n: u64| usize::try_from(n).ok().filter(|&n| n > 0);
    match (size(rows), size(cols), row_bytes, start.checked_add(prefix)) {
        (Some(rows), Some(cols), Some(row_bytes), Some(start)) => {
            Ok(Layout { sample, big_endian, rows, cols, start, row_bytes, tile: None })
        }
        _ => {
            let what =
                format!("an image of at least one sample and less than 2^64 bytes expected, found {rows} x {cols}");
            Err(Defect::missing(what).into())
        }
    }
}

/// Reads SAMPLE_TYPE and SAMPLE_BITS, with the synonyms of the PDS Data Dictionary. Integers of 8 bits are always unsigned: labels of
/// images up to 255 call them MSB_INTEGER and LSB_INTEGER, and GDAL reads them as unsigned.
fn sample(image: &LabelBlock, bits: u64) -> std::result::Result<(Sample, bool), Refusal> {
    let item = image.find("SAMPLE_TYPE")?;
    let Some((item, name)) = item.and_then(|item| Some((item, item.value.text()?.to_ascii_uppercase()))) else {
        return Err(Defect::missing("SAMPLE_TYPE of the IMAGE expected, found none").into());
    };
    let words: Vec<&str> = name.split(['_', ' ']).filter(|word| !word.is_empty()).collect();
    let big_endian = !words.iter().any(|word| ["LSB", "PC", "VAX"].contains(word));
    let signed = !words.contains(&"UNSIGNED");
    let is_real = words.iter().any(|word| ["REAL", "FLOAT"].contains(word));
    let is_integer = words.contains(&"INTEGER");
    let vax = is_real && words.iter().any(|word| word.starts_with("VAX"));
    let sample = match (is_real, is_integer, bits, signed) {
        _ if vax => None,
        (true, false, 32, _) => Some(Sample::F32),
        (true, false, 64, _) => Some(Sample::F64),
        (false, true, 8, _) => Some(Sample::U8),
        (false, true, 16, true) => Some(Sample::I16),
        (false, true, 16, false) => Some(Sample::U16),
        (false, true, 32, true) => Some(Sample::I32),
        (false, true, 32, false) => Some(Sample::U32),
        _ => None,
    };
    let refuse = || {
        let read = "integers of 8, 16 or 32 bits, IEEE and PC reals of 32 or 64 bits are read";
        Refusal::Unsupported(format!("line {}: samples {name} of {bits} bits; {read}", item.line))
    };
    sample.map(|sample| (sample, big_endian)).ok_or_else(refuse)
}

/// Returns the stored numbers that mean "no measurement".
fn missing(image: &LabelBlock, sample: Sample) -> std::result::Result<Vec<f64>, Defect> {
    let mut missing = Vec::new();
    for item in &image.items {
        let key = item.key.as_str();
        let sets_apart = [
            "MISSING",
            "MISSING_CONSTANT",
            "INVALID_CONSTANT",
            "INVALID_VALUE",
            "NOT_APPLICABLE_CONSTANT",
            "UNKNOWN_CONSTANT",
            "NULL_CONSTANT",
        ]
        .contains(&key)
            || key == "CORE_NULL"
            || key.starts_with("CORE_") && key.ends_with("_SATURATION");
        if !sets_apart || item.value.is_absent() {
            continue;
        }
        for value in item.value.members().iter().filter(|value| !value.is_absent()) {
            let stored = stored(value, sample);
            missing.push(
                stored.ok_or_else(|| {
                    Defect::at(item.line, format!("a number as {key} expected, found {:?}", value.kind))
                })?,
            );
        }
    }
    Ok(missing)
}

/// Returns a constant in the samples' type. For real samples a based integer is a bit pattern; some labels quote it.
fn stored(value: &Value, sample: Sample) -> Option<f64> {
    if let Some(text) = value.text() {
        let kind = super::value::classify(text).ok()?;
        let value = Value { kind, unit: None };
        return if value.text().is_some() { None } else { stored(&value, sample) };
    }
    match (&value.kind, sample) {
        (ValueKind::Based { value, .. }, Sample::F32) => Some(f64::from(f32::from_bits(u32::try_from(*value).ok()?))),
        (ValueKind::Based { value, .. }, Sample::F64) => Some(f64::from_bits(u64::try_from(*value).ok()?)),
        (_, Sample::F32) => value.number().map(|number| f64::from(number as f32)),
        _ => value.number(),
    }
}
