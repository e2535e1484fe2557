//! Finished rows of an unfinished prediction, on disk. The next run continues an interrupted run with them.

use elunar_base::digest::sha256_hex;
use elunar_base::output::{Staged, open_growing};
use elunar_base::{Error, Result, folder_of};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// What the file begins with. Anything else is somebody's, and stays.
const MAGIC: [u8; 16] = *b"elunar part 1\n\0\0";
/// Number of bytes before the first row: the magic and the job's SHA-256.
const HEADER_BYTES: u64 = 16 + 32;

/// File of the finished rows, beside the output: `dtm.tif.part` for `dtm.tif`.
pub struct PartFile {
    path: PathBuf,
    file: File,
    cols: usize,
    rows: usize,
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
    /// the rows may still have the file open ([`elunar_base::output::Owner::is_successor`]).
    ///
    /// # Errors
    /// [`Error::Usage`] if a link, no regular file or another file lies there; [`Error::Io`] if the file cannot be created or read.
    pub fn open_at(path: PathBuf, job: &str, cols: usize, copied: bool) -> Result<Self> {
        if copied && path.exists() {
            // A link is refused here.
            let mut old = open_growing(&path)?;
            check_ours(&path, &mut old)?;
            let mut copy = Staged::create(&path)?;
            old.rewind().and_then(|()| std::io::copy(&mut old, copy.file())).map_err(Error::io(&path))?;
            copy.publish()?;
        }
        let id = Self::id(job, cols);
        let mut file = open_growing(&path)?;
        check_ours(&path, &mut file)?;
        file.rewind().map_err(Error::io(&path))?;
        let mut start = || -> std::io::Result<usize> {
            let (mut found, row_bytes) = ([0; HEADER_BYTES as usize], 4 * cols as u64);
            let same = file.read_exact(&mut found).is_ok() && found[..] == id[..];
            if !same {
                file.set_len(0)?;
                file.write_all(&id)?;
            }
            // A run that was killed during a write leaves an incomplete row.
            let rows = (file.metadata()?.len() - HEADER_BYTES) / row_bytes.max(1);
            file.set_len(HEADER_BYTES + rows * row_bytes)?;
            Ok(rows as usize)
        };
        let rows = start().map_err(Error::io(&path))?;
        Ok(Self { path, file, cols, rows })
    }

    /// Removes the rows of the same job at `path`, if they are there.
    ///
    /// # Errors
    /// [`Error::Io`] if they cannot be removed.
    pub fn discard(path: &Path, job: &str, cols: usize) -> Result<()> {
        let mut found = [0; HEADER_BYTES as usize];
        let known = File::open(path).and_then(|mut file| file.read_exact(&mut found));
        if known.is_ok() && found[..] == Self::id(job, cols)[..] {
            std::fs::remove_file(path).map_err(Error::io(path))?;
        }
        Ok(())
    }

    fn id(job: &str, cols: usize) -> Vec<u8> {
        [&MAGIC[..], &Sha256::new().chain_update(job).chain_update(cols.to_le_bytes()).finalize()].concat()
    }

    /// Returns the number of whole rows on disk.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
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
        let bytes: Vec<u8> = samples.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.file.write_all(&bytes).and_then(|()| self.file.sync_data()).map_err(Error::io(&self.path))?;
        self.rows += samples.len() / self.cols.max(1);
        Ok(())
    }

    /// Passes all rows to `take`, in order, in blocks.
    ///
    /// # Errors
    /// [`Error::Io`] if they cannot be read. Errors of `take` are passed on.
    pub fn read(&mut self, take: &mut dyn FnMut(&[f32]) -> Result<()>) -> Result<()> {
        const ROWS_AT_ONCE: usize = 256;
        self.file.seek(SeekFrom::Start(HEADER_BYTES)).map_err(Error::io(&self.path))?;
        let mut left = self.rows;
        while left > 0 {
            let rows = left.min(ROWS_AT_ONCE);
            let mut bytes = vec![0; 4 * rows * self.cols];
            self.file.read_exact(&mut bytes).map_err(Error::io(&self.path))?;
            let samples: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect();
            take(&samples)?;
            left -= rows;
        }
        Ok(())
    }

    /// Removes the file, once its rows are stored elsewhere or not needed.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be removed.
    pub fn remove(self) -> Result<()> {
        let Self { path, file, .. } = self;
        drop(file);
        std::fs::remove_file(&path).map_err(Error::io(&path))
    }
}

/// Refuses a file that no run of this program began. One that was killed at once may have left a part of the magic, a power cut zeros.
fn check_ours(path: &Path, file: &mut File) -> Result<()> {
    let mut found = Vec::new();
    file.rewind().and_then(|()| file.take(MAGIC.len() as u64).read_to_end(&mut found)).map_err(Error::io(path))?;
    if MAGIC.starts_with(&found) || found.iter().all(|byte| *byte == 0) {
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

#[cfg(test)]
mod tests {
    use super::*;

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
        assert_eq!(part.rows(), 2);
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
        for bytes in [&b""[..], b"elunar p", &MAGIC, &[0; 500]] {
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
