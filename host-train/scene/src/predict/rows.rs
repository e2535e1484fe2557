//! The finished rows of a part of a scene, compressed, in a file that appears whole. `join` makes the DTM of them.

use super::span::PartOf;
use elunar_base::output::Staged;
use elunar_base::{Error, Result, read};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// First line of the file.
const MAGIC: &str = "elunar rows 1\n";
/// What it begins with in all versions.
const KIND: &str = "elunar rows ";
/// Rows that are compressed together.
const BLOCK_ROWS: usize = 64;
/// Longest line about a part, bytes.
const MOST_HEAD_BYTES: u64 = 1 << 16;

/// What the file says about its rows: one line of JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RowsHead {
    /// The job ([`super::identity::Identity`]).
    pub job: String,
    /// The part.
    pub part: PartOf,
    /// Its first row in the scene.
    pub first: usize,
    /// Its number of rows.
    pub rows: usize,
    /// Samples of a row, with all maps.
    pub width: usize,
    /// Tiles of the part without contrast or relief.
    pub tiles_coarse: usize,
    /// Tiles of the part without a valid pixel.
    pub tiles_empty: usize,
}

/// Returns the path of a finished part: `dtm.tif.2-of-5.rows` beside `dtm.tif`.
#[must_use]
pub fn rows_path(output: &Path, part: PartOf) -> PathBuf {
    let mut name = output.file_name().unwrap_or_default().to_os_string();
    name.push(format!(".{}-of-{}.rows", part.k, part.n));
    output.with_file_name(name)
}

/// Returns whether a file has the rows of a part, of whatever job.
#[must_use]
pub fn is_rows(path: &Path) -> bool {
    read::begins_with(path, KIND)
}

/// Writes rows that come in blocks.
pub struct RowsWriter {
    path: PathBuf,
    head: RowsHead,
    file: Staged,
    waiting: Vec<f32>,
    given: usize,
}

impl RowsWriter {
    /// Starts the file.
    ///
    /// # Errors
    /// As [`Staged::create`].
    pub fn create(path: &Path, head: RowsHead) -> Result<Self> {
        let mut file = Staged::create(path)?;
        let line = serde_json::to_string(&head).map_err(|e| Error::usage(format!("{}: {e}", path.display())))?;
        file.file().write_all(format!("{MAGIC}{line}\n").as_bytes()).map_err(Error::io(path))?;
        Ok(Self { path: path.into(), head, file, waiting: vec![], given: 0 })
    }

    /// Adds samples of whole rows.
    ///
    /// # Errors
    /// [`Error::Io`] if they cannot be written.
    pub fn add(&mut self, samples: &[f32]) -> Result<()> {
        self.given += samples.len();
        self.waiting.extend_from_slice(samples);
        let block = BLOCK_ROWS * self.head.width;
        while self.waiting.len() >= block && block > 0 {
            let rest = self.waiting.split_off(block);
            self.write()?;
            self.waiting = rest;
        }
        Ok(())
    }

    /// Completes the file and gives it its path.
    ///
    /// # Errors
    /// [`Error::Usage`] if rows are missing; as [`Staged::publish`].
    pub fn finish(mut self) -> Result<()> {
        let expected = self.head.rows * self.head.width;
        if self.given != expected {
            let what = format!("{expected} samples expected, {} given", self.given);
            return Err(Error::usage(format!("{}: {what}", self.path.display())));
        }
        if !self.waiting.is_empty() {
            self.write()?;
        }
        self.file.publish()
    }

    fn write(&mut self) -> Result<()> {
        let bytes: Vec<u8> = self.waiting.iter().flat_map(|v| v.to_le_bytes()).collect();
        let mut pack = || -> std::io::Result<()> {
            let packed = packing::pack(&bytes)?;
            let mut out = BufWriter::new(self.file.file());
            out.write_all(&(packed.len() as u32).to_le_bytes())?;
            out.write_all(&packed)?;
            out.flush()
        };
        pack().map_err(Error::io(&self.path))?;
        self.waiting.clear();
        Ok(())
    }
}

/// Reads a finished part.
pub struct RowsReader {
    path: PathBuf,
    /// What the file says about its rows.
    pub head: RowsHead,
    file: BufReader<File>,
}

impl RowsReader {
    /// Opens a part.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read, [`Error::Broken`] if it is no part.
    pub fn open(path: &Path) -> Result<Self> {
        let mut file = BufReader::new(read::file(path)?);
        let mut text = String::new();
        let mut line = |text: &mut String| file.by_ref().take(MOST_HEAD_BYTES).read_line(text);
        let found = line(&mut text).and_then(|_| line(&mut text));
        let head = text.strip_prefix(MAGIC).map(serde_json::from_str);
        match (found, head) {
            (Ok(_), Some(Ok(head))) => Ok(Self { path: path.into(), head, file }),
            _ => Err(Error::broken(path, "the rows of a part expected, something else found")),
        }
    }

    /// Passes all rows to `take`, in order, in blocks.
    ///
    /// # Errors
    /// [`Error::Broken`] if the file is damaged or cut. Errors of `take` are passed on.
    pub fn read(mut self, take: &mut dyn FnMut(&[f32]) -> Result<()>) -> Result<()> {
        let width = self.head.width;
        let mut left = self.head.rows;
        while left > 0 {
            let rows = left.min(BLOCK_ROWS);
            let bytes =
                self.block(4 * rows * width).map_err(|e| Error::broken(&self.path, format!("rows expected: {e}")))?;
            let samples: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect();
            take(&samples)?;
            left -= rows;
        }
        Ok(())
    }

    fn block(&mut self, bytes: usize) -> std::io::Result<Vec<u8>> {
        let mut length = [0; 4];
        self.file.read_exact(&mut length)?;
        let mut packed = vec![];
        let length = u64::from(u32::from_le_bytes(length));
        if self.file.by_ref().take(length).read_to_end(&mut packed)? as u64 != length {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
        let found = packing::unpack(&packed, bytes)?;
        if found.len() == bytes { Ok(found) } else { Err(std::io::ErrorKind::InvalidData.into()) }
    }
}

#[cfg(not(target_family = "wasm"))]
mod packing {
    use std::io::Result;

    pub(super) fn pack(bytes: &[u8]) -> Result<Vec<u8>> {
        zstd::bulk::compress(bytes, 1)
    }

    pub(super) fn unpack(packed: &[u8], bytes: usize) -> Result<Vec<u8>> {
        zstd::bulk::decompress(packed, bytes)
    }
}

/// Zstandard is C, which is not compiled for WebAssembly. No part is made there.
#[cfg(target_family = "wasm")]
mod packing {
    use std::io::{ErrorKind, Result};

    pub(super) fn pack(_: &[u8]) -> Result<Vec<u8>> {
        Err(ErrorKind::Unsupported.into())
    }

    pub(super) fn unpack(_: &[u8], _: usize) -> Result<Vec<u8>> {
        Err(ErrorKind::Unsupported.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head(rows: usize) -> RowsHead {
        let part = PartOf { k: 2, n: 3 };
        RowsHead { job: "j".into(), part, first: 7, rows, width: 3, tiles_coarse: 1, tiles_empty: 0 }
    }

    fn all(path: &Path) -> Result<Vec<f32>> {
        let mut all = vec![];
        RowsReader::open(path)?.read(&mut |rows| {
            all.extend_from_slice(rows);
            Ok(())
        })?;
        Ok(all)
    }

    #[test]
    fn rows_read_back_and_a_cut_or_damaged_file_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = rows_path(&folder.path().join("dtm.tif"), PartOf { k: 2, n: 3 });
        assert!(path.ends_with("dtm.tif.2-of-3.rows"));
        for rows in [0, 1, 64, 200] {
            let samples: Vec<f32> = (0..3 * rows).map(|i| i as f32 * 0.5).collect();
            let mut writer = RowsWriter::create(&path, head(rows)).unwrap();
            samples.chunks(3 * 7).for_each(|some| writer.add(some).unwrap());
            writer.finish().unwrap();
            assert_eq!(RowsReader::open(&path).unwrap().head, head(rows));
            assert_eq!(all(&path).unwrap(), samples);
        }
        assert!(RowsWriter::create(&path, head(2)).unwrap().finish().is_err(), "rows are missing");
        let whole = std::fs::read(&path).unwrap();
        for cut in [0, 10, 40, whole.len() / 2, whole.len() - 1] {
            std::fs::write(&path, &whole[..cut]).unwrap();
            assert!(matches!(all(&path), Err(Error::Broken { .. })), "{cut}");
        }
    }
}
