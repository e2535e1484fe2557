//! Steps: in front of each change of files a test may stop, fail or kill a process.

use std::fs::File;
use std::io::{Result, Write};
use std::path::Path;

/// What is about to be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    /// A file or folder is created.
    Create,
    /// Its bytes are written, or its length is set.
    Write,
    /// They are brought to disk.
    Sync,
    /// A file gets the name of another one, which it replaces.
    Rename,
    /// A file gets a name that no other one may have.
    Take,
    /// A lock is opened and judged.
    Judge,
    /// A file is removed.
    Remove,
    /// The right to succeed is given back.
    EndSuccession,
    /// The names of a folder are brought to disk.
    SyncFolder,
}

/// Asks the test that the thread is in.
#[cfg(all(test, unix))]
pub(super) fn before(step: Step, path: &Path) -> Result<()> {
    ASKED.get().map_or(Ok(()), |asked| asked(step, path))
}

/// Writes bytes in pieces, with a step in front of each.
#[cfg(all(test, unix))]
pub(super) fn write(file: &mut File, path: &Path, bytes: &[u8]) -> Result<()> {
    const PIECES: usize = 3;
    for piece in bytes.chunks(bytes.len().div_ceil(PIECES).max(1)) {
        before(Step::Write, path)?;
        file.write_all(piece)?;
    }
    Ok(())
}

/// What says whether a step may be done.
#[cfg(all(test, unix))]
pub(super) type Asked = fn(Step, &Path) -> Result<()>;

#[cfg(all(test, unix))]
thread_local! {
    pub(super) static ASKED: std::cell::Cell<Option<Asked>> = const { std::cell::Cell::new(None) };
}

/// Does nothing outside tests.
#[cfg(not(all(test, unix)))]
#[inline]
pub(super) fn before(_: Step, _: &Path) -> Result<()> {
    Ok(())
}

/// Writes bytes.
#[cfg(not(all(test, unix)))]
#[inline]
pub(super) fn write(file: &mut File, _: &Path, bytes: &[u8]) -> Result<()> {
    file.write_all(bytes)
}
