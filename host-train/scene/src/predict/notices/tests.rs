//! Ordinary scenes have no warning, and each warning has its cause.

use super::super::job::Finished;
use super::super::sun::{AngleSource, KnownFrom};
use super::super::{NamedRaster, Scene, Survey};
use super::light::share_of_relief;
use super::{check_exchange, notice_of_heights, notices};
use elunar_core::nn::Illumination;
use elunar_core::sun::Body;
use elunar_net::illumination::KnownSun;
use elunar_raster::Raster;
use elunar_raster::source::InMemory;
use elunar_synth::{Moon, SynthOptions, SynthScene};
use std::sync::Arc;

const ROWS: usize = 512;
const COLS: usize = 640;

fn made(index: u64, options: SynthOptions) -> SynthScene {
    Moon::new(4711, options).unwrap().scene(index, ROWS, COLS).unwrap()
}

fn input(name: &str, raster: Raster, unit: Option<&str>, format: &str) -> NamedRaster {
    NamedRaster { name: name.into(), source: Arc::new(InMemory::new(raster, unit.map(String::from), format)) }
}

fn scene(image: Raster, coarse: Raster) -> Scene {
    let format = "GeoTIFF, f32";
    Scene::new(input("i.tif", image, None, format), input("c.tif", coarse, Some("m"), format)).unwrap()
}

fn told(azimuth_deg: f64, elevation_deg: f64) -> KnownFrom {
    let sun = KnownSun { azimuth_deg: Some(azimuth_deg), elevation_deg: Some(elevation_deg) };
    KnownFrom { sun, ..KnownFrom::default() }
}

/// Returns the warnings, the survey and the share of relief.
fn warned(scene: &Scene, sun: &KnownFrom) -> (Vec<String>, Survey, Option<f32>) {
    let survey = scene.survey().unwrap();
    let lighting = survey.lighting(Illumination::Weighed, sun.sun);
    let found = notices(scene, &survey, sun, &lighting, false).unwrap();
    let share = share_of_relief(&survey, &lighting);
    (found, survey, share)
}

/// Returns the only warning.
fn the_one(scene: &Scene, sun: &KnownFrom) -> String {
    let (mut found, ..) = warned(scene, sun);
    assert_eq!(found.len(), 1, "{found:?}");
    found.remove(0)
}

#[test]
fn ordinary_scenes_have_no_warning() {
    let (mut least_share, mut least_contrast) = (f32::INFINITY, f64::INFINITY);
    let (usual, low) = (SynthOptions::default(), (7.0, 18.0));
    let kinds = [
        (0..24, usual.clone()),
        (24..32, SynthOptions { sun_elevation_deg: low, ..usual.clone() }),
        (32..36, SynthOptions { albedo_contrast: (4.0, 4.0), ..usual }),
    ];
    for (index, options) in kinds.iter().flat_map(|(indices, options)| indices.clone().map(move |i| (i, options))) {
        let made = made(index, options.clone());
        let scene = scene(made.image_raster(), made.coarse_raster());
        for sun in [told(made.sun_azimuth_deg, made.sun_elevation_deg), KnownFrom::default()] {
            let (found, survey, share) = warned(&scene, &sun);
            assert!(found.is_empty(), "{index}: {found:?}");
            least_share = least_share.min(share.unwrap_or(1.0));
            least_contrast = least_contrast.min(survey.brightness.contrast());
        }
    }
    println!("least share of relief {least_share:.2}, least contrast {least_contrast:.4}");
    assert!(least_share > 0.2 && least_contrast > 0.02);
}

#[test]
fn a_sun_against_the_fit_is_told() {
    let made = made(2, SynthOptions::default());
    let scene = scene(made.image_raster(), made.coarse_raster());
    let (azimuth_deg, elevation_deg) = (made.sun_azimuth_deg, made.sun_elevation_deg);
    for off_deg in [-15.0, 0.0, 15.0, 360.0] {
        let (found, ..) = warned(&scene, &told((azimuth_deg + off_deg) % 360.0, elevation_deg));
        assert!(found.is_empty(), "{off_deg}: {found:?}");
    }
    for off_deg in [50.0, 90.0, -90.0, 180.0] {
        let text = the_one(&scene, &told((azimuth_deg + off_deg) % 360.0, elevation_deg));
        assert!(text.starts_with("--sun-azimuth is ") && text.contains("show a Sun at "), "{text}");
        assert!(text.contains("clockwise from the grid's up"), "{text}");
    }
    let of_file = KnownFrom { azimuth_from: AngleSource::File, ..told((azimuth_deg + 90.0) % 360.0, elevation_deg) };
    let text = the_one(&scene, &of_file);
    assert!(text.starts_with("the Sun's azimuth in the image's file is") && text.contains("--fit-sun"), "{text}");
    // A network that takes no light cannot be misled.
    let survey = scene.survey().unwrap();
    let lighting = survey.lighting(Illumination::Any, of_file.sun);
    assert_eq!(notices(&scene, &survey, &of_file, &lighting, false).unwrap(), [""; 0]);
    // An image that shows no Sun contradicts none.
    let mut level = made.image_raster();
    level.samples.iter_mut().enumerate().for_each(|(i, v)| *v = 100.0 + noise(i));
    let (found, ..) = warned(&self::scene(level, made.coarse_raster()), &told(azimuth_deg + 90.0, elevation_deg));
    assert!(!found.iter().any(|text| text.contains("show a Sun")), "{found:?}");
}

/// Returns a number between -10 and 10 that follows no pattern.
fn noise(i: usize) -> f32 {
    let mixed = (i as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let mixed = (mixed ^ (mixed >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    20.0 * ((mixed >> 40) as f32 / (1u64 << 24) as f32) - 10.0
}

#[test]
fn an_image_without_relief_is_told() {
    let made = made(2, SynthOptions::default());
    let mut image = made.image_raster();
    image.samples.iter_mut().enumerate().for_each(|(i, v)| *v = 100.0 + noise(i));
    let sun = told(made.sun_azimuth_deg, made.sun_elevation_deg);
    let text = the_one(&scene(image.clone(), made.coarse_raster()), &sun);
    assert!(text.starts_with("i.tif: only ") && text.contains("looks like relief under this light"), "{text}");
    image.samples.iter_mut().for_each(|v| *v = 100.0 + 0.01 * (*v - 100.0));
    let (found, ..) = warned(&scene(image.clone(), made.coarse_raster()), &sun);
    assert!(found[0].starts_with("i.tif: nearly constant, brightness varies by 0.1 %"), "{found:?}");
}

#[test]
fn values_that_are_no_brightness_are_told() {
    let made = made(2, SynthOptions::default());
    let sun = told(made.sun_azimuth_deg, made.sun_elevation_deg);
    let mut image = made.image_raster();
    image.samples.iter_mut().for_each(|v| *v = -*v);
    let text = the_one(&scene(image, made.coarse_raster()), &sun);
    assert!(text.starts_with("i.tif: mean -") && text.contains("expected above 0"), "{text}");
}

#[test]
fn an_image_of_other_ground_is_told() {
    let (made, other) = (made(2, SynthOptions::default()), made(5, SynthOptions::default()));
    let mut coarse = other.coarse_raster();
    coarse.georef = made.coarse_raster().georef;
    let scene = scene(made.image_raster(), coarse);
    let text = the_one(&scene, &KnownFrom::default());
    assert!(text.starts_with("i.tif: its brightness hardly follows the slopes of c.tif (probability 0."), "{text}");
    assert!(text.ends_with("If so, say --sun-azimuth"), "{text}");
    let (found, ..) = warned(&scene, &told(made.sun_azimuth_deg, made.sun_elevation_deg));
    assert!(found.iter().any(|text| text.ends_with("clockwise from the grid's up?")), "{found:?}");
}

#[test]
fn clipped_images_are_told() {
    let made = made(2, SynthOptions::default());
    let sun = told(made.sun_azimuth_deg, made.sun_elevation_deg);
    let changed = |change: &dyn Fn(usize, f32) -> f32| {
        let mut image = made.image_raster();
        image.samples.iter_mut().enumerate().for_each(|(i, v)| *v = change(i, *v));
        warned(&scene(image, made.coarse_raster()), &sun).0
    };
    // The left quarter was never seen.
    let found = changed(&|i, v| if i % COLS < COLS / 4 { 0.0 } else { v });
    let text = found.iter().find(|text| text.contains("lowest value, 0:")).unwrap_or_else(|| panic!("{found:?}"));
    assert!(text.starts_with("i.tif: 25.0 % of its pixels") && text.contains("--image-nodata 0"), "{text}");
    assert!(!found.iter().any(|text| text.contains("looks like relief")), "the cause, not the effect: {found:?}");
    let found = changed(&|_, v| v.min(100.0));
    assert!(found.iter().any(|text| text.contains("highest value, 100:")), "{found:?}");
    // A nodata value makes them voids.
    let found = changed(&|i, v| if i % COLS < COLS / 4 { f32::NAN } else { v });
    assert!(!found.iter().any(|text| text.contains("lowest value")), "{found:?}");
}

/// Returns the warnings about a coarse DTM that was changed, from row, column and height.
fn changed(change: &dyn Fn(usize, usize, f32) -> f32) -> Vec<String> {
    let made = made(2, SynthOptions::default());
    let mut coarse = made.coarse_raster();
    let cols = coarse.cols;
    coarse.samples.iter_mut().enumerate().for_each(|(i, z)| *z = change(i / cols, i % cols, *z));
    let scene = scene(made.image_raster(), coarse);
    warned(&scene, &told(made.sun_azimuth_deg, made.sun_elevation_deg)).0
}

#[test]
fn plateaus_of_a_void_value_are_told_and_level_ground_is_not() {
    let corner = |row: usize, col: usize| (8..11).contains(&row) && (8..12).contains(&col);
    for value in [-9999.0, -32768.0, 0.0_f32] {
        let found = changed(&|row, col, z| if corner(row, col) { value } else { z - 2000.0 });
        let text = found.iter().find(|text| text.contains("exactly")).unwrap_or_else(|| panic!("{value}: {found:?}"));
        assert!(text.starts_with("c.tif: ") && text.ends_with(&format!("--coarse-nodata {value}")), "{text}");
        assert!(!found.iter().any(|text| text.contains("the Moon's are")), "one warning is enough: {found:?}");
    }
    let found = changed(&|_, _, _| 0.0);
    assert!(found.iter().any(|text| text.starts_with("c.tif: all heights under the image are exactly 0")), "{found:?}");
    let found = changed(&|_, _, _| 5.0);
    assert!(!found.iter().any(|text| text.contains("exactly")), "{found:?}");
    // Whole metres near the sphere are zero in places, and a lake of lava is level.
    let near_zero = |z: f32| (z / 10.0).round();
    let found = changed(&|_, _, z| near_zero(z));
    assert!(!found.iter().any(|text| text.contains("exactly")), "{found:?}");
    let found = changed(&|row, col, z| if corner(row, col) { 0.0 } else { z.abs().min(20.0) });
    assert!(!found.iter().any(|text| text.contains("exactly")), "{found:?}");
}

#[test]
fn heights_that_the_moon_does_not_have_are_told() {
    let radius_m = Body::Moon.radius_m() as f32;
    let found = changed(&|_, _, z| z + radius_m);
    assert!(found.len() == 1 && found[0].contains("the Moon's are between -9,200 and 10,800 m"), "{found:?}");
    assert_eq!(changed(&|_, _, z| z + 9_000.0), [""; 0]);
    let found = changed(&|_, _, z| z / 1000.0 - 2.0);
    assert!(found.iter().any(|text| text.contains("kilometres taken for metres")), "{found:?}");
    // As level, but 2 km below the sphere: not kilometres.
    let found = changed(&|_, _, z| z / 1000.0 - 2000.0);
    assert!(!found.iter().any(|text| text.contains("kilometres")), "{found:?}");
}

#[test]
fn a_coarse_dtm_of_a_part_of_the_image_is_told_with_its_share() {
    let made = made(2, SynthOptions::default());
    let sun = told(made.sun_azimuth_deg, made.sun_elevation_deg);
    let covered_to = |share: f64, of_image: f64| {
        let (mut image, mut coarse) = (made.image_raster(), made.coarse_raster());
        let cols = coarse.cols;
        let beyond = |i: usize, cols: usize, share: f64| (i % cols) as f64 >= share * cols as f64;
        coarse.samples.iter_mut().enumerate().filter(|(i, _)| beyond(*i, cols, share)).for_each(|(_, z)| *z = f32::NAN);
        image
            .samples
            .iter_mut()
            .enumerate()
            .filter(|(i, _)| beyond(*i, COLS, of_image))
            .for_each(|(_, v)| *v = f32::NAN);
        let (found, survey, _) = warned(&scene(image, coarse), &sun);
        (found.into_iter().filter(|text| text.contains("covers")).collect::<Vec<_>>(), survey.coverage().unwrap())
    };
    let (found, share) = covered_to(0.4, 1.0);
    assert!((share - 0.4).abs() < 0.06, "{share}");
    assert_eq!(
        found,
        [format!("c.tif: covers {:.1} % of the valid pixels of i.tif: the DTM is void in the others", 100.0 * share)]
    );
    let (found, share) = covered_to(1.0, 1.0);
    assert!(found.is_empty() && share > 0.99, "{share} {found:?}");
    // Where the image is void, too, nothing is missing.
    let (found, share) = covered_to(0.5, 0.4);
    assert!(found.is_empty() && share > 0.9, "{share} {found:?}");
}

#[test]
fn heights_of_the_output_that_the_moon_does_not_have_are_told() {
    let made = made(2, SynthOptions::default());
    let scene = scene(made.image_raster(), made.coarse_raster());
    let of = |low_m: f32, high_m: f32| {
        notice_of_heights("dtm.tif", &scene, &Finished { low_m, high_m, pixels_valid: 1, origins: None })
    };
    let text = of(-18_000.0, 300.0).unwrap();
    assert!(text.starts_with("dtm.tif: heights from -18000 to 300 m, but the Moon's are between"), "{text}");
    assert!(of(-300.0, 18_000.0).is_some() && of(-9_100.0, 10_700.0).is_none());
    // Without a height there is nothing to say.
    assert_eq!(of(f32::INFINITY, f32::NEG_INFINITY), None);
}

#[test]
fn pixels_unlike_those_of_training_are_told() {
    let made = made(2, SynthOptions::default());
    let told_at = |coarse_px: f32| {
        let mut scene = scene(made.image_raster(), made.coarse_raster());
        scene.coarse_px = coarse_px;
        warned(&scene, &told(made.sun_azimuth_deg, made.sun_elevation_deg)).0
    };
    for fit in [4.0, 29.6, 120.0] {
        let found = told_at(fit);
        assert!(!found.iter().any(|text| text.contains("training scenes")), "{fit}: {found:?}");
    }
    for unfit in [3.9, 121.0] {
        let text =
            format!("c.tif: its pixels are {unfit:.1} pixels of i.tif wide, those of the training scenes are 12 to 59");
        let found = told_at(unfit);
        assert!(found.iter().any(|found| found.starts_with(&text)), "{unfit}: {found:?}");
    }
}

#[test]
fn exchanged_files_are_refused_or_told() {
    let made = made(2, SynthOptions::default());
    let (image, coarse) = (made.image_raster(), made.coarse_raster());
    let (grey, heights) = ("GeoTIFF, u16, tiles of 512 x 512, Deflate", "GeoTIFF, f32, tiles of 512 x 512, Deflate");
    let refused = |coarse: &NamedRaster, unit_stated: bool| {
        check_exchange(&input("i.tif", image.clone(), None, grey), coarse, unit_stated).err().map(|e| e.to_string())
    };
    let text = refused(&input("c.tif", image.clone(), None, grey), false).unwrap();
    assert!(text.contains("c.tif: heights coarser than i.tif expected, found GeoTIFF, u16"), "{text}");
    assert_eq!(refused(&input("c.tif", image.clone(), None, grey), true), None);
    assert_eq!(refused(&input("c.tif", image.clone(), Some("m"), grey), false), None);
    assert_eq!(refused(&input("c.tif", image.clone(), None, heights), false), None);
    assert_eq!(refused(&input("c.tif", coarse.clone(), None, grey), false), None);
    let pair = |of_image: Option<&str>, of_coarse: &str| {
        let (image, coarse) = (image.clone(), coarse.clone());
        Scene::new(input("i.tif", image, of_image, heights), input("c.tif", coarse, None, of_coarse)).unwrap()
    };
    let text = the_one(&pair(Some("m"), heights), &KnownFrom::default());
    assert!(text.starts_with("i.tif: its file says metres"), "{text}");
    let text = the_one(&pair(None, grey), &KnownFrom::default());
    assert!(text.starts_with("c.tif: GeoTIFF, u16") && text.contains("--coarse-unit"), "{text}");
    let turned = Scene::new(input("c.tif", coarse, Some("m"), heights), input("i.tif", image.clone(), None, grey));
    let text = turned.err().unwrap().to_string();
    assert!(text.contains("i.tif: expected a DTM coarser than c.tif") && text.contains("exchanged?"), "{text}");
}
