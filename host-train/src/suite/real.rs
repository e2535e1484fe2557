//! The built-in list of real scenes: images with a DTM of stereo or altimetry, from a folder of these data sets.

use super::files::map_file;
use super::list::{List, SuiteScene};
use elunar_base::{Error, Result};
use elunar_core::sun::Body;
use elunar_raster::geotiff::{SampleType, WriteOptions, write};
use elunar_raster::{Crs, GeoRef, Raster, source};
use std::path::Path;

/// A data set: a folder with an image and a DTM of the same ground.
struct Set {
    folder: &'static str,
    kind: &'static str,
    image: &'static str,
    truth: &'static str,
    /// Side of the squares of the image's pixels that are averaged to one.
    shrink: usize,
    /// Side of the coarse DTM's pixels, in averaged pixels of the image.
    coarse_px: usize,
    /// True side of the image's pixels, where the files state another, metres.
    pixel_m: Option<f64>,
    /// Whether pixels of the image that are 0 are void.
    zero_is_void: bool,
    /// Prefix of the scenes' names, and upper left corners of square windows; none: the whole image.
    windows: Option<(&'static str, &'static [(usize, usize)])>,
}

/// Every window of the north pole has its own Sun.
const POLE: &[(usize, usize)] = &[(0, 0), (127, 508), (508, 127), (508, 508)];
/// Side of a window, pixels.
const WINDOW_PX: usize = 254;
/// The data sets.
const SETS: [Set; 7] = [
    set("moon_aristarchus_cp_wac", "Moon", ["image_iof_214m.tif", "truth_dtm_214m.tif"]),
    set("mars_noctis_hirise", "Mars", ["image_17.5m.tif", "truth_dtm_17.5m_scale_guessed.tif"]),
    Set {
        // Its product has 3903 x 8962 pixels of 2 m.
        pixel_m: Some(35.85),
        ..set("mars_cerberus_hirise", "Mars", ["image_scale_guessed.tif", "truth_dtm_scale_guessed.tif"])
    },
    Set { shrink: 2, coarse_px: 25, ..set("mars_gale_hirise_1m", "Mars", ["image_1m.tif", "truth_dtm_1m.tif"]) },
    Set {
        zero_is_void: true,
        ..set("mars_candor_hirise", "Mars", ["image_42.26m.tif", "truth_dtm_42.26m_height_scale_guessed.tif"])
    },
    Set { zero_is_void: true, shrink: 2, ..set("mars_gale_hrsc", "Mars", ["image_333m.tif", "truth_dtm_667m.tif"]) },
    Set {
        windows: Some(("north_pole", POLE)),
        ..set("moon_wac_lola_north_pole", "Moon, north pole", ["image_1600m.tif", "truth_dtm_1600m.tif"])
    },
];
/// Wavelength that a Gaussian of 2 pixels halves, pixels. Stereo and altimetry resolve less than their pixel.
const RESOLUTION_PX: f64 = 2.0 / 0.18739;
/// A coarse pixel needs this share of valid heights, a pixel of the image this share of valid pixels.
const LEAST_VALID: [f64; 2] = [0.3, 0.5];
const ABOUT: &str = "Real images with DTMs of stereo or altimetry; the Sun is not told. The coarse DTM is the truth averaged over 20 or 25 \
    pixels of the image, without error. Truth and DTMs are compared after a Gaussian of 2 pixels of the truth. Heights of Noctis, \
    Cerberus and Candor have a guessed scale: only ratios count.";

const fn set(folder: &'static str, kind: &'static str, [image, truth]: [&'static str; 2]) -> Set {
    Set { folder, kind, image, truth, shrink: 1, coarse_px: 20, pixel_m: None, zero_is_void: false, windows: None }
}

/// Makes the scenes of the data sets in `data`, writes their images, coarse DTMs and truths into `out`, and returns their list and the folders
/// of the sets that are absent.
///
/// # Errors
/// [`Error::Input`] if `data` holds none of the sets, or a set is too small. If files cannot be read or written.
pub fn real(data: &Path, out: &Path) -> Result<(List, Vec<String>)> {
    let (there, absent): (Vec<&Set>, Vec<&Set>) = SETS.iter().partition(|set| data.join(set.folder).is_dir());
    if there.is_empty() {
        let expected: Vec<String> =
            SETS.iter().map(|set| format!("{0}/{1} and {0}/{2}", set.folder, set.image, set.truth)).collect();
        return Err(Error::input(format!(
            "{}: expected one or more real scenes ({}), found none",
            data.display(),
            expected.join("; ")
        )));
    }
    std::fs::create_dir_all(out).map_err(Error::io(out))?;
    let mut scene = vec![];
    for set in there {
        scene.extend(scenes(set, &data.join(set.folder), out)?);
    }
    let skipped = absent.iter().map(|set| data.join(set.folder).display().to_string()).collect();
    Ok((List { name: "real".into(), about: ABOUT.into(), scene }, skipped))
}

/// Returns the names of the scenes that [`real`] makes of a folder of data sets.
#[must_use]
pub fn names(data: &Path) -> Vec<String> {
    let of = |set: &Set| match set.windows {
        Some((prefix, windows)) => (0..windows.len()).map(|number| window_name(prefix, number)).collect(),
        None => vec![set.folder.to_string()],
    };
    SETS.iter().filter(|set| data.join(set.folder).is_dir()).flat_map(of).collect()
}

fn window_name(prefix: &str, number: usize) -> String {
    format!("{prefix}_{number}")
}

fn scenes(set: &Set, folder: &Path, out: &Path) -> Result<Vec<SuiteScene>> {
    let read = |file: &str| -> Result<(Raster, GeoRef)> {
        let raster = source::read(&folder.join(file))?;
        let unplaced = || Error::input(format!("{}: expected a place, found none", folder.join(file).display()));
        let georef = raster.georef.clone().ok_or_else(unplaced)?;
        Ok((raster, georef))
    };
    let ((mut image, mut of_image), (mut truth, mut of_truth)) = (read(set.image)?, read(set.truth)?);
    if let Some(pixel_m) = set.pixel_m {
        let times = pixel_m / of_image.transform[1].abs();
        for georef in [&mut of_image, &mut of_truth] {
            [1, 2, 4, 5].into_iter().for_each(|i| georef.transform[i] *= times);
        }
    }
    // Reference systems that a file does not state are those of the other, or of the Moon.
    if of_image.crs.is_empty() {
        of_image.crs = if of_truth.crs.is_empty() {
            Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0)
        } else {
            of_truth.crs.clone()
        };
    }
    truth.georef = Some(GeoRef { crs: of_image.crs.clone(), ..of_truth });
    image.georef = Some(of_image);
    if set.zero_is_void {
        image.samples.iter_mut().filter(|v| **v == 0.0).for_each(|v| *v = f32::NAN);
    }
    if set.shrink > 1 {
        image = means(&image, set.folder, set.shrink, LEAST_VALID[1])?;
    }
    let Some((prefix, windows)) = set.windows else {
        return Ok(vec![scene(set, set.folder.into(), [image, truth], out)?]);
    };
    let cut = |map: &Raster, (row, col): (usize, usize), file: &str| {
        if row + WINDOW_PX > map.rows || col + WINDOW_PX > map.cols {
            let corner = (row + WINDOW_PX, col + WINDOW_PX);
            let what =
                format!("expected at least {} x {} pixels, found {} x {}", corner.0, corner.1, map.rows, map.cols);
            return Err(Error::input(format!("{}: {what}", folder.join(file).display())));
        }
        let samples = (row..row + WINDOW_PX).flat_map(|r| &map.samples[r * map.cols + col..][..WINDOW_PX]);
        let georef = map.georef.as_ref().map(|georef| {
            let [x0, xc, xr, y0, yc, yr] = georef.transform;
            let (r, c) = (row as f64, col as f64);
            GeoRef { transform: [x0 + c * xc + r * xr, xc, xr, y0 + c * yc + r * yr, yc, yr], crs: georef.crs.clone() }
        });
        Ok(Raster { rows: WINDOW_PX, cols: WINDOW_PX, samples: samples.copied().collect(), georef })
    };
    let one = |(number, corner): (usize, &(usize, usize))| {
        let maps = [cut(&image, *corner, set.image)?, cut(&truth, *corner, set.truth)?];
        scene(set, window_name(prefix, number), maps, out)
    };
    windows.iter().enumerate().map(one).collect()
}

/// Writes a scene, with its coarse DTM averaged from the truth.
fn scene(set: &Set, name: String, [image, truth]: [Raster; 2], out: &Path) -> Result<SuiteScene> {
    let column = |map: &Raster| map.georef.as_ref().map_or(1.0, |georef| georef.transform[1].abs());
    let side = ((set.coarse_px as f64 * column(&image) / column(&truth)).round_ties_even() as usize).max(1);
    let coarse = means(&truth, &name, side, LEAST_VALID[0])?;
    let coarse = Raster { samples: filled(&coarse), ..coarse };
    let path = |what: &str| out.join(map_file(&name, what));
    write(&path("image"), &image, &WriteOptions::image(SampleType::F32, "image of a real scene"))?;
    write(&path("coarse"), &coarse, &WriteOptions::heights("truth of a real scene, averaged"))?;
    write(&path("truth"), &truth, &WriteOptions::heights("true DTM of a real scene"))?;
    Ok(SuiteScene {
        kind: set.kind.into(),
        image: Some(path("image")),
        coarse: Some(path("coarse")),
        truth: Some(path("truth")),
        truth_resolution_m: Some(RESOLUTION_PX * column(&truth)),
        ..SuiteScene::named(name)
    })
}

/// Returns means over whole squares of `side` pixels; NaN where less than a share `least` of a square is valid.
pub(super) fn means(map: &Raster, name: &str, side: usize, least: f64) -> Result<Raster> {
    let (rows, cols) = (map.rows / side, map.cols / side);
    if rows == 0 || cols == 0 {
        let what = format!("{name}: expected at least {side} x {side} pixels, found {} x {}", map.rows, map.cols);
        return Err(Error::input(what));
    }
    let mean = |i: usize| {
        let (top, left) = (i / cols * side, i % cols * side);
        let square = (top..top + side).flat_map(|row| &map.samples[row * map.cols + left..][..side]);
        let valid = square.filter(|v| v.is_finite());
        let (sum, count) = valid.fold((0.0, 0_usize), |(sum, count), v| (sum + f64::from(*v), count + 1));
        if count > 0 && count as f64 >= least * (side * side) as f64 { (sum / count as f64) as f32 } else { f32::NAN }
    };
    let wide = side as f64;
    let georef = map.georef.as_ref().map(|georef| {
        let [x0, xc, xr, y0, yc, yr] = georef.transform;
        GeoRef { transform: [x0, xc * wide, xr * wide, y0, yc * wide, yr * wide], crs: georef.crs.clone() }
    });
    Ok(Raster { rows, cols, samples: (0..rows * cols).map(mean).collect(), georef })
}

/// Returns the samples, with that of the nearest valid pixel in every void; the first in order of rows, if several are as near.
fn filled(map: &Raster) -> Vec<f32> {
    let valid: Vec<usize> = (0..map.samples.len()).filter(|i| map.samples[*i].is_finite()).collect();
    let distance = |i: usize, j: usize| {
        (i / map.cols).abs_diff(j / map.cols).pow(2) + (i % map.cols).abs_diff(j % map.cols).pow(2)
    };
    let sample = |i: usize| match map.samples[i] {
        v if v.is_finite() => v,
        v => valid.iter().min_by_key(|j| distance(i, **j)).map_or(v, |j| map.samples[*j]),
    };
    (0..map.samples.len()).map(sample).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::suite::scene::TestScene;

    fn save(
        folder: &Path,
        file: &str,
        (rows, cols): (usize, usize),
        pixel_m: f64,
        value: impl Fn(usize, usize) -> f32,
    ) {
        std::fs::create_dir_all(folder).unwrap();
        let transform = [100.0, pixel_m, 0.0, 900.0, 0.0, -pixel_m];
        let samples = (0..rows * cols).map(|i| value(i / cols, i % cols)).collect();
        let georef = Some(GeoRef { transform, crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0) });
        let raster = Raster { rows, cols, samples, georef };
        write(&folder.join(file), &raster, &WriteOptions::heights("made up")).unwrap();
    }

    #[test]
    fn scenes_are_averaged_and_absent_sets_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let gale = folder.path().join("mars_gale_hirise_1m");
        save(&gale, "image_1m.tif", (110, 160), 1.0, |r, c| (r * 10 + c) as f32);
        // The second coarse pixel is void, the last square is cut.
        save(&gale, "truth_dtm_1m.tif", (110, 160), 1.0, |r, c| {
            if r < 50 && (50..100).contains(&c) { f32::NAN } else { (r + c) as f32 }
        });
        let out = folder.path().join("out");
        let (list, skipped) = real(folder.path(), &out).unwrap();
        assert_eq!((list.scene.len(), skipped.len()), (1, 6));
        assert!(skipped[0].ends_with("moon_aristarchus_cp_wac"), "{skipped:?}");
        let scene = TestScene::make(&list.scene[0]).unwrap();
        assert_eq!((scene.raw_image.rows, scene.raw_image.cols, scene.raw_image.samples[1]), (55, 80, 7.5));
        assert_eq!(scene.raw_image.pixel_m(), Some((2.0, 2.0)));
        assert_eq!((scene.coarse.rows, scene.coarse.cols, scene.coarse_m), (2, 3, 50.0));
        // Means of r + c over 50 x 50 pixels; the void takes the first of the nearest three.
        assert_eq!(scene.coarse.samples, [49.0, 49.0, 149.0, 99.0, 149.0, 199.0]);
        assert_eq!(scene.coarse.georef.unwrap().transform, [100.0, 50.0, 0.0, 900.0, 0.0, -50.0]);
        assert!((scene.entry.truth_resolution_m.unwrap() - 10.673).abs() < 1e-3);
        assert_eq!((scene.sun_deg, scene.entry.kind.as_str()), ((None, None), "Mars"));
    }

    #[test]
    fn the_pole_is_cut_into_windows_and_too_small_a_map_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let pole = folder.path().join("moon_wac_lola_north_pole");
        save(&pole, "image_1600m.tif", (762, 762), 1600.0, |r, c| (r * 762 + c) as f32);
        save(&pole, "truth_dtm_1600m.tif", (762, 762), 1600.0, |r, c| (r * 3 + c) as f32);
        let (list, _) = real(folder.path(), &folder.path().join("out")).unwrap();
        let names: Vec<&str> = list.scene.iter().map(|scene| scene.name.as_str()).collect();
        assert_eq!(names, ["north_pole_0", "north_pole_1", "north_pole_2", "north_pole_3"]);
        let scene = TestScene::make(&list.scene[1]).unwrap();
        assert_eq!((scene.truth.rows, scene.truth.cols, scene.truth.samples[0]), (254, 254, 127.0 * 3.0 + 508.0));
        assert_eq!(scene.raw_image.samples[254], (128 * 762 + 508) as f32);
        let transform = scene.truth.georef.unwrap().transform;
        assert_eq!((transform[0], transform[3]), (100.0 + 508.0 * 1600.0, 900.0 - 127.0 * 1600.0));
        assert_eq!((scene.coarse.rows, scene.coarse_m), (12, 32_000.0));
        save(&pole, "truth_dtm_1600m.tif", (300, 762), 1600.0, |_, _| 0.0);
        let refused = real(folder.path(), &folder.path().join("out")).unwrap_err().to_string();
        assert!(refused.contains("truth_dtm_1600m.tif") && refused.contains("300 x 762"), "{refused}");
    }

    /// The list of the script `suites/external.py` has the same maps.
    #[test]
    fn scenes_are_those_of_the_script() {
        let folder = tempfile::tempdir().unwrap();
        let noctis = folder.path().join("real/mars_noctis_hirise");
        let hill = |r: usize, c: usize| (r as f32 * 0.13).sin() * 30.0 + (c as f32 * 0.07).cos() * 50.0 - 1900.0;
        // A void border, as a turned image has.
        let holed = |r: usize, c: usize| if c + r < 60 || r > 105 { f32::NAN } else { hill(r, c) };
        save(&noctis, "image_17.5m.tif", (125, 170), 17.5, |r, c| 2100.0 + hill(r, c));
        save(&noctis, "truth_dtm_17.5m_scale_guessed.tif", (125, 170), 17.5, holed);
        let gale = folder.path().join("real/mars_gale_hirise_1m");
        save(&gale, "image_1m.tif", (111, 163), 1.0, |r, c| 2000.0 + holed(r, c));
        save(&gale, "truth_dtm_1m.tif", (111, 163), 1.0, holed);
        let cerberus = folder.path().join("real/mars_cerberus_hirise");
        for file in ["image_scale_guessed.tif", "truth_dtm_scale_guessed.tif"] {
            save(&cerberus, file, (125, 170), 31.25, hill);
        }
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/suites/external.py");
        let script =
            format!("import subprocess, sys\nsubprocess.run([sys.executable, {script:?}, '.', 'lists'], check=True)");
        if elunar_testing::rasterio(&script, folder.path()).is_none() {
            return;
        }
        let (list, _) = real(&folder.path().join("real"), &folder.path().join("out")).unwrap();
        let theirs = List::read(&folder.path().join("lists/real.toml")).unwrap();
        assert_eq!((list.scene.len(), &list.about), (3, &theirs.about));
        assert!((list.scene[1].truth_resolution_m.unwrap() / RESOLUTION_PX - 35.85).abs() < 1e-9);
        for (ours, theirs) in list.scene.iter().zip(&theirs.scene) {
            assert_eq!((&ours.name, &ours.kind), (&theirs.name, &theirs.kind));
            assert!((ours.truth_resolution_m.unwrap() / theirs.truth_resolution_m.unwrap() - 1.0).abs() < 1e-12);
            for (ours, theirs) in
                [(&ours.image, &theirs.image), (&ours.coarse, &theirs.coarse), (&ours.truth, &theirs.truth)]
            {
                let [a, b] = [ours, theirs].map(|path| source::read(path.as_ref().unwrap()).unwrap());
                let place = |map: &Raster| map.georef.as_ref().unwrap().transform;
                assert_eq!((a.rows, a.cols, place(&a)), (b.rows, b.cols, place(&b)), "{ours:?}");
                assert!(a.samples.iter().zip(&b.samples).all(|(a, b)| a == b || a.is_nan() && b.is_nan()), "{ours:?}");
            }
        }
    }

    #[test]
    fn a_folder_without_any_set_is_refused_with_the_files_expected() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let refused = real(folder.path(), &out).unwrap_err().to_string();
        assert!(refused.contains("mars_gale_hirise_1m/image_1m.tif") && refused.contains("found none"), "{refused}");
        assert!(!out.exists());
        std::fs::create_dir(folder.path().join("mars_noctis_hirise")).unwrap();
        let refused = real(folder.path(), &out).unwrap_err().to_string();
        assert!(refused.contains("image_17.5m.tif"), "{refused}");
    }
}
