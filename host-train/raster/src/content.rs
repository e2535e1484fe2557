//! Hashes of files' contents, so that work is recognised on another machine, whatever the path and the time of a file.

use crate::format::Format;
use crate::{Error, Result, mask, pds3, read};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};

/// Returns the SHA-256 of a file, hexadecimal.
///
/// # Errors
/// As [`read::file`]; [`Error::Io`] if it cannot be read.
pub fn sha256(path: &Path) -> Result<String> {
    sha256_while(path, &|| true)
}

/// Returns the SHA-256 of a file as [`sha256`] does, while `goes_on` says yes. It is asked after every megabyte.
///
/// # Errors
/// [`Error::Stopped`] once it says no; otherwise as [`sha256`].
pub fn sha256_while(path: &Path, goes_on: &dyn Fn() -> bool) -> Result<String> {
    let found = hash_while(&mut read::file(path)?, goes_on).map_err(Error::io(path))?;
    found.ok_or_else(|| Error::stopped(format!("stopped while {} was read for its SHA-256", path.display())))
}

/// Returns the SHA-256 of an open file from its beginning, hexadecimal.
pub(crate) fn sha256_of(file: &mut File) -> std::io::Result<String> {
    hash_while(file, &|| true).map(Option::unwrap_or_default)
}

/// Returns the SHA-256 of an open file as [`sha256_of`] does; `None` once `goes_on` says no.
fn hash_while(file: &mut File, goes_on: &dyn Fn() -> bool) -> std::io::Result<Option<String>> {
    let (mut hash, mut buffer) = (Sha256::new(), vec![0; 1 << 20]);
    file.rewind()?;
    while goes_on() {
        match file.read(&mut buffer)? {
            0 => return Ok(Some(hex(&hash.finalize()))),
            read => hash.update(&buffer[..read]),
        }
    }
    Ok(None)
}

/// Returns the SHA-256 of a text, hexadecimal.
#[must_use]
pub fn sha256_of_text(text: &str) -> String {
    hex(&Sha256::digest(text))
}

/// Returns the SHA-256 of a raster's files, hexadecimal. A PDS3 product of a label and an image has two, joined by `+`, as the user names
/// the one or the other. A mask has one more.
///
/// # Errors
/// [`Error::Io`] if a file cannot be read; as [`crate::source::open`] if it is no raster.
pub fn sha256_of_raster(path: &Path) -> Result<String> {
    sha256_of_raster_while(path, &|| true)
}

/// Returns the SHA-256 of a raster's files as [`sha256_of_raster`] does, while `goes_on` says yes.
///
/// # Errors
/// As [`sha256_while`] and [`sha256_of_raster`].
pub fn sha256_of_raster_while(path: &Path, goes_on: &dyn Fn() -> bool) -> Result<String> {
    let hashes: Vec<String> =
        files_of_raster(path)?.iter().map(|file| sha256_while(file, goes_on)).collect::<Result<_>>()?;
    Ok(hashes.join("+"))
}

/// Returns the files of a raster: one, or a PDS3 label and the image that it describes; and the mask beside it.
///
/// # Errors
/// [`Error::Io`] if a file cannot be read; as [`crate::source::open`] if it is no raster.
pub fn files_of_raster(path: &Path) -> Result<Vec<PathBuf>> {
    let label = match Format::of(path)? {
        Format::Pds3 => Some(path.to_path_buf()),
        Format::Unknown(_) => pds3::label_beside(path)?,
        _ => None,
    };
    let mut files = match label {
        Some(label) => vec![pds3::image_of(&label)?, label],
        None => vec![path.into()],
    };
    files.reverse();
    files.dedup();
    files.extend(mask::beside(path));
    Ok(files)
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hash_is_that_of_the_standard() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, "abc").unwrap();
        let known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!((sha256(&path).unwrap().as_str(), sha256_of_text("abc").as_str()), (known, known));
        assert!(matches!(sha256(&folder.path().join("b")), Err(Error::Io { .. })));
    }

    #[test]
    fn a_label_counts_with_its_image() {
        let folder = tempfile::tempdir().unwrap();
        let [label, image] = ["A.LBL", "A.IMG"].map(|name| folder.path().join(name));
        let text = "PDS_VERSION_ID = PDS3\r\n^IMAGE = \"A.IMG\"\r\nOBJECT = IMAGE\r\nLINES = 2\r\nLINE_SAMPLES = 2\r\n\
            SAMPLE_TYPE = UNSIGNED_INTEGER\r\nSAMPLE_BITS = 8\r\nEND_OBJECT = IMAGE\r\nEND\r\n";
        std::fs::write(&label, text).unwrap();
        std::fs::write(&image, [1, 2, 3, 4]).unwrap();
        let first = sha256_of_raster(&label).unwrap();
        assert_eq!(first, format!("{}+{}", sha256(&label).unwrap(), sha256(&image).unwrap()));
        assert_eq!(sha256_of_raster(&image).unwrap(), first);
        std::fs::write(&image, [1, 2, 3, 5]).unwrap();
        assert_ne!(sha256_of_raster(&label).unwrap(), first);
    }
}
