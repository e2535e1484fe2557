//! A folder of GeoTIFF triples (`*_image.tif`, `*_coarse.tif`, `*_truth.tif`) as a source of tiles.

use super::sample::RawTile;
use super::source::TileSource;
use elunar_base::{Error, Result};
use elunar_core::tile::{TILE_COLS, TILE_ROWS};
use elunar_net::illumination::KnownSun;
use elunar_raster::align::{Interpolation, Named, onto, spacing_ratio};
use elunar_raster::{Raster, heights, source};
use std::path::{Path, PathBuf};

/// The files of one scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Triple {
    /// Orbiter image.
    pub image: PathBuf,
    /// Coarse DTM on its own grid.
    pub coarse: PathBuf,
    /// True DTM.
    pub truth: PathBuf,
}

/// Returns the triples of a folder, in order of name.
///
/// # Errors
/// [`Error::Io`] if the folder cannot be read, [`Error::Input`] if it holds no image or an image lacks its DTMs.
pub fn triples(folder: &Path) -> Result<Vec<Triple>> {
    const IMAGE: &str = "_image.tif";
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let image = entry.map_err(Error::io(folder))?.path();
        let Some(stem) = image.to_str().and_then(|name| name.strip_suffix(IMAGE)) else { continue };
        let [coarse, truth] = ["coarse", "truth"].map(|kind| PathBuf::from(format!("{stem}_{kind}.tif")));
        for path in [&coarse, &truth] {
            if !path.exists() {
                let what = format!("{}: expected {} beside it, found none", image.display(), path.display());
                return Err(Error::input(what));
            }
        }
        found.push(Triple { image, coarse, truth });
    }
    found.sort_by(|a, b| a.image.cmp(&b.image));
    if found.is_empty() {
        return Err(Error::input(format!("{}: expected files *{IMAGE}, found none", folder.display())));
    }
    Ok(found)
}

/// One scene in memory: three maps on the image's grid.
struct Scene {
    image: Raster,
    coarse: Raster,
    truth: Raster,
    pixel_m: f32,
    coarse_px: f32,
}

/// All whole tiles of a folder's scenes, without overlap and without invalid pixels (Sec. III-A).
pub struct FolderSource {
    scenes: Vec<Scene>,
    /// Scene, first row and first column of each tile.
    tiles: Vec<(usize, usize, usize)>,
    /// Images without a whole valid tile.
    unused: Vec<PathBuf>,
}

impl FolderSource {
    /// Reads the folder's triples and cuts their grids into tiles.
    ///
    /// # Errors
    /// If files are missing or unreadable, do not overlap, or hold no whole valid tile.
    pub fn open(folder: &Path) -> Result<Self> {
        let triples = triples(folder)?;
        let scenes: Vec<Scene> = triples.iter().map(Scene::read).collect::<Result<_>>()?;
        let (mut tiles, mut unused) = (Vec::new(), Vec::new());
        for (index, (scene, triple)) in scenes.iter().zip(triples).enumerate() {
            let before = tiles.len();
            for row in (0..(scene.image.rows + 1).saturating_sub(TILE_ROWS)).step_by(TILE_ROWS) {
                for col in (0..(scene.image.cols + 1).saturating_sub(TILE_COLS)).step_by(TILE_COLS) {
                    let whole = scene.tile(row, col);
                    if [&whole.image, &whole.coarse_m, &whole.truth_m].iter().all(|m| m.iter().all(|v| v.is_finite())) {
                        tiles.push((index, row, col));
                    }
                }
            }
            if tiles.len() == before {
                unused.push(triple.image);
            }
        }
        if tiles.is_empty() {
            let what = format!("expected a scene with {TILE_ROWS}x{TILE_COLS} valid pixels, found none");
            return Err(Error::input(format!("{}: {what}", folder.display())));
        }
        Ok(Self { scenes, tiles, unused })
    }
}

impl TileSource for FolderSource {
    fn tile(&self, index: u64) -> Result<RawTile> {
        let (scene, row, col) = self.tiles[(index % self.tiles.len() as u64) as usize];
        Ok(self.scenes[scene].tile(row, col))
    }

    fn count(&self) -> Option<usize> {
        Some(self.tiles.len())
    }

    fn unused(&self) -> &[PathBuf] {
        &self.unused
    }
}

impl Scene {
    fn read(triple: &Triple) -> Result<Self> {
        let image = source::read(&triple.image)?;
        let name = triple.image.display().to_string();
        let on_image = |path: &Path, how| -> Result<(Raster, f32)> {
            let raster = heights::read(path)?;
            let path = path.display().to_string();
            let (named, image) = (Named::new(&path, &raster), Named::new(&name, &image));
            Ok((onto(named, image, how)?, spacing_ratio(named, image)?))
        };
        let (coarse, coarse_px) = on_image(&triple.coarse, Interpolation::Bicubic)?;
        let (truth, _) = on_image(&triple.truth, Interpolation::Bilinear)?;
        let size = image.pixel_m().ok_or_else(|| Error::input(format!("{name}: expected a pixel size in metres")))?;
        let pixel_m = (size.0 * size.1).sqrt() as f32;
        Ok(Self { image, coarse, truth, pixel_m, coarse_px })
    }

    fn tile(&self, row: usize, col: usize) -> RawTile {
        let cut = |raster: &Raster| -> Vec<f32> {
            let line = |r: usize| &raster.samples[r * raster.cols + col..][..TILE_COLS];
            (row..row + TILE_ROWS).flat_map(|r| line(r).iter().copied()).collect()
        };
        RawTile {
            rows: TILE_ROWS,
            cols: TILE_COLS,
            pixel_m: self.pixel_m,
            coarse_px: self.coarse_px,
            image: cut(&self.image),
            coarse_m: cut(&self.coarse),
            truth_m: cut(&self.truth),
            sun: KnownSun::default(),
        }
    }
}
