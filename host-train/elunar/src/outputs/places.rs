//! Where paths lead: folders by their whole paths, files by folder and name and by device and number.

use elunar_base::folder_of;
use std::collections::{HashMap, HashSet};
use std::ffi::{OsStr, OsString};
use std::path::{Component, Path, PathBuf};

/// Most names of a folder that are looked at one by one: a folder on a network may hold a hundred thousand others.
const FEW: usize = 64;
/// Longest chain of links that lead nowhere.
const MOST_LINKS: usize = 40;

/// One of the two ways to know a file.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) enum Place {
    /// Number of its folder's whole path, and its name.
    Name(usize, OsString),
    /// Device and number, which hard links share.
    Number((u64, u64)),
}

impl Place {
    /// Returns device and number, if it is known by them.
    pub(super) fn number(&self) -> Option<(u64, u64)> {
        if let Self::Number(number) = self { Some(*number) } else { None }
    }
}

/// What a folder says of a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) is_link: bool,
    /// Device and number; of a link, its own. `None` if the system has none.
    pub(super) number: Option<(u64, u64)>,
}

impl Entry {
    /// Returns what lies at a path.
    pub(super) fn at(path: &Path) -> Option<Self> {
        let found = std::fs::symlink_metadata(path).ok()?;
        Some(Self { is_link: found.is_symlink(), number: number(&found) })
    }
}

/// Folders by numbers: as they are spelled, and whole.
#[derive(Debug, Default)]
pub(super) struct Folders {
    /// The spelled path, and the number of the whole one.
    spelled: Vec<(PathBuf, usize)>,
    whole: Vec<PathBuf>,
    by_spelled: HashMap<PathBuf, usize>,
    by_whole: HashMap<PathBuf, usize>,
}

impl Folders {
    /// Returns the number of a path's folder, and the name in it.
    pub(super) fn of(&mut self, path: &Path) -> (usize, OsString) {
        // A path such as `..` is no file.
        let (folder, name) = path.file_name().map_or((path, OsStr::new("")), |name| (folder_of(path), name));
        if let Some(known) = self.by_spelled.get(folder) {
            return (*known, name.into());
        }
        let whole = self.number_of(whole(folder, MOST_LINKS));
        self.by_spelled.insert(folder.into(), self.spelled.len());
        self.spelled.push((folder.into(), whole));
        (self.spelled.len() - 1, name.into())
    }

    fn number_of(&mut self, whole: PathBuf) -> usize {
        let next = self.whole.len();
        let number = *self.by_whole.entry(whole.clone()).or_insert(next);
        if number == next {
            self.whole.push(whole);
        }
        number
    }

    /// Returns a folder as it is spelled; empty for the current one.
    pub(super) fn spelled(&self, folder: usize) -> &Path {
        let path = &self.spelled[folder].0;
        if path == Path::new(".") { Path::new("") } else { path }
    }

    /// Returns the number of the whole path of a spelled folder.
    pub(super) fn whole(&self, folder: usize) -> usize {
        self.spelled[folder].1
    }

    /// Returns a whole path.
    pub(super) fn path(&self, whole: usize) -> &Path {
        &self.whole[whole]
    }

    /// Returns the places of a name in a folder with a whole path, of which the folder says `entry`.
    pub(super) fn places(&mut self, folder: usize, name: &OsStr, entry: Option<&Entry>) -> Vec<Place> {
        let Some(entry) = entry else { return vec![Place::Name(folder, name.into())] };
        if !entry.is_link {
            return std::iter::once(Place::Name(folder, name.into())).chain(entry.number.map(Place::Number)).collect();
        }
        let path = self.path(folder).join(name);
        let at = whole(&path, MOST_LINKS);
        let there = std::fs::metadata(&path).ok().and_then(|found| number(&found));
        let to = self.number_of(folder_of(&at).into());
        let to = Place::Name(to, at.file_name().unwrap_or_default().into());
        [Place::Name(folder, name.into()), to].into_iter().chain(there.map(Place::Number)).collect()
    }
}

/// Returns where a path leads, also through folders and links that lead to nothing yet.
fn whole(path: &Path, links: usize) -> PathBuf {
    if let Ok(whole) = path.canonicalize() {
        return whole;
    }
    let mut at = PathBuf::new();
    for part in std::path::absolute(path).unwrap_or_else(|_| path.into()).components() {
        match part {
            Component::ParentDir => drop(at.pop()),
            _ => at.push(part),
        }
        if let Ok(whole) = at.canonicalize() {
            at = whole;
        } else if let Some(to) = std::fs::read_link(&at).ok().filter(|_| links > 0) {
            at = whole(&folder_of(&at).join(to), links - 1);
        }
    }
    at
}

/// Returns the entries of those names in a folder. Passes all entries of the folder to `see`, or one that may be anything. What is not there has
/// none.
pub(super) fn listed(folder: &Path, names: &HashSet<&OsStr>, mut see: impl FnMut(&Entry)) -> HashMap<OsString, Entry> {
    let mut found = HashMap::new();
    let listed = if names.len() > FEW { std::fs::read_dir(folder).ok() } else { None };
    let Some(entries) = listed else {
        // Of few names, or in a folder that may be entered and not listed, each is looked at. Anything else may be in it.
        see(&Entry { is_link: true, number: None });
        let there = names.iter().filter_map(|name| Some((OsString::from(name), Entry::at(&folder.join(name))?)));
        found.extend(there.inspect(|(_, entry)| see(entry)));
        return found;
    };
    let device = std::fs::metadata(folder).ok().and_then(|found| number(&found)).map(|(device, _)| device);
    for entry in entries.flatten() {
        let seen = seen(&entry, device);
        see(&seen);
        if names.contains(&*entry.file_name()) {
            found.insert(entry.file_name(), seen);
        }
    }
    found
}

/// Returns what a folder on `device` says of an entry, without a look at the file where the system does not need one.
fn seen(entry: &std::fs::DirEntry, device: Option<u64>) -> Entry {
    let is_link = entry.file_type().is_ok_and(|kind| kind.is_symlink());
    #[cfg(unix)]
    let number = device.map(|device| (device, std::os::unix::fs::DirEntryExt::ino(entry)));
    #[cfg(not(unix))]
    let number = device.zip(None);
    Entry { is_link, number }
}

/// Returns device and number of a file.
fn number(found: &std::fs::Metadata) -> Option<(u64, u64)> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        Some((found.dev(), found.ino()))
    }
    #[cfg(not(unix))]
    {
        let _ = found;
        None
    }
}
