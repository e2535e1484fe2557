//! What an output may replace.

use crate::{Error, Result};
use std::fs::{FileType, Metadata};
use std::path::Path;

/// Checks that nothing lies at `path`, or a regular file. Links are not followed.
///
/// # Errors
/// [`Error::Usage`] if something else lies there: a folder, a device, a FIFO, a link; [`Error::Io`] if that cannot be found out.
pub fn check_target(path: &Path) -> Result<()> {
    match std::fs::symlink_metadata(path) {
        Ok(found) => check_regular(path, &found),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(Error::io(path)(error)),
    }
}

/// Refuses what is not a regular file.
pub(super) fn check_regular(path: &Path, found: &Metadata) -> Result<()> {
    if found.is_file() {
        return Ok(());
    }
    let kind = kind_of(found.file_type());
    Err(Error::usage(format!("{}: a regular file or nothing expected, a {kind} found", path.display())))
}

/// Names what is no regular file.
pub(crate) fn kind_of(found: FileType) -> &'static str {
    if found.is_dir() {
        return "folder";
    }
    if found.is_symlink() {
        return "link";
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if found.is_fifo() {
            return "FIFO";
        }
        if found.is_socket() {
            return "socket";
        }
        if found.is_char_device() || found.is_block_device() {
            return "device";
        }
    }
    "special file"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_regular_file_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.tif");
        check_target(&file).unwrap();
        std::fs::write(&file, "old").unwrap();
        check_target(&file).unwrap();
        let refused = |path: &Path| check_target(path).unwrap_err().to_string();
        assert!(refused(folder.path()).ends_with("a regular file or nothing expected, a folder found"));
        #[cfg(unix)]
        {
            let link = folder.path().join("link.tif");
            std::os::unix::fs::symlink(&file, &link).unwrap();
            assert!(refused(&link).ends_with("link.tif: a regular file or nothing expected, a link found"));
            std::fs::remove_file(&file).unwrap();
            assert!(refused(&link).ends_with("a link found"), "a link to nothing is a link");
            assert!(
                refused(Path::new("/dev/null"))
                    .ends_with("/dev/null: a regular file or nothing expected, a device found")
            );
            let socket = folder.path().join("socket");
            let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
            assert!(refused(&socket).ends_with("a socket found"));
        }
    }
}
