//! The light of scenes: what voids do to it, and what a user reads of it.

use super::job::light_text;
use super::{NamedRaster, Scene};
use elunar_core::nn::{Illumination, LightSource};
use elunar_net::illumination::{KnownSun, Light, Lighting};
use elunar_raster::Raster;
use elunar_synth::{Moon, SynthOptions};

const ROWS: usize = 512;
const COLS: usize = 640;

/// Returns image and coarse DTM of a scene, and the azimuth and the light of its Sun.
fn moon(index: u64) -> (Raster, Raster, f64, Light) {
    let made = Moon::new(4711, SynthOptions::default()).unwrap().scene(index, ROWS, COLS).unwrap();
    let light = Light::from_sun(made.sun_azimuth_deg, made.sun_elevation_deg).unwrap();
    (made.image_raster(), made.coarse_raster(), made.sun_azimuth_deg, light)
}

fn fitted(image: &Raster, coarse: &Raster) -> Lighting {
    let input = |name: &str, raster: &Raster| NamedRaster::in_memory(name, raster.clone());
    let scene = Scene::new(input("image", image), input("coarse DTM", coarse)).unwrap();
    scene.light_for(Illumination::Weighed, KnownSun::default()).unwrap().whole
}

fn apart_deg(a: f64, b: f64) -> f64 {
    ((a - b + 180.0).rem_euclid(360.0) - 180.0).abs()
}

/// Before, voids were filled first, and the light was fitted to the filling: by up to 40 degrees and a factor of 2 elsewhere.
#[test]
fn voids_do_not_move_the_light() {
    for index in [0, 2, 4] {
        let (mut image, coarse, azimuth_deg, _) = moon(index);
        let half = Raster { rows: ROWS / 2, samples: image.samples[..ROWS / 2 * COLS].to_vec(), ..image.clone() };
        let alone = fitted(&half, &coarse);
        image.samples[ROWS / 2 * COLS..].fill(f32::NAN);
        let with_void = fitted(&image, &coarse);
        assert_eq!(with_void.source, LightSource::Fitted);
        let (found, expected) = (with_void.light, alone.light);
        assert!(apart_deg(found.azimuth_deg(), expected.azimuth_deg()) < 2.0, "{index}: {found:?} for {expected:?}");
        assert!((found.strength() / expected.strength() - 1.0).abs() < 0.05, "{index}: {found:?} for {expected:?}");
        assert!(apart_deg(found.azimuth_deg(), azimuth_deg) < 15.0, "{index}: {found:?}, Sun at {azimuth_deg}");
    }
}

/// A stretch of the numbers, as in images for viewing, changes the strength and neither the azimuth nor the trust.
#[test]
fn an_offset_or_a_stretch_leaves_the_azimuth() {
    let (image, coarse, azimuth_deg, _) = moon(2);
    let plain = fitted(&image, &coarse);
    for stretch in [|v: f32| 0.5 * v + 900.0, |v: f32| v.sqrt(), |v: f32| (v / 8.0).round()] {
        let samples = image.samples.iter().map(|v| stretch(*v)).collect();
        let found = fitted(&Raster { samples, ..image.clone() }, &coarse);
        assert!(apart_deg(found.light.azimuth_deg(), azimuth_deg) < 10.0, "{found:?}");
        assert!((found.trust - plain.trust).abs() < 0.05, "{found:?} for {plain:?}");
        assert!(found.light.strength() < 1.1 * plain.light.strength(), "{found:?} for {plain:?}");
    }
}

#[test]
fn a_user_reads_the_light_and_how_sure_it_is() {
    let light = Light::from_sun(300.0, 30.0).unwrap();
    let fitted = Lighting {
        source: LightSource::Fitted,
        trust: 0.85,
        log_strength_sd: 0.2,
        azimuth_sd_deg: 7.6,
        ..Lighting::given(light)
    };
    let text = light_text(&fitted);
    assert_eq!(
        text,
        format!(
            "azimuth 300 +- 8 deg, strength {:.2}, uncertain by a factor of 1.22, as of a Sun 30 deg high; trust 0.85; fitted",
            light.strength()
        )
    );
    let doubtful = light_text(&Lighting { related: 0.42, ..fitted });
    assert!(
        doubtful.ends_with("trust 0.85; brightness follows the coarse DTM with probability 0.42; fitted"),
        "{doubtful}"
    );
    let given = light_text(&Lighting::given(light));
    assert!(given.starts_with("azimuth 300 deg, strength") && given.ends_with("trust 1.00; given"), "{given}");
    let assumed = light_text(&Lighting::decide(Illumination::Weighed, KnownSun::default(), &Default::default()));
    assert!(assumed.contains("+- 180 deg") && assumed.contains("trust 0.00; assumed"), "{assumed}");
    assert!(assumed.ends_with("give --sun-azimuth and --sun-elevation"), "{assumed}");
    assert_eq!(light_text(&Lighting::NOT_ASKED), "not used by the network");
}
