//! Reading, whole or in windows.

use super::super::source::{Info, Source, check_window};
use super::super::{Raster, source};
use super::cache::Cache;
use super::handle::Handle;
use super::layout::Layout;
use super::metadata;
use super::place::georef;
use super::plain;
use super::rule::Rule;
use super::tag;
use elunar_base::memory::may_fail;
use elunar_base::{Error, Result};
use elunar_core::tile::Window;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use tiff::decoder::DecodingResult;

/// Size of the cache of decoded samples, bytes: one row of 512-pixel tiles of a raster 32,000 columns wide.
const CACHE_BYTES: usize = 64 << 20;

/// Opens a GeoTIFF for reading in windows: one band. Lengths become metres.
///
/// Samples become NaN if they equal the NoData tag (42113), are 1e30 or more from zero or not finite, or are special pixels of PDS3 and ISIS:
/// at or below -32764 in signed 16-bit files. Scale and offset of the metadata tag (42112) are applied. An
/// offset equal to the radius of the file's own sphere is left out: planetary products state radii that way, and heights of this program
/// are above the sphere. `f64` and 32-bit integers are rounded to `f32`. For files with `AREA_OR_POINT=Point` the transform is moved by
/// half a pixel, so that it always refers to pixel corners.
///
/// At most 64 MiB of decoded samples are cached in addition to the result. Within that size, windows that share strips or tiles are fast in
/// any order. A strip or tile of a file that is not plain has at most 2^24 pixels, so that decoding one takes at most 192 MiB more. The file
/// stays open.
///
/// # Errors
/// [`Error::Io`] if the file cannot be opened, [`Error::Broken`] if it is truncated or contradicts itself,
/// [`Error::Unsupported`] for larger strips and tiles, several bands, palettes, inverted grey, internal masks, ground control points and codecs unknown here.
pub fn open(path: &Path) -> Result<Box<dyn Source>> {
    open_with(path, None)
}

/// Opens a GeoTIFF as [`open`] does. Samples stored as `nodata` are invalid, too.
pub(crate) fn open_with(path: &Path, nodata: Option<f64>) -> Result<Box<dyn Source>> {
    Ok(Box::new(GeoTiff::open(path, CACHE_BYTES, nodata)?))
}

/// Reads all samples of a GeoTIFF, as [`open`] returns them.
///
/// # Errors
/// As [`open`]. [`Error::Input`] if the memory does not suffice.
pub fn read(path: impl AsRef<Path>) -> Result<Raster> {
    // Each chunk is read once, so no cache is needed.
    source::read_all(&GeoTiff::open(path.as_ref(), 0, None)?)
}

/// Opens a band, counted from 0, as [`open`] does. Several bands must be stored one after the other (planar), as [`Writer`] does. Scale and
/// offset are those of the first band.
///
/// [`Writer`]: super::Writer
///
/// # Errors
/// As [`open`]. [`Error::Unsupported`] if the file has no such band.
pub fn open_band(path: &Path, band: usize) -> Result<Box<dyn Source>> {
    Ok(Box::new(GeoTiff::open_band(path, Some(band), CACHE_BYTES, None)?))
}

/// Returns the text of a metadata item of a GeoTIFF; `None` if the file does not have it.
///
/// # Errors
/// As [`open`].
pub fn read_item(path: &Path, name: &str) -> Result<Option<String>> {
    let xml = Handle::open(path)?.text(tag::GDAL_METADATA)?.unwrap_or_default();
    Ok(metadata::parse(&xml).into_iter().find(|item| item.role.is_empty() && item.name == name).map(|item| item.text))
}

/// An open file.
pub(super) struct GeoTiff {
    path: PathBuf,
    info: Info,
    layout: Layout,
    rule: Rule,
    state: Mutex<State>,
}

/// State that only one reader at a time may use.
struct State {
    file: Handle,
    cache: Cache,
}

impl GeoTiff {
    pub(super) fn open(path: &Path, cache_bytes: usize, nodata: Option<f64>) -> Result<Self> {
        Self::open_band(path, None, cache_bytes, nodata)
    }

    fn open_band(path: &Path, band: Option<usize>, cache_bytes: usize, nodata: Option<f64>) -> Result<Self> {
        let (layout, mut file) = Layout::of(Handle::open(path)?, band)?;
        let georef = georef(&mut file)?;
        let rule = Rule::of(&mut file, layout.kind, georef.as_ref(), nodata)?;
        file.refuse_masks()?;
        let format = layout.format.clone();
        let (rows, cols, unit, unit_in_file) = (layout.rows, layout.cols, rule.unit.clone(), rule.unit_in_file.clone());
        let applied = rule.applied();
        let info = Info { rows, cols, georef, unit, unit_in_file, applied, format, sun: rule.sun, warnings: vec![] };
        let state = Mutex::new(State { file, cache: Cache::new(cache_bytes) });
        Ok(Self { path: path.into(), info, layout, rule, state })
    }

    /// Returns the samples of one chunk, rows of [`Layout::chunk_cols`], from the cache or the file.
    fn chunk(&self, chunk: usize) -> Result<Arc<Vec<f32>>> {
        // A reader that panicked leaves the decoder between two chunks at worst. Each chunk starts anew.
        let mut state = self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(samples) = state.cache.get(chunk) {
            return Ok(samples);
        }
        state.cache.make_room(self.layout.chunk_rows * self.layout.chunk_cols);
        let samples = Arc::new(self.decode(&mut state.file, chunk)?);
        state.cache.insert(chunk, &samples);
        Ok(samples)
    }

    /// Says which chunks will be read next. A file on the net fetches them together.
    fn want(&self, chunks: Range<usize>) -> Result<()> {
        let mut state = self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let State { file, cache } = &mut *state;
        let is_new = |chunk: &usize| cache.get(*chunk).is_none() && self.layout.unwritten.binary_search(chunk).is_err();
        let mut extents = chunks.filter(is_new).map(|chunk| self.layout.extent(chunk));
        file.tiff.inner().bytes().want(&mut extents).map_err(Error::io(&self.path))
    }

    fn decode(&self, file: &mut Handle, chunk: usize) -> Result<Vec<f32>> {
        let (layout, (.., rows, _)) = (&self.layout, self.layout.place(chunk));
        if let Some(start) = layout.plain {
            let row_bytes = layout.cols * layout.sample_bytes;
            let at = start + (chunk * layout.chunk_rows * row_bytes) as u64;
            let data = plain::read(file, layout.kind, at, rows * layout.cols)?;
            return data.and_then(|data| self.rule.samples(&data)).ok_or_else(|| file.unsupported(&layout.format));
        }
        let mut data = DecodingResult::U8(vec![]);
        // Whole rows of the tile, with padding. If the decoder drops the padding, it loses its position in LZW tiles.
        let decoded = file.tiff.read_chunk_to_buffer(
            &mut data,
            (layout.chunks_before + chunk) as u32,
            layout.chunk_cols * layout.sample_bytes,
        );
        let part = |what: String| file.broken(format!("part {} of {}: {what}", chunk + 1, layout.chunks));
        file.check(decoded).map_err(|error| match error {
            Error::Broken { what, .. } => part(what),
            other => other,
        })?;
        let samples = self.rule.samples(&data).ok_or_else(|| part("64-bit integers".into()))?;
        if samples.len() < rows * layout.chunk_cols {
            return Err(part(format!("{} samples expected, {} found", rows * layout.chunk_cols, samples.len())));
        }
        Ok(samples)
    }
}

impl Source for GeoTiff {
    fn info(&self) -> &Info {
        &self.info
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        let layout = &self.layout;
        check_window(window, layout.rows, layout.cols)?;
        let mut samples = Vec::new();
        may_fail(|| samples.try_reserve_exact(window.rows * window.cols)).map_err(|_| {
            let (rows, cols) = (window.rows, window.cols);
            let what = format!("not enough memory for {rows} x {cols} pixels");
            Error::io(&self.path)(std::io::Error::new(std::io::ErrorKind::OutOfMemory, what))
        })?;
        samples.resize(window.rows * window.cols, self.rule.unwritten());
        if samples.is_empty() {
            return Ok(samples);
        }
        let chunk_rows = window.row / layout.chunk_rows..=(window.row + window.rows - 1) / layout.chunk_rows;
        let last_across = (window.col + window.cols - 1) / layout.chunk_cols;
        for down in chunk_rows {
            for across in window.col / layout.chunk_cols..=last_across {
                let chunk = down * layout.across + across;
                self.want(chunk..down * layout.across + last_across + 1)?;
                if layout.unwritten.binary_search(&chunk).is_err() {
                    copy(&self.chunk(chunk)?, layout.place(chunk), layout.chunk_cols, window, &mut samples);
                }
            }
        }
        Ok(samples)
    }
}

/// Copies the part of `window` that a chunk at (row, column, rows, columns) has.
fn copy(
    chunk: &[f32],
    (row0, col0, rows, cols): (usize, usize, usize, usize),
    stride: usize,
    window: Window,
    out: &mut [f32],
) {
    let (first_col, end_col) = (col0.max(window.col), (col0 + cols).min(window.col + window.cols));
    for row in row0.max(window.row)..(row0 + rows).min(window.row + window.rows) {
        let from = &chunk[(row - row0) * stride..][first_col - col0..end_col - col0];
        let to = (row - window.row) * window.cols + first_col - window.col;
        out[to..to + from.len()].copy_from_slice(from);
    }
}
