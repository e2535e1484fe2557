//! Properties of scenes, tested through the public interface.

use super::structure::{HIGHLAND, LAGS_M, MARE, mean_square_difference};
use super::*;
use rayon::prelude::*;

#[test]
fn ensemble_has_the_structure_function_of_the_nac_dtms() {
    for (kind, reference) in [(TerrainKind::Mare, MARE), (TerrainKind::Highland, HIGHLAND)] {
        let moon = Moon::new(11, SynthOptions { kind: Some(kind), ..Default::default() }).unwrap();
        const SEEDS: u64 = 512;
        let squares: Vec<[f64; 6]> = (0..SEEDS)
            .into_par_iter()
            .map(|index| {
                let tile = moon.tile(index);
                LAGS_M.map(|lag_m| mean_square_difference(&tile.truth_m, tile.cols, (lag_m / tile.pixel_m) as usize))
            })
            .collect();
        for (lag, expected) in reference.sigma_m.iter().enumerate() {
            let sigma_m = (squares.iter().map(|s| s[lag]).sum::<f64>() / SEEDS as f64).sqrt();
            println!("{kind:?} {:>3} m: {sigma_m:.3} m, {} has {expected} m", LAGS_M[lag], reference.site);
            assert!(
                (sigma_m / expected - 1.0).abs() < 0.15,
                "{kind:?} at {} m: {sigma_m:.3} m, expected {expected} m within 15 %",
                LAGS_M[lag]
            );
        }
    }
}

#[test]
fn tiles_depend_on_seed_and_index_alone() {
    let options = SynthOptions { rows: 48, cols: 64, ..Default::default() };
    let moon = Moon::new(3, options.clone()).unwrap();
    let one_by_one: Vec<SynthTile> = (0..4).map(|index| moon.tile(index)).collect();
    let again = Moon::new(3, options.clone()).unwrap();
    let backwards: Vec<SynthTile> = vec![3, 2, 1, 0].into_par_iter().map(|index| again.tile(index)).collect();
    assert!(one_by_one.iter().eq(backwards.iter().rev()));
    assert_ne!(one_by_one[0].truth_m, one_by_one[1].truth_m);
    assert_ne!(one_by_one[0].truth_m, Moon::new(4, options).unwrap().tile(0).truth_m);
}

#[test]
fn tiles_are_complete_at_every_legal_pixel() {
    for pixel_m in [1.0, 2.0, 5.0, 8.0] {
        let options = SynthOptions { rows: 40, cols: 56, pixel_m, ..Default::default() };
        let tile = Moon::new(5, options).unwrap().tile(0);
        for (name, values) in [("image", &tile.image), ("coarse", &tile.coarse_m), ("truth", &tile.truth_m)] {
            assert_eq!(values.len(), 40 * 56, "{name}");
            assert!(values.iter().all(|v| v.is_finite()), "{name} at {pixel_m} m");
        }
        assert!(tile.image.iter().all(|dn| (0.0..=4095.0).contains(dn) && dn.fract() == 0.0));
    }
}

#[test]
fn illegal_options_are_refused() {
    let legal = SynthOptions::default();
    for bad in [
        SynthOptions { pixel_m: 0.5, ..legal.clone() },
        SynthOptions { pixel_m: f64::NAN, ..legal.clone() },
        SynthOptions { rows: 8, ..legal.clone() },
        SynthOptions { sun_elevation_deg: (50.0, 20.0), ..legal.clone() },
        SynthOptions { misregistration_m: -1.0, ..legal.clone() },
        SynthOptions { albedo_contrast: (1.0, 11.0), ..legal.clone() },
        SynthOptions { response_exponent: (0.1, 1.0), ..legal.clone() },
        SynthOptions { lunar_weight_shift: (-2.0, 0.0), ..legal.clone() },
        SynthOptions { landforms: 1.5, ..legal.clone() },
        SynthOptions { landforms: f64::NAN, ..legal.clone() },
        SynthOptions { relief: (2.0, 1.0), ..legal },
    ] {
        assert!(Moon::new(0, bad.clone()).is_err(), "{bad:?}");
    }
}

#[test]
fn landforms_are_on_their_share_of_the_scenes_and_leave_the_others_alone() {
    let tiles = |landforms| {
        let moon = Moon::new(3, SynthOptions { rows: 16, cols: 24, landforms, ..Default::default() }).unwrap();
        (0..60).map(move |index| moon.tile(index))
    };
    let changed = |landforms| tiles(0.0).zip(tiles(landforms)).filter(|(a, b)| a.truth_m != b.truth_m).count();
    assert_eq!(changed(0.0), 0);
    assert!((20..=40).contains(&changed(0.5)), "{} of 60", changed(0.5));
    assert!(changed(1.0) >= 45, "{} of 60", changed(1.0));
    assert!(tiles(1.0).all(|tile| tile.truth_m.iter().chain(&tile.image).all(|v| v.is_finite())));
    // Every tile is the same but for its landforms: Sun and coarse error keep their random streams.
    assert!(tiles(0.0).zip(tiles(1.0)).all(|(a, b)| a.sun_azimuth_deg == b.sun_azimuth_deg && a.kind == b.kind));
}

#[test]
fn half_of_the_suns_stand_opposite_and_the_ground_stays() {
    let options = SynthOptions { rows: 16, cols: 24, sun_azimuth_deg: (60.0, 120.0), ..Default::default() };
    let usual = Moon::new(3, options.clone()).unwrap();
    let turned = Moon::new(3, SynthOptions { sun_opposite: true, ..options }).unwrap();
    let opposite = (0..60).filter(|index| {
        let (a, b) = (usual.tile(*index), turned.tile(*index));
        assert_eq!((&a.truth_m, &a.coarse_m, a.sun_elevation_deg), (&b.truth_m, &b.coarse_m, b.sun_elevation_deg));
        let turn_deg = b.sun_azimuth_deg - a.sun_azimuth_deg;
        assert!(turn_deg == 0.0 && a.image == b.image || (turn_deg - 180.0).abs() < 1e-9 && a.image != b.image);
        turn_deg > 0.0
    });
    let opposite = opposite.count();
    assert!((20..=40).contains(&opposite), "{opposite} of 60");
}

#[test]
fn albedo_contrast_changes_the_image_alone() {
    let tile = |albedo_contrast| {
        let options = SynthOptions { rows: 64, cols: 80, albedo_contrast, ..Default::default() };
        Moon::new(3, options).unwrap().tile(1)
    };
    let [none, usual, strong, drawn] = [(0.0, 0.0), (1.0, 1.0), (4.0, 4.0), (1.0, 4.0)].map(tile);
    assert_eq!(usual, Moon::new(3, SynthOptions { rows: 64, cols: 80, ..Default::default() }).unwrap().tile(1));
    for other in [&none, &strong, &drawn] {
        assert_eq!((&other.truth_m, &other.coarse_m), (&usual.truth_m, &usual.coarse_m));
        assert_eq!(other.sun_azimuth_deg, usual.sun_azimuth_deg);
    }
    let apart = |a: &SynthTile| a.image.iter().zip(&none.image).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>();
    assert!(apart(&usual) > 0.0 && apart(&strong) > 2.0 * apart(&usual), "{} {}", apart(&usual), apart(&strong));
    assert!((apart(&usual)..apart(&strong)).contains(&apart(&drawn)), "{}", apart(&drawn));
}

#[test]
fn photometry_and_tones_change_the_image_alone_and_stripes_the_coarse_dtm_alone() {
    let small = SynthOptions { rows: 64, cols: 80, ..Default::default() };
    let usual = Moon::new(3, small.clone()).unwrap().tile(1);
    let images = [
        SynthOptions { lunar_weight_shift: (0.3, 0.3), ..small.clone() },
        SynthOptions { response_exponent: (0.7, 0.7), ..small.clone() },
        SynthOptions { pedestal: (0.2, 0.2), ..small.clone() },
    ]
    .map(|options| Moon::new(3, options).unwrap().tile(1));
    for tile in &images {
        assert_eq!((&tile.truth_m, &tile.coarse_m), (&usual.truth_m, &usual.coarse_m));
        assert_ne!(tile.image, usual.image);
    }
    // A pedestal and a smaller exponent both lower the contrast.
    let contrast = |tile: &SynthTile| {
        let (low, high) = tile.image.iter().fold((f32::MAX, 0.0f32), |(low, high), v| (low.min(*v), high.max(*v)));
        (high - low) / (high + low)
    };
    assert!(contrast(&images[1]) < contrast(&usual) && contrast(&images[2]) < contrast(&usual));
    let striped = Moon::new(3, SynthOptions { coarse_stripes_m: (1.0, 1.0), ..small }).unwrap().tile(1);
    assert_eq!((&striped.truth_m, &striped.image), (&usual.truth_m, &usual.image));
    assert_ne!(striped.coarse_m, usual.coarse_m);
}

#[test]
fn relief_scales_heights_about_their_base() {
    let tile = |relief| {
        let options = SynthOptions { rows: 64, cols: 80, kind: Some(TerrainKind::Mare), relief, ..Default::default() };
        Moon::new(3, options).unwrap().tile(1)
    };
    let [flat, usual, rough, drawn] = [(0.0, 0.0), (1.0, 1.0), (2.5, 2.5), (1.0, 2.5)].map(tile);
    let base_m = flat.truth_m[0];
    assert!(flat.truth_m.iter().all(|&height| height == base_m));
    for (one, two) in usual.truth_m.iter().zip(&rough.truth_m) {
        assert!((2.5 * (one - base_m) - (two - base_m)).abs() < 1e-3 * base_m.abs(), "{one} and {two} above {base_m}");
    }
    let height = |tile: &SynthTile| tile.truth_m.iter().map(|h| (h - base_m).abs()).sum::<f32>();
    assert!((height(&usual)..height(&rough)).contains(&height(&drawn)) && height(&drawn) > height(&usual));
}

#[test]
fn coarse_dtm_is_the_truth_blurred_shifted_and_bent() {
    let flawless = SynthOptions { coarse_error_m: (0.0, 0.0), misregistration_m: 0.0, ..Default::default() };
    let rms = |tile: &SynthTile| {
        let square = |(a, b): (&f32, &f32)| f64::from(a - b) * f64::from(a - b);
        (tile.coarse_m.iter().zip(&tile.truth_m).map(square).sum::<f64>() / tile.truth_m.len() as f64).sqrt()
    };
    let mean = |options: &SynthOptions| {
        let moon = Moon::new(9, options.clone()).unwrap();
        (0..12).map(|index| rms(&moon.tile(index)).powi(2)).sum::<f64>() / 12.0
    };
    let (clean, real) = (mean(&flawless), mean(&SynthOptions::default()));
    // A 59 m average lacks detail of a metre or so. The errors add 1.5 to 4 m, and the effect of the shift on slopes.
    assert!(clean.sqrt() < 2.0, "flawless coarse DTM is {} m off", clean.sqrt());
    assert!((1.5..5.0).contains(&(real - clean).sqrt()), "flaws of {} m", (real - clean).sqrt());
}
