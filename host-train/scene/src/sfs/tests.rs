//! The solver finds hills that were rendered in closed form.

use super::*;
use crate::predict::NamedRaster;
use elunar_core::sun::Body;
use elunar_raster::{Crs, GeoRef, Raster};
use std::ops::ControlFlow;

const ROWS: usize = 100;
const COLS: usize = 120;
const PIXEL_M: f64 = 2.0;
const SUN: (f64, f64) = (290.0, 40.0);

fn raster(rows: usize, cols: usize, origin: (f64, f64), pixel_m: f64, value: impl Fn(f64, f64) -> f64) -> Raster {
    let transform = [origin.0, pixel_m, 0.0, origin.1, 0.0, -pixel_m];
    let georef = GeoRef { transform, crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0) };
    let sample = |i: usize| {
        let (x, y) = georef.centre((i / cols) as f64, (i % cols) as f64);
        value(x, y) as f32
    };
    Raster { rows, cols, samples: (0..rows * cols).map(sample).collect(), georef: Some(georef) }
}

/// Hills on a slope: (east, north, radius, height), metres.
const HILLS: [(f64, f64, f64, f64); 4] =
    [(60.0, -70.0, 14.0, 5.0), (150.0, -60.0, 18.0, -6.0), (100.0, -130.0, 12.0, 4.0), (185.0, -140.0, 15.0, 5.0)];

/// Returns height and its gradient towards east and north, in closed form.
fn ground(x: f64, y: f64) -> [f64; 3] {
    let mut found = [-1900.0 + 0.03 * x - 0.02 * y, 0.03, -0.02];
    for (east, north, radius, height) in HILLS {
        let (dx, dy) = (x - east, y - north);
        let z = height * (-(dx * dx + dy * dy) / (2.0 * radius * radius)).exp();
        found[0] += z;
        found[1] -= z * dx / (radius * radius);
        found[2] -= z * dy / (radius * radius);
    }
    found
}

/// Returns the brightness by the definition: angles between normal, Sun and zenith; McEwen's polynomial.
fn brightness(x: f64, y: f64) -> f64 {
    let [_, by_east, by_north] = ground(x, y);
    let (azimuth, elevation) = (SUN.0.to_radians(), SUN.1.to_radians());
    let length = (1.0 + by_east * by_east + by_north * by_north).sqrt();
    let sun = [elevation.cos() * azimuth.sin(), elevation.cos() * azimuth.cos(), elevation.sin()];
    let incidence = (sun[2] - by_east * sun[0] - by_north * sun[1]) / length;
    let phase = 90.0 - SUN.1;
    let weight = 1.0 - 0.019 * phase + 2.42e-4 * phase * phase - 1.46e-6 * phase * phase * phase;
    700.0 * (2.0 * weight * incidence / (incidence + 1.0 / length) + (1.0 - weight) * incidence)
}

fn truth() -> Raster {
    raster(ROWS, COLS, (0.0, 0.0), PIXEL_M, |x, y| ground(x, y)[0])
}

fn image() -> Raster {
    raster(ROWS, COLS, (0.0, 0.0), PIXEL_M, brightness)
}

/// Returns means over 40 m, wider than the hills' radii.
fn coarse() -> Raster {
    raster(9, 10, (-80.0, 80.0), 40.0, |x, y| {
        let at = |k: i32| f64::from(k) * 4.0 - 18.0;
        (0..100).map(|k| ground(x + at(k / 10), y + at(k % 10))[0]).sum::<f64>() / 100.0
    })
}

/// Returns settings with a lower weight of the coarse DTM than the default, because the hills have one albedo and little noise.
fn settings() -> SfsSettings {
    let default = SfsSettings::new(SUN.0, SUN.1, PIXEL_M);
    SfsSettings { tile: (64, 80), overlap_px: 24, threads: 2, dem_constraint_weight_per_m: 0.01, ..default }
}

struct Found {
    dtm: Vec<f32>,
    tally: Tally,
    tiles: Vec<TileLog>,
}

fn found(image: &Raster, coarse: &Raster, settings: &SfsSettings, from: usize) -> Result<Found> {
    let image = NamedRaster::in_memory("image", image.clone());
    let scene = Scene::new(image.clone(), NamedRaster::in_memory("coarse", coarse.clone()))?;
    let journal = SfsJournal::new(&scene, &image, Some(NamedRaster::in_memory("truth", truth())))?;
    let mut dtm = vec![];
    let mut keep = |rows: &[f32]| {
        dtm.extend_from_slice(rows);
        Ok(())
    };
    let tally = solve_rows(&scene, settings, &journal, from, &mut keep, &mut |_, _| ControlFlow::Continue(()))?;
    Ok(Found { dtm, tally, tiles: journal.tiles() })
}

fn solved(image: &Raster, coarse: &Raster, settings: &SfsSettings) -> Found {
    found(image, coarse, settings, 0).unwrap()
}

/// Returns root mean squares of the height error (metres) and of the error of the slope towards the Sun, the only slope that an image
/// shows. The border is left out, because tiles see it from one side only.
fn errors(dtm: &[f32]) -> (f64, f64) {
    let (truth, border) = (truth(), 4);
    let error = |i: usize| f64::from(dtm[i]) - f64::from(truth.samples[i]);
    let (to_east, to_north) = SUN.0.to_radians().sin_cos();
    let towards = |i: usize| {
        let (east, south) = (error(i + 1) - error(i - 1), error(i + COLS) - error(i - COLS));
        (east * to_east - south * to_north) / (2.0 * PIXEL_M)
    };
    let inner = || (border..ROWS - border).flat_map(|r| (border..COLS - border).map(move |c| r * COLS + c));
    let rms = |of: &dyn Fn(usize) -> f64| (inner().map(|i| of(i).powi(2)).sum::<f64>() / inner().count() as f64).sqrt();
    (rms(&error), rms(&towards))
}

/// Returns the same errors for the coarse DTM.
fn start_errors() -> (f64, f64) {
    let scene =
        Scene::new(NamedRaster::in_memory("image", image()), NamedRaster::in_memory("coarse", coarse())).unwrap();
    errors(&scene.coarse_raster().unwrap().samples)
}

/// Returns repeatable noise: about normal, variance 1.
fn noise(i: usize) -> f64 {
    let uniform = |k: usize| ((i * 12 + k).wrapping_mul(2_654_435_761) % 65_536) as f64 / 65_536.0;
    (0..12).map(uniform).sum::<f64>() - 6.0
}

#[test]
fn hills_rendered_in_closed_form_are_found() {
    // One tile: neighbours with different errors across the light would have a false slope between them.
    let weights = SfsSettings { smoothness_weight_m: 0.05, dem_constraint_weight_per_m: 1e-3, ..settings() };
    let exact = SfsSettings { tile: (ROWS, COLS), tolerance: 1e-6, ..weights };
    let (start, found) = (start_errors(), solved(&image(), &coarse(), &exact));
    let (height_m, slope) = errors(&found.dtm);
    eprintln!("coarse {start:.3?}, found {height_m:.3} m, {slope:.4}");
    assert!(start.0 > 0.5 && start.1 > 0.03, "{start:?}");
    assert!(slope < 0.03 * start.1, "slope towards the Sun: {slope}, of the coarse DTM {}", start.1);
    // The image shows no slope across the light. There the coarse DTM's error remains.
    assert!(height_m < 0.4 * start.0, "{height_m} m, of the coarse DTM {} m", start.0);
    assert!(found.tiles.iter().all(TileLog::converged));
}

#[test]
fn noise_is_not_taken_for_ground() {
    let mut image = image();
    image.samples.iter_mut().enumerate().for_each(|(i, v)| *v *= 1.0 + 0.02 * noise(i) as f32);
    let (start, (height_m, slope)) = (start_errors(), errors(&solved(&image, &coarse(), &settings()).dtm));
    eprintln!("coarse {start:.3?}, found {height_m:.3} m, {slope:.4}");
    assert!(height_m < 0.5 * start.0 && slope < 0.5 * start.1, "{height_m} m, {slope}; of the coarse DTM {start:?}");
}

#[test]
fn every_step_lowers_the_cost_and_errors_fall_with_it() {
    let found = solved(&image(), &coarse(), &settings());
    assert_eq!((found.tally.tiles, found.tiles.len()), (4, 4));
    for tile in &found.tiles {
        assert!(tile.converged() && tile.seconds > 0.0 && tile.lit_px == 62 * 78);
        assert_eq!(tile.levels.iter().map(|level| level.rows).collect::<Vec<_>>(), [16, 32, 64]);
        for level in &tile.levels {
            assert!(level.steps.windows(2).all(|pair| pair[1].cost() < pair[0].cost()));
        }
    }
    let points = curve(&found.tiles);
    assert_eq!(points.iter().filter(|p| p.level_step == 0).map(|p| p.level).collect::<Vec<_>>(), [2, 1, 0]);
    let (first, last) = (points.first().unwrap(), points.last().unwrap());
    assert!(last.rmse_m.unwrap() < 0.6 * first.rmse_m.unwrap());
    assert!(last.slope_mae_deg.unwrap() < 0.6 * first.slope_mae_deg.unwrap());
    let value: serde_json::Value = serde_json::from_str(&json(&settings(), &found.tiles)).unwrap();
    assert_eq!(value["curve"].as_array().unwrap().len(), points.len());
    assert_eq!(value["tiles"][3]["row"], 36);
    assert!(value["seconds_per_tile"]["median"].as_f64().unwrap() > 0.0);
    let folder = tempfile::tempdir().unwrap();
    for name in ["curve.csv", "curve.png"] {
        write_curve(&folder.path().join(name), &points).unwrap();
    }
    let text = std::fs::read_to_string(folder.path().join("curve.csv")).unwrap();
    assert_eq!(text.lines().count(), points.len() + 1);
    assert!(write_curve(&folder.path().join("curve.txt"), &points).is_err());
}

#[test]
fn datum_and_exposure_change_nothing() {
    let plain = solved(&image(), &coarse(), &settings()).dtm;
    let (mut image, mut coarse) = (image(), coarse());
    image.samples.iter_mut().for_each(|v| *v *= 0.25);
    coarse.samples.iter_mut().for_each(|z| *z += 2048.0);
    for (a, b) in solved(&image, &coarse, &settings()).dtm.iter().zip(&plain) {
        // As `f32`, heights of thousands of metres have steps of 0.0001 m. The start of the pyramid changes by such steps.
        assert!((a - b - 2048.0).abs() < 5e-3, "{a} {b}");
    }
}

#[test]
fn threads_and_restarts_change_no_byte() {
    let bits = |dtm: &[f32]| dtm.iter().map(|z| z.to_bits()).collect::<Vec<_>>();
    let one = solved(&image(), &coarse(), &SfsSettings { threads: 1, ..settings() }).dtm;
    let three = solved(&image(), &coarse(), &SfsSettings { threads: 3, ..settings() }).dtm;
    assert_eq!(bits(&one), bits(&three));
    let rest = found(&image(), &coarse(), &settings(), 80).unwrap().dtm;
    assert_eq!(bits(&rest), bits(&one[80 * COLS..]));
}

#[test]
fn shadows_and_gaps_count_nothing() {
    let settings = SfsSettings { shadow_threshold: 0.1, ..settings() };
    let (mut image, plain) = (image(), solved(&image(), &coarse(), &settings).dtm);
    let (shadow, gap) = (40 * COLS + 20, 70 * COLS + 90);
    for i in [shadow, shadow + 1, shadow + COLS] {
        image.samples[i] = 3.0;
    }
    image.samples[gap] = f32::NAN;
    let dtm = solved(&image, &coarse(), &settings).dtm;
    for (i, (a, b)) in dtm.iter().zip(&plain).enumerate() {
        assert_eq!(a.is_nan(), i == gap);
        // Read as ground, a pixel that dark would be a steep wall several metres high.
        assert!(i == gap || (a - b).abs() < 0.1, "pixel {i}: {a} instead of {b}");
    }
}

#[test]
fn without_contrast_the_coarse_dtm_stands() {
    let (mut flat, coarse) = (image(), coarse());
    flat.samples.fill(100.0);
    let found = solved(&flat, &coarse, &settings());
    let scene = Scene::new(NamedRaster::in_memory("image", flat), NamedRaster::in_memory("coarse", coarse)).unwrap();
    assert_eq!((found.tally.tiles_coarse, found.tiles.len()), (4, 0));
    assert_eq!(found.dtm, scene.coarse_raster().unwrap().samples);
}

#[test]
fn illegal_settings_are_named() {
    let default = settings();
    let cases = [
        (SfsSettings { smoothness_weight_m: 0.0, ..default }, "smoothness weight"),
        (SfsSettings { dem_constraint_weight_per_m: f64::NAN, ..default }, "DEM constraint weight"),
        (SfsSettings { tolerance: -1.0, ..default }, "tolerance"),
        (SfsSettings { shadow_threshold: 1.0, ..default }, "shadow threshold"),
        (SfsSettings { levels: 0, ..default }, "levels"),
        (SfsSettings { iterations: 0, ..default }, "iterations"),
        (SfsSettings { sun_elevation_deg: -5.0, ..default }, "elevation"),
        (SfsSettings { overlap_px: 64, ..default }, "overlap"),
    ];
    for (settings, name) in cases {
        let text = found(&image(), &coarse(), &settings, 0).err().unwrap().to_string();
        assert!(text.contains(name), "{text}");
    }
}
