//! Files of tiles: safetensors with one row per tile.
//!
//! | tensor | type and shape | what |
//! |---|---|---|
//! | `image` | f32 `[N, 256, 320]` | relative brightness, as in the image file |
//! | `coarse_m` | f32 `[N, 256, 320]` | coarse DTM on the image's grid, metres |
//! | `truth_m` | f32 `[N, 256, 320]` | true DTM on the image's grid, metres |
//! | `pixel_m` | f32 `[N, 2]` | ground size of a pixel from row to row and from column to column, metres |
//! | `coarse_px` | f32 `[N]` | side of a pixel of the coarse DTM on its own grid, pixels of the image |
//! | `sun_azimuth_deg` | f32 `[N]` | azimuth of the Sun, degrees clockwise from up; NaN where unknown |
//! | `sun_elevation_deg` | f32 `[N]` | its elevation above the horizon, degrees; NaN where unknown |
//! | `offset_px` | f32 `[N, 2]` | measured offset of the true DTM from the image, downwards and to the right; NaN where unknown |
//! | `scene` | i32 `[N]` | number of the scene in the manifest |
//! | `transform` | f64 `[N, 6]` | pixel-to-map transform in GDAL's order |

use crate::sample::RawTile;
use elunar_base::{Error, Result, atomic_write, read};
use elunar_core::tile::{TILE_COLS, TILE_ROWS};
use elunar_net::illumination::KnownSun;
use elunar_net::sun::{check_azimuth, check_elevation};
use safetensors::tensor::{Dtype, Metadata, TensorView};
use std::collections::HashMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Number of pixels of a tile.
const TILE_PX: usize = TILE_ROWS * TILE_COLS;

/// Longest header that is accepted, bytes.
const LONGEST_HEADER: u64 = 1 << 20;

/// The tiles of one shard. Every list has one entry per tile.
#[derive(Debug, Clone, Default)]
pub(super) struct Shard {
    pub(super) image: Vec<f32>,
    pub(super) coarse_m: Vec<f32>,
    pub(super) truth_m: Vec<f32>,
    pub(super) pixel_m: Vec<f32>,
    pub(super) coarse_px: Vec<f32>,
    pub(super) sun_azimuth_deg: Vec<f32>,
    pub(super) sun_elevation_deg: Vec<f32>,
    pub(super) offset_px: Vec<f32>,
    pub(super) scene: Vec<i32>,
    pub(super) transform: Vec<f64>,
}

impl Shard {
    /// Returns the number of tiles.
    pub(super) fn len(&self) -> usize {
        self.scene.len()
    }

    /// Writes the file, whole or not at all. `about` is stored in its metadata under that name.
    pub(super) fn write(&self, path: &Path, about: &str) -> Result<()> {
        let n = self.len();
        let f32s = |values: &[f32]| -> Vec<u8> { values.iter().flat_map(|v| v.to_le_bytes()).collect() };
        let maps = vec![n, TILE_ROWS, TILE_COLS];
        let entries = [
            ("image", Dtype::F32, maps.clone(), f32s(&self.image)),
            ("coarse_m", Dtype::F32, maps.clone(), f32s(&self.coarse_m)),
            ("truth_m", Dtype::F32, maps, f32s(&self.truth_m)),
            ("pixel_m", Dtype::F32, vec![n, 2], f32s(&self.pixel_m)),
            ("coarse_px", Dtype::F32, vec![n], f32s(&self.coarse_px)),
            ("sun_azimuth_deg", Dtype::F32, vec![n], f32s(&self.sun_azimuth_deg)),
            ("sun_elevation_deg", Dtype::F32, vec![n], f32s(&self.sun_elevation_deg)),
            ("offset_px", Dtype::F32, vec![n, 2], f32s(&self.offset_px)),
            ("scene", Dtype::I32, vec![n], self.scene.iter().flat_map(|v| v.to_le_bytes()).collect()),
            ("transform", Dtype::F64, vec![n, 6], self.transform.iter().flat_map(|v| v.to_le_bytes()).collect()),
        ];
        let wrong = |e: safetensors::SafeTensorError| Error::input(format!("{}: {e}", path.display()));
        let views: Result<Vec<(&str, TensorView)>> = entries
            .iter()
            .map(|(name, dtype, shape, bytes)| {
                Ok((*name, TensorView::new(*dtype, shape.clone(), bytes).map_err(wrong)?))
            })
            .collect();
        // A single entry, because several would be written in random order.
        let metadata = HashMap::from([("about".to_owned(), about.to_owned())]);
        atomic_write(path, &safetensors::serialize(views?, Some(metadata)).map_err(wrong)?)
    }
}

/// A shard open for reading, tile by tile. Only its small tensors are in memory.
pub struct ShardFile {
    path: PathBuf,
    file: Mutex<File>,
    /// Byte offsets of image, coarse DTM and true DTM in the file.
    maps: [u64; 3],
    pixel_m: Vec<f32>,
    coarse_px: Vec<f32>,
    sun_azimuth_deg: Vec<f32>,
    sun_elevation_deg: Vec<f32>,
}

impl ShardFile {
    /// Opens a shard and checks its layout.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read, [`Error::Broken`] if it is not a whole shard of 256 x 320 tiles.
    pub fn open(path: &Path) -> Result<Self> {
        let mut file = read::file(path)?;
        let length = file.metadata().map_err(Error::io(path))?.len();
        let mut count = [0; 8];
        file.read_exact(&mut count)
            .map_err(|_| Error::broken(path, format!("a shard expected, {length} bytes found")))?;
        let count = u64::from_le_bytes(count);
        if count > LONGEST_HEADER.min(length.saturating_sub(8)) {
            return Err(Error::broken(
                path,
                format!("a header of at most {LONGEST_HEADER} bytes expected, {count} found"),
            ));
        }
        let mut header = vec![0; count as usize];
        file.read_exact(&mut header).map_err(Error::io(path))?;
        let header: Metadata =
            serde_json::from_slice(&header).map_err(|e| Error::broken(path, format!("header: {e}")))?;
        let start = 8 + count;
        let expected = start + header.data_len() as u64;
        if length != expected {
            return Err(Error::broken(path, format!("{expected} bytes expected, {length} found")));
        }
        let tiles = header.info("scene").and_then(|info| info.shape.first().copied()).unwrap_or(0);
        let tensor = |name: &str, shape: &[usize]| {
            let info = header.info(name).filter(|info| info.dtype == Dtype::F32 && info.shape == shape);
            info.map(|info| start + info.data_offsets.0 as u64)
                .ok_or_else(|| Error::broken(path, format!("a tensor {name} of F32 {shape:?} expected, none found")))
        };
        let map = [tiles, TILE_ROWS, TILE_COLS];
        let maps = [tensor("image", &map)?, tensor("coarse_m", &map)?, tensor("truth_m", &map)?];
        let pixel_m = numbers(&mut file, path, tensor("pixel_m", &[tiles, 2])?, 2 * tiles)?;
        let coarse_px = numbers(&mut file, path, tensor("coarse_px", &[tiles])?, tiles)?;
        let sun_azimuth_deg = numbers(&mut file, path, tensor("sun_azimuth_deg", &[tiles])?, tiles)?;
        let sun_elevation_deg = numbers(&mut file, path, tensor("sun_elevation_deg", &[tiles])?, tiles)?;
        for (index, sun) in sun_azimuth_deg.iter().zip(&sun_elevation_deg).enumerate() {
            let wrong = |error: Error| Error::broken(path, format!("tile {index}: {error}"));
            known(*sun.0).map_or(Ok(()), |deg| check_azimuth("sun_azimuth_deg", deg)).map_err(wrong)?;
            known(*sun.1).map_or(Ok(()), |deg| check_elevation("sun_elevation_deg", deg)).map_err(wrong)?;
        }
        Ok(Self {
            path: path.into(),
            file: Mutex::new(file),
            maps,
            pixel_m,
            coarse_px,
            sun_azimuth_deg,
            sun_elevation_deg,
        })
    }

    /// Returns the number of tiles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.coarse_px.len()
    }

    /// Returns whether the shard has no tile.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Reads tile `index`, below [`Self::len`].
    ///
    /// # Errors
    /// [`Error::Input`] if there is no such tile, [`Error::Io`] if it cannot be read.
    pub fn tile(&self, index: usize) -> Result<RawTile> {
        if index >= self.len() {
            return Err(Error::input(format!(
                "{}: {} tiles, number {index} asked for",
                self.path.display(),
                self.len()
            )));
        }
        let [image, coarse_m, truth_m] = {
            // A reader that panicked leaves no bad state, because every read seeks first.
            let mut file = self.file.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            let at = |start: u64| start + (index * TILE_PX * size_of::<f32>()) as u64;
            let mut read = |start: u64| numbers(&mut file, &self.path, at(start), TILE_PX);
            [read(self.maps[0])?, read(self.maps[1])?, read(self.maps[2])?]
        };
        let (azimuth_deg, elevation_deg) = (self.sun_azimuth_deg[index], self.sun_elevation_deg[index]);
        Ok(RawTile {
            rows: TILE_ROWS,
            cols: TILE_COLS,
            pixel_m: (self.pixel_m[2 * index] * self.pixel_m[2 * index + 1]).sqrt(),
            image,
            coarse_m,
            truth_m,
            coarse_px: self.coarse_px[index],
            sun: KnownSun { azimuth_deg: known(azimuth_deg), elevation_deg: known(elevation_deg) },
        })
    }
}

/// Returns an angle of a shard, degrees; NaN means that it is not known.
fn known(deg: f32) -> Option<f64> {
    (!deg.is_nan()).then_some(f64::from(deg))
}

fn numbers(file: &mut File, path: &Path, at: u64, count: usize) -> Result<Vec<f32>> {
    let mut bytes = vec![0; count * size_of::<f32>()];
    file.seek(SeekFrom::Start(at)).map_err(Error::io(path))?;
    file.read_exact(&mut bytes).map_err(Error::io(path))?;
    Ok(bytes.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shard(tiles: usize) -> Shard {
        let map = |k: usize| (0..tiles * TILE_PX).map(|i| (i % 9973) as f32 + k as f32 * 0.25).collect();
        Shard {
            image: map(0),
            coarse_m: map(1),
            truth_m: map(2),
            pixel_m: [2.0, 8.0].repeat(tiles),
            coarse_px: vec![30.0; tiles],
            sun_azimuth_deg: (0..tiles).map(|i| if i == 0 { f32::NAN } else { 90.0 }).collect(),
            sun_elevation_deg: (0..tiles).map(|i| if i == 1 { f32::NAN } else { 30.0 }).collect(),
            offset_px: vec![0.5; 2 * tiles],
            scene: vec![7; tiles],
            transform: vec![1.5; 6 * tiles],
        }
    }

    #[test]
    fn tiles_come_back_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.safetensors");
        let written = shard(3);
        written.write(&path, "a test").unwrap();
        let file = ShardFile::open(&path).unwrap();
        assert_eq!(file.len(), 3);
        for index in [2, 0, 1] {
            let tile = file.tile(index).unwrap();
            let part = index * TILE_PX..(index + 1) * TILE_PX;
            assert_eq!(tile.image, written.image[part.clone()]);
            assert_eq!(tile.coarse_m, written.coarse_m[part.clone()]);
            assert_eq!(tile.truth_m, written.truth_m[part]);
            assert_eq!((tile.pixel_m, tile.coarse_px), (4.0, 30.0));
            assert_eq!(tile.sun.azimuth_deg, (index > 0).then_some(90.0));
            assert_eq!(tile.sun.elevation_deg, (index != 1).then_some(30.0));
        }
        assert!(file.tile(3).is_err());
        let again = folder.path().join("t.safetensors");
        written.write(&again, "a test").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), std::fs::read(&again).unwrap(), "the same tiles are the same bytes");
    }

    #[test]
    fn a_sun_out_of_range_is_no_shard() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.safetensors");
        for (azimuth_deg, elevation_deg, expected) in [
            (10.0, -1.0, "tile 1: sun_elevation_deg: a number above 0 and below 90 degrees expected, found -1"),
            (10.0, f32::INFINITY, "found inf"),
            (400.0, 30.0, "tile 1: sun_azimuth_deg"),
        ] {
            let mut wrong = shard(2);
            (wrong.sun_azimuth_deg[1], wrong.sun_elevation_deg[1]) = (azimuth_deg, elevation_deg);
            wrong.write(&path, "a test").unwrap();
            let error = ShardFile::open(&path).err().expect("refused").to_string();
            assert!(error.contains(expected) && error.contains("s.safetensors"), "{error}");
        }
    }

    #[test]
    fn broken_shards_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.safetensors");
        shard(1).write(&path, "a test").unwrap();
        let whole = std::fs::read(&path).unwrap();
        let refused = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            ShardFile::open(&path).err().expect("refused").to_string()
        };
        assert!(refused(&whole[..whole.len() - 1]).contains("bytes expected"));
        assert!(refused(&whole[..5]).contains("a shard expected"));
        assert!(refused(&[255; 64]).contains("a header of at most"));
        assert!(refused(b"\x02\0\0\0\0\0\0\0{}").contains("a tensor image of F32"));
        let mut wrong = whole.clone();
        wrong[9] = b'X';
        assert!(refused(&wrong).contains("s.safetensors"));
    }
}
