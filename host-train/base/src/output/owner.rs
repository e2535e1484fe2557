//! One owner per output. A lock beside the output, a file that is created exclusively, names the process that writes it.
//!
//! The file is the claim; the kernel's lock on it says whether a claim of this machine that is found can be judged. Of a claim from another
//! machine nothing is known but its life signs: its owner touches the file ([`super::renewal`]). A claim without them for a minute is taken
//! over. An owner that was only halted finds that its lock is another's ([`Owner::check`]), and stops.

use super::growing::without_following;
use super::listing::Listing;
use super::record::{OutputRecord, start_of};
use super::renewal::{Renewal, Succession, is_at, is_old};
use super::step::{Step, before, write};
use super::target::check_target;
use super::whole::UNFINISHED;
use crate::{Error, Result, folder_of};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Suffix of the lock beside an output.
const SUFFIX: &str = ".lock";
/// The lock in an output folder.
const IN_FOLDER: &str = "owner.lock";
/// Number of times that a lock may vanish or change under our eyes.
const TRIES: usize = 100;

/// The right to write an output, until it is dropped.
#[derive(Debug)]
#[must_use = "the output is owned until this is dropped"]
pub struct Owner {
    lock: PathBuf,
    file: File,
    /// A folder that this made, removed again if nothing came into it.
    made: Option<PathBuf>,
    renewal: Renewal,
    is_successor: bool,
    /// Of a folder, what is ours in it.
    listing: Option<Listing>,
}

/// A lock that was taken, and whether from an owner on another machine that may still live.
type Taken = (File, bool);

impl Owner {
    /// Takes a file that will be written: `dtm.tif.lock` is the lock of `dtm.tif`. Whether the file may be replaced is checked, too.
    ///
    /// # Errors
    /// [`Error::Busy`] if another process owns it; [`Error::Usage`] if there is no such folder; as [`check_target`]; [`Error::Io`] if the folder
    /// cannot be written.
    pub fn of_file(output: &Path) -> Result<Self> {
        check_target(output)?;
        if !folder_of(output).is_dir() {
            let folder = folder_of(output).display();
            return Err(Error::usage(format!("{}: the folder {folder} expected, none found", output.display())));
        }
        let mut name = output.file_name().unwrap_or_default().to_os_string();
        name.push(SUFFIX);
        Self::take(output, output.with_file_name(name))
    }

    /// Creates a folder if it is absent, and takes it for a run of `command` that writes files of these `names`: relative, with `/`; one that ends
    /// with `/` is a folder that is the command's with all that is in it. At none lies anything but what an earlier run of the command has listed.
    /// If the folder's owner was killed, removes the files that it was writing under names of their own.
    ///
    /// # Errors
    /// As [`Self::of_file`]; [`Error::Usage`] if something lies there that is another's.
    pub fn of_folder(folder: &Path, command: &str, names: impl IntoIterator<Item = String>) -> Result<Self> {
        let made = (!folder.exists()).then(|| folder.to_path_buf());
        std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
        let lock = folder.join(IN_FOLDER);
        let succeeds = lock.exists();
        let mut owner = Self::take(folder, lock)?;
        owner.made = made;
        if succeeds {
            remove_unfinished(folder);
        }
        owner.listing = Some(Listing::open(folder, command)?);
        owner.claim(names)?;
        Ok(owner)
    }

    /// Adds names to those of [`Self::of_folder`], before the first of these files is written.
    ///
    /// # Errors
    /// [`Error::Usage`] if something lies there that is another's; [`Error::Io`] if the list cannot be written.
    pub fn claim(&mut self, names: impl IntoIterator<Item = String>) -> Result<()> {
        self.listing.as_mut().map_or(Ok(()), |listing| listing.claim(names))
    }

    /// Removes a file of the folder, or, if its name ends with `/`, a folder in it, if it is listed.
    ///
    /// # Errors
    /// [`Error::Usage`] if something in that folder is another's; [`Error::Io`] if something cannot be removed.
    pub fn remove(&self, name: &str) -> Result<()> {
        self.listing.as_ref().map_or(Ok(()), |listing| listing.remove(name))
    }

    fn take(output: &Path, lock: PathBuf) -> Result<Self> {
        let here = OutputRecord::here();
        remove_dead_claims(folder_of(&lock), &here);
        let own = |lock: PathBuf, (file, is_successor): Taken| {
            let renewal = Renewal::begin(&lock, &file).inspect_err(|_| drop(std::fs::remove_file(&lock)))?;
            Ok(Self { lock, file, made: None, renewal, is_successor, listing: None })
        };
        for _ in 0..TRIES {
            let claim = claim(&lock, &here).map_err(Error::io(output))?;
            before(Step::Take, &lock).map_err(Error::io(output))?;
            match claim.persist_noclobber(&lock) {
                Ok(file) => return own(lock, (file, false)),
                Err(found) if found.error.kind() == ErrorKind::AlreadyExists => {
                    if let Some(taken) = succeed(output, &lock, &here, found.file)? {
                        return own(lock, taken);
                    }
                }
                Err(failed) => return Err(Error::io(output)(failed.error)),
            }
        }
        Err(Error::busy(output, "its owners change too fast; try again"))
    }

    /// Checks that the output is still ours. It is not if this run was halted for more than a minute and another machine took it over, or if
    /// somebody removed the lock.
    ///
    /// # Errors
    /// [`Error::Busy`] if it is not.
    pub fn check(&self) -> Result<()> {
        if !self.renewal.is_lost() && is_at(&self.file, &self.lock) {
            return Ok(());
        }
        let why = "its lock is gone or another's: this run was halted for long, or somebody removed the lock";
        Err(Error::busy(&self.lock, why))
    }

    /// Returns whether this took the place of an owner on another machine. If that was only halted, it may still write once to files that it
    /// has open: such files must not be gone on with, only copies of them.
    #[must_use]
    pub fn is_successor(&self) -> bool {
        self.is_successor
    }
}

impl Drop for Owner {
    fn drop(&mut self) {
        // What lies there now may be another's only if somebody removed ours by hand.
        if is_at(&self.file, &self.lock) {
            self.listing.iter_mut().for_each(Listing::close);
            // An error leaves a lock that the next run recognises as left behind.
            let _ = before(Step::Remove, &self.lock).and_then(|()| std::fs::remove_file(&self.lock));
        }
        if let Some(folder) = &self.made {
            // Fails if something is in it, as it should.
            let _ = before(Step::Remove, folder).and_then(|()| std::fs::remove_dir(folder));
        }
    }
}

/// Removes the files of a folder that [`super::Staged`] makes and a killed owner leaves.
fn remove_unfinished(folder: &Path) {
    for path in nameless(folder, UNFINISHED) {
        // What cannot be removed does no harm.
        let _ = before(Step::Remove, &path).and_then(|()| std::fs::remove_file(path));
    }
}

/// Removes claims whose processes were killed before they could make them locks. One without a word in it is judged by its age.
fn remove_dead_claims(folder: &Path, here: &OutputRecord) {
    let empty_and_old = |found: std::fs::Metadata| {
        found.len() == 0 && found.modified().is_ok_and(|changed| is_old(changed, std::time::SystemTime::now()))
    };
    for path in nameless(folder, SUFFIX) {
        if std::fs::symlink_metadata(&path).is_ok_and(empty_and_old) {
            let _ = before(Step::Remove, &path).and_then(|()| std::fs::remove_file(path));
            continue;
        }
        let read = |path| text(&mut without_following(OpenOptions::new().read(true)).open(path).ok()?, path).ok();
        // Without its kernel's lock, nothing is known of a claim from another name space.
        let known = |record: &OutputRecord| record.namespace == here.namespace || record.boot != here.boot;
        let record = read(&path).and_then(|text| OutputRecord::parse(&text)).filter(known);
        if record.is_some_and(|record| record.has_ended(here, start_of)) {
            let _ = before(Step::Remove, &path).and_then(|()| std::fs::remove_file(path));
        }
    }
}

/// Returns the regular files of a folder that have a name for the time being, with this end.
fn nameless(folder: &Path, end: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let ours = |name: &str| name.starts_with(".tmp") && name.ends_with(end);
    let found = entries.filter(|entry| {
        entry.file_name().to_str().is_some_and(ours) && entry.file_type().is_ok_and(|kind| kind.is_file())
    });
    found.map(|entry| entry.path()).collect()
}

/// Writes the record into a nameless claim, under the kernel's lock. Only whole records get the lock's name.
fn claim(lock: &Path, here: &OutputRecord) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    // Others must be able to read who it is.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    before(Step::Create, lock)?;
    let mut claim = builder.suffix(SUFFIX).tempfile_in(folder_of(lock))?;
    write(claim.as_file_mut(), lock, here.text().as_bytes())?;
    before(Step::Sync, claim.path())?;
    claim.as_file().sync_all()?;
    // Where there are no locks, the file alone is the claim.
    let _ = try_lock(claim.as_file());
    Ok(claim)
}

/// Takes the kernel's lock on a file, if it is free and there is one.
fn try_lock(file: &File) -> std::result::Result<(), TryLockError> {
    #[cfg(all(test, unix))]
    if super::simulated::has_no_flock() {
        return Err(TryLockError::Error(ErrorKind::Unsupported.into()));
    }
    file.try_lock()
}

/// Takes the place of an owner that has ended. `None` if the lock has just vanished or changed.
fn succeed(output: &Path, lock: &Path, here: &OutputRecord, claim: NamedTempFile) -> Result<Option<Taken>> {
    before(Step::Judge, lock).map_err(Error::io(lock))?;
    check_target(lock)?;
    let mut options = OpenOptions::new();
    let mut file = match without_following(options.read(true)).open(lock) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        opened => opened.map_err(Error::io(lock))?,
    };
    let is_locking = match try_lock(&file) {
        Ok(()) => true,
        Err(TryLockError::WouldBlock) => return Err(busy(output, lock, &text(&mut file, lock)?, false)),
        Err(TryLockError::Error(_)) => false,
    };
    let text = text(&mut file, lock)?;
    // A lock that we hold cannot be succeeded by others, if it still is the one at its place.
    if !is_at(&file, lock) {
        return Ok(None);
    }
    // A power cut may leave an empty file.
    if !text.is_empty() {
        let Some(found) = OutputRecord::parse(&text) else {
            let what = "the record of an owner expected, other text found; remove the file if nothing uses it";
            return Err(Error::usage(format!("{}: {what}", lock.display())));
        };
        if !is_locking || !found.has_ended(here, start_of) {
            if !found.is_renewed || !found.is_elsewhere(here) {
                return Err(busy(output, lock, &text, true));
            }
            return inherit(output, lock, (&file, &text), claim);
        }
    } else if !is_locking {
        return Err(busy(output, lock, &text, true));
    }
    before(Step::Rename, lock).map_err(Error::io(output))?;
    claim.persist(lock).map(|file| Some((file, false))).map_err(|e| Error::io(output)(e.error))
}

/// Takes the place of an owner on another machine that has given no life sign for long.
fn inherit(output: &Path, lock: &Path, (file, text): (&File, &str), claim: NamedTempFile) -> Result<Option<Taken>> {
    // Both times are the file system's. The claim was written just now.
    let changed = |file: &File| file.metadata().and_then(|found| found.modified()).map_err(Error::io(lock));
    let now = changed(claim.as_file())?;
    if !is_old(changed(file)?, now) {
        return Err(busy(output, lock, text, false));
    }
    let Some(_succession) = Succession::claim(lock, text, now)? else {
        return Err(busy(output, lock, text, false));
    };
    before(Step::Judge, lock).map_err(Error::io(lock))?;
    // Another may have succeeded before us, or the owner has woken.
    if !is_at(file, lock) || !is_old(changed(file)?, now) {
        return Ok(None);
    }
    before(Step::Rename, lock).map_err(Error::io(output))?;
    claim.persist(lock).map(|file| Some((file, true))).map_err(|e| Error::io(output)(e.error))
}

fn text(file: &mut File, lock: &Path) -> Result<String> {
    const MOST_BYTES: u64 = 4096;
    let mut bytes = Vec::new();
    file.take(MOST_BYTES).read_to_end(&mut bytes).map_err(Error::io(lock))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Returns the error of an output that another owns. If that cannot be judged from here, it says what the user may do.
fn busy(output: &Path, lock: &Path, text: &str, unsure: bool) -> Error {
    let who = OutputRecord::parse(text).map_or_else(|| "another process".into(), |record| record.who());
    let hint = if unsure { format!("; if that run is gone, remove {}", lock.display()) } else { String::new() };
    Error::busy(output, format!("{who}; try again when it has ended{hint}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_output_has_one_owner_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("dtm.tif");
        let first = Owner::of_file(&output).unwrap();
        let lock = std::fs::read_to_string(folder.path().join("dtm.tif.lock")).unwrap();
        assert!(lock.contains(&format!("\npid {}\n", std::process::id())), "{lock}");
        let error = Owner::of_file(&output).unwrap_err();
        assert!(matches!(error, Error::Busy { .. }), "{error}");
        let _other = Owner::of_file(&folder.path().join("other.tif")).unwrap();
        drop(first);
        let _second = Owner::of_file(&output).unwrap();
        let runs = folder.path().join("runs");
        let _run = Owner::of_folder(&runs, "test", []).unwrap();
        assert!(Owner::of_folder(&runs, "test", []).unwrap_err().to_string().contains("try again"));
    }

    #[test]
    fn a_lock_left_behind_is_taken_over_and_a_foreign_one_counts() {
        let folder = tempfile::tempdir().unwrap();
        let (output, lock) = (folder.path().join("dtm.tif"), folder.path().join("dtm.tif.lock"));
        let here = OutputRecord::here();
        let killed = OutputRecord { process_start: here.process_start.map(|start| start + 1), ..here.clone() };
        for left in [killed.text(), String::new()] {
            std::fs::write(&lock, left).unwrap();
            drop(Owner::of_file(&output).unwrap());
            assert!(!lock.exists());
        }
        let elsewhere = OutputRecord { host: "elsewhere".into(), boot: "another".into(), is_renewed: false, ..here };
        std::fs::write(&lock, elsewhere.text()).unwrap();
        let error = Owner::of_file(&output).unwrap_err().to_string();
        assert!(
            error.contains("on elsewhere") && error.contains("remove") && error.contains("dtm.tif.lock"),
            "{error}"
        );
        assert_eq!(std::fs::read_to_string(&lock).unwrap(), elsewhere.text());
        std::fs::write(&lock, "[[package]]\n").unwrap();
        let error = Owner::of_file(&output).unwrap_err();
        assert!(matches!(error, Error::Usage(_)) && error.to_string().contains("other text found"), "{error}");
        assert_eq!(std::fs::read(&lock).unwrap(), b"[[package]]\n");
    }

    /// Lets eight threads ask for an output at once.
    fn by_eight_at_once(output: &Path) -> Vec<Result<Owner>> {
        let start = std::sync::Barrier::new(8);
        let take = || {
            start.wait();
            Owner::of_file(output)
        };
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8).map(|_| scope.spawn(take)).collect();
            threads.into_iter().map(|thread| thread.join().unwrap()).collect()
        })
    }

    /// Lets the last life sign be `age_s` old.
    fn grow_old(lock: &Path, age_s: u64) {
        let then = std::time::SystemTime::now() - std::time::Duration::from_secs(age_s);
        File::options().write(true).open(lock).unwrap().set_modified(then).unwrap();
    }

    #[test]
    fn an_owner_elsewhere_counts_as_long_as_it_gives_life_signs() {
        let folder = tempfile::tempdir().unwrap();
        let (output, lock) = (folder.path().join("dtm.tif"), folder.path().join("dtm.tif.lock"));
        // Another machine, also one of the same name.
        for host in ["elsewhere".to_string(), OutputRecord::here().host] {
            let elsewhere = OutputRecord { host, boot: "another".into(), ..OutputRecord::here() };
            std::fs::write(&lock, elsewhere.text()).unwrap();
            for age_s in [0, 50] {
                grow_old(&lock, age_s);
                assert!(matches!(Owner::of_file(&output), Err(Error::Busy { .. })), "{age_s} s");
            }
            grow_old(&lock, 70);
            let owner = Owner::of_file(&output).unwrap();
            assert!(owner.is_successor());
            owner.check().unwrap();
            drop(owner);
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "something was left");
    }

    #[test]
    fn of_many_that_find_an_abandoned_lock_one_succeeds_and_the_old_owner_sees_it() {
        let folder = tempfile::tempdir().unwrap();
        let (output, lock) = (folder.path().join("dtm.tif"), folder.path().join("dtm.tif.lock"));
        for _ in 0..50 {
            let elsewhere = OutputRecord { boot: "another".into(), ..OutputRecord::here() };
            std::fs::write(&lock, elsewhere.text()).unwrap();
            let old = File::open(&lock).unwrap();
            grow_old(&lock, 100);
            let taken = by_eight_at_once(&output);
            assert_eq!(taken.iter().filter(|owner| owner.is_ok()).count(), 1);
            assert!(!is_at(&old, &lock));
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "something was left");
    }

    #[test]
    fn a_claimant_that_was_killed_blocks_for_a_minute_alone() {
        let folder = tempfile::tempdir().unwrap();
        let (output, lock) = (folder.path().join("dtm.tif"), folder.path().join("dtm.tif.lock"));
        let elsewhere = OutputRecord { boot: "another".into(), ..OutputRecord::here() };
        std::fs::write(&lock, elsewhere.text()).unwrap();
        grow_old(&lock, 200);
        let killed = Succession::claim(&lock, &elsewhere.text(), std::time::SystemTime::now()).unwrap().unwrap();
        assert!(matches!(Owner::of_file(&output), Err(Error::Busy { .. })));
        let left = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path());
        let left: Vec<PathBuf> = left.filter(|path| *path != lock).collect();
        grow_old(&left[0], 70);
        assert!(Owner::of_file(&output).unwrap().is_successor());
        drop(killed);
    }

    #[test]
    fn an_owner_that_lost_its_lock_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let (output, lock) = (folder.path().join("dtm.tif"), folder.path().join("dtm.tif.lock"));
        let owner = Owner::of_file(&output).unwrap();
        owner.check().unwrap();
        std::fs::write(folder.path().join("new"), OutputRecord::here().text()).unwrap();
        std::fs::rename(folder.path().join("new"), &lock).unwrap();
        let error = owner.check().unwrap_err();
        assert!(matches!(error, Error::Busy { .. }), "{error}");
        drop(owner);
        assert!(lock.exists(), "the lock of another was removed");
    }

    #[test]
    fn what_a_killed_owner_of_a_folder_was_writing_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let here = OutputRecord::here();
        let killed = OutputRecord { process_start: here.process_start.map(|start| start + 1), ..here };
        let [part, kept, named] = [".tmpA1b2C3.part", "dtm.tif.part", ".tmpA1b2C3.tif"].map(|n| folder.path().join(n));
        [&part, &kept, &named].iter().for_each(|path| std::fs::write(path, "x").unwrap());
        // Without a lock there was no owner that was killed.
        drop(Owner::of_folder(folder.path(), "test", []).unwrap());
        assert!(part.exists());
        std::fs::write(folder.path().join(IN_FOLDER), killed.text()).unwrap();
        drop(Owner::of_folder(folder.path(), "test", []).unwrap());
        assert!(!part.exists() && kept.exists() && named.exists());
    }

    #[test]
    fn claims_of_killed_processes_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let here = OutputRecord::here();
        let killed = OutputRecord { process_start: here.process_start.map(|start| start + 1), ..here.clone() };
        let [dead, alive, other, empty, young] =
            [3, 4, 5, 6, 7].map(|k| folder.path().join(format!(".tmpA1b2C{k}.lock")));
        let none = String::new;
        let texts = [killed.text(), here.text(), "x".into(), none(), none()];
        for (path, text) in [&dead, &alive, &other, &empty, &young].into_iter().zip(texts) {
            std::fs::write(path, text).unwrap();
        }
        grow_old(&empty, 70);
        drop(Owner::of_file(&folder.path().join("dtm.tif")).unwrap());
        assert!(!dead.exists() && alive.exists() && other.exists() && !empty.exists() && young.exists());
    }

    #[test]
    fn of_many_that_find_a_dead_owner_one_succeeds() {
        let folder = tempfile::tempdir().unwrap();
        let (output, lock) = (folder.path().join("dtm.tif"), folder.path().join("dtm.tif.lock"));
        let here = OutputRecord::here();
        let killed = OutputRecord { process_start: here.process_start.map(|start| start + 1), ..here };
        for _ in 0..50 {
            std::fs::write(&lock, killed.text()).unwrap();
            let taken = by_eight_at_once(&output);
            // A thread that looks while another reads the old lock may be refused, but never are there two.
            assert_eq!(taken.iter().filter(|owner| owner.is_ok()).count(), 1);
        }
    }
}
