//! Raw samples in a file, row after row or tile after tile, as in images with labels and `.npy` files behind their headers.

use super::nodata::{self, Nodata};
use super::source::{Info, Source, check_window};
use elunar_base::{Error, Result};
use elunar_core::mask::is_real_i16;
use elunar_core::tile::Window;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// Type of a stored sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sample {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    F32,
    F64,
}

impl Sample {
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Returns the range of integers; `None` for floats.
    fn range(self) -> Option<std::ops::RangeInclusive<f64>> {
        let signed = matches!(self, Self::I8 | Self::I16 | Self::I32);
        (!matches!(self, Self::F32 | Self::F64)).then(|| nodata::range_of(signed, 8 * self.bytes() as u32))
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::I8 => "i8",
            Self::U16 => "u16",
            Self::I16 => "i16",
            Self::U32 => "u32",
            Self::I32 => "i32",
            Self::F32 => "f32",
            Self::F64 => "f64",
        }
    }
}

/// Position of the samples in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) sample: Sample,
    pub(super) big_endian: bool,
    pub(super) rows: usize,
    pub(super) cols: usize,
    /// Offset of the first sample, bytes.
    pub(super) start: u64,
    /// Distance from one row's first sample to the next row's, bytes; within a tile, if there are tiles.
    pub(super) row_bytes: u64,
    /// Rows and columns of a tile, at least 1. Tiles follow each other from left to right, then downwards, those at the edges filled up.
    pub(super) tile: Option<(usize, usize)>,
}

impl Layout {
    /// Describes the stored numbers: `f32 little-endian, tiles of 128 x 128`.
    pub(super) fn stored(&self) -> String {
        let order = match (self.sample.bytes(), self.big_endian) {
            (1, _) => "",
            (_, true) => " big-endian",
            (_, false) => " little-endian",
        };
        let tiles = self.tile.map_or_else(String::new, |(rows, cols)| format!(", tiles of {rows} x {cols}"));
        format!("{}{order}{tiles}", self.sample.name())
    }

    /// Returns the offset behind the last sample, or behind the last tile; `None` beyond 2^64.
    pub(super) fn end(&self) -> Option<u64> {
        if let Some((rows, cols)) = self.tile {
            let count = (self.rows.div_ceil(rows) as u64).checked_mul(self.cols.div_ceil(cols) as u64)?;
            return self.start.checked_add(self.row_bytes.checked_mul(rows as u64)?.checked_mul(count)?);
        }
        let last = (self.rows as u64).checked_sub(1)?.checked_mul(self.row_bytes)?;
        let row = (self.cols as u64).checked_mul(self.sample.bytes() as u64)?;
        self.start.checked_add(last)?.checked_add(row)
    }

    /// Returns the offset of a sample, and how many samples of its row follow each other there. The sample lies before [`Layout::end`].
    fn run(&self, row: usize, col: usize) -> (u64, usize) {
        let (rows, cols) = self.tile.unwrap_or((self.rows, self.cols));
        let tile = (row / rows * self.cols.div_ceil(cols) + col / cols) as u64;
        let within = (row % rows) as u64 * self.row_bytes + (col % cols * self.sample.bytes()) as u64;
        (self.start + tile * rows as u64 * self.row_bytes + within, cols - col % cols)
    }
}

/// Meaning of the stored numbers.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Meaning {
    /// Stored numbers that mean "no measurement", in addition to the special pixels of every format.
    missing: Nodata,
    /// Sample = stored * scale + offset.
    pub(super) scale: f64,
    pub(super) offset: f64,
}

impl Meaning {
    /// Makes the meaning of samples that are stored as `sample`. Those that equal one of `missing` mean "no measurement".
    pub(super) fn new(sample: Sample, missing: impl IntoIterator<Item = f64>, scale: f64, offset: f64) -> Self {
        let missing = match sample.range() {
            Some(range) => Nodata::of_integers(missing, &range),
            None => Nodata::of_floats(missing, 8 * sample.bytes() as u32),
        };
        Self { missing, scale, offset }
    }

    fn apply(&self, stored: f64) -> f32 {
        if self.missing.has_integer(stored) { f32::NAN } else { self.finish(stored) }
    }

    pub(super) fn apply_float(&self, stored: f64) -> f32 {
        if self.missing.has_float(stored) { f32::NAN } else { self.finish(stored) }
    }

    fn finish(&self, stored: f64) -> f32 {
        nodata::sample(stored * self.scale + self.offset)
    }
}

/// A file of raw samples, open for reading.
#[derive(Debug)]
pub(super) struct Binary {
    path: PathBuf,
    file: Mutex<File>,
    layout: Layout,
    meaning: Meaning,
    info: Info,
}

impl Binary {
    /// Makes a reader of a file that is long enough for `layout`.
    pub(super) fn new(path: PathBuf, file: File, layout: Layout, meaning: Meaning, info: Info) -> Self {
        Self { path, file: Mutex::new(file), layout, meaning, info }
    }

    fn convert(&self, bytes: &[u8], out: &mut Vec<f32>) {
        let meaning = &self.meaning;
        /// Reads every group of bytes as one number.
        macro_rules! each {
            ($kind:ty, $convert:expr) => {{
                let groups = bytes.as_chunks::<{ size_of::<$kind>() }>().0.iter();
                if self.layout.big_endian {
                    out.extend(groups.map(|&b| $convert(<$kind>::from_be_bytes(b))));
                } else {
                    out.extend(groups.map(|&b| $convert(<$kind>::from_le_bytes(b))));
                }
            }};
        }
        match self.layout.sample {
            Sample::U8 => each!(u8, |v| meaning.apply(f64::from(v))),
            Sample::I8 => each!(i8, |v| meaning.apply(f64::from(v))),
            Sample::U16 => each!(u16, |v| meaning.apply(f64::from(v))),
            Sample::I16 => each!(i16, |v| if is_real_i16(v) { meaning.apply(f64::from(v)) } else { f32::NAN }),
            Sample::U32 => each!(u32, |v| meaning.apply(f64::from(v))),
            Sample::I32 => each!(i32, |v| meaning.apply(f64::from(v))),
            Sample::F32 => each!(f32, |v| meaning.apply_float(f64::from(v))),
            Sample::F64 => each!(f64, |v| meaning.apply_float(v)),
        }
    }
}

impl Source for Binary {
    fn info(&self) -> &Info {
        &self.info
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        let Layout { rows, cols, sample, .. } = self.layout;
        check_window(window, rows, cols)?;
        let mut out = Vec::with_capacity(window.rows * window.cols);
        if window.rows == 0 || window.cols == 0 {
            return Ok(out);
        }
        let mut line = vec![0; window.cols.min(self.layout.tile.map_or(cols, |tile| tile.1)) * sample.bytes()];
        // A reader that panicked leaves no bad state, because every read seeks first.
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        for row in window.row..window.row + window.rows {
            let (mut col, end) = (window.col, window.col + window.cols);
            while col < end {
                let (at, count) = self.layout.run(row, col);
                let count = count.min(end - col);
                let run = &mut line[..count * sample.bytes()];
                file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(run)).map_err(Error::io(&self.path))?;
                self.convert(run, &mut out);
                col += count;
            }
        }
        Ok(out)
    }
}
