//! The bounds for linear methods: the best linear filter that truths teach, applied to the scene and anchored as a network's result is.
//!
//! - [`Teacher::OtherGrounds`]: for every scene, grounds of the synthetic Moon are rendered under its Sun, with its coarse DTM's resolution.
//!   [`LinearFilter`] learns from their truths. Photoclinometry and shape from shading with one fixed filter cannot do better on such grounds.
//! - [`Teacher::OwnTruth`]: the filter learns from the scene's own truth. It needs no Sun.
//!
//! Both know truths, so they are bounds and no competitors. They are not strict: sums are over neighbouring waves of windowed maps, and the
//! least squares are of heights.

use super::list::SuiteScene;
use super::scene::TestScene;
use elunar_base::{Error, Result};
use elunar_core::norm::Anchor;
use elunar_core::tile::{TILE_COLS, TILE_ROWS};
use elunar_evaluate::linear::{Lesson, LinearFilter, contrast, in_pixels};
use elunar_raster::Raster;
use elunar_raster::align::{Interpolation, Named, onto};
use elunar_synth::{COARSE_PIXEL_M, Moon, SynthOptions, TerrainKind};
use rayon::prelude::*;

/// The truths that a filter learns from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Teacher {
    /// Those of other grounds under the scene's Sun.
    OtherGrounds,
    /// The scene's own.
    OwnTruth,
}

/// Number of grounds that teach a scene's filter (our choice).
const GROUNDS: usize = 32;
/// Number of grounds of which those are taken whose contrast is nearest to the scene's. Brightness is less linear the rougher the ground.
const CANDIDATES: u64 = 96;
/// Seed of these grounds' Moon, far from those of training, validation, tours and the built-in suite.
const SEED: u64 = 700_000_000_000;
/// Rows and columns of a ground. The gains of scenes of another size are interpolated.
const GROUND_PX: (usize, usize) = (TILE_ROWS, TILE_COLS);
/// Pixels that the synthetic Moon can have, metres.
const PIXEL_M: (f64, f64) = (1.0, 8.0);

/// Returns the first scene whose Sun is not known. Its light cannot be given to other grounds.
pub(super) fn without_sun(scenes: &[SuiteScene]) -> Option<&SuiteScene> {
    let known = |scene: &SuiteScene| scene.sun_azimuth_deg.is_some() && scene.sun_elevation_deg.is_some();
    scenes.iter().find(|scene| scene.synth.is_none() && !known(scene))
}

/// Returns the options of the grounds that teach the filter of `scene`: those of its list, else the defaults with the scene's kind and as many
/// pixels per coarse pixel; under the scene's Sun.
fn options(scene: &TestScene) -> Result<SynthOptions> {
    let (Some(azimuth_deg), Some(elevation_deg)) = scene.sun_deg else {
        let what = "linear bound: expected the Sun's azimuth and elevation, found none";
        return Err(Error::input(format!("scene {}: {what}", scene.entry.name)));
    };
    let of_list = scene.entry.synth.as_ref().map(|synth| synth.options.clone());
    let base = of_list.unwrap_or_else(|| SynthOptions {
        pixel_m: (COARSE_PIXEL_M / f64::from(scene.input.coarse_px)).clamp(PIXEL_M.0, PIXEL_M.1),
        kind: match scene.entry.kind.as_str() {
            "mare" => Some(TerrainKind::Mare),
            "highland" => Some(TerrainKind::Highland),
            _ => None,
        },
        ..SynthOptions::default()
    });
    Ok(SynthOptions {
        rows: GROUND_PX.0,
        cols: GROUND_PX.1,
        also_pixel_m: vec![],
        sun_azimuth_deg: (azimuth_deg.rem_euclid(360.0), azimuth_deg.rem_euclid(360.0)),
        sun_elevation_deg: (elevation_deg, elevation_deg),
        ..base
    })
}

/// Returns the filter that other grounds teach for `scene`.
fn of_other_grounds(scene: &TestScene) -> Result<LinearFilter> {
    let options = options(scene)?;
    let (shape, pixel_m) = ((options.rows, options.cols), options.pixel_m);
    let moon = Moon::new(SEED, options)?;
    let image = contrast_of(scene);
    let rms = |map: &[f64]| (map.iter().map(|v| v * v).sum::<f64>() / map.len().max(1) as f64).sqrt();
    let off = |index: u64| (rms(&contrast(&moon.tile(index).image, shape)) / rms(&image)).ln().abs();
    let mut found: Vec<(f64, u64)> = (0..CANDIDATES).into_par_iter().map(|index| (off(index), index)).collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.truncate(GROUNDS);
    let lesson = |number: usize| {
        let ground = moon.tile(found[number].1);
        Ok(Lesson {
            contrast: contrast(&ground.image, shape),
            coarse: in_pixels(&ground.coarse_m, pixel_m, shape),
            truth: in_pixels(&ground.truth_m, pixel_m, shape),
        })
    };
    LinearFilter::fit(shape, (COARSE_PIXEL_M / pixel_m) as f32, found.len(), lesson)
}

/// Returns the filter that the truth of `scene` teaches. Where there is no truth, it is the coarse DTM.
fn of_own_truth(scene: &TestScene) -> Result<LinearFilter> {
    let coarse = scene.input.coarse_raster()?;
    let (shape, pixel_m) = ((coarse.rows, coarse.cols), f64::from(scene.input.pixel_m));
    let name = |what: &str| format!("{}: {what}", scene.entry.name);
    let (truth_name, coarse_name) = (name("truth"), name("coarse DTM"));
    let truth =
        onto(Named::new(&truth_name, &scene.truth), Named::new(&coarse_name, &coarse), Interpolation::Bilinear)?;
    let known = |(truth, coarse): (&f32, &f32)| if truth.is_finite() { *truth } else { *coarse };
    let truth: Vec<f32> = truth.samples.iter().zip(&coarse.samples).map(known).collect();
    let [coarse_px, truth_px] = [&coarse.samples, &truth].map(|heights_m| in_pixels(heights_m, pixel_m, shape));
    let lesson = Lesson { contrast: contrast_of(scene), coarse: coarse_px, truth: truth_px };
    LinearFilter::fit(shape, scene.input.coarse_px, 1, |_| Ok(lesson.clone()))
}

fn contrast_of(scene: &TestScene) -> Vec<f64> {
    contrast(&scene.raw_image.samples, (scene.raw_image.rows, scene.raw_image.cols))
}

/// Returns the DTM of the scene on the image's grid, metres; NaN where image or coarse DTM is invalid. With `anchored`, its long waves are the
/// coarse DTM's: those of the filter are worse.
///
/// # Errors
/// [`Error::Input`] with [`Teacher::OtherGrounds`] if the Sun is not known, or stands where the synthetic Moon has none; if truth and image are
/// not of one place.
pub(super) fn dtm(scene: &TestScene, teacher: Teacher, anchored: bool) -> Result<Raster> {
    let filter = match teacher {
        Teacher::OtherGrounds => of_other_grounds(scene)?,
        Teacher::OwnTruth => of_own_truth(scene)?,
    };
    let coarse = scene.input.coarse_raster()?;
    let (shape, pixel_m) = ((coarse.rows, coarse.cols), f64::from(scene.input.pixel_m));
    let filled = in_pixels(&coarse.samples, pixel_m, shape);
    let heights = filter.apply(&contrast_of(scene), &filled, shape);
    let [mut heights_m, coarse_m] =
        [heights, filled].map(|map| map.iter().map(|z| (z * pixel_m) as f32).collect::<Vec<f32>>());
    if anchored {
        let (mut difference, mut sums) = (vec![0.0; coarse_m.len()], vec![0.0; Anchor::sums_len(shape.0, shape.1)]);
        Anchor::whole(scene.input.coarse_px)
            .apply(&mut heights_m, &coarse_m, shape.1, &mut difference, &mut sums)
            .map_err(|e| Error::input(format!("linear bound: {e}")))?;
    }
    let valid = |(height, coarse): (f32, &f32)| if coarse.is_finite() { height } else { f32::NAN };
    let samples = heights_m.into_iter().zip(&coarse.samples).map(valid).collect();
    Ok(Raster { samples, ..coarse })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::suite::list::List;
    use crate::suite::method::{Method, Usage};
    use crate::suite::score::score;

    #[test]
    fn the_bounds_are_no_worse_than_the_untrained_pipeline() {
        let list = List::built_in().unwrap();
        for name in ["mare-a-sun1", "highland-b-sun2"] {
            let mut entry = list.scene.iter().find(|scene| scene.name == name).unwrap().clone();
            let options = &mut entry.synth.as_mut().unwrap().options;
            (options.rows, options.cols) = (256, 320);
            let scene = TestScene::make(&entry).unwrap();
            let methods =
                [Teacher::OtherGrounds, Teacher::OwnTruth].map(|teacher| Method::linear(teacher, Usage::default()));
            let methods: Vec<Method> = std::iter::once(Method::untrained(Usage::default())).chain(methods).collect();
            let found = score(&scene, &methods.iter().collect::<Vec<_>>()).unwrap().result.scored;
            let figures = |k: usize| (found[k].heights.rmse_m, found[k].relief.slope_vector_error.unwrap());
            let [coarse, untrained, bound, own] = [0, 1, 2, 3].map(figures);
            println!(
                "{name}: coarse {coarse:.4?}, untrained {untrained:.4?}, other grounds {bound:.4?}, own truth {own:.4?}"
            );
            assert!(bound.0 <= 1.02 * untrained.0 && bound.1 <= 1.02 * untrained.1, "{name}: {bound:?} {untrained:?}");
            assert!(bound.1 < 0.8 * coarse.1, "{name}: {bound:?} {coarse:?}");
            assert!(own.0 <= 1.02 * untrained.0 && own.1 < untrained.1, "{name}: {own:?} {untrained:?}");
        }
    }

    #[test]
    fn a_scene_without_a_sun_is_found() {
        let list = List::built_in().unwrap();
        assert!(without_sun(&list.scene).is_none());
        let file =
            SuiteScene { truth: Some("t.tif".into()), sun_azimuth_deg: Some(90.0), ..SuiteScene::named("f".into()) };
        assert_eq!(without_sun(std::slice::from_ref(&file)).map(|scene| scene.name.as_str()), Some("f"));
        assert!(without_sun(&[SuiteScene { sun_elevation_deg: Some(20.0), ..file }]).is_none());
    }
}
