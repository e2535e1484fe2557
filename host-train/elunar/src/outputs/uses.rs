//! Files that are read and files that are written, by one command or by all items of a manifest: none may be both, and none is written twice.
//!
//! A file is known by the folder that its path leads to and its name there, and by device and number, which links share. Folders are listed
//! once, so that a hundred thousand items are a matter of seconds.

use super::places::{Entry, Folders, Place, listed};
use elunar_raster::content::files_of_raster;
use std::collections::{HashMap, HashSet};
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

/// Paths that are read and written; `W` says by whom.
#[derive(Debug)]
pub struct Uses<W> {
    folders: Folders,
    written: Vec<Use<W>>,
    read: Vec<Use<W>>,
}

/// A name in a folder, and who uses it.
#[derive(Debug)]
struct Use<W> {
    folder: usize,
    name: OsString,
    by: W,
}

/// A file to write that is also read, or written by another.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Clash<W> {
    /// The file, as its writer spells it.
    pub path: PathBuf,
    /// Who writes it.
    pub written_by: W,
    /// Who else uses it.
    pub other: W,
    /// Whether the other one reads it.
    pub is_read: bool,
}

impl<W> Default for Uses<W> {
    fn default() -> Self {
        Self { folders: Folders::default(), written: vec![], read: vec![] }
    }
}

impl<W: Copy> Uses<W> {
    /// Adds files to write.
    pub fn write<'a>(&mut self, paths: impl IntoIterator<Item = &'a PathBuf>, by: W) {
        for path in paths {
            let one = self.used(path, by);
            self.written.push(one);
        }
    }

    /// Adds a file to read, and the image that it points at if it is a label.
    pub fn read(&mut self, path: &Path, by: W) {
        let one = self.used(path, by);
        self.read.push(one);
    }

    fn used(&mut self, path: &Path, by: W) -> Use<W> {
        let (folder, name) = self.folders.of(path);
        Use { folder, name, by }
    }

    /// Returns a file to write that is also read or written by another; `None` if all are apart.
    #[must_use]
    pub fn clash(mut self) -> Option<Clash<W>> {
        let folders = &mut self.folders;
        let mut written: HashMap<Place, usize> = HashMap::new();
        let entries = list(folders, &self.written, &HashSet::new());
        for (index, one) in self.written.iter().enumerate() {
            let (places, _) = places(folders, one, &entries);
            for place in places {
                // A new file replaces the name alone: what has another name stays.
                let is_name = matches!(place, Place::Name(..));
                if let Some(first) = written.insert(place, index).filter(|first| is_name && *first != index) {
                    return Some(clash(folders, one, &self.written[first], false));
                }
            }
        }
        let numbers: HashSet<(u64, u64)> = written.keys().filter_map(Place::number).collect();
        let entries = list(folders, &self.read, &numbers);
        let mut seen = HashSet::new();
        for one in self.read.iter().filter(|one| seen.insert((one.folder, &one.name))) {
            let (mut all, may_point) = places(folders, one, &entries);
            if may_point || is_vrt(&one.name) {
                all.extend(pointed(folders, one));
            }
            if let Some(index) = all.iter().find_map(|place| written.get(place)) {
                return Some(clash(folders, &self.written[*index], one, true));
            }
        }
        None
    }
}

/// Returns whether a file is a VRT by its name. It names files of any folder.
fn is_vrt(name: &OsStr) -> bool {
    Path::new(name).extension().is_some_and(|end| end.eq_ignore_ascii_case("vrt"))
}

fn clash<W: Copy>(folders: &Folders, writer: &Use<W>, other: &Use<W>, is_read: bool) -> Clash<W> {
    let path = folders.spelled(writer.folder).join(&writer.name);
    Clash { path, written_by: writer.by, other: other.by, is_read }
}

/// What lies in the folders of some uses: the entries of their names, and whether a label in the folder may point at a file to write.
type Entries = HashMap<usize, (HashMap<OsString, Entry>, bool)>;

/// Lists the folders of `uses`. A label points at a file of its own folder: that one is to be written only if the folder has a link, or one of
/// the files of these `numbers`.
fn list<W>(folders: &Folders, uses: &[Use<W>], numbers: &HashSet<(u64, u64)>) -> Entries {
    let mut wanted: HashMap<usize, HashSet<&OsStr>> = HashMap::new();
    for one in uses {
        wanted.entry(folders.whole(one.folder)).or_default().insert(&one.name);
    }
    let one = |(folder, names)| {
        let mut may_point = false;
        let found = listed(folders.path(folder), &names, |entry| {
            may_point |= entry.is_link || entry.number.is_none_or(|number| numbers.contains(&number));
        });
        (folder, (found, may_point))
    };
    wanted.into_iter().map(one).collect()
}

/// Returns the places that a use's name leads to, and whether its folder may hide others behind labels.
fn places<W>(folders: &mut Folders, one: &Use<W>, entries: &Entries) -> (Vec<Place>, bool) {
    let whole = folders.whole(one.folder);
    let (entry, may_point) = entries.get(&whole).map_or((None, true), |(found, point)| (found.get(&one.name), *point));
    (folders.places(whole, &one.name, entry), may_point)
}

/// Returns the places of the other file of a raster, if it is a label with an image.
fn pointed<W>(folders: &mut Folders, one: &Use<W>) -> Vec<Place> {
    let path = folders.spelled(one.folder).join(&one.name);
    // What is no raster is one file. A pipe would wait for its writer.
    let files = if path.is_file() { files_of_raster(&path).unwrap_or_default() } else { vec![] };
    let mut all = vec![];
    for file in files {
        let (folder, name) = folders.of(&file);
        let whole = folders.whole(folder);
        let entry = Entry::at(&file);
        all.extend(folders.places(whole, &name, entry.as_ref()));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Files of a new folder.
    fn files(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        names.iter().for_each(|name| std::fs::write(folder.path().join(name), name).unwrap());
        folder
    }

    /// Returns who writes and who else uses a file: paths to write by 1, 2, ... and to read by 11, 12, ...
    fn found(at: &Path, written: &[&str], read: &[&str]) -> Option<(u32, u32)> {
        let mut uses = Uses::default();
        (1..).zip(written).for_each(|(by, path)| uses.write([&at.join(path)], by));
        (11..).zip(read).for_each(|(by, path)| uses.read(&at.join(path), by));
        uses.clash().map(|clash| (clash.written_by, clash.other))
    }

    #[test]
    fn spellings_of_one_file_are_one_file() {
        let folder = files(&["a.tif", "b.tif"]);
        let at = folder.path();
        assert_eq!(found(at, &["c.tif", "no/a.tif"], &["a.tif", "b.tif", "a.tif"]), None);
        for spelled in ["a.tif", "./a.tif", "no/../a.tif", "no/such/.././../a.tif"] {
            assert_eq!(found(at, &["c.tif", spelled], &["b.tif", "a.tif"]), Some((2, 12)), "{spelled}");
            assert_eq!(found(at, &["a.tif", spelled], &[]), Some((2, 1)), "{spelled}");
        }
        // Nothing needs to be there yet.
        assert_eq!(found(at, &["new/c.tif"], &["new/./c.tif"]), Some((1, 11)));
    }

    #[cfg(unix)]
    #[test]
    fn links_lead_to_one_file() {
        use std::os::unix::fs::symlink;
        let folder = files(&["a.tif"]);
        let at = folder.path();
        for name in ["sub", "other"] {
            std::fs::create_dir(at.join(name)).unwrap();
        }
        symlink("../a.tif", at.join("sub/soft.tif")).unwrap();
        symlink(at.join("sub"), at.join("link")).unwrap();
        symlink("new.tif", at.join("nothing.tif")).unwrap();
        std::fs::hard_link(at.join("a.tif"), at.join("other/hard.tif")).unwrap();
        for (written, read) in [
            ("a.tif", "sub/soft.tif"),
            ("sub/soft.tif", "a.tif"),
            ("link/soft.tif", "a.tif"),
            ("other/hard.tif", "a.tif"),
            ("other/hard.tif", "link/soft.tif"),
            ("link/new.tif", "sub/new.tif"),
            ("new.tif", "nothing.tif"),
        ] {
            assert_eq!(found(at, &[written], &[read]), Some((1, 11)), "{written}, {read}");
        }
        assert_eq!(found(at, &["link/a.tif"], &["a.tif"]), None);
    }

    #[test]
    fn the_files_of_a_vrt_are_read() {
        let folder = files(&["d.tif"]);
        let at = folder.path();
        std::fs::create_dir(at.join("in")).unwrap();
        let vrt = "<VRTDataset rasterXSize=\"1\" rasterYSize=\"1\"><VRTRasterBand><SimpleSource>\
            <SourceFilename relativeToVRT=\"1\">../d.tif</SourceFilename><SrcRect xOff=\"0\" yOff=\"0\" xSize=\"1\" ySize=\"1\"/>\
            <DstRect xOff=\"0\" yOff=\"0\" xSize=\"1\" ySize=\"1\"/></SimpleSource></VRTRasterBand></VRTDataset>";
        std::fs::write(at.join("in/a.vrt"), vrt).unwrap();
        assert_eq!(found(at, &["d.tif"], &["in/a.vrt"]), Some((1, 11)));
        assert_eq!(found(at, &["e.tif"], &["in/a.vrt"]), None);
    }

    #[test]
    fn the_image_of_a_label_is_read() {
        let folder = files(&["d.tif"]);
        let at = folder.path();
        let label = "PDS_VERSION_ID = PDS3\r\n^IMAGE = \"d.tif\"\r\nOBJECT = IMAGE\r\nLINES = 1\r\nLINE_SAMPLES = 5\r\n\
            SAMPLE_TYPE = UNSIGNED_INTEGER\r\nSAMPLE_BITS = 8\r\nEND_OBJECT = IMAGE\r\nEND\r\n";
        std::fs::write(at.join("l.lbl"), label).unwrap();
        assert_eq!(found(at, &["d.tif"], &["l.lbl"]), Some((1, 11)));
        assert_eq!(found(at, &["e.tif"], &["l.lbl"]), None);
        #[cfg(unix)]
        {
            // The image lies elsewhere, and is a link beside the label.
            std::fs::create_dir(at.join("out")).unwrap();
            std::fs::rename(at.join("d.tif"), at.join("out/d.tif")).unwrap();
            std::os::unix::fs::symlink("out/d.tif", at.join("d.tif")).unwrap();
            assert_eq!(found(at, &["out/d.tif"], &["l.lbl"]), Some((1, 11)));
            std::fs::remove_file(at.join("d.tif")).unwrap();
            std::fs::hard_link(at.join("out/d.tif"), at.join("d.tif")).unwrap();
            assert_eq!(found(at, &["out/d.tif"], &["l.lbl"]), Some((1, 11)));
        }
    }
}
