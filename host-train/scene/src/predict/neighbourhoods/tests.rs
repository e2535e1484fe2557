use super::*;
use crate::predict::half_tests::slope_error;
use crate::predict::{NamedRaster, PredictOptions, Scene, int8, predict};
use elunar_raster::Raster;
use elunar_synth::{Moon, SynthOptions, photograph};
use std::ops::ControlFlow;

const ROWS: usize = 640;
const COLS: usize = 1280;
const UNKNOWN: KnownSun = KnownSun { azimuth_deg: None, elevation_deg: None };

/// Returns a mosaic of images whose Sun turns by `turn_deg` about azimuth 300 from the left edge to the right, its coarse DTM, and the truth.
fn mosaic(turn_deg: f64) -> (Raster, Raster, Raster) {
    const IMAGES: usize = 9;
    let options = SynthOptions { pixel_m: 4.0, ..SynthOptions::default() };
    let made = Moon::new(4711, options).unwrap().scene(2, ROWS, COLS).unwrap();
    let truth = made.truth_raster();
    let azimuth = |k: usize| 300.0 + turn_deg * (k as f64 / (IMAGES - 1) as f64 - 0.5);
    let images: Vec<Raster> = (0..IMAGES).map(|k| photograph(&truth, (azimuth(k), 30.0), 5).unwrap()).collect();
    let mut mosaic = images[0].clone();
    for (i, v) in mosaic.samples.iter_mut().enumerate() {
        // Neighbouring images are blended.
        let place = (i % COLS) as f64 / COLS as f64 * (IMAGES - 1) as f64;
        let (k, part) = (place as usize, place.fract() as f32);
        *v = (1.0 - part) * images[k].samples[i] + part * images[k + 1].samples[i];
    }
    (mosaic, made.coarse_raster(), truth)
}

fn scene(image: &Raster, coarse: &Raster) -> Scene {
    Scene::new(NamedRaster::in_memory("image", image.clone()), NamedRaster::in_memory("coarse DTM", coarse.clone()))
        .unwrap()
}

fn tile(left: usize) -> Window {
    Window { row: 200, col: left, rows: 256, cols: 320 }
}

fn apart_deg(a: f64, b: f64) -> f64 {
    ((a - b + 180.0).rem_euclid(360.0) - 180.0).abs()
}

#[test]
fn a_scene_under_one_sun_has_one_light() {
    let (image, coarse, _) = mosaic(0.0);
    let light = scene(&image, &coarse).light_for(Illumination::Weighed, UNKNOWN).unwrap();
    assert_eq!((light.change(), light.of(tile(0))), (None, light.whole));
}

#[test]
fn every_tile_has_the_light_of_its_neighbourhood() {
    let (mut image, coarse, _) = mosaic(120.0);
    let light_of = |image: &Raster, illumination, sun| scene(image, &coarse).light_for(illumination, sun).unwrap();
    let light = light_of(&image, Illumination::Weighed, UNKNOWN);
    let change = light.change().unwrap();
    assert!(change.turn_deg[0] < -25.0 && change.turn_deg[1] > 25.0, "{change:?}");
    assert!(change.strength[0] > 0.5 && change.strength[1] < 2.0, "{change:?}");
    let text = change.to_string();
    assert!(text.contains(&format!("azimuth {:+.0} to", change.turn_deg[0])), "{text}");
    for left in [0, 320, 640, 960] {
        let (found, expected) = (light.of(tile(left)), 240.0 + 120.0 * (left as f64 + 160.0) / COLS as f64);
        let azimuth = found.light.azimuth_deg();
        assert!(apart_deg(azimuth, expected) < 15.0, "{left}: {found:?}, Sun at {expected}");
        assert!(found.trust > 0.9 && found.source == LightSource::Fitted, "{left}: {found:?}");
    }
    // A known azimuth holds everywhere. Networks that know only the quadrant have no parts.
    let known = KnownSun { azimuth_deg: Some(300.0), elevation_deg: None };
    assert_eq!(light_of(&image, Illumination::Weighed, known).change(), None);
    assert_eq!(light_of(&image, Illumination::Northwest, UNKNOWN).change(), None);
    // Where the image is void, the light is that of the nearest parts.
    image.samples.iter_mut().enumerate().filter(|(i, _)| i % COLS >= 640).for_each(|(_, v)| *v = f32::NAN);
    let light = light_of(&image, Illumination::Weighed, UNKNOWN);
    assert!(light.change().is_some(), "{light:?}");
    let near = light.of(tile(960)).light.azimuth_deg();
    assert!(apart_deg(near, 300.0) < 30.0, "{near}");
}

/// Slopes are better than under one light, and nothing but the light differs.
#[test]
fn slopes_gain_by_the_light_of_the_neighbourhood() {
    let nano = int8::open(&std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/nano.eld")).unwrap();
    let (image, coarse, truth) = mosaic(90.0);
    let scene = scene(&image, &coarse);
    let whole = scene.light_for(Illumination::Weighed, UNKNOWN).unwrap().whole;
    let one = KnownSun { azimuth_deg: Some(whole.light.azimuth_deg()), elevation_deg: None };
    let [one, own] = [one, UNKNOWN].map(|sun| {
        let found = predict(&scene, &nano, &PredictOptions { sun, ..PredictOptions::default() }, &mut |_, _| {
            ControlFlow::Continue(())
        });
        slope_error(&found.unwrap().dtm, &truth, COLS - 1)
    });
    let coarse = slope_error(&scene.coarse_raster().unwrap(), &truth, COLS - 1);
    println!(
        "slope-vector error over the coarse DTM's: one light {:.3}, of neighbourhoods {:.3}",
        one / coarse,
        own / coarse
    );
    assert!(own < 0.95 * one, "{own} for {one}");
}
