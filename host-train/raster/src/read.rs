//! Files that are read whole: at most so many bytes of them, whatever the file's size says.

use crate::{Error, Result};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Most bytes of a file of weights, a model, or a list of many items (our choice).
pub const MOST_BYTES: u64 = 1 << 30;
/// Most bytes of a file of settings (our choice).
pub const MOST_SETTINGS_BYTES: u64 = 1 << 24;

/// Reads a file of at most `most` bytes.
///
/// # Errors
/// [`Error::Unsupported`] if it is longer, [`Error::Io`] if it cannot be read.
pub fn bytes(path: &Path, most: u64) -> Result<Vec<u8>> {
    let too_long = |found: String| Error::unsupported(path, format!("at most {most} bytes expected, {found} found"));
    let file = File::open(path).map_err(Error::io(path))?;
    let length = file.metadata().map_err(Error::io(path))?.len();
    if length > most {
        return Err(too_long(length.to_string()));
    }
    let mut bytes = Vec::with_capacity(length as usize);
    // A device or a pipe says nothing of its length.
    file.take(most + 1).read_to_end(&mut bytes).map_err(Error::io(path))?;
    if bytes.len() as u64 > most { Err(too_long("more".into())) } else { Ok(bytes) }
}

/// Reads a file of text of at most `most` bytes.
///
/// # Errors
/// As [`bytes`]; [`Error::Io`] if it is not UTF-8.
pub fn text(path: &Path, most: u64) -> Result<String> {
    let not_text = |_| Error::io(path)(std::io::Error::new(std::io::ErrorKind::InvalidData, "text in UTF-8 expected"));
    String::from_utf8(bytes(path, most)?).map_err(not_text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_too_long_is_refused_before_it_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, "four").unwrap();
        assert_eq!((bytes(&path, 4).unwrap(), text(&path, 4).unwrap()), (b"four".to_vec(), "four".into()));
        let error = bytes(&path, 3).unwrap_err().to_string();
        assert!(error.ends_with("at most 3 bytes expected, 4 found"), "{error}");
        // A sparse file of a terabyte.
        File::options().write(true).open(&path).unwrap().set_len(1 << 40).unwrap();
        assert!(matches!(bytes(&path, MOST_BYTES), Err(Error::Unsupported { .. })));
        #[cfg(unix)]
        assert!(bytes(Path::new("/dev/zero"), 1 << 16).unwrap_err().to_string().ends_with("more found"));
        std::fs::write(&path, [0xFF]).unwrap();
        assert!(text(&path, 4).unwrap_err().to_string().contains("UTF-8"));
    }
}
