//! Finished rows of an unfinished job, on disk. The next run continues an interrupted run with them.
//!
//! Behind each row is its checksum, which only this job can have made for this row: a power cut may leave rows that were never written whole. Rows
//! are those before the first wrong checksum.

use super::growing::open_growing;
use super::step::{Step, before, write};
use super::whole::{Staged, atomic_write, sync_folder};
use crate::digest::sha256_hex;
use crate::{Error, Result, folder_of};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// What the file begins with in all versions. Anything else is somebody's, and stays.
const KIND: &[u8] = b"elunar part ";
/// What it begins with in this version.
const MAGIC: [u8; 16] = *b"elunar part 2\n\0\0";
/// Number of bytes before the first row: the magic and the job's SHA-256.
const HEADER_BYTES: usize = 16 + 32;
/// Number of bytes of a row's checksum: the first ones of a SHA-256.
const SUM_BYTES: usize = 8;
/// Rows that are read at once.
const ROWS_AT_ONCE: usize = 256;

/// File of the finished rows, beside the output: `dtm.tif.part` for `dtm.tif`.
pub struct PartFile {
    path: PathBuf,
    file: File,
    id: Vec<u8>,
    cols: usize,
    rows: usize,
    lost: usize,
}

impl PartFile {
    /// Opens the rows of the same job, or starts a new file. `job` is a text that differs between jobs: inputs, model, options.
    ///
    /// # Errors
    /// As [`Self::open_at`].
    pub fn open(output: &Path, job: &str, cols: usize) -> Result<Self> {
        Self::open_at(part_path(output, None)?, job, cols, false)
    }

    /// Opens the rows of the same job at `path` ([`part_path`]), or starts a new file. With `copied` it goes on with a copy: the run that wrote
    /// the rows may still have the file open ([`super::Owner::is_successor`]).
    ///
    /// # Errors
    /// [`Error::Usage`] if a link, no regular file or another file lies there; [`Error::Io`] if the file cannot be created or read.
    pub fn open_at(path: PathBuf, job: &str, cols: usize, copied: bool) -> Result<Self> {
        if copied && path.exists() {
            // A link is refused here.
            let mut old = open_growing(&path)?;
            check_ours(&path, &mut old)?;
            let mut copy = Staged::create(&path)?;
            before(Step::Write, &path)
                .and_then(|()| old.rewind())
                .and_then(|()| std::io::copy(&mut old, copy.file()))
                .map_err(Error::io(&path))?;
            copy.publish()?;
        }
        let (id, mut found) = (id(job, cols), [0; HEADER_BYTES]);
        let mut file = open_growing(&path)?;
        check_ours(&path, &mut file)?;
        file.rewind().map_err(Error::io(&path))?;
        let is_same = file.read_exact(&mut found).is_ok() && found[..] == id[..];
        if !is_same {
            // Another job's rows never come under this header, nor does a cut leave half of it.
            atomic_write(&path, &id)?;
            file = open_growing(&path)?;
        }
        let mut part = Self { path, file, id, cols, rows: 0, lost: 0 };
        match part.find() {
            Ok(()) => Ok(part),
            Err(error) => Err(Error::io(&part.path)(error)),
        }
    }

    /// Finds the rows, and cuts off what follows them.
    fn find(&mut self) -> std::io::Result<()> {
        loop {
            let found = self.block(self.rows, ROWS_AT_ONCE)?.len() / self.cols.max(1);
            self.rows += found;
            if found < ROWS_AT_ONCE {
                break;
            }
        }
        // A run that was killed during a write leaves an incomplete row.
        let whole = self.file.metadata()?.len().saturating_sub(HEADER_BYTES as u64) / self.row_bytes();
        // An owner that was halted may just have cut off what was found. The checksums tell when the rows are read.
        self.lost = (whole as usize).saturating_sub(self.rows);
        before(Step::Write, &self.path).and_then(|()| self.file.set_len(self.place(self.rows)))?;
        // Who began the file may have been killed before its name was on disk.
        sync_folder(&self.path)
    }

    /// Removes the rows of the same job at `path`, or a file that a run began and a kill or cut left without a whole header. What was made
    /// of the rows must be on disk ([`super::settle`]).
    ///
    /// # Errors
    /// [`Error::Io`] if they cannot be removed.
    pub fn discard(path: &Path, job: &str, cols: usize) -> Result<()> {
        let mut found = Vec::new();
        let known = File::open(path).and_then(|file| file.take(HEADER_BYTES as u64).read_to_end(&mut found));
        if known.is_ok() && id(job, cols).starts_with(&found) {
            before(Step::Remove, path).and_then(|()| std::fs::remove_file(path)).map_err(Error::io(path))?;
        }
        Ok(())
    }

    /// Returns the number of whole rows on disk.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Returns the number of rows that were found, but not as they were made. They are gone, and to be made again.
    #[must_use]
    pub fn lost(&self) -> usize {
        self.lost
    }

    /// Returns the path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Appends whole rows and waits until they are on disk.
    ///
    /// # Errors
    /// [`Error::Io`] if they cannot be written, [`Error::Usage`] if they are not whole.
    pub fn append(&mut self, samples: &[f32]) -> Result<()> {
        if !samples.len().is_multiple_of(self.cols.max(1)) {
            let what = format!("expected rows of {} samples, found {} samples", self.cols, samples.len());
            return Err(Error::usage(format!("{}: {what}", self.path.display())));
        }
        let mut bytes = Vec::with_capacity(samples.len() / self.cols.max(1) * self.row_bytes() as usize);
        for (samples, row) in samples.chunks(self.cols.max(1)).zip(self.rows..) {
            let from = bytes.len();
            bytes.extend(samples.iter().flat_map(|v| v.to_le_bytes()));
            bytes.extend(sum(&self.id, row, &bytes[from..]));
        }
        write(&mut self.file, &self.path, &bytes)
            .and_then(|()| before(Step::Sync, &self.path))
            .and_then(|()| self.file.sync_data())
            .map_err(Error::io(&self.path))?;
        self.rows += samples.len() / self.cols.max(1);
        Ok(())
    }

    /// Passes all rows to `take`, in order, in blocks.
    ///
    /// # Errors
    /// [`Error::Io`] if they cannot be read, or somebody has changed them. Errors of `take` are passed on.
    pub fn read(&mut self, take: &mut dyn FnMut(&[f32]) -> Result<()>) -> Result<()> {
        let mut from = 0;
        while from < self.rows {
            let rows = ROWS_AT_ONCE.min(self.rows - from);
            let samples = self.block(from, rows).map_err(Error::io(&self.path))?;
            if samples.len() != rows * self.cols {
                let what = "rows as they were written expected, changed ones found; try again";
                return Err(Error::io(&self.path)(std::io::Error::new(ErrorKind::InvalidData, what)));
            }
            take(&samples)?;
            from += rows;
        }
        Ok(())
    }

    /// Reads rows, at most `most`, as far as their checksums are right.
    fn block(&mut self, from: usize, most: usize) -> std::io::Result<Vec<f32>> {
        let (row_bytes, mut bytes) = (self.row_bytes(), Vec::new());
        self.file.seek(SeekFrom::Start(self.place(from)))?;
        (&self.file).take(most as u64 * row_bytes).read_to_end(&mut bytes)?;
        let mut samples = Vec::with_capacity(bytes.len() / 4);
        for (row, bytes) in bytes.chunks_exact(row_bytes as usize).enumerate() {
            let (bytes, found) = bytes.split_at(4 * self.cols);
            if found != sum(&self.id, from + row, bytes) {
                break;
            }
            samples.extend(bytes.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)));
        }
        Ok(samples)
    }

    fn row_bytes(&self) -> u64 {
        (4 * self.cols + SUM_BYTES) as u64
    }

    /// Returns where a row begins.
    fn place(&self, row: usize) -> u64 {
        HEADER_BYTES as u64 + row as u64 * self.row_bytes()
    }

    /// Removes the file, once its rows are stored elsewhere or not needed.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be removed.
    pub fn remove(self) -> Result<()> {
        let Self { path, file, .. } = self;
        drop(file);
        before(Step::Remove, &path).and_then(|()| std::fs::remove_file(&path)).map_err(Error::io(&path))
    }
}

/// Returns what the file of a job begins with.
fn id(job: &str, cols: usize) -> Vec<u8> {
    [&MAGIC[..], &Sha256::new().chain_update(job).chain_update(cols.to_le_bytes()).finalize()].concat()
}

/// Returns the checksum of a row.
fn sum(id: &[u8], row: usize, bytes: &[u8]) -> [u8; SUM_BYTES] {
    let sum = Sha256::new().chain_update(id).chain_update((row as u64).to_le_bytes()).chain_update(bytes).finalize();
    std::array::from_fn(|i| sum[i])
}

/// Refuses a file that no run of this program began. One of an earlier version that was killed at once may have left a part of the magic, a power
/// cut zeros.
fn check_ours(path: &Path, file: &mut File) -> Result<()> {
    let mut found = Vec::new();
    file.rewind().and_then(|()| file.take(MAGIC.len() as u64).read_to_end(&mut found)).map_err(Error::io(path))?;
    if found.starts_with(KIND) || MAGIC.starts_with(&found) || found.iter().all(|byte| *byte == 0) {
        return Ok(());
    }
    let what = "rows of an unfinished run expected, another file found; remove it, or name another output";
    Err(Error::usage(format!("{}: {what}", path.display())))
}

/// Returns the path of the rows of `output`: `dtm.tif.part` beside `dtm.tif`. In another folder, the name holds the hash of the output's whole
/// path, so that outputs of one name keep apart.
///
/// # Errors
/// [`Error::Usage`] if the folder does not exist; [`Error::Io`] if that of the output does not.
pub fn part_path(output: &Path, folder: Option<&Path>) -> Result<PathBuf> {
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    let Some(folder) = folder else { return Ok(output.with_file_name(format!("{name}.part"))) };
    if !folder.is_dir() {
        return Err(Error::usage(format!("--part-dir {}: a folder expected, none found", folder.display())));
    }
    let place = folder_of(output).canonicalize().map_err(Error::io(output))?;
    let id = sha256_hex(place.join(&*name).to_string_lossy().as_bytes());
    Ok(folder.join(format!("{name}.{}.part", &id[..16])))
}

/// Gives every whole row its checksum, as if none was compared.
#[cfg(all(test, unix))]
pub(super) fn seal_again(path: &Path, job: &str, cols: usize) -> std::io::Result<()> {
    let (id, mut bytes) = (id(job, cols), std::fs::read(path)?);
    let rows = if bytes.starts_with(&id) { &mut bytes[HEADER_BYTES..] } else { &mut [] };
    for (row, bytes) in rows.chunks_exact_mut(4 * cols + SUM_BYTES).enumerate() {
        let (samples, found) = bytes.split_at_mut(4 * cols);
        found.copy_from_slice(&sum(&id, row, samples));
    }
    std::fs::write(path, bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn rows(part: &mut PartFile) -> Vec<f32> {
        let mut all = vec![];
        part.read(&mut |rows| {
            all.extend_from_slice(rows);
            Ok(())
        })
        .unwrap();
        all
    }

    #[test]
    fn the_same_job_goes_on_and_another_begins_anew() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("dtm.tif");
        let mut part = PartFile::open(&output, "a", 3).unwrap();
        assert_eq!((part.rows(), part.path()), (0, folder.path().join("dtm.tif.part").as_path()));
        part.append(&[1.0, 2.0, f32::NAN, 4.0, 5.0, 6.0]).unwrap();
        assert!(part.append(&[1.0]).is_err());
        // The run was killed in the middle of a row.
        drop(part);
        let path = folder.path().join("dtm.tif.part");
        std::fs::OpenOptions::new().append(true).open(&path).unwrap().write_all(&[7; 9]).unwrap();
        let mut part = PartFile::open(&output, "a", 3).unwrap();
        assert_eq!((part.rows(), part.lost()), (2, 0));
        part.append(&[7.0, 8.0, 9.0]).unwrap();
        let found = rows(&mut part);
        assert!(found[2].is_nan());
        assert_eq!((found.len(), found[5], found[8]), (9, 6.0, 9.0));
        drop(part);
        assert_eq!(PartFile::open(&output, "a", 1).unwrap().rows(), 0, "another width is another job");
        assert_eq!(PartFile::open(&output, "b", 3).unwrap().rows(), 0);
        for (job, cols) in [("a", 3), ("b", 1)] {
            PartFile::discard(&path, job, cols).unwrap();
            assert!(path.exists(), "rows of another job are kept");
        }
        PartFile::discard(&path, "b", 3).unwrap();
        assert!(!path.exists());
        PartFile::discard(&path, "b", 3).unwrap();
        PartFile::open(&output, "b", 3).unwrap().remove().unwrap();
        assert!(!path.exists());
        for begun in [&b""[..], b"elunar p"] {
            std::fs::write(&path, begun).unwrap();
            PartFile::discard(&path, "b", 3).unwrap();
            assert!(!path.exists(), "a file without a whole header is left");
        }
        std::fs::write(&path, "somebody's").unwrap();
        PartFile::discard(&path, "b", 3).unwrap();
        assert!(path.exists(), "another file is removed");
    }

    #[test]
    fn a_damaged_row_and_those_behind_it_are_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("dtm.tif");
        let mut part = PartFile::open(&output, "a", 2).unwrap();
        part.append(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).unwrap();
        let (path, row_bytes) = (part.path().to_path_buf(), part.row_bytes() as usize);
        let whole = std::fs::read(&path).unwrap();
        for at in HEADER_BYTES..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            std::fs::write(&path, &bytes).unwrap();
            let error = part.read(&mut |_| Ok(())).unwrap_err().to_string();
            assert!(error.contains("dtm.tif.part") && error.contains("changed ones found"), "{error}");
            let again = PartFile::open(&output, "a", 2).unwrap();
            let before = (at - HEADER_BYTES) / row_bytes;
            assert_eq!((again.rows(), again.lost()), (before, 3 - before), "byte {at}");
        }
        // A right row at another's place is wrong there.
        let (first, second) = (HEADER_BYTES..HEADER_BYTES + row_bytes, HEADER_BYTES + row_bytes);
        let mut bytes = whole.clone();
        bytes.copy_within(first, second);
        std::fs::write(&path, &bytes).unwrap();
        let again = PartFile::open(&output, "a", 2).unwrap();
        assert_eq!((again.rows(), again.lost()), (1, 2));
    }

    #[test]
    fn a_successor_goes_on_with_a_copy() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dtm.tif.part");
        let mut halted = PartFile::open_at(path.clone(), "a", 2, false).unwrap();
        halted.append(&[1.0, 2.0]).unwrap();
        let mut successor = PartFile::open_at(path, "a", 2, true).unwrap();
        assert_eq!(successor.rows(), 1);
        successor.append(&[3.0, 4.0]).unwrap();
        halted.append(&[9.0, 9.0, 9.0, 9.0]).unwrap();
        assert_eq!(rows(&mut successor), [1.0, 2.0, 3.0, 4.0]);
    }

    #[test]
    fn rows_of_outputs_of_one_name_keep_apart_in_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["a", "b", "parts"] {
            std::fs::create_dir(at(name)).unwrap();
        }
        let [a, b] = ["a/dtm.tif", "b/dtm.tif"].map(|name| part_path(&at(name), Some(&at("parts"))).unwrap());
        assert!(a != b && a.parent() == b.parent(), "{a:?} {b:?}");
        assert_eq!(part_path(&at("a/../a/dtm.tif"), Some(&at("parts"))).unwrap(), a);
        let error = part_path(&at("a/dtm.tif"), Some(&at("none"))).unwrap_err().to_string();
        assert!(error.contains("--part-dir") && error.contains("none"), "{error}");
    }

    #[test]
    fn a_cut_file_is_no_job_and_a_foreign_one_stays() {
        let folder = tempfile::tempdir().unwrap();
        let (output, part) = (folder.path().join("dtm.tif"), folder.path().join("dtm.tif.part"));
        for bytes in [&b""[..], b"elunar p", &MAGIC, b"elunar part 1\n\0\0 of an earlier version", &[0; 500]] {
            std::fs::write(&part, bytes).unwrap();
            assert_eq!(PartFile::open(&output, "a", 3).unwrap().rows(), 0);
        }
        for bytes in [&b"short"[..], &[9; 500]] {
            std::fs::write(&part, bytes).unwrap();
            for copied in [false, true] {
                let error = PartFile::open_at(part.clone(), "a", 3, copied).err().unwrap();
                assert!(
                    matches!(&error, Error::Usage(_)) && error.to_string().contains("another file found"),
                    "{error}"
                );
            }
            assert_eq!(std::fs::read(&part).unwrap(), bytes);
        }
    }
}
