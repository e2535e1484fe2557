//! The life sign of an owner: it touches its lock as long as it lives, so that other machines see when it has ended.

use super::step::{Step, before};
use crate::{Error, HAS_THREADS, Result};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// Time between two life signs.
const RENEWED_EVERY: Duration = Duration::from_secs(10);
/// Age of the last life sign at which an owner of another machine counts as ended: six are missing.
pub(super) const ABANDONED_AFTER: Duration = Duration::from_secs(60);

/// Renews a lock until it is dropped.
#[derive(Debug)]
pub(super) struct Renewal {
    lost: Arc<AtomicBool>,
    /// Its end wakes the thread.
    _stop: Sender<()>,
}

impl Renewal {
    /// Begins to touch `file`, the lock at `lock`.
    ///
    /// # Errors
    /// [`Error::Io`] if the system refuses a thread.
    pub(super) fn begin(lock: &Path, file: &File) -> Result<Self> {
        let refused =
            |_| Error::io(lock)(std::io::Error::new(std::io::ErrorKind::OutOfMemory, "no thread for the lock"));
        let lost = Arc::new(AtomicBool::new(false));
        let (_stop, ended) = channel::<()>();
        #[cfg(all(test, unix))]
        if super::simulated::is_active() {
            return Ok(Self { lost, _stop });
        }
        if !HAS_THREADS {
            return Ok(Self { lost, _stop });
        }
        let (path, file) = (lock.to_path_buf(), file.try_clone().map_err(Error::io(lock))?);
        let renew = {
            let lost = lost.clone();
            move || {
                while ended.recv_timeout(RENEWED_EVERY) == Err(RecvTimeoutError::Timeout) {
                    if !is_at(&file, &path) {
                        lost.store(true, Ordering::SeqCst);
                        return;
                    }
                    // A life sign that fails is missed once; the next one follows.
                    let _ = touch(&file);
                }
            }
        };
        // It waits, and needs next to no stack.
        std::thread::Builder::new().name("lock".into()).stack_size(64 << 10).spawn(renew).map_err(refused)?;
        Ok(Self { lost, _stop })
    }

    /// Returns whether the lock was seen to be another's.
    pub(super) fn is_lost(&self) -> bool {
        self.lost.load(Ordering::SeqCst)
    }
}

/// Sets the time of the last change to now, by the clock of the file system's server.
fn touch(file: &File) -> std::io::Result<()> {
    #[cfg(unix)]
    {
        use rustix::fs::{Timespec, Timestamps, UTIME_NOW, UTIME_OMIT, futimens};
        let [now, kept] = [UTIME_NOW, UTIME_OMIT].map(|tv_nsec| Timespec { tv_sec: 0, tv_nsec });
        Ok(futimens(file, &Timestamps { last_access: kept, last_modification: now })?)
    }
    #[cfg(not(unix))]
    file.set_modified(std::time::SystemTime::now())
}

/// The only process that may replace an abandoned lock: who creates this file.
#[derive(Debug)]
pub(super) struct Succession {
    path: PathBuf,
}

impl Succession {
    /// Claims the succession of the record `text` of `lock`. `None` if another claims it, or has just done so.
    ///
    /// A claimant that was killed leaves its file. Once that is old, the next claimant uses the next number.
    pub(super) fn claim(lock: &Path, text: &str, now: std::time::SystemTime) -> Result<Option<Self>> {
        const MOST: u32 = 100;
        let id = text
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
        for number in 0..MOST {
            let path = PathBuf::from(format!("{}.{id:016x}.{number}", lock.display()));
            before(Step::Create, &path).map_err(Error::io(&path))?;
            match File::create_new(&path) {
                Ok(_) => return Ok(Some(Self { path })),
                Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {
                    let changed = std::fs::symlink_metadata(&path).and_then(|found| found.modified());
                    if !changed.is_ok_and(|changed| is_old(changed, now)) {
                        return Ok(None);
                    }
                }
                Err(error) => return Err(Error::io(&path)(error)),
            }
        }
        Ok(None)
    }
}

impl Drop for Succession {
    fn drop(&mut self) {
        // An error leaves a file that grows old.
        let _ = before(Step::EndSuccession, &self.path).and_then(|()| std::fs::remove_file(&self.path));
    }
}

/// Returns whether a file that changed at `changed` is abandoned at `now`, by the same clock.
pub(super) fn is_old(changed: std::time::SystemTime, now: std::time::SystemTime) -> bool {
    now.duration_since(changed).is_ok_and(|age| age > ABANDONED_AFTER)
}

/// Returns whether `path` names this file.
pub(super) fn is_at(file: &File, path: &Path) -> bool {
    let (Ok(ours), Ok(there)) = (file.metadata(), std::fs::symlink_metadata(path)) else { return false };
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        (ours.dev(), ours.ino()) == (there.dev(), there.ino())
    }
    #[cfg(not(unix))]
    {
        ours.created().ok() == there.created().ok()
    }
}
