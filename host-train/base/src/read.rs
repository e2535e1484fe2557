//! Inputs are opened and read here alone: files, and texts of at most so many bytes, whatever the file's size says.

use crate::memory::may_fail;
use crate::output::kind_of;
use crate::{Error, Result};
use std::fs::{File, FileType};
use std::io::{ErrorKind, Read};
use std::path::Path;

/// Most bytes of a list of many items (our choice).
pub const MOST_BYTES: u64 = 1 << 30;
/// Most bytes of a file of weights, or a model (our choice): three times those of the paper's network.
pub const MOST_WEIGHTS_BYTES: u64 = 1 << 32;
/// Most bytes of a file of settings (our choice).
pub const MOST_SETTINGS_BYTES: u64 = 1 << 24;
/// Ends of the names of inputs that are no rasters.
const OTHER_ENDS: [&str; 7] = ["csv", "eld", "json", "jsonl", "safetensors", "toml", "txt"];
/// A text is checked after so many bytes, so that the first piece of what is no text ends the reading.
const PIECE_BYTES: u64 = 1 << 16;
/// The standard library's reader wants some more room than it fills. What it lacks it takes without an error that could be handled.
const PROBE_BYTES: usize = 64;

/// Opens a regular file, also through a link.
///
/// # Errors
/// [`Error::Input`] if something else is there: a folder, a FIFO, a device. [`Error::Io`] if it cannot be opened.
pub fn file(path: &Path) -> Result<File> {
    open(path, |found| found.is_file())
}

/// Opens a text: a regular file, or a pipe as of `<(command)`.
///
/// # Errors
/// As [`file`].
pub fn text_file(path: &Path) -> Result<File> {
    open(path, |found| found.is_file() || is_pipe(found))
}

/// Returns whether a path is the address of a file on the net that can be read by parts: `http://` or `https://`.
#[must_use]
pub fn is_address(path: &Path) -> bool {
    scheme(path).is_some_and(|(scheme, _)| ["http", "https"].iter().any(|known| scheme.eq_ignore_ascii_case(known)))
}

/// Splits an address into scheme and rest.
fn scheme(path: &Path) -> Option<(&str, &str)> {
    path.to_str().and_then(|text| text.split_once("://"))
}

/// Returns the line that fetches a file on the net.
#[must_use]
pub fn fetch_line(path: &Path) -> String {
    format!("this fetches it: curl -L -o {} {}", name_at(path), path.display())
}

/// Returns the name of a file on the net.
fn name_at(path: &Path) -> &str {
    let address = scheme(path).map_or("", |(_, address)| address);
    let name = address.split(['?', '#']).next().and_then(|path| path.rsplit_once('/')).map_or("", |(_, name)| name);
    if name.is_empty() { "OUT.tif" } else { name }
}

/// Refuses the address of a file on the net, with the line that fetches it.
///
/// # Errors
/// [`Error::Input`] if it is one.
pub fn refuse_address(path: &Path) -> Result<()> {
    if !is_address(path) && !scheme(path).is_some_and(|(scheme, _)| scheme.eq_ignore_ascii_case("ftp")) {
        return Ok(());
    }
    let (whole, name) = (path.display(), name_at(path));
    let end = name.rsplit_once('.').map_or("", |(_, end)| end);
    let line = match OTHER_ENDS.iter().any(|other| end.eq_ignore_ascii_case(other)) {
        true => fetch_line(path),
        false => format!("this fetches it: gdal_translate /vsicurl/{whole} {name}"),
    };
    Err(Error::input(format!("{whole}: a file on this machine expected, found an address; {line}")))
}

fn open(path: &Path, is_right: impl FnOnce(FileType) -> bool) -> Result<File> {
    refuse_address(path)?;
    // Looked at before it is opened: a FIFO without a writer would wait for ever, and a device may have no end.
    let found = std::fs::metadata(path).map_err(Error::io(path))?.file_type();
    if !is_right(found) {
        return Err(Error::input(format!("{}: a file expected, found a {}", path.display(), kind_of(found))));
    }
    File::open(path).map_err(Error::io(path))
}

#[cfg(unix)]
fn is_pipe(found: FileType) -> bool {
    std::os::unix::fs::FileTypeExt::is_fifo(&found)
}

#[cfg(not(unix))]
fn is_pipe(_: FileType) -> bool {
    false
}

/// Reads a regular file of at most `most` bytes.
///
/// # Errors
/// [`Error::Unsupported`] if it is longer; otherwise as [`file`].
pub fn bytes(path: &Path, most: u64) -> Result<Vec<u8>> {
    whole(path, file(path)?, most, |_| true)
}

/// Returns whether a regular file begins so. Only so much of it is read.
#[must_use]
pub fn begins_with(path: &Path, head: &str) -> bool {
    let mut found = vec![];
    let read = |file: File| file.take(head.len() as u64).read_to_end(&mut found).is_ok();
    file(path).is_ok_and(read) && found == head.as_bytes()
}

/// Reads a text of at most `most` bytes, from a file or a pipe.
///
/// # Errors
/// [`Error::Unsupported`] if it is longer; [`Error::Io`] if it is not UTF-8, or contains a byte 0; otherwise as [`text_file`].
pub fn text(path: &Path, most: u64) -> Result<String> {
    let mut checked = 0;
    let is_text = |bytes: &[u8]| {
        let new = &bytes[checked..];
        let valid = match std::str::from_utf8(new) {
            Ok(_) => Some(new.len()),
            // The rest of the last character has not been read yet.
            Err(error) if error.error_len().is_none() => Some(error.valid_up_to()),
            Err(_) => None,
        };
        checked += valid.unwrap_or(0);
        valid.is_some() && !new.contains(&0)
    };
    let bytes = whole(path, text_file(path)?, most, is_text)?;
    String::from_utf8(bytes).map_err(|_| no_text(path))
}

/// Opens a text of at most `most` bytes, from a file or a pipe, to be read from front to back.
///
/// # Errors
/// [`Error::Unsupported`] if the file is longer; otherwise as [`text_file`]. Reading behind the last byte that may be is an error, too.
pub fn stream(path: &Path, most: u64) -> Result<impl Read> {
    let file = text_file(path)?;
    check_length(path, &file, most)?;
    Ok(Bounded { file, most, left: most })
}

/// A file that ends with an error behind so many bytes.
struct Bounded {
    file: File,
    most: u64,
    left: u64,
}

impl Read for Bounded {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let found = self.file.read(out)?;
        self.left = self.left.checked_sub(found as u64).ok_or_else(|| {
            std::io::Error::new(ErrorKind::InvalidData, format!("at most {} bytes expected, more found", self.most))
        })?;
        Ok(found)
    }
}

/// Refuses a file that is longer than `most` bytes. Returns its length; that of a pipe is 0.
fn check_length(path: &Path, file: &File, most: u64) -> Result<u64> {
    let length = file.metadata().map_err(Error::io(path))?.len();
    if length > most { Err(too_long(path, most, &length.to_string())) } else { Ok(length) }
}

fn too_long(path: &Path, most: u64, found: &str) -> Error {
    Error::unsupported(path, format!("at most {most} bytes expected, {found} found"))
}

fn no_text(path: &Path) -> Error {
    Error::io(path)(std::io::Error::new(ErrorKind::InvalidData, "text in UTF-8 expected"))
}

/// Reads what is left of `file`, piece by piece, while `is_right` accepts what was read so far. Memory that the system refuses is an error about
/// the file.
fn whole(path: &Path, file: File, most: u64, mut is_right: impl FnMut(&[u8]) -> bool) -> Result<Vec<u8>> {
    let length = check_length(path, &file, most)?;
    let mut bytes = vec![];
    // A pipe says nothing of its length, and a file may grow meanwhile.
    let mut rest = file.take(most + 1);
    let mut room = PIECE_BYTES;
    loop {
        // The rest of a file in one piece of memory, once the first is right.
        may_fail(|| bytes.try_reserve(room as usize + PROBE_BYTES)).map_err(|error| Error::io(path)(error.into()))?;
        if rest.by_ref().take(PIECE_BYTES).read_to_end(&mut bytes).map_err(Error::io(path))? == 0 {
            break;
        }
        if !is_right(&bytes) {
            return Err(no_text(path));
        }
        room = if length == 0 { PIECE_BYTES } else { length.saturating_sub(bytes.len() as u64) };
    }
    if bytes.len() as u64 > most { Err(too_long(path, most, "more")) } else { Ok(bytes) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_no_files() {
        let refused = |address: &str| bytes(Path::new(address), 9).unwrap_err().to_string();
        for (address, line) in [
            ("https://host/a/b.tif?x=1", "gdal_translate /vsicurl/https://host/a/b.tif?x=1 b.tif"),
            ("HTTP://host/", "gdal_translate /vsicurl/HTTP://host/ OUT.tif"),
            ("ftp://host/t.CSV#1", "curl -L -o t.CSV ftp://host/t.CSV#1"),
        ] {
            let what = "a file on this machine expected, found an address; this fetches it";
            assert_eq!(refused(address), format!("{address}: {what}: {line}"));
        }
        assert!(!refused("file://a").contains("address") && !refused("a/http://b").contains("address"));
    }

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
        std::fs::write(&path, [0xFF]).unwrap();
        assert!(text(&path, 4).unwrap_err().to_string().contains("UTF-8"));
    }

    #[test]
    fn a_text_is_checked_while_it_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        // Characters of three bytes lie across the ends of pieces.
        let long = "é€".repeat(60_000);
        std::fs::write(&path, &long).unwrap();
        assert!(text(&path, MOST_BYTES).unwrap() == long);
        // UTF-16, a sparse file of zeros, a character that is cut at the end.
        for content in [&b"\xFF\xFEa\0"[..], b"a\0b\0", b"caf\xC3"] {
            std::fs::write(&path, content).unwrap();
            assert!(text(&path, 9).unwrap_err().to_string().contains("text in UTF-8 expected"), "{content:?}");
        }
        std::fs::write(&path, "").unwrap();
        File::options().write(true).open(&path).unwrap().set_len(1 << 30).unwrap();
        let start = std::time::Instant::now();
        assert!(text(&path, MOST_BYTES).unwrap_err().to_string().contains("text in UTF-8 expected"));
        assert!(start.elapsed().as_secs_f64() < 1.0, "read as a whole");
    }

    #[test]
    #[cfg(unix)]
    fn what_has_no_end_is_no_input() {
        let folder = tempfile::tempdir().unwrap();
        let [link, fifo] = ["zero", "fifo"].map(|name| folder.path().join(name));
        std::os::unix::fs::symlink("/dev/zero", &link).unwrap();
        assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
        for (path, kind) in [(link.as_path(), "device"), (folder.path(), "folder"), (&fifo, "FIFO")] {
            let error = bytes(path, 1 << 16).unwrap_err();
            assert!(matches!(&error, Error::Input(what) if what.ends_with(&format!("found a {kind}"))), "{error}");
        }
        assert!(text(&link, 1 << 16).unwrap_err().to_string().ends_with("a file expected, found a device"));
        // A text may come from a pipe, which is read no further than a file would be.
        let endless = || {
            let path = fifo.clone();
            std::thread::spawn(move || {
                let mut file = File::options().write(true).open(path).unwrap();
                while std::io::Write::write_all(&mut file, b"abc\n").is_ok() {}
            })
        };
        let writer = endless();
        assert!(text(&fifo, 1 << 16).unwrap_err().to_string().ends_with("at most 65536 bytes expected, more found"));
        writer.join().unwrap();
        let writer = endless();
        let error = stream(&fifo, 1 << 16).unwrap().read_to_end(&mut vec![]).unwrap_err().to_string();
        assert_eq!(error, "at most 65536 bytes expected, more found");
        writer.join().unwrap();
        std::fs::write(folder.path().join("a"), [b'a'; 9]).unwrap();
        assert!(stream(&folder.path().join("a"), 8).is_err());
        assert_eq!(stream(&folder.path().join("a"), 9).unwrap().read_to_end(&mut vec![]).unwrap(), 9);
    }
}
