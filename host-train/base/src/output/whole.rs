//! Files that appear whole or not at all.

use super::step::{Step, before, write};
use super::target::check_target;
use crate::digest::sha256_of;
use crate::{Error, Result, folder_of};
use std::fs::File;
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// The end of the name of a file that is not finished.
pub(super) const UNFINISHED: &str = ".part";

/// A file that is written beside its path under a name of its own, and then renamed. Dropped before that, it vanishes.
#[derive(Debug)]
pub struct Staged {
    path: PathBuf,
    file: NamedTempFile,
}

impl Staged {
    /// Creates the file exclusively, so that no link and no other file is opened. A kill may leave a `.tmp*.part` in the folder.
    ///
    /// # Errors
    /// As [`check_target`]; [`Error::Io`] if the folder cannot be written.
    pub fn create(path: &Path) -> Result<Self> {
        check_target(path)?;
        let mut builder = tempfile::Builder::new();
        builder.suffix(UNFINISHED);
        // Permissions follow the user's umask. A temporary file is private by default.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        before(Step::Create, path).map_err(Error::io(path))?;
        let file = builder.tempfile_in(folder_of(path)).map_err(Error::io(path))?;
        Ok(Self { path: path.into(), file })
    }

    /// Returns the file, to be written.
    pub fn file(&mut self) -> &mut File {
        self.file.as_file_mut()
    }

    /// Returns the SHA-256 of what was written, hexadecimal.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read back.
    pub fn sha256(&mut self) -> Result<String> {
        sha256_of(self.file.as_file_mut()).map_err(Error::io(&self.path))
    }

    /// Waits until the file is on disk, renames it to its path, and waits until the name is on disk, too.
    ///
    /// # Errors
    /// As [`check_target`]; [`Error::Io`] if the disk is full or the file cannot be renamed.
    pub fn publish(self) -> Result<()> {
        let Self { path, file } = self;
        before(Step::Sync, file.path()).and_then(|()| file.as_file().sync_all()).map_err(Error::io(&path))?;
        check_target(&path)?;
        before(Step::Rename, &path).map_err(Error::io(&path))?;
        file.persist(&path).map_err(|e| Error::io(&path)(e.error))?;
        sync_folder(&path).map_err(Error::io(&path))
    }
}

/// Waits until the names in the folder of `path` are on disk: otherwise a power cut may undo a rename. Not all systems can.
pub(super) fn sync_folder(path: &Path) -> std::io::Result<()> {
    use std::io::ErrorKind::{InvalidInput, PermissionDenied, Unsupported};
    before(Step::SyncFolder, path)?;
    if !cfg!(unix) {
        return Ok(());
    }
    match File::open(folder_of(path)).and_then(|folder| folder.sync_all()) {
        Err(error) if matches!(error.kind(), InvalidInput | PermissionDenied | Unsupported) => Ok(()),
        done => done,
    }
}

/// Waits until the name of a finished file is on disk. Who gave it may have been killed before that, and a power cut would undo it.
///
/// # Errors
/// [`Error::Io`] if the folder cannot be brought to disk.
pub fn settle(path: &Path) -> Result<()> {
    sync_folder(path).map_err(Error::io(path))
}

/// Writes `bytes` to `path` whole or not at all. A temporary file beside it is written, synced and renamed.
///
/// # Errors
/// As [`check_target`]; [`Error::Io`] if the folder or file cannot be written.
pub fn atomic_write(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut staged = Staged::create(path)?;
    write(staged.file(), path, bytes).map_err(Error::io(path))?;
    staged.publish()
}
