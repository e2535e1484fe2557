//! The bytes of a file, here or on the net.

use crate::http::{self, Remote};
use elunar_base::{Error, Result, read};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// An open file.
pub(crate) enum Bytes {
    /// A file of this machine.
    File(File),
    /// A file on the net, and the position in it.
    Remote(Arc<Remote>, u64),
}

impl Bytes {
    /// Opens a file.
    ///
    /// # Errors
    /// As [`read::file`]; of an address, as [`http::open`].
    pub(crate) fn open(path: &Path) -> Result<Self> {
        if read::is_address(path) { Ok(Self::Remote(http::open(path)?, 0)) } else { read::file(path).map(Self::File) }
    }

    /// Returns the number of bytes.
    pub(crate) fn length(&self) -> std::io::Result<u64> {
        match self {
            Self::File(file) => Ok(file.metadata()?.len()),
            Self::Remote(remote, _) => Ok(remote.length()),
        }
    }

    /// Returns whether the file is on the net.
    pub(crate) fn is_remote(&self) -> bool {
        matches!(self, Self::Remote(..))
    }

    /// Says what will be read next. It changes no result.
    pub(crate) fn want(&self, ranges: &mut dyn Iterator<Item = Range<u64>>) -> std::io::Result<()> {
        match self {
            Self::File(_) => Ok(()),
            Self::Remote(remote, _) => remote.want(ranges),
        }
    }
}

impl Read for Bytes {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        match self {
            Self::File(file) => file.read(out),
            Self::Remote(remote, at) => {
                let read = remote.read_at(*at, out)?;
                *at += read as u64;
                Ok(read)
            }
        }
    }
}

impl Seek for Bytes {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        match self {
            Self::File(file) => file.seek(to),
            Self::Remote(remote, at) => {
                *at = match to {
                    SeekFrom::Start(to) => to,
                    SeekFrom::Current(by) => at.saturating_add_signed(by),
                    SeekFrom::End(by) => remote.length().saturating_add_signed(by),
                };
                Ok(*at)
            }
        }
    }
}

/// Returns what stands for the content of a file on the net, if the path is an address.
///
/// # Errors
/// As [`http::open`].
pub(crate) fn identity(path: &Path) -> Result<Option<String>> {
    if read::is_address(path) { Ok(Some(http::open(path)?.identity())) } else { Ok(None) }
}

/// Returns a reader that keeps the version of a file on the net as long as it lives; `None` for a file of this machine.
///
/// # Errors
/// As [`http::open`].
pub(crate) fn held(path: &Path) -> Result<Option<Arc<Remote>>> {
    if read::is_address(path) { http::open(path).map(Some) } else { Ok(None) }
}

/// Refuses a file on the net that is no GeoTIFF.
pub(crate) fn no_geotiff(path: &Path, found: &str) -> Error {
    Error::unsupported(path, format!("on the net a GeoTIFF expected, found {found}; {}", read::fetch_line(path)))
}
