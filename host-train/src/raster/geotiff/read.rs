//! Reading.

use super::super::{Crs, GeoRef, GeoTransform, Raster};
use super::{LOWEST_VALID, metadata, tag};
use crate::{Error, Result};
use elunar_core::mask::is_real_i16;
use std::fs::File;
use std::io::{BufReader, ErrorKind};
use std::path::Path;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

/// Deflate and LZW cannot shrink data more than about 1000 and 2700 times: a file that claims more is damaged or hostile.
const MOST_COMPRESSION: u64 = 4096;

type Tiff = Decoder<BufReader<File>>;

/// Reads the first image of a GeoTIFF: one band, in the unit of the file, except that kilometres become metres.
///
/// Samples become NaN where they equal the nodata tag (42113), are not finite, or are special pixels of PDS3 and ISIS: at or below
/// -3.4e38 in float files, at or below -32764 in signed 16-bit ones.
/// Scale and offset of the metadata tag (42112) are applied, except an offset equal to the radius of the file's own sphere: planetary
/// products state radii that way, and heights of this program are above the sphere. `f64` and 32-bit integers are rounded to `f32`.
/// For files with `AREA_OR_POINT=Point` the transform is moved by half a pixel, so that it always speaks of pixel corners.
///
/// # Errors
/// [`Error::Io`] if the file cannot be opened, [`Error::Broken`] if it is truncated or contradicts itself,
/// [`Error::Unsupported`] for several bands, palettes, inverted grey, internal masks, ground control points and codecs unknown here.
pub fn read(path: impl AsRef<Path>) -> Result<Raster> {
    let path = path.as_ref();
    let file = File::open(path).map_err(Error::io(path))?;
    let file_bytes = file.metadata().map_err(Error::io(path))?.len();
    let mut tiff = Decoder::new(BufReader::new(file)).map_err(|e| refuse(path, e))?;
    let (cols, rows) = tiff.dimensions().map_err(|e| refuse(path, e))?;
    check_layout(path, &mut tiff)?;
    let tiff = limited(path, tiff, (rows, cols), file_bytes)?;
    read_limited(path, tiff, rows as usize, cols as usize)
}

fn read_limited(path: &Path, mut tiff: Tiff, rows: usize, cols: usize) -> Result<Raster> {
    let georef = georef(path, &mut tiff)?;
    let rule = Rule::of(path, &mut tiff, georef.as_ref())?;
    let samples = samples(path, &mut tiff, rows, cols, &rule)?;
    refuse_masks(path, &mut tiff)?;
    Ok(Raster { rows, cols, samples, georef })
}

/// Refuses everything that is not one band of plain grey samples.
fn check_layout(path: &Path, tiff: &mut Tiff) -> Result<()> {
    let bands: u16 = find_unsigned(path, tiff, Tag::SamplesPerPixel)?.unwrap_or(1);
    if bands != 1 {
        return Err(Error::unsupported(path, format!("{bands} bands found, one expected")));
    }
    match tiff.colortype().map_err(|e| refuse(path, e))? {
        ColorType::Gray(8 | 16 | 32 | 64) | ColorType::Multiband { bit_depth: 8 | 16 | 32 | 64, .. } => {}
        other => {
            return Err(Error::unsupported(path, format!("{other:?} samples, grey of 8, 16, 32 or 64 bits expected")));
        }
    }
    match find_unsigned::<u16>(path, tiff, Tag::PhotometricInterpretation)? {
        Some(0) => Err(Error::unsupported(path, "grey counted downwards (white is zero), black is zero expected")),
        _ => Ok(()),
    }
}

/// Refuses sizes the file cannot hold, then lets the decoder use as much memory as the claimed size needs.
fn limited(path: &Path, mut tiff: Tiff, (rows, cols): (u32, u32), file_bytes: u64) -> Result<Tiff> {
    let bits: u64 = find_unsigned(path, &mut tiff, Tag::BitsPerSample)?.unwrap_or(8);
    let (chunk_cols, chunk_rows) = tiff.chunk_dimensions();
    // A tile may be larger than the image, a strip's stated rows may exceed it without meaning.
    let tile = if matches!(tiff.get_chunk_type(), tiff::decoder::ChunkType::Tile) {
        u64::from(chunk_cols) * u64::from(chunk_rows)
    } else {
        0
    };
    let claimed = (u64::from(rows) * u64::from(cols)).max(tile).saturating_mul(bits / 8);
    if claimed / MOST_COMPRESSION > file_bytes {
        let what =
            format!("claims {rows} x {cols} pixels ({claimed} bytes), which a file of {file_bytes} bytes cannot hold");
        return Err(Error::broken(path, what));
    }
    let mut limits = Limits::default();
    limits.decoding_buffer_size = limits.decoding_buffer_size.max(usize::try_from(claimed).unwrap_or(usize::MAX));
    limits.intermediate_buffer_size =
        limits.intermediate_buffer_size.max(usize::try_from(file_bytes).unwrap_or(usize::MAX));
    limits.ifd_value_size = limits.ifd_value_size.max(usize::try_from(file_bytes.min(1 << 26)).unwrap_or(usize::MAX));
    Ok(tiff.with_limits(limits))
}

fn samples(path: &Path, tiff: &mut Tiff, rows: usize, cols: usize, rule: &Rule) -> Result<Vec<f32>> {
    let mut samples = Vec::new();
    let refuse_memory = |_| Error::usage(format!("{}: not enough memory for {rows} x {cols} pixels", path.display()));
    samples.try_reserve_exact(rows * cols).map_err(refuse_memory)?;
    samples.resize(rows * cols, f32::NAN);
    let (chunk_cols, chunk_rows) = tiff.chunk_dimensions();
    let (chunk_cols, chunk_rows) = (chunk_cols as usize, (chunk_rows as usize).min(rows));
    let across = cols.div_ceil(chunk_cols);
    let chunks = across * rows.div_ceil(chunk_rows);
    let sample_bytes = find_unsigned::<usize>(path, tiff, Tag::BitsPerSample)?.unwrap_or(8) / 8;
    let mut data = DecodingResult::U8(vec![]);
    for chunk in 0..chunks {
        // Whole rows of the tile, padding included: asked to drop the padding, the decoder loses its place in LZW tiles.
        tiff.read_chunk_to_buffer(&mut data, chunk as u32, chunk_cols * sample_bytes).map_err(|e| {
            match refuse(path, e) {
                Error::Broken { path, what } => {
                    Error::Broken { path, what: format!("part {} of {chunks}: {what}", chunk + 1) }
                }
                other => other,
            }
        })?;
        let (row, col) = (chunk / across * chunk_rows, chunk % across * chunk_cols);
        let (height, width) = (chunk_rows.min(rows - row), chunk_cols.min(cols - col));
        let mut window = Window { samples: &mut samples[row * cols + col..], cols, height, width, stride: chunk_cols };
        let fits = match &data {
            DecodingResult::U8(v) => window.fill(v, |v| rule.whole(f64::from(v))),
            DecodingResult::I8(v) => window.fill(v, |v| rule.whole(f64::from(v))),
            DecodingResult::U16(v) => window.fill(v, |v| rule.whole(f64::from(v))),
            DecodingResult::I16(v) => {
                window.fill(v, |v| if is_real_i16(v) { rule.whole(f64::from(v)) } else { f32::NAN })
            }
            DecodingResult::U32(v) => window.fill(v, |v| rule.whole(f64::from(v))),
            DecodingResult::I32(v) => window.fill(v, |v| rule.whole(f64::from(v))),
            DecodingResult::F16(v) => window.fill(v, |v| rule.float(v.to_f64(), rule.nodata)),
            DecodingResult::F32(v) => window.fill(v, |v| rule.float(f64::from(v), rule.nodata_f32)),
            DecodingResult::F64(v) => window.fill(v, |v| rule.float(v, rule.nodata)),
            DecodingResult::U64(_) | DecodingResult::I64(_) => {
                return Err(Error::unsupported(path, "64-bit integers; integers up to 32 bits and floats are read"));
            }
        };
        if !fits {
            return Err(Error::broken(
                path,
                format!("part {} of {chunks} holds fewer than {width} x {height} samples", chunk + 1),
            ));
        }
    }
    Ok(samples)
}

/// Where one strip or tile goes.
struct Window<'a> {
    samples: &'a mut [f32],
    cols: usize,
    height: usize,
    width: usize,
    /// Samples from one row of the chunk to the next.
    stride: usize,
}

impl Window<'_> {
    /// False if there are too few values.
    fn fill<T: Copy>(&mut self, values: &[T], convert: impl Fn(T) -> f32) -> bool {
        if values.len() < self.stride * self.height {
            return false;
        }
        for (row, values) in values.chunks_exact(self.stride).take(self.height).enumerate() {
            let target = &mut self.samples[row * self.cols..][..self.width];
            target.iter_mut().zip(values).for_each(|(to, &from)| *to = convert(from));
        }
        true
    }
}

/// How a stored number becomes a sample.
struct Rule {
    nodata: Option<f64>,
    /// As `f32` files hold it: the text may carry more digits.
    nodata_f32: Option<f64>,
    scale: f64,
    offset: f64,
}

impl Rule {
    fn of(path: &Path, tiff: &mut Tiff, georef: Option<&GeoRef>) -> Result<Self> {
        let number = |name: &str, text: &str| -> Result<f64> {
            let parsed = text.trim().parse::<f64>();
            parsed.map_err(|_| Error::broken(path, format!("{name} is {text:?}, a number expected")))
        };
        let nodata = match find_text(path, tiff, Tag::GdalNodata)? {
            Some(text) if !text.trim().is_empty() => Some(number("nodata tag 42113", &text)?),
            _ => None,
        };
        let (mut scale, mut offset, mut unit) = (1.0, 0.0, String::new());
        for item in metadata::parse(&find_text(path, tiff, tag::GDAL_METADATA)?.unwrap_or_default()) {
            match item.role.as_str() {
                "scale" => scale = number("band scale", &item.text)?,
                "offset" => offset = number("band offset", &item.text)?,
                "unittype" => unit = item.text.trim().to_lowercase(),
                _ => {}
            }
        }
        let mut to_metres = if matches!(unit.as_str(), "km" | "kilometre" | "kilometer" | "kilometres" | "kilometers") {
            1000.0
        } else {
            1.0
        };
        if let Some(radius_m) = georef.and_then(|g| g.crs.sphere_radius_m()) {
            let is_radius = |value: f64| (value - radius_m).abs() <= 1e-6 * radius_m;
            // A radius in kilometres says the unit even where the unit is not stated.
            if is_radius(offset * 1000.0) {
                (offset, to_metres) = (0.0, 1000.0);
            } else if is_radius(offset) {
                offset = 0.0;
            }
        }
        let (scale, offset) = (scale * to_metres, offset * to_metres);
        Ok(Self { nodata, nodata_f32: nodata.map(|v| f64::from(v as f32)), scale, offset })
    }

    fn whole(&self, value: f64) -> f32 {
        if self.nodata == Some(value) { f32::NAN } else { self.finish(value) }
    }

    fn float(&self, value: f64, nodata: Option<f64>) -> f32 {
        let valid = value.is_finite() && value > LOWEST_VALID && nodata != Some(value);
        if valid { self.finish(value) } else { f32::NAN }
    }

    fn finish(&self, value: f64) -> f32 {
        let sample = (value * self.scale + self.offset) as f32;
        if sample.is_finite() { sample } else { f32::NAN }
    }
}

fn georef(path: &Path, tiff: &mut Tiff) -> Result<Option<GeoRef>> {
    let directory = find(path, tiff, Tag::GeoKeyDirectoryTag)?.map(|v| v.into_u16_vec());
    let doubles = find(path, tiff, Tag::GeoDoubleParamsTag)?.map(|v| v.into_f64_vec());
    let crs = Crs {
        directory: directory.transpose().map_err(|e| refuse(path, e))?.unwrap_or_default(),
        doubles: doubles.transpose().map_err(|e| refuse(path, e))?.unwrap_or_default(),
        ascii: find_text(path, tiff, Tag::GeoAsciiParamsTag)?.unwrap_or_default(),
    };
    if let Some(defect) = crs.defect() {
        return Err(Error::broken(path, defect));
    }
    let Some(mut t) = transform(path, tiff)? else { return Ok(None) };
    if !t.iter().all(|v| v.is_finite()) || t[1] * t[5] == t[2] * t[4] {
        return Err(Error::broken(path, format!("transform {t:?} has no inverse")));
    }
    if crs.pixel_is_point() {
        t[0] -= 0.5 * (t[1] + t[2]);
        t[3] -= 0.5 * (t[4] + t[5]);
    }
    Ok(Some(GeoRef { transform: t, crs }))
}

fn transform(path: &Path, tiff: &mut Tiff) -> Result<Option<GeoTransform>> {
    let scale = find_doubles(path, tiff, Tag::ModelPixelScaleTag)?;
    let ties = find_doubles(path, tiff, Tag::ModelTiepointTag)?;
    if let (Some(scale), Some(ties)) = (&scale, &ties) {
        let (&[sx, sy, ..], &[col, row, _, x, y, _]) = (scale.as_slice(), ties.as_slice()) else {
            let what = format!("{} pixel scales and {} tie point numbers, 3 and 6 expected", scale.len(), ties.len());
            return Err(Error::unsupported(path, what));
        };
        let sy = sy.abs();
        return Ok(Some([x - col * sx, sx, 0.0, y + row * sy, 0.0, -sy]));
    }
    if let Some(m) = find_doubles(path, tiff, Tag::ModelTransformationTag)? {
        let &[a, b, _, x, c, d, _, y, ..] = m.as_slice() else {
            return Err(Error::broken(path, format!("transformation tag 34264 of {} numbers, 16 expected", m.len())));
        };
        return Ok(Some([x, a, b, y, c, d]));
    }
    match ties {
        Some(ties) => {
            Err(Error::unsupported(path, format!("{} ground control points, a transform expected", ties.len() / 6)))
        }
        None => Ok(None),
    }
}

/// An internal mask (a further image of subfile type 4) says which pixels are real; it is not read, so it is refused.
fn refuse_masks(path: &Path, tiff: &mut Tiff) -> Result<()> {
    while tiff.more_images() && tiff.next_image().is_ok() {
        if find_unsigned::<u32>(path, tiff, Tag::NewSubfileType)?.is_some_and(|kind| kind & 4 != 0) {
            return Err(Error::unsupported(path, "an internal mask; a nodata value expected"));
        }
    }
    Ok(())
}

fn find(path: &Path, tiff: &mut Tiff, tag: Tag) -> Result<Option<tiff::decoder::ifd::Value>> {
    tiff.find_tag(tag).map_err(|e| refuse(path, e))
}

fn find_doubles(path: &Path, tiff: &mut Tiff, tag: Tag) -> Result<Option<Vec<f64>>> {
    find(path, tiff, tag)?.map(|v| v.into_f64_vec().map_err(|e| refuse(path, e))).transpose()
}

fn find_unsigned<T: TryFrom<u64>>(path: &Path, tiff: &mut Tiff, tag: Tag) -> Result<Option<T>> {
    tiff.find_tag_unsigned(tag).map_err(|e| refuse(path, e))
}

/// Text up to its end, whatever encoding the writer used: other bytes than ASCII are replaced.
fn find_text(path: &Path, tiff: &mut Tiff, tag: Tag) -> Result<Option<String>> {
    let mut ifd = tiff.image_ifd();
    let mut buffer = tiff::tags::ValueBuffer::empty(tiff::tags::Type::ASCII);
    if ifd.find_tag_buf(tag, &mut buffer).map_err(|e| refuse(path, e))?.is_none() {
        return Ok(None);
    }
    let bytes = buffer.as_bytes();
    let text = bytes.split(|&b| b == 0).next().unwrap_or(bytes);
    // One character per byte keeps the positions that GeoKeys state.
    Ok(Some(text.iter().map(|&b| if b.is_ascii() { char::from(b) } else { '?' }).collect()))
}

/// Sorts a decoder's refusal into ours.
fn refuse(path: &Path, error: TiffError) -> Error {
    match error {
        TiffError::IoError(e) if e.kind() == ErrorKind::UnexpectedEof => Error::broken(path, "the file ends too early"),
        TiffError::IoError(e)
            if matches!(e.kind(), ErrorKind::InvalidData | ErrorKind::InvalidInput | ErrorKind::Other) =>
        {
            Error::broken(path, e.to_string())
        }
        TiffError::IoError(source) => Error::Io { path: path.into(), source },
        TiffError::UnsupportedError(e) => Error::unsupported(path, e.to_string()),
        other => Error::broken(path, other.to_string()),
    }
}
