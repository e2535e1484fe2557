//! An image of other ground than the coarse DTM's: the fitted light is no surer than chance.

use super::{Input, Scene};
use elunar_synth::{Moon, SynthOptions, SynthScene};

/// Largest distance of the found distribution from the uniform one. 72 pairs that share 24 images and 24 DTMs are not independent: beyond
/// the 0.16 of the Kolmogorov-Smirnov test at the 5 % level for 72.
const APART: f64 = 0.2;

/// The trust is erf(s / sqrt 2)^2 / (1 + t^2) ([`elunar_core::norm::LightEstimate`]). Of chance alone the error function is uniform.
#[test]
fn a_light_fitted_to_other_ground_is_no_surer_than_chance() {
    let moon = Moon::new(4711, SynthOptions::default()).unwrap();
    let all: Vec<SynthScene> = (0..24).map(|i| moon.scene(i, 512, 640).unwrap()).collect();
    let sure = |image: &SynthScene, ground: &SynthScene| {
        let mut coarse = ground.coarse_raster();
        coarse.georef = image.coarse_raster().georef;
        let input = Input::in_memory;
        let scene = Scene::new(input("image", image.image_raster()), input("coarse DTM", coarse)).unwrap();
        let survey = scene.survey().unwrap();
        let fit = survey.light.estimate(None, None).expect("hills in the light");
        let sd = f64::from(fit.azimuth_sd_deg).to_radians();
        (f64::from(fit.trust) * (1.0 + sd * sd)).sqrt()
    };
    let pairs = (0..24).flat_map(|i| [5, 10, 15].map(|step| (i, (i + step) % 24)));
    let mut found: Vec<f64> = pairs.map(|(i, j)| sure(&all[i], &all[j])).collect();
    found.sort_by(f64::total_cmp);
    let n = found.len() as f64;
    let uniform = |(i, v): (usize, &f64)| (v - i as f64 / n).abs().max((v - (i + 1) as f64 / n).abs());
    let apart = found.iter().enumerate().map(uniform).fold(0.0, f64::max);
    println!(
        "{n} pairs: {apart:.3} from uniform; deciles {:.2?}",
        (1..10).map(|d| found[found.len() * d / 10]).collect::<Vec<_>>()
    );
    assert!(apart <= APART, "{apart:.3} from uniform");
}
