//! The list of the files that a command wrote into a folder: it replaces and removes these and no others.
//!
//! `COMMAND.files` lies in the folder and is written before the first file that it names, so that a kill leaves no file unlisted. Names that end
//! with `/` are folders that are the command's with all that is in them.

use super::step::{Step, before};
use super::target::{check_regular, check_target, kind_of};
use super::whole::{UNFINISHED, atomic_write, sync_folder};
use crate::{Error, Result, read};
use std::collections::BTreeSet;
use std::fs::Metadata;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// First line of a list.
const HEAD: &str = "elunar files 1";
/// End of its name.
const SUFFIX: &str = ".files";

/// The files of a folder that a command calls its own.
#[derive(Debug)]
pub(super) struct Listing {
    folder: PathBuf,
    /// The list itself.
    path: PathBuf,
    names: BTreeSet<String>,
}

impl Listing {
    /// Reads the list of a command. Names of which nothing is there are forgotten.
    ///
    /// # Errors
    /// [`Error::Usage`] if something else lies in its place; [`Error::Io`] if it cannot be read.
    pub(super) fn open(folder: &Path, command: &str) -> Result<Self> {
        let path = folder.join(format!("{command}{SUFFIX}"));
        let mut names = BTreeSet::new();
        check_target(&path)?;
        if let Some(text) = there(&path)?.map(|_| read::text(&path, read::MOST_BYTES)).transpose()? {
            let mut lines = text.lines();
            if lines.next() != Some(HEAD) {
                let what =
                    format!("the list of files of an earlier run ({HEAD:?}) or nothing expected, another file found");
                return Err(Error::usage(format!("{}: {what}", path.display())));
            }
            names = lines.map(String::from).collect();
        }
        let mut listing = Self { folder: folder.into(), path, names };
        listing.forget_absent();
        Ok(listing)
    }

    fn forget_absent(&mut self) {
        let folder = &self.folder;
        self.names.retain(|name| std::fs::symlink_metadata(folder.join(name.trim_end_matches('/'))).is_ok());
    }

    /// Checks that at every name nothing lies, or what the list names.
    ///
    /// # Errors
    /// [`Error::Usage`] with the first path at which something else lies.
    pub(super) fn check<'a>(&self, names: impl IntoIterator<Item = &'a String>) -> Result<()> {
        names.into_iter().try_for_each(|name| self.check_one(name))
    }

    fn check_one(&self, name: &str) -> Result<()> {
        let (whole, is_folder) = (name.trim_end_matches('/'), name.ends_with('/'));
        for (end, _) in whole.match_indices('/') {
            let path = self.folder.join(&whole[..end]);
            match there(&path)? {
                None => return Ok(()),
                Some(found) => check_folder(&path, &found)?,
            }
        }
        let path = self.folder.join(whole);
        let Some(found) = there(&path)? else { return Ok(()) };
        if !self.names.contains(name) {
            return Err(self.foreign(&path));
        }
        if !is_folder {
            return check_regular(&path, &found);
        }
        check_folder(&path, &found)?;
        let own = |inner: &str| self.names.contains(&format!("{name}{inner}"));
        match foreign_in(&path, own)? {
            Some(other) => Err(self.foreign(&other)),
            None => Ok(()),
        }
    }

    fn foreign(&self, path: &Path) -> Error {
        let list = self.path.display();
        let what = format!(
            "nothing, or what {list} names, expected, something else found: this run would replace it. Choose another folder, or move it away; if an earlier version wrote it, name it in that list"
        );
        Error::usage(format!("{}: {what}", path.display()))
    }

    /// Adds names, and writes the list if it has changed. Nothing may lie there but what the list named before.
    ///
    /// # Errors
    /// As [`Self::check`]; [`Error::Io`] if the list cannot be written.
    pub(super) fn claim(&mut self, names: impl IntoIterator<Item = String>) -> Result<()> {
        let mut all: BTreeSet<String> = names.into_iter().collect();
        self.check(&all)?;
        all.append(&mut self.names);
        self.names = all;
        self.write()
    }

    fn write(&self) -> Result<()> {
        let text: String = std::iter::once(HEAD)
            .chain(self.names.iter().map(String::as_str))
            .fold(String::new(), |text, line| text + line + "\n");
        let is_known = there(&self.path)?.is_some() && read::text(&self.path, read::MOST_BYTES)? == text;
        match self.names.is_empty() {
            true => Ok(()),
            // Who wrote it may have been killed before its name was on disk.
            false if is_known => sync_folder(&self.path).map_err(Error::io(&self.path)),
            false => atomic_write(&self.path, text.as_bytes()),
        }
    }

    /// Removes a file, or a folder with all that the list names in it. What the list does not name stays.
    ///
    /// # Errors
    /// [`Error::Usage`] if a folder has something that is not listed; [`Error::Io`] if something cannot be removed.
    pub(super) fn remove(&self, name: &str) -> Result<()> {
        let path = self.folder.join(name.trim_end_matches('/'));
        let Some(found) = there(&path)?.filter(|_| self.names.contains(name)) else { return Ok(()) };
        if name.ends_with('/') {
            check_folder(&path, &found)?;
            return remove_all(&path, |inner| self.names.contains(&format!("{name}{inner}")));
        }
        check_regular(&path, &found)?;
        before(Step::Remove, &path).and_then(|()| std::fs::remove_file(&path)).map_err(Error::io(&path))
    }

    /// Leaves a list of what is there, or none if nothing is.
    pub(super) fn close(&mut self) {
        self.forget_absent();
        // An error leaves names of files that are not there.
        let remove = || before(Step::Remove, &self.path).and_then(|()| std::fs::remove_file(&self.path));
        let _ = if self.names.is_empty() { remove().is_ok() } else { self.write().is_ok() };
    }
}

/// Checks, without a change, that a run of `command` may write files of these names into a folder, which need not exist: as
/// [`super::Owner::of_folder`] does.
///
/// # Errors
/// [`Error::Usage`] with the first path at which something lies that the command's list does not name.
pub fn check_names(folder: &Path, command: &str, names: impl IntoIterator<Item = String>) -> Result<()> {
    Listing::open(folder, command)?.check(&names.into_iter().collect::<Vec<_>>())
}

/// Removes a folder with files of these names, and with what a killed run was writing. If it has anything else, nothing is removed.
///
/// # Errors
/// [`Error::Usage`] if it is no folder, or has another file; [`Error::Io`] if something cannot be removed.
pub fn remove_folder(folder: &Path, names: &[&str]) -> Result<()> {
    let Some(found) = there(folder)? else { return Ok(()) };
    check_folder(folder, &found)?;
    remove_all(folder, |name| names.contains(&name))
}

fn remove_all(folder: &Path, own: impl Fn(&str) -> bool) -> Result<()> {
    if let Some(other) = foreign_in(folder, own)? {
        let what = "a file of an earlier run expected, another one found: this run would remove it";
        return Err(Error::usage(format!("{}: {what}", other.display())));
    }
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let path = entry.map_err(Error::io(folder))?.path();
        std::fs::remove_file(&path).map_err(Error::io(&path))?;
    }
    std::fs::remove_dir(folder).map_err(Error::io(folder))
}

/// Returns something in a folder that is no regular file of an own name, and none that a killed run was writing.
fn foreign_in(folder: &Path, own: impl Fn(&str) -> bool) -> Result<Option<PathBuf>> {
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let entry = entry.map_err(Error::io(folder))?;
        let name = entry.file_name();
        let is_own =
            name.to_str().is_some_and(|name| own(name) || name.starts_with(".tmp") && name.ends_with(UNFINISHED));
        if !is_own || !entry.file_type().map_err(Error::io(folder))?.is_file() {
            return Ok(Some(entry.path()));
        }
    }
    Ok(None)
}

/// Returns what lies at a path, links not followed; `None` if nothing does.
fn there(path: &Path) -> Result<Option<Metadata>> {
    match std::fs::symlink_metadata(path) {
        Ok(found) => Ok(Some(found)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(Error::io(path)(error)),
    }
}

/// Refuses what is no folder of its own.
fn check_folder(path: &Path, found: &Metadata) -> Result<()> {
    if found.is_dir() {
        return Ok(());
    }
    let kind = if found.is_file() { "file" } else { kind_of(found.file_type()) };
    Err(Error::usage(format!("{}: a folder or nothing expected, a {kind} found", path.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(all: &[&str]) -> Vec<String> {
        all.iter().map(|name| name.to_string()).collect()
    }

    /// Returns a folder with a list of these names, at each of which a file lies.
    fn listed(all: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        Listing::open(folder.path(), "test").unwrap().claim(names(all)).unwrap();
        for name in all {
            let path = folder.path().join(name);
            std::fs::create_dir_all(if name.ends_with('/') { &path } else { path.parent().unwrap() }).unwrap();
            if !name.ends_with('/') {
                std::fs::write(path, "own").unwrap();
            }
        }
        folder
    }

    fn text(folder: &Path) -> Option<String> {
        std::fs::read_to_string(folder.join("test.files")).ok()
    }

    #[test]
    fn what_is_listed_is_replaced_and_nothing_else() {
        let folder = listed(&["a", "sub/b", "w/", "w/c"]);
        let at = folder.path();
        assert_eq!(text(at).unwrap(), "elunar files 1\na\nsub/b\nw/\nw/c\n");
        let claim = |all: &[&str]| Listing::open(at, "test").unwrap().claim(names(all));
        claim(&["a", "sub/b", "w/", "w/c", "new", "no/new"]).unwrap();
        for (foreign, asked) in [("x", "x"), ("sub/x", "sub/x"), ("w/x", "w/"), ("w/.tmpA.tif", "w/")] {
            std::fs::write(at.join(foreign), "theirs").unwrap();
            let before = text(at);
            let error = claim(&["other", asked]).unwrap_err().to_string();
            assert!(error.contains(&format!("{}: nothing, or what ", at.join(foreign).display())), "{error}");
            assert!(text(at) == before && std::fs::read(at.join(foreign)).unwrap() == b"theirs");
            std::fs::remove_file(at.join(foreign)).unwrap();
        }
        // What a killed run was writing is its own.
        std::fs::write(at.join("w/.tmpA1b2C3.part"), "half").unwrap();
        claim(&["w/"]).unwrap();
        // Another command's list is not this one's.
        assert!(check_names(at, "other", names(&["a"])).is_err());
        assert!(check_names(&at.join("no"), "other", names(&["a"])).is_ok());
    }

    #[test]
    fn folders_and_links_in_the_place_of_files_are_refused() {
        let folder = listed(&["a", "sub/b"]);
        let at = folder.path();
        let error = |all: &[&str]| check_names(at, "test", names(all)).unwrap_err().to_string();
        std::fs::create_dir(at.join("d")).unwrap();
        assert!(error(&["d"]).contains("something else found"));
        assert!(error(&["d/"]).contains("something else found"));
        assert!(error(&["a/x"]).ends_with("a folder or nothing expected, a file found"));
        assert!(check_names(at, "test", names(&["d/x"])).is_ok(), "a folder that others made may be used");
        #[cfg(unix)]
        {
            std::fs::remove_file(at.join("a")).unwrap();
            std::os::unix::fs::symlink("sub", at.join("a")).unwrap();
            assert!(error(&["a/x"]).ends_with("a folder or nothing expected, a link found"));
            assert!(error(&["a"]).ends_with("a regular file or nothing expected, a link found"));
        }
        std::fs::write(at.join("test.files"), "mine\n").unwrap();
        let error = Listing::open(at, "test").unwrap_err().to_string();
        assert!(error.contains("the list of files of an earlier run"), "{error}");
    }

    #[test]
    fn removed_is_what_is_listed() {
        let folder = listed(&["a", "w/", "w/c"]);
        let at = folder.path();
        let mut listing = Listing::open(at, "test").unwrap();
        std::fs::write(at.join("x"), "theirs").unwrap();
        listing.remove("x").unwrap();
        listing.remove("a").unwrap();
        listing.remove("no").unwrap();
        assert!(at.join("x").exists() && !at.join("a").exists());
        std::fs::write(at.join("w/x"), "theirs").unwrap();
        assert!(listing.remove("w/").unwrap_err().to_string().contains("this run would remove it"));
        assert!(at.join("w/c").exists() && at.join("w/x").exists());
        std::fs::remove_file(at.join("w/x")).unwrap();
        std::fs::write(at.join("w/.tmpA1b2C3.part"), "half").unwrap();
        listing.remove("w/").unwrap();
        assert!(!at.join("w").exists());
        listing.close();
        assert_eq!(text(at), None, "a list of nothing");
        // A name of which nothing is there is another's as soon as something is.
        listing.claim(names(&["y"])).unwrap();
        listing.close();
        std::fs::write(at.join("y"), "theirs").unwrap();
        assert!(check_names(at, "test", names(&["y"])).is_err());
    }

    #[test]
    fn a_folder_of_known_names_is_removed_as_a_whole_or_not_at_all() {
        let folder = listed(&["w/c", "w/d"]);
        let w = folder.path().join("w");
        assert!(remove_folder(&w, &["c"]).is_err());
        assert!(w.join("c").exists());
        remove_folder(&w, &["c", "d", "e"]).unwrap();
        remove_folder(&w, &["c"]).unwrap();
        assert!(!w.exists());
    }
}
