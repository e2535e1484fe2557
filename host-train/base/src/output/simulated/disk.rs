//! A folder, and what a power cut may leave of it.

use super::Random;
use std::collections::{BTreeMap, BTreeSet};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};
use tempfile::TempDir;

/// Number of a file; its bytes stay under this name when no other one is left.
type Number = u64;

/// A folder with the states that its names had since they were last brought to disk.
pub(super) struct Disk {
    random: Random,
    _room: TempDir,
    pub(super) folder: PathBuf,
    kept: PathBuf,
    now: BTreeMap<String, Number>,
    /// Per name: the state on disk, then every later one.
    states: BTreeMap<String, Vec<Option<Number>>>,
    /// Bytes that are on disk, of files that were ever synced.
    synced: BTreeMap<Number, Vec<u8>>,
    /// Names at the time of a kill, and those that a cut leaves.
    remembered: BTreeMap<String, Number>,
    left: Option<BTreeMap<String, Number>>,
}

impl Disk {
    pub(super) fn new(random: Random) -> Self {
        // In memory where there is such a folder.
        let shared = Path::new("/dev/shm");
        let room = if shared.is_dir() { TempDir::new_in(shared) } else { TempDir::new() }.expect("a folder");
        let [folder, kept] = ["folder", "kept"].map(|name| room.path().join(name));
        [&folder, &kept].into_iter().for_each(|folder| std::fs::create_dir(folder).expect("a folder"));
        let (now, states, synced, remembered, left) = Default::default();
        Self { random, _room: room, folder, kept, now, states, synced, remembered, left }
    }

    /// Finds what has changed since the last look.
    pub(super) fn look(&mut self) {
        let mut found = BTreeMap::new();
        for entry in std::fs::read_dir(&self.folder).expect("a folder").flatten() {
            let Ok(file) = entry.metadata() else { continue };
            let kept = self.kept.join(file.ino().to_string());
            if !kept.exists() {
                std::fs::hard_link(entry.path(), kept).expect("a second name");
            }
            found.insert(entry.file_name().to_string_lossy().into_owned(), file.ino());
        }
        let names: BTreeSet<String> = self.now.keys().chain(found.keys()).cloned().collect();
        for name in names {
            let (old, new) = (self.now.get(&name).copied(), found.get(&name).copied());
            if old != new {
                self.states.entry(name).or_insert_with(|| vec![old]).push(new);
            }
        }
        self.now = found;
    }

    /// The bytes of a file are on disk.
    pub(super) fn sync(&mut self, path: &Path) {
        if let Ok(file) = std::fs::symlink_metadata(path) {
            self.synced.insert(file.ino(), std::fs::read(path).expect("a file"));
        }
    }

    /// All names are on disk.
    pub(super) fn sync_names(&mut self) {
        self.look();
        self.states.clear();
    }

    /// Remembers the names at a kill.
    pub(super) fn remember(&mut self) {
        self.look();
        self.remembered = self.now.clone();
    }

    /// Puts back what the destructors of a killed process have removed.
    pub(super) fn put_back(&mut self) {
        for (name, number) in &self.remembered {
            let path = self.folder.join(name);
            if !path.exists() {
                std::fs::hard_link(self.kept.join(number.to_string()), path).expect("a name again");
            }
        }
        self.look();
    }

    /// Cuts power: of each name any state since the last sync is left, of bytes that are not on disk any sectors, in any order.
    pub(super) fn cut(&mut self) {
        self.look();
        let mut left = BTreeMap::new();
        let names: BTreeSet<String> = self.now.keys().chain(self.states.keys()).cloned().collect();
        for name in names {
            let state = match self.states.get(&name) {
                Some(states) => states[self.random.below(states.len())],
                None => self.now.get(&name).copied(),
            };
            if let Some(number) = state {
                left.insert(name, number);
            }
        }
        self.left = Some(left);
    }

    /// After all processes have ended: the folder as a cut has left it, if there was one.
    pub(super) fn start_again(&mut self) {
        let Some(left) = self.left.take() else { return };
        for entry in std::fs::read_dir(&self.folder).expect("a folder").flatten() {
            std::fs::remove_file(entry.path()).expect("a file");
        }
        for (name, number) in left {
            let kept = self.kept.join(number.to_string());
            let written = std::fs::read(&kept).expect("a file");
            let on_disk = self.synced.remove(&number).unwrap_or_default();
            if on_disk != written {
                std::fs::write(&kept, self.torn(&on_disk, &written)).expect("a torn file");
            }
            self.synced.insert(number, std::fs::read(&kept).expect("a file"));
            std::fs::hard_link(kept, self.folder.join(name)).expect("a name again");
        }
        self.now.clear();
        self.look();
        self.states.clear();
    }

    /// Returns what a cut leaves of bytes that were not synced: a length, and of each sector the old or the new bytes. Where there was none, zeros
    /// or what others have left.
    fn torn(&mut self, old: &[u8], new: &[u8]) -> Vec<u8> {
        const SECTOR_BYTES: usize = 16;
        let (least, most) = (old.len().min(new.len()), old.len().max(new.len()));
        let length = [old.len(), new.len(), least + self.random.below(most - least + 1)][self.random.below(3)];
        let mut bytes = vec![0; length];
        for (i, sector) in bytes.chunks_mut(SECTOR_BYTES).enumerate() {
            let from = [old, new][self.random.below(2)].get(i * SECTOR_BYTES..).unwrap_or_default();
            sector.fill([0, 0xa5][self.random.below(2)]);
            sector.iter_mut().zip(from).for_each(|(left, byte)| *left = *byte);
        }
        bytes
    }

    /// Lets an hour go by. Files whose text `is_touched` are touched meanwhile.
    pub(super) fn age(&self, is_touched: impl Fn(&str) -> bool) {
        for entry in std::fs::read_dir(&self.folder).expect("a folder").flatten() {
            let text = std::fs::read(entry.path()).unwrap_or_default();
            if is_touched(&String::from_utf8_lossy(&text)) {
                continue;
            }
            let file = std::fs::OpenOptions::new().append(true).open(entry.path()).expect("a file");
            file.set_modified(SystemTime::now() - Duration::from_secs(3600)).expect("a time");
        }
    }
}
