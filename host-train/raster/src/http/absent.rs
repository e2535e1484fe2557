//! Without the feature `http` there are no files on the net.

use elunar_base::{Error, Result, read};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// A file on the net: there is none.
pub(crate) enum Remote {}

impl Remote {
    pub(crate) fn length(&self) -> u64 {
        match *self {}
    }

    pub(crate) fn identity(&self) -> String {
        match *self {}
    }

    pub(crate) fn read_at(&self, _: u64, _: &mut [u8]) -> std::io::Result<usize> {
        match *self {}
    }

    pub(crate) fn want(&self, _: &mut dyn Iterator<Item = Range<u64>>) -> std::io::Result<()> {
        match *self {}
    }
}

/// Refuses an address, with the line that fetches the file.
///
/// # Errors
/// As [`read::refuse_address`].
pub(crate) fn open(path: &Path) -> Result<Arc<Remote>> {
    read::refuse_address(path)?;
    Err(Error::unsupported(path, "an address expected"))
}
