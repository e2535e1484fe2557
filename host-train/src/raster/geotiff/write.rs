//! Writing.

use super::super::{GeoRef, Raster, atomic_write};
use super::metadata::{self, Item};
use super::{NODATA, NODATA_TEXT, tag};
use crate::{Error, Result};
use rayon::prelude::*;
use std::io::{Cursor, Seek, Write};
use std::path::Path;
use tiff::encoder::compression::{CompressionAlgorithm, Deflate};
use tiff::encoder::{DirectoryEncoder, TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard};
use tiff::tags::Tag;
use tiff::{TiffError, TiffResult};

/// Tile side, pixels: GDAL's and the Ames Stereo Pipeline's default.
const TILE_PX: usize = 256;

/// Above this many bytes of samples the file becomes a BigTIFF, even if compression might have kept it below 4 GB.
const CLASSIC_BYTES: usize = 2_000_000_000;

/// How samples are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleType {
    /// As they are; nodata is [`NODATA`].
    F32,
    /// Rounded to 0..=255. If any sample is invalid, 0 is nodata and valid samples are at least 1.
    U8,
    /// Rounded to 0..=65535. If any sample is invalid, 0 is nodata and valid samples are at least 1.
    U16,
}

/// What goes into the file besides samples and place.
#[derive(Debug, Clone, PartialEq)]
pub struct WriteOptions {
    /// How samples are stored.
    pub sample: SampleType,
    /// Unit of the samples; `m` for heights.
    pub unit: Option<String>,
    /// What the band is: for heights the sphere they are above, and where they come from.
    pub description: Option<String>,
    /// Further metadata items, name and text.
    pub items: Vec<(String, String)>,
}

impl WriteOptions {
    /// Heights in metres, stored as `f32`.
    #[must_use]
    pub fn heights(description: impl Into<String>) -> Self {
        Self { sample: SampleType::F32, unit: Some("m".into()), description: Some(description.into()), items: vec![] }
    }

    /// An image without unit.
    #[must_use]
    pub fn image(sample: SampleType, description: impl Into<String>) -> Self {
        Self { sample, unit: None, description: Some(description.into()), items: vec![] }
    }

    /// Adds a metadata item.
    #[must_use]
    pub fn with_item(mut self, name: impl Into<String>, text: impl Into<String>) -> Self {
        self.items.push((name.into(), text.into()));
        self
    }
}

/// Writes `raster` as a tiled, Deflate-compressed GeoTIFF, whole or not at all. The reference system's keys go out as they came in.
/// Float files carry the nodata tag always, integer files only if a sample is invalid.
///
/// # Errors
/// [`Error::Usage`] if the raster is empty, its sample count is not rows x columns, or a sample does not fit an integer type;
/// [`Error::Io`] if the file cannot be written.
pub fn write(path: &Path, raster: &Raster, options: &WriteOptions) -> Result<()> {
    if raster.rows == 0 || raster.cols == 0 || raster.samples.len() != raster.rows * raster.cols {
        let (rows, cols, found) = (raster.rows, raster.cols, raster.samples.len());
        return Err(Error::usage(format!(
            "{}: {rows} x {cols} pixels expected, {found} samples found",
            path.display()
        )));
    }
    check_range(path, raster, options.sample)?;
    let bytes = match raster.samples.len() * options.sample.bytes() > CLASSIC_BYTES {
        true => encode::<TiffKindBig>(raster, options),
        false => encode::<TiffKindStandard>(raster, options),
    };
    let bytes = bytes.map_err(|e| match e {
        TiffError::IoError(source) => Error::Io { path: path.into(), source },
        other => Error::usage(format!("{}: {other}", path.display())),
    })?;
    atomic_write(path, &bytes)
}

impl SampleType {
    fn bytes(self) -> usize {
        match self {
            Self::F32 => 4,
            Self::U16 => 2,
            Self::U8 => 1,
        }
    }

    fn highest(self) -> Option<f32> {
        match self {
            Self::F32 => None,
            Self::U16 => Some(f32::from(u16::MAX)),
            Self::U8 => Some(f32::from(u8::MAX)),
        }
    }
}

fn check_range(path: &Path, raster: &Raster, sample: SampleType) -> Result<()> {
    let Some(highest) = sample.highest() else { return Ok(()) };
    match raster.range() {
        Some((low, high)) if low.round() < 0.0 || high.round() > highest => Err(Error::usage(format!(
            "{}: samples within 0 and {highest} expected, {low} to {high} found",
            path.display()
        ))),
        _ => Ok(()),
    }
}

fn encode<K: TiffKind>(raster: &Raster, options: &WriteOptions) -> TiffResult<Vec<u8>> {
    let mut bytes = Cursor::new(Vec::new());
    let mut tiff = TiffEncoder::<_, K>::new_generic(&mut bytes)?;
    let mut directory = tiff.image_directory()?;
    write_layout(&mut directory, raster, options.sample)?;
    write_tiles(&mut directory, raster, options.sample)?;
    if let Some(georef) = &raster.georef {
        write_georef(&mut directory, georef)?;
    }
    let has_gaps = raster.samples.iter().any(|v| !v.is_finite());
    match options.sample {
        SampleType::F32 => directory.write_tag(Tag::GdalNodata, NODATA_TEXT)?,
        _ if has_gaps => directory.write_tag(Tag::GdalNodata, "0")?,
        _ => {}
    }
    let items = items(options);
    if !items.is_empty() {
        directory.write_tag(tag::GDAL_METADATA, metadata::format(&items).as_str())?;
    }
    directory.finish()?;
    Ok(bytes.into_inner())
}

fn write_layout<W: Write + Seek, K: TiffKind>(
    directory: &mut DirectoryEncoder<W, K>,
    raster: &Raster,
    sample: SampleType,
) -> TiffResult<()> {
    // Predictor 3 (floating point) and 2 (horizontal differences); format 3 is float, 1 unsigned.
    let (format, predictor) = if sample == SampleType::F32 { (3_u16, 3_u16) } else { (1, 2) };
    let (tile_rows, tile_cols) = tile_size(raster);
    directory.write_tag(Tag::ImageWidth, u32::try_from(raster.cols)?)?;
    directory.write_tag(Tag::ImageLength, u32::try_from(raster.rows)?)?;
    directory.write_tag(Tag::BitsPerSample, 8 * sample.bytes() as u16)?;
    directory.write_tag(Tag::Compression, 8_u16)?;
    directory.write_tag(Tag::PhotometricInterpretation, 1_u16)?;
    directory.write_tag(Tag::SamplesPerPixel, 1_u16)?;
    directory.write_tag(Tag::PlanarConfiguration, 1_u16)?;
    directory.write_tag(Tag::Predictor, predictor)?;
    directory.write_tag(Tag::TileWidth, u32::try_from(tile_cols)?)?;
    directory.write_tag(Tag::TileLength, u32::try_from(tile_rows)?)?;
    directory.write_tag(Tag::SampleFormat, format)
}

/// Tile sides must be multiples of 16.
fn tile_size(raster: &Raster) -> (usize, usize) {
    (TILE_PX.min(raster.rows.next_multiple_of(16)), TILE_PX.min(raster.cols.next_multiple_of(16)))
}

fn write_tiles<W: Write + Seek, K: TiffKind>(
    directory: &mut DirectoryEncoder<W, K>,
    raster: &Raster,
    sample: SampleType,
) -> TiffResult<()> {
    let (tile_rows, tile_cols) = tile_size(raster);
    let across = raster.cols.div_ceil(tile_cols);
    let has_gaps = raster.samples.iter().any(|v| !v.is_finite());
    let compressed: Vec<Vec<u8>> = (0..across * raster.rows.div_ceil(tile_rows))
        .into_par_iter()
        .map(|tile| {
            let (row, col) = (tile / across * tile_rows, tile % across * tile_cols);
            let mut bytes = Vec::with_capacity(tile_rows * tile_cols * sample.bytes());
            for r in row..row + tile_rows {
                encode_row(raster, r, col..col + tile_cols, sample, has_gaps, &mut bytes);
            }
            let mut packed = Vec::new();
            Deflate::default().write_to(&mut packed, &bytes).map(|_| packed)
        })
        .collect::<std::io::Result<_>>()?;
    let mut offsets = Vec::with_capacity(compressed.len());
    for tile in &compressed {
        offsets.push(directory.write_data(tile.as_slice())?);
    }
    let lengths: Vec<u32> = compressed.iter().map(|tile| tile.len() as u32).collect();
    directory.write_tag(Tag::TileByteCounts, lengths.as_slice())?;
    match offsets.iter().map(|&offset| u32::try_from(offset)).collect::<std::result::Result<Vec<u32>, _>>() {
        Ok(offsets) => directory.write_tag(Tag::TileOffsets, offsets.as_slice()),
        Err(_) => directory.write_tag(Tag::TileOffsets, offsets.as_slice()),
    }
}

/// Appends one row of one tile, prediction applied. Beyond the raster its last row and column repeat: that compresses best.
fn encode_row(
    raster: &Raster,
    row: usize,
    cols: std::ops::Range<usize>,
    sample: SampleType,
    has_gaps: bool,
    out: &mut Vec<u8>,
) {
    let line = &raster.samples[row.min(raster.rows - 1) * raster.cols..][..raster.cols];
    let values = cols.clone().map(|col| line[col.min(raster.cols - 1)]);
    let lowest = if has_gaps { 1.0 } else { 0.0 };
    let whole = |v: f32, highest: f32| if v.is_finite() { v.round().clamp(lowest, highest) } else { 0.0 };
    match sample {
        SampleType::F32 => {
            // Predictor 3: the row's bytes by significance, highest first, then differences of neighbouring bytes.
            let start = out.len();
            let width = cols.len();
            out.resize(start + 4 * width, 0);
            let planes = &mut out[start..];
            for (i, value) in values.enumerate() {
                let value = if value.is_finite() { value } else { NODATA };
                for (plane, byte) in value.to_be_bytes().into_iter().enumerate() {
                    planes[plane * width + i] = byte;
                }
            }
            for i in (1..planes.len()).rev() {
                planes[i] = planes[i].wrapping_sub(planes[i - 1]);
            }
        }
        SampleType::U16 => {
            let mut previous = 0_u16;
            for value in values.map(|v| whole(v, f32::from(u16::MAX)) as u16) {
                out.extend(value.wrapping_sub(previous).to_ne_bytes());
                previous = value;
            }
        }
        SampleType::U8 => {
            let mut previous = 0_u8;
            for value in values.map(|v| whole(v, f32::from(u8::MAX)) as u8) {
                out.push(value.wrapping_sub(previous));
                previous = value;
            }
        }
    }
}

fn write_georef<W: Write + Seek, K: TiffKind>(
    directory: &mut DirectoryEncoder<W, K>,
    georef: &GeoRef,
) -> TiffResult<()> {
    let mut t = georef.transform;
    if georef.crs.pixel_is_point() {
        t[0] += 0.5 * (t[1] + t[2]);
        t[3] += 0.5 * (t[4] + t[5]);
    }
    if t[1] > 0.0 && t[5] < 0.0 && t[2] == 0.0 && t[4] == 0.0 {
        directory.write_tag(Tag::ModelPixelScaleTag, [t[1], -t[5], 0.0].as_slice())?;
        directory.write_tag(Tag::ModelTiepointTag, [0.0, 0.0, 0.0, t[0], t[3], 0.0].as_slice())?;
    } else {
        let matrix = [t[1], t[2], 0.0, t[0], t[4], t[5], 0.0, t[3], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        directory.write_tag(Tag::ModelTransformationTag, matrix.as_slice())?;
    }
    let crs = &georef.crs;
    if !crs.is_empty() {
        directory.write_tag(Tag::GeoKeyDirectoryTag, crs.directory.as_slice())?;
        if !crs.doubles.is_empty() {
            directory.write_tag(Tag::GeoDoubleParamsTag, crs.doubles.as_slice())?;
        }
        if !crs.ascii.is_empty() {
            directory.write_tag(Tag::GeoAsciiParamsTag, crs.ascii.as_str())?;
        }
    }
    Ok(())
}

fn items(options: &WriteOptions) -> Vec<Item> {
    let free = |(name, text): &(String, String)| Item { name: name.clone(), role: String::new(), text: text.clone() };
    let band =
        |name: &str, role: &str, text: &String| Item { name: name.into(), role: role.into(), text: text.clone() };
    let mut items: Vec<Item> = options.items.iter().map(free).collect();
    items.extend(options.unit.iter().map(|unit| band("UNITTYPE", "unittype", unit)));
    items.extend(options.description.iter().map(|text| band("DESCRIPTION", "description", text)));
    items
}

/// Encodes without a file, so that BigTIFF can be tried on a small raster.
#[cfg(test)]
pub(super) fn encode_for_test(raster: &Raster, big: bool) -> Vec<u8> {
    let options = WriteOptions::heights("test");
    let bytes =
        if big { encode::<TiffKindBig>(raster, &options) } else { encode::<TiffKindStandard>(raster, &options) };
    bytes.expect("memory takes everything")
}
