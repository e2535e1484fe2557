//! Strips of all lengths and widths around the tiles' borders, with rings and budgets of every kind.

use super::rig::{Scene, TILE, file, run, settings};
use crate::strip::StripSettings;

#[test]
fn every_length_is_the_whole_scene_at_once() {
    let file = file();
    let mut gaps = 0;
    for cols in [1, 7, TILE.cols, 11, 17, 25] {
        for rows in 1..=4 * TILE.rows {
            let scene = Scene::new(rows, cols);
            let (ring, budget) = (TILE.rows + 1 + rows % 5 * 6, [1, 5_000, u64::MAX][rows % 3]);
            let settings = settings(cols, ring);
            let expected = scene.heights_m(&file, &settings);
            let what = format!("{rows} x {cols}, {ring} lines kept, {budget} at once");
            let found = run(&file, &scene, settings, budget, rows % 2 == 0);
            scene.assert_heights(&found, &expected, &settings, &what);
            gaps += expected.iter().filter(|z| z.is_nan()).count();
        }
    }
    assert!(gaps > 500, "{gaps}");
}

#[test]
fn every_overlap_is_the_whole_scene_at_once() {
    let file = file();
    let scene = Scene::new(41, 23);
    for overlap_px in 0..TILE.cols {
        for (ring, eager) in [(TILE.rows + 1, true), (TILE.rows + 1, false), (60, false)] {
            let settings = StripSettings { overlap_px, anchor: overlap_px % 2 == 0, ..settings(23, ring) };
            let expected = scene.heights_m(&file, &settings);
            let found = run(&file, &scene, settings, 700, eager);
            scene.assert_heights(&found, &expected, &settings, &format!("overlap {overlap_px}"));
        }
    }
}

#[test]
fn tiles_with_nothing_to_see_keep_the_coarse_heights() {
    let file = file();
    let mut scene = Scene::new(60, 25);
    // Lines without contrast, lines without light, lines without relief.
    scene.image[..14 * 25].fill(7.0);
    scene.image[20 * 25..34 * 25].fill(f32::NAN);
    scene.coarse_m[40 * 25..53 * 25].fill(-1900.0);
    let settings = StripSettings { overlap_px: 0, ..settings(25, 20) };
    let expected = scene.heights_m(&file, &settings);
    scene.assert_heights(&run(&file, &scene, settings, 1000, true), &expected, &settings, "nothing to see");
    let real = |i: &usize| scene.coarse_m[*i].is_finite() && scene.coarse_m[*i] > -1e9;
    let coarse = (0..12 * 25).filter(real).filter(|&i| (expected[i] - scene.coarse_m[i]).abs() < 1e-3).count();
    assert_eq!(coarse, (0..12 * 25).filter(real).count());
    assert!(expected[20 * 25..34 * 25].iter().all(|z| z.is_nan()));
}
