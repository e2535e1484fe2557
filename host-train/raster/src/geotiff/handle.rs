//! An open TIFF with its name, so that every error names the file.

use super::lengths::amended;
use super::overlaid::Overlaid;
use crate::bytes::Bytes;
use elunar_base::{Error, Result};
use std::io::{ErrorKind, Seek as _};
use std::path::{Path, PathBuf};
use tiff::TiffError;
use tiff::decoder::Decoder;
use tiff::tags::{Tag, Type, ValueBuffer};

/// Greatest number of images in one file. A longer chain may be a loop.
const MOST_IMAGES: usize = 256;

/// A TIFF, positioned at its first image.
pub(super) struct Handle {
    pub(super) path: PathBuf,
    pub(super) file_bytes: u64,
    pub(super) tiff: Decoder<Overlaid>,
}

impl Handle {
    pub(super) fn open(path: &Path) -> Result<Self> {
        let mut file = Bytes::open(path)?;
        let file_bytes = file.length().map_err(Error::io(path))?;
        let pieces = amended(&mut file, file_bytes).and_then(|pieces| file.rewind().map(|()| pieces));
        let pieces = pieces.map_err(|e| refusal(path, TiffError::IoError(e)))?;
        let tiff = Decoder::new(Overlaid::new(file, pieces)).map_err(|e| refusal(path, e))?;
        Ok(Self { path: path.into(), file_bytes, tiff })
    }

    pub(super) fn broken(&self, what: impl Into<String>) -> Error {
        Error::broken(&self.path, what)
    }

    pub(super) fn unsupported(&self, what: impl Into<String>) -> Error {
        Error::unsupported(&self.path, what)
    }

    /// Converts a decoder's error into ours.
    pub(super) fn check<T>(&self, result: std::result::Result<T, TiffError>) -> Result<T> {
        result.map_err(|e| refusal(&self.path, e))
    }

    pub(super) fn unsigned<T: TryFrom<u64>>(&mut self, tag: Tag) -> Result<Option<T>> {
        let value = self.tiff.find_tag_unsigned(tag);
        self.check(value)
    }

    pub(super) fn unsigned_list<T: TryFrom<u64>>(&mut self, tag: Tag) -> Result<Option<Vec<T>>> {
        let values = self.tiff.find_tag_unsigned_vec(tag);
        self.check(values)
    }

    pub(super) fn doubles(&mut self, tag: Tag) -> Result<Option<Vec<f64>>> {
        let values = self.tiff.find_tag(tag).and_then(|v| v.map(|v| v.into_f64_vec()).transpose());
        self.check(values)
    }

    /// Reads text up to its end in any encoding. Bytes other than ASCII are replaced.
    pub(super) fn text(&mut self, tag: Tag) -> Result<Option<String>> {
        let mut buffer = ValueBuffer::empty(Type::ASCII);
        let found = self.tiff.image_ifd().find_tag_buf(tag, &mut buffer).map(|found| found.is_some());
        if !self.check(found)? {
            return Ok(None);
        }
        let bytes = buffer.as_bytes();
        let text = bytes.split(|&b| b == 0).next().unwrap_or(bytes);
        // One character per byte keeps the positions in GeoKeys valid.
        Ok(Some(text.iter().map(|&b| if b.is_ascii() { char::from(b) } else { '?' }).collect()))
    }

    /// Refuses a file with an internal mask (a further image of subfile type 4), because the mask is not read.
    pub(super) fn refuse_masks(&mut self) -> Result<()> {
        let mut next = self.tiff.ifd_pointer();
        for _ in 0..MOST_IMAGES {
            let Some(at) = next else { return Ok(()) };
            // A broken overview does not matter. Only the first image is read, and it is valid.
            let Ok(directory) = self.tiff.read_directory(at) else { return Ok(()) };
            let mut tags = self.tiff.read_directory_tags(&directory);
            if tags.find_tag_unsigned::<u32>(Tag::NewSubfileType).is_ok_and(|kind| kind.is_some_and(|k| k & 4 != 0)) {
                return Err(self.unsupported(
                    "an internal mask; a nodata value expected (gdalwarp -dstnodata -3.4028226550889045e+38 IN OUT makes one)",
                ));
            }
            next = directory.next();
        }
        Err(self.broken(format!("more than {MOST_IMAGES} images in a chain")))
    }
}

fn refusal(path: &Path, error: TiffError) -> Error {
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
