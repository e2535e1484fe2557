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

/// Asks the test that the thread is in.
#[cfg(all(test, unix))]
pub(super) fn before(step: Step, path: &std::path::Path) -> std::io::Result<()> {
    ASKED.get().map_or(Ok(()), |asked| asked(step, path))
}

/// What says whether a step may be done.
#[cfg(all(test, unix))]
pub(super) type Asked = fn(Step, &std::path::Path) -> std::io::Result<()>;

#[cfg(all(test, unix))]
thread_local! {
    pub(super) static ASKED: std::cell::Cell<Option<Asked>> = const { std::cell::Cell::new(None) };
}

/// Does nothing outside tests.
#[cfg(not(all(test, unix)))]
#[inline]
pub(super) fn before(_: Step, _: &std::path::Path) -> std::io::Result<()> {
    Ok(())
}
