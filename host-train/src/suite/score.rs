//! Scores of all methods on one scene, on the same pixels, and of one method on one ground under two Suns.

use super::method::Method;
use super::results::{COARSE, CrossResult, MethodScores, SceneResult};
use super::scene::TestScene;
use elunar_base::{Error, Result};
use elunar_core::metrics::HeightErrors;
use elunar_evaluate::lowpass::high_pass;
use elunar_evaluate::{Candidate, Comparison, ImageLight, compare, relief, spectral};
use elunar_raster::Raster;
use elunar_raster::align::Named;

/// Results on a scene, with the DTMs for pictures.
pub struct ScoredScene {
    /// The scores, without pictures.
    pub result: SceneResult,
    /// The rasters, coarse DTM first.
    pub comparison: Comparison,
}

/// Runs every method on `scene`, and compares the DTMs and the coarse DTM with the truth.
///
/// # Errors
/// If a method fails, or no pixel is common to all.
pub fn score(scene: &TestScene, methods: &[&Method]) -> Result<ScoredScene> {
    let mut made = Vec::with_capacity(methods.len());
    for method in methods {
        made.push(method.dtm(scene).map_err(|e| e.about(&format!("scene {}", scene.entry.name)))?);
    }
    let truth_name = format!("{}: truth", scene.entry.name);
    let mut candidates = vec![Candidate::coarse(COARSE, &scene.coarse)];
    candidates.extend(methods.iter().zip(&made).map(|(method, (dtm, _))| Candidate::fine(&method.name, dtm)));
    let comparison = compare(Named::new(&truth_name, &scene.truth), &candidates, scene.entry.truth_resolution_m)?;
    let seconds = std::iter::once(None).chain(made.iter().map(|(_, seconds)| *seconds));
    let light = scene.sun_deg.0.zip(scene.sun_deg.1);
    let light =
        light.map(|(azimuth_deg, elevation_deg)| ImageLight { image: &scene.image, azimuth_deg, elevation_deg });
    let scored = comparison.scored.iter().zip(seconds).map(|(scored, seconds)| {
        Ok(MethodScores {
            method: scored.name.clone(),
            heights: scored.scores,
            relief: relief(&comparison, scored, scene.high_pass_m, light)?,
            spectral: spectral(&comparison, scored),
            seconds,
        })
    });
    let scored = scored.collect::<Result<Vec<_>>>()?;
    let entry = &scene.entry;
    let result = SceneResult {
        name: entry.name.clone(),
        kind: entry.kind.clone(),
        remarks: entry.remarks.clone(),
        weak_truth: entry.weak_truth,
        shape: (scene.truth.rows, scene.truth.cols),
        pixel_m: scene.pixel_m,
        coarse_m: scene.coarse_m,
        high_pass_m: scene.high_pass_m,
        sun_deg: scene.sun_deg,
        pixels: (comparison.common_pixels, comparison.truth_pixels),
        scored,
        pictures: vec![],
    };
    Ok(ScoredScene { result, comparison })
}

/// One scene of a ground: its name, truth, high-pass wavelength and pixel, and the DTMs of all methods.
pub struct Seen {
    /// Name of the scene.
    pub name: String,
    /// True DTM.
    pub truth: Raster,
    /// Wavelength that separates long and short waves, metres.
    pub high_pass_m: f64,
    /// Name and DTM of each method, on the truth's grid.
    pub dtms: Vec<(String, Raster)>,
}

/// Compares the DTMs of a ground under two Suns (Fig. 14), method by method. The coarse DTM does not depend on the Sun and is left out.
///
/// # Errors
/// [`Error::Input`] if the two scenes have different grids.
pub fn cross(ground: &str, a: &Seen, b: &Seen) -> Result<Vec<CrossResult>> {
    if (a.truth.rows, a.truth.cols, &a.truth.georef) != (b.truth.rows, b.truth.cols, &b.truth.georef) {
        let what = format!("expected {} and {} on one grid", a.name, b.name);
        return Err(Error::input(format!("ground {ground}: {what}, found two")));
    }
    let pixel_m = a.truth.pixel_m().ok_or_else(|| Error::input(format!("ground {ground}: pixel size unknown")))?;
    let rms = |x: &[f32], y: &[f32]| -> Result<HeightErrors> {
        let mut errors = HeightErrors::default();
        errors.extend(x, y, None).map_err(|e| Error::input(format!("ground {ground}: {e}")))?;
        Ok(errors)
    };
    let pairs = a.dtms.iter().filter(|(name, _)| name != COARSE);
    pairs
        .map(|(method, first)| {
            let second = b.dtms.iter().find(|(name, _)| name == method).map(|(_, dtm)| dtm);
            let second =
                second.ok_or_else(|| Error::input(format!("{}: expected a DTM of {method}, found none", b.name)))?;
            let mut both = rms(&a.truth.samples, &first.samples)?;
            both.merge(&rms(&a.truth.samples, &second.samples)?);
            let none = || Error::input(format!("ground {ground}: expected pixels common to both DTMs, found none"));
            let short = |map: &Raster| high_pass(map, a.high_pass_m, pixel_m);
            let (short_a, short_b, short_truth) = (short(first), short(second), short(&a.truth));
            let mut fine = rms(&short_truth, &short_a)?;
            fine.merge(&rms(&short_truth, &short_b)?);
            Ok(CrossResult {
                ground: ground.into(),
                method: method.clone(),
                scenes: (a.name.clone(), b.name.clone()),
                difference_m: rms(&first.samples, &second.samples)?.rmse_m().ok_or_else(none)?,
                rmse_m: both.rmse_m().ok_or_else(none)?,
                high_pass_m: (rms(&short_a, &short_b)?.rmse_m(), fine.rmse_m()),
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_core::sun::Body;
    use elunar_raster::{Crs, GeoRef};

    fn raster(height: impl Fn(usize) -> f32) -> Raster {
        let georef = GeoRef {
            transform: [0.0, 2.0, 0.0, 0.0, 0.0, -2.0],
            crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0),
        };
        Raster { rows: 90, cols: 100, samples: (0..9000).map(height).collect(), georef: Some(georef) }
    }

    fn seen(name: &str, dtm: Raster) -> Seen {
        let truth = raster(|i| (i % 100) as f32);
        Seen {
            name: name.into(),
            truth,
            high_pass_m: 60.0,
            dtms: vec![(COARSE.into(), raster(|_| 0.0)), ("net".into(), dtm)],
        }
    }

    #[test]
    fn errors_of_both_suns_and_their_difference() {
        let truth = |i: usize| (i % 100) as f32;
        // The same error under both Suns, and opposite ones.
        let same = cross("g", &seen("a", raster(|i| truth(i) + 2.0)), &seen("b", raster(|i| truth(i) + 2.0))).unwrap();
        assert_eq!((same.len(), same[0].ratio(), same[0].rmse_m), (1, 0.0, 2.0));
        let apart = cross("g", &seen("a", raster(|i| truth(i) + 2.0)), &seen("b", raster(|i| truth(i) - 2.0))).unwrap();
        assert_eq!(apart[0].ratio(), 2.0);
        // An offset is not a short wave, but stripes are.
        assert!(apart[0].high_pass_m.0.unwrap() < 1e-3);
        let stripes = seen("b", raster(|i| truth(i) + 2.0 * (i % 2) as f32));
        let striped = cross("g", &seen("a", raster(truth)), &stripes).unwrap();
        assert!((striped[0].high_pass_m.0.unwrap() - 1.0).abs() < 0.05, "{:?}", striped[0]);
        let mut elsewhere = seen("b", raster(truth));
        elsewhere.truth.georef.as_mut().unwrap().transform[0] = 50.0;
        assert!(cross("g", &seen("a", raster(truth)), &elsewhere).is_err());
    }
}
