//! SHA-256 as text. It identifies files and jobs, so that work is recognised on another machine, whatever the path and the time of a file.

use crate::{Error, Result, read};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;

/// Returns the SHA-256 of bytes or of a text as 64 hexadecimal digits.
#[must_use]
pub fn sha256_hex(bytes: impl AsRef<[u8]>) -> String {
    hex(&Sha256::digest(bytes))
}

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

/// Returns two hexadecimal digits per byte.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
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
        assert_eq!((sha256(&path).unwrap().as_str(), sha256_hex("abc").as_str()), (known, known));
        assert!(matches!(sha256(&folder.path().join("b")), Err(Error::Io { .. })));
    }
}
