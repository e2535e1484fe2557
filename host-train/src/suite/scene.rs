//! The scene of a list's entry: image, coarse DTM and truth are read, rendered or made.

use super::files::map_file;
use super::list::SuiteScene;
use elunar_base::{Error, Result};
use elunar_raster::align::{Interpolation, Named, onto};
use elunar_raster::geotiff::{SampleType, WriteOptions, write};
use elunar_raster::stated::Statements;
use elunar_raster::{GeoRef, Raster, heights, source};
use elunar_scene::predict::{NamedRaster, Scene};
use elunar_synth::{COARSE_PIXEL_M, Moon, photograph};
use std::path::{Path, PathBuf};

/// Shortest wavelength of the default high-pass, metres. A coarse DTM of 59 m resolves no shorter waves.
const HIGH_PASS_M: f64 = 60.0;
/// Seed of the camera for rendered images.
const CAMERA_SEED: u64 = 1;

/// A scene in memory.
pub struct TestScene {
    /// The entry of the list.
    pub entry: SuiteScene,
    /// Image and coarse DTM as input of a network.
    pub input: Scene,
    /// The image on the truth's grid.
    pub image: Raster,
    /// The image on its own grid.
    pub raw_image: Raster,
    /// The coarse DTM on its own grid, metres.
    pub coarse: Raster,
    /// True DTM, metres.
    pub truth: Raster,
    /// Azimuth and elevation of the Sun, degrees; `None` if unknown.
    pub sun_deg: (Option<f64>, Option<f64>),
    /// Pixel of the truth (row, column), metres.
    pub pixel_m: (f64, f64),
    /// Side of the coarse DTM's pixels, metres.
    pub coarse_m: f64,
    /// Wavelength that separates long and short waves, metres.
    pub high_pass_m: f64,
}

impl TestScene {
    /// Makes or reads the scene.
    ///
    /// # Errors
    /// If files cannot be read or do not fit each other, or a synthetic scene's options are out of range.
    pub fn make(entry: &SuiteScene) -> Result<Self> {
        let (image, coarse, truth, sun_deg) = match &entry.synth {
            Some(synth) => {
                let made = Moon::new(synth.seed, synth.options.clone())?;
                let made = made.scene(synth.index, synth.options.rows, synth.options.cols)?;
                let sun = (Some(made.sun_azimuth_deg), Some(made.sun_elevation_deg));
                (made.image_raster(), made.coarse_raster(), made.truth_raster(), sun)
            }
            None => files(entry)?,
        };
        let named = |what: &str| format!("{}: {what}", entry.name);
        let (truth_name, coarse_name) = (named("truth"), named("coarse DTM"));
        let unknown = || Error::input(format!("{truth_name}: pixel size in metres unknown"));
        let pixel_m = truth.pixel_m().ok_or_else(unknown)?;
        let (row_m, col_m) =
            coarse.pixel_m().ok_or_else(|| Error::input(format!("{coarse_name}: pixel size unknown")))?;
        let coarse_m = (row_m * col_m).sqrt();
        let input = Scene::new(
            NamedRaster::in_memory(named("image"), image.clone()),
            NamedRaster::in_memory(coarse_name, coarse.clone()),
        )?;
        let on_truth =
            onto(Named::new(&named("image"), &image), Named::new(&truth_name, &truth), Interpolation::Bilinear)?;
        Ok(Self {
            entry: entry.clone(),
            input,
            image: on_truth,
            raw_image: image,
            coarse,
            truth,
            sun_deg,
            pixel_m,
            coarse_m,
            high_pass_m: entry.high_pass_m.unwrap_or(HIGH_PASS_M.max(coarse_m)),
        })
    }

    /// Writes `NAME_image.tif`, `NAME_coarse.tif` and `NAME_truth.tif`, for other programs.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let file = |what: &str| folder.join(map_file(&self.entry.name, what));
        let (azimuth, elevation) = self.sun_deg;
        let image = WriteOptions::image(SampleType::F32, "image of a test scene, relative brightness")
            .with_sun(azimuth, elevation);
        write(&file("image"), &self.raw_image, &image)?;
        write(&file("coarse"), &self.coarse, &WriteOptions::heights("coarse DTM of a test scene"))?;
        write(&file("truth"), &self.truth, &WriteOptions::heights("true DTM of a test scene"))
    }
}

/// Image, coarse DTM, truth, and the Sun's azimuth and elevation.
type Parts = (Raster, Raster, Raster, (Option<f64>, Option<f64>));

fn files(entry: &SuiteScene) -> Result<Parts> {
    let srs = entry.crs().map_err(Error::input)?;
    let stated = || Statements { srs: srs.clone(), unit: None };
    let read = |path: &PathBuf, is_image: bool| -> Result<Raster> {
        let name = path.display().to_string();
        let source = match is_image {
            true => stated().of(&name, source::open(path)?)?,
            false => heights::open_with(path, stated(), None)?,
        };
        let (info, whole) = (
            source.info().clone(),
            elunar_core::tile::Window { row: 0, col: 0, rows: source.info().rows, cols: source.info().cols },
        );
        info.place(&name)?;
        Ok(Raster { rows: info.rows, cols: info.cols, samples: source.read(whole)?, georef: info.georef })
    };
    let missing = || Error::input(format!("scene {}: expected a truth, found none", entry.name));
    let truth = read(entry.truth.as_ref().ok_or_else(missing)?, false)?;
    let sun = (entry.sun_azimuth_deg, entry.sun_elevation_deg);
    let image = match (&entry.image, sun) {
        (Some(path), _) => read(path, true)?,
        (None, (Some(azimuth_deg), Some(elevation_deg))) => {
            photograph(&truth, (azimuth_deg, elevation_deg), CAMERA_SEED)?
        }
        _ => return Err(Error::input(format!("scene {}: expected an image, or the Sun to make one", entry.name))),
    };
    let coarse = match &entry.coarse {
        Some(path) => read(path, false)?,
        None => average(&truth, coarse_px(entry, &truth)?)?,
    };
    Ok((image, coarse, truth, sun))
}

fn coarse_px(entry: &SuiteScene, truth: &Raster) -> Result<usize> {
    let side_m = truth.pixel_m().map(|(row_m, col_m)| (row_m * col_m).sqrt());
    let side_m =
        side_m.ok_or_else(|| Error::input(format!("scene {}: pixel size of the truth unknown", entry.name)))?;
    Ok(entry.coarse_px.unwrap_or_else(|| ((COARSE_PIXEL_M / side_m).round() as usize).max(2)))
}

/// Returns means over blocks of `side` x `side` pixels. Blocks at the far edges keep their size, and the mean is over the existing pixels.
/// A block with less than half valid pixels is void.
fn average(fine: &Raster, side: usize) -> Result<Raster> {
    let georef = fine.georef.as_ref().ok_or_else(|| Error::input("averaging: a raster with a place expected"))?;
    let (rows, cols) = (fine.rows.div_ceil(side), fine.cols.div_ceil(side));
    let mut sums = vec![(0.0, 0_usize, 0_usize); rows * cols];
    for (i, v) in fine.samples.iter().enumerate() {
        let (sum, valid, all) = &mut sums[i / fine.cols / side * cols + i % fine.cols / side];
        *all += 1;
        if v.is_finite() {
            *sum += f64::from(*v);
            *valid += 1;
        }
    }
    let mean = |&(sum, valid, all): &(f64, usize, usize)| {
        if 2 * valid >= all { (sum / valid as f64) as f32 } else { f32::NAN }
    };
    let [x0, xc, xr, y0, yc, yr] = georef.transform;
    let wide = side as f64;
    let transform = [x0, xc * wide, xr * wide, y0, yc * wide, yr * wide];
    let georef = GeoRef { transform, crs: georef.crs.clone() };
    Ok(Raster { rows, cols, samples: sums.iter().map(mean).collect(), georef: Some(georef) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::suite::list::List;
    use elunar_core::sun::Body;
    use elunar_raster::Crs;

    fn dtm(rows: usize, cols: usize) -> Raster {
        let georef = GeoRef {
            transform: [700.0, 2.0, 0.0, 900.0, 0.0, -2.0],
            crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0),
        };
        let height = |i: usize| 0.3 * (i / cols) as f32 + (0.9 * (i % cols) as f32).sin();
        Raster { rows, cols, samples: (0..rows * cols).map(height).collect(), georef: Some(georef) }
    }

    #[test]
    fn averages_keep_means_and_places() {
        let mut fine = dtm(64, 95);
        fine.samples[0] = f32::NAN;
        (0..64).for_each(|row| fine.samples[row * 95 + 90..][..5].fill(f32::NAN));
        let made = average(&fine, 30).unwrap();
        assert_eq!((made.rows, made.cols), (3, 4));
        assert_eq!(made.georef.as_ref().unwrap().transform, [700.0, 60.0, 0.0, 900.0, 0.0, -60.0]);
        let block = |r: usize, c: usize| fine.samples[r * 95 + c];
        let expected: f32 =
            (30..60).flat_map(|r| (30..60).map(move |c| (r, c))).map(|(r, c)| block(r, c)).sum::<f32>() / 900.0;
        assert!((made.samples[5] - expected).abs() < 1e-4);
        assert!(made.samples[0].is_finite() && made.samples[3].is_nan());
    }

    #[test]
    fn a_truth_and_a_sun_make_a_scene() {
        let folder = tempfile::tempdir().unwrap();
        write(&folder.path().join("t.tif"), &dtm(96, 128), &WriteOptions::heights("test")).unwrap();
        let list = folder.path().join("list.toml");
        let text =
            "name = 'n'\n[[scene]]\nname = 's'\ntruth = 't.tif'\nsun_azimuth_deg = 270\nsun_elevation_deg = 30\n";
        std::fs::write(&list, text).unwrap();
        let scene = TestScene::make(&List::read(&list).unwrap().scene[0]).unwrap();
        assert_eq!((scene.coarse.rows, scene.coarse.cols, scene.coarse_m), (4, 5, 60.0));
        assert_eq!((scene.sun_deg, scene.high_pass_m), ((Some(270.0), Some(30.0)), 60.0));
        scene.write(folder.path()).unwrap();
        let again = source::read(&folder.path().join("s_coarse.tif")).unwrap();
        assert_eq!(again.samples, scene.coarse.samples);
        // The scene's files make a scene themselves.
        let text = "name = 'n'\n[[scene]]\nname = 's'\nimage = 's_image.tif'\ncoarse = 's_coarse.tif'\ntruth = 's_truth.tif'\n";
        std::fs::write(&list, text).unwrap();
        let again = TestScene::make(&List::read(&list).unwrap().scene[0]).unwrap();
        assert_eq!((again.image.samples, again.sun_deg), (scene.image.samples, (None, None)));
    }
}
