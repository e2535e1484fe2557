//! Pieces of files, and their places in a VRT.

use super::super::mask::masked;
use super::super::nodata::Nodata;
use super::super::pam::told;
use super::{Format, Source, open_with, source};
use elunar_base::{Result, read};
use elunar_core::tile::Window;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Most files of a VRT that are open at once (our choice); a process may have 1024.
const MOST_OPEN: usize = 32;

/// A rectangle of a file, and where it lies.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    /// Number of the file.
    pub(super) file: usize,
    /// The rectangle in the file.
    pub(super) from: Window,
    /// Row and column of its first pixel in the VRT, which may lie outside.
    pub(super) to: (i64, i64),
    /// `NODATA`: where the file has this number or a void, what lies below is seen.
    pub(super) clear: Option<f64>,
}

/// The part of a piece in a window.
pub(super) struct Part {
    /// The rectangle in the file.
    pub(super) from: Window,
    /// Row and column of its first pixel in the window.
    pub(super) row: usize,
    pub(super) col: usize,
}

impl Piece {
    /// Returns the piece with its `NODATA` as the file's samples have it.
    pub(super) fn converted(&self, sample: impl Fn(f64) -> f64) -> Self {
        Self { clear: self.clear.map(sample), ..self.clone() }
    }

    /// Returns the part of the piece in a window of the VRT; `None` if there is none.
    pub(super) fn within(&self, window: Window) -> Option<Part> {
        let (row, rows, skipped_rows) = overlap(self.to.0, self.from.rows, window.row, window.rows)?;
        let (col, cols, skipped_cols) = overlap(self.to.1, self.from.cols, window.col, window.cols)?;
        let from = Window { row: self.from.row + skipped_rows, col: self.from.col + skipped_cols, rows, cols };
        Some(Part { from, row, col })
    }

    /// Returns whether what lies below a sample is seen.
    pub(super) fn lets_through(&self, sample: f32) -> bool {
        self.clear.is_some_and(|clear| Nodata::of_floats([clear], 32).has_float(f64::from(sample)))
    }
}

/// Returns where a run of `count` from `to` on begins in a window, how much of it lies there, and how much of the run lies before it.
fn overlap(to: i64, count: usize, start: usize, length: usize) -> Option<(usize, usize, usize)> {
    let (start, length) = (i64::try_from(start).ok()?, i64::try_from(length).ok()?);
    let end = to.saturating_add(i64::try_from(count).ok()?).min(start.saturating_add(length));
    let first = to.max(start);
    let size = |n: i64| usize::try_from(n).ok();
    (end > first).then(|| Some((size(first - start)?, size(end - first)?, size(first - to)?)))?
}

/// Files of a VRT. The latest few are open.
pub(super) struct Opened {
    paths: Vec<PathBuf>,
    nested: usize,
    open: Mutex<VecDeque<(usize, Arc<dyn Source>)>>,
}

impl Opened {
    pub(super) fn new(paths: Vec<PathBuf>, nested: usize) -> Self {
        Self { paths, nested, open: Mutex::default() }
    }

    /// Returns a file, opened anew if it is not among the latest.
    pub(super) fn get(&self, file: usize) -> Result<Arc<dyn Source>> {
        // A list that lacks a file is no bad state.
        let open = || self.open.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, source)) = open().iter().find(|(number, _)| *number == file) {
            return Ok(Arc::clone(source));
        }
        let source: Arc<dyn Source> = Arc::from(open_file(&self.paths[file], self.nested)?);
        let mut list = open();
        list.truncate(MOST_OPEN - 1);
        list.push_front((file, Arc::clone(&source)));
        Ok(source)
    }
}

/// Opens a file of a VRT with its mask.
pub(super) fn open_file(path: &Path, nested: usize) -> Result<Box<dyn Source>> {
    // A VRT's identity is that of its files' bytes.
    read::refuse_address(path)?;
    match Format::of(path)? {
        Format::Vrt => Ok(told(path, masked(path, open_with(path, None, nested + 1)?)?)),
        _ => source::open(path),
    }
}
