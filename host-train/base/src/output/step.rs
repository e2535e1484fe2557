//! Steps: in front of each change of files a test may stop, fail or kill a process.

/// What is about to be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    /// A file or folder is created.
    Create,
    /// Its bytes are written.
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

/// Does nothing outside tests.
#[cfg(not(all(test, unix)))]
#[inline]
pub(super) fn before(_: Step, _: &std::path::Path) -> std::io::Result<()> {
    Ok(())
}

#[cfg(all(test, unix))]
pub(super) use super::simulated::before;
