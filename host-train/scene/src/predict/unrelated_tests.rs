//! An image of other ground than the coarse DTM's: the fitted light is no surer than chance, and the image is hardly taken for this ground's.

use super::untrained::Untrained;
use super::{NamedRaster, PredictOptions, Scene, predict};
use elunar_core::norm::LightEstimate;
use elunar_synth::{Moon, SynthOptions, SynthScene};

/// Largest distance of the found distribution from the uniform one. 72 pairs that share 24 images and 24 DTMs are not independent: beyond
/// the 0.16 of the Kolmogorov-Smirnov test at the 5 % level for 72.
const APART: f64 = 0.2;

fn scenes(rows: usize, cols: usize) -> Vec<SynthScene> {
    let moon = Moon::new(4711, SynthOptions::default()).unwrap();
    (0..24).map(|i| moon.scene(i, rows, cols).unwrap()).collect()
}

/// Returns the scene of an image, and a coarse DTM laid under it.
fn pair(image: &SynthScene, ground: &SynthScene) -> Scene {
    let mut coarse = ground.coarse_raster();
    coarse.georef = image.coarse_raster().georef;
    let input = NamedRaster::in_memory;
    Scene::new(input("image", image.image_raster()), input("coarse DTM", coarse)).unwrap()
}

fn fit(image: &SynthScene, ground: &SynthScene) -> LightEstimate {
    pair(image, ground).survey().unwrap().light.estimate(None, None).expect("hills in the light")
}

fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    values
}

fn deciles(sorted: &[f64]) -> Vec<f64> {
    (1..10).map(|d| sorted[sorted.len() * d / 10]).collect()
}

/// The trust is erf(s / sqrt 2)^2 / (1 + t^2) ([`LightEstimate`]). Of chance alone the error function is uniform.
#[test]
fn a_light_fitted_to_other_ground_is_no_surer_than_chance() {
    let all = scenes(512, 640);
    let pairs = (0..24).flat_map(|i| [5, 10, 15].map(|step| (i, (i + step) % 24)));
    let fits: Vec<LightEstimate> = pairs.map(|(i, j)| fit(&all[i], &all[j])).collect();
    let sure = |fit: &LightEstimate| {
        let sd = f64::from(fit.azimuth_sd_deg).to_radians();
        (f64::from(fit.trust) * (1.0 + sd * sd)).sqrt()
    };
    let found = sorted(fits.iter().map(sure).collect());
    let n = found.len() as f64;
    let uniform = |(i, v): (usize, &f64)| (v - i as f64 / n).abs().max((v - (i + 1) as f64 / n).abs());
    let apart = found.iter().enumerate().map(uniform).fold(0.0, f64::max);
    println!("{n} pairs: {apart:.3} from uniform; deciles {:.2?}", deciles(&found));
    assert!(apart <= APART, "{apart:.3} from uniform");

    let related = sorted(fits.iter().map(|fit| fit.related.into()).collect());
    let own = sorted(all.iter().map(|one| fit(one, one).related.into()).collect());
    println!("related, other ground: deciles {:.3?}; own ground: least {:.4}", deciles(&related), own[0]);
    assert!(related[36] < 0.1 && own[0] > 0.99, "{} {}", related[36], own[0]);
}

/// What a method adds to the coarse DTM, rms, falls where the image is of other ground.
#[test]
fn an_image_of_other_ground_adds_little() {
    let all = scenes(200, 256);
    let added_m = |image, ground| {
        let scene = pair(image, ground);
        let made = predict(&scene, &Untrained, &PredictOptions::default(), &mut super::tests::silent).unwrap();
        let band = scene.band(0, scene.rows).unwrap();
        let square = |(z, coarse): (&f32, &f32)| f64::from(z - coarse).powi(2);
        let squares: Vec<f64> =
            made.dtm.samples.iter().zip(&band.coarse_m).map(square).filter(|v| v.is_finite()).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    let own = sorted((0..24).map(|i| added_m(&all[i], &all[i])).collect());
    let other = sorted((0..24).map(|i| added_m(&all[i], &all[(i + 7) % 24])).collect());
    println!("added, m: own ground {:.2?}, other ground {:.2?}", deciles(&own), deciles(&other));
    assert!(other[12] < 0.25 * own[12], "{} {}", other[12], own[12]);
}
