use super::*;
use crate::samples::Masked;
use proptest::prelude::*;

const ROWS: usize = 130;
const COLS: usize = 150;
/// Side of a coarse pixel, pixels of the image.
const COARSE_PX: f32 = 8.0;

fn bits(valid: &[bool]) -> Vec<u8> {
    valid.chunks(8).map(|eight| eight.iter().rev().fold(0, |byte, bit| byte << 1 | u8::from(*bit))).collect()
}

/// Returns rolling hills with waves of 3 to 7 coarse pixels, and their image under `light`, times a brightness.
fn scene(light: Light, brightness: f32) -> (Vec<f32>, Vec<f32>) {
    let height = |r: f32, c: f32| {
        1.5 * ((r + 0.2 * c) / 4.3).sin() + 2.0 * ((c + 0.4 * r) / 6.1).cos() + 1.2 * ((c - 0.7 * r) / 7.0).sin()
    };
    let at = |i: usize| ((i / COLS) as f32, (i % COLS) as f32);
    let heights = (0..ROWS * COLS).map(|i| height(at(i).0, at(i).1)).collect();
    let image = (0..ROWS * COLS).map(|i| {
        let (r, c) = at(i);
        let (x, y) = (height(r, c + 1.0) - height(r, c - 1.0), height(r + 1.0, c) - height(r - 1.0, c));
        brightness * (1.0 + (light.east * x + light.south * y) / 4.0)
    });
    (image.collect(), heights)
}

/// Returns the mean over squares of a coarse pixel about every pixel: what a coarse DTM keeps of a map.
fn coarse(map: &[f32]) -> Vec<f32> {
    let side = COARSE_PX as isize;
    let at = |r: isize, c: isize| {
        map[r.clamp(0, ROWS as isize - 1) as usize * COLS + c.clamp(0, COLS as isize - 1) as usize]
    };
    let mean = |i: usize| {
        let (r, c) = ((i / COLS) as isize, (i % COLS) as isize);
        // An even box has half weights at its ends.
        let weight = |d: isize| if d.abs() == side / 2 { 0.5 } else { 1.0 };
        let box_ = || -side / 2..=side / 2;
        box_().flat_map(|dr| box_().map(move |dc| weight(dr) * weight(dc) * at(r + dr, c + dc))).sum::<f32>()
            / (side * side) as f32
    };
    (0..map.len()).map(mean).collect()
}

fn fit(image: &[f32], heights: &[f32]) -> LightFit {
    LightFit::of_tile(image, heights, COLS, 2.0, COARSE_PX)
}

/// Returns the strength that an image without noise gives: the fitted one, drawn to the expected one.
fn drawn(fitted: f64) -> f64 {
    let [of_fit, of_expected] = [strength::FITTED_SPREAD, EXPECTED_SPREAD].map(|spread| 1.0 / (spread * spread));
    ((of_fit * fitted.ln() + of_expected * EXPECTED_STRENGTH.ln()) / (of_fit + of_expected)).exp()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    /// The coarse DTM has lost up to a half of these waves. A fit that compares it with the image as it is would be too strong.
    #[test]
    fn the_light_is_found_without_bias(azimuth in 0.0f64..360.0, strength in 0.3f64..3.0, brightness in 1.0f32..5000.0) {
        let light = Light::of(azimuth, strength).unwrap();
        let (image, heights) = scene(light, brightness);
        let fit = fit(&image, &coarse(&heights));
        let found = fit.estimate(None, None).unwrap();
        let (strength, light) = (drawn(strength), Light::of(azimuth, drawn(strength)).unwrap());
        let error = libm::hypot(f64::from(found.light.east - light.east), f64::from(found.light.south - light.south));
        prop_assert!(error < 0.06 * strength, "{found:?} for {light:?}");
        prop_assert!(found.trust > 0.95 && found.azimuth_sd_deg < 10.0, "{found:?}");
        prop_assert!(found.related > 0.99, "{found:?}");
        let known = fit.estimate(Some(azimuth), None).unwrap();
        prop_assert!((f64::from(known.light.strength()) - strength).abs() < 0.06 * strength);
        prop_assert!((known.trust, known.azimuth_sd_deg) == (1.0, 0.0) && known.related > 0.999, "{known:?}");
        let opposite = fit.estimate(Some(azimuth + 180.0), None).unwrap();
        prop_assert!(opposite.related < 0.01, "{opposite:?}");
    }

    /// Albedo that does not follow relief makes the fit unsure, and by as much as it errs.
    #[test]
    fn noise_makes_the_fit_unsure(azimuth in 0.0f64..360.0, seed in any::<u32>()) {
        let light = Light::of(azimuth, 0.5).unwrap();
        let (mut image, heights) = scene(light, 1.0);
        // Patches of 12 x 12 pixels, up to twice as bright.
        for (i, v) in image.iter_mut().enumerate() {
            let patch = (i / COLS / 12 * 40 + i % COLS / 12) as u32;
            *v *= 1.0 + (patch.wrapping_add(seed).wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32;
        }
        let found = fit(&image, &coarse(&heights)).estimate(None, None).unwrap();
        prop_assert!(found.azimuth_sd_deg > 2.0, "{found:?}");
        let off = (found.light.azimuth_deg() - azimuth + 180.0).rem_euclid(360.0) - 180.0;
        prop_assert!(off.abs() < 4.5 * f64::from(found.azimuth_sd_deg), "{found:?}, {off} off");
    }
}

#[test]
fn brightness_that_ignores_slope_is_not_trusted() {
    let (_, heights) = scene(Light { east: 1.0, south: 0.0 }, 1.0);
    let noise = |i: usize| 100.0 + ((i / COLS / 6 * 97 + i % COLS / 6) as u32).wrapping_mul(2_654_435_761) as f32 / 2e8;
    let image: Vec<f32> = (0..ROWS * COLS).map(noise).collect();
    let found = fit(&image, &heights).estimate(None, None).unwrap();
    assert!(found.trust < 0.6 && found.azimuth_sd_deg > 25.0, "{found:?}");
    assert!(found.related < 0.1, "{found:?}");
}

/// The Bayes factor against its integral: the likelihood of a light, averaged over lights of the expected distribution, over that of none.
#[test]
fn the_probability_of_a_light_is_that_of_bayes() {
    let fits = [([9.0, 2.0, 5.0], [1.0, -2.0]), ([40.0, -10.0, 60.0], [30.0, 9.0]), ([0.3, 0.0, 0.1], [0.1, 0.4])];
    let axes = [None, Some(Axis { azimuth_deg: 70.0, sd_deg: 15.0 }), Some(Axis { azimuth_deg: 150.0, sd_deg: 300.0 })];
    for ((precision, vector), axis) in fits.into_iter().flat_map(|fit| axes.map(|axis| (fit, axis))) {
        let turn = axis.map_or(1e3, |axis| axis.sd_deg.to_radians());
        let share = 0.5 - 0.5 * (-2.0 * turn * turn).exp();
        let [of_along, of_across] = [1.0 - share, share].map(|share| share * EXPECTED_STRENGTH * EXPECTED_STRENGTH);
        let [east, south] = direction(axis.map_or(0.0, |axis| axis.azimuth_deg));
        let formal = precision.map(|v| VARIANCE_FACTOR * v);
        let [b, c] = vector.map(|v| VARIANCE_FACTOR * v);
        let (step, mut sum) = (EXPECTED_STRENGTH / 40.0, 0.0);
        for (i, j) in (-240..=240).flat_map(|i| (-240..=240).map(move |j| (i, j))) {
            let (x, y) = (f64::from(i) * step, f64::from(j) * step);
            let (along, across) = (x * east + y * south, x * south - y * east);
            let expected = along * along / of_along + across * across / of_across;
            let log_likelihood = x * b + y * c - 0.5 * square(formal, [x, y]);
            sum += step * step * (log_likelihood - 0.5 * expected).exp();
        }
        let odds = sum / (core::f64::consts::TAU * (of_along * of_across).sqrt());
        let found = Information { precision, vector }.related(axis);
        assert!((found - odds / (1.0 + odds)).abs() < 1e-3, "{axis:?}: {found} for {}", odds / (1.0 + odds));
    }
}

/// A long wave of brightness, as albedo and a turning Sun make it, does not move the fit.
#[test]
fn long_waves_of_brightness_do_not_count() {
    let light = Light::of(200.0, 1.0).unwrap();
    let (image, heights) = scene(light, 1.0);
    let ramp: Vec<f32> = image.iter().enumerate().map(|(i, v)| v + (i / COLS) as f32 / ROWS as f32).collect();
    let (clean, found) = (fit(&image, &heights), fit(&ramp, &heights));
    let [clean, found] = [clean, found].map(|fit| fit.estimate(None, None).unwrap().light);
    assert!((clean.azimuth_deg() - found.azimuth_deg()).abs() < 6.0, "{found:?} for {clean:?}");
}

#[test]
fn cells_with_invalid_pixels_are_left_out() {
    let light = Light::of(300.0, 1.0).unwrap();
    let (mut image, heights) = scene(light, 7.0);
    let clean = fit(&image, &heights);
    // Wrong values under the mask, within one cell; a void elsewhere. Both are a quarter of a cell.
    let block =
        |i: usize, first: usize| (first..first + 4).contains(&(i / COLS)) && (first..first + 4).contains(&(i % COLS));
    let valid: Vec<bool> = (0..image.len()).map(|i| !block(i, 20)).collect();
    for (i, v) in image.iter_mut().enumerate() {
        *v = if block(i, 20) {
            1e3
        } else if block(i, 100) {
            f32::NAN
        } else {
            *v
        };
    }
    let bits = bits(&valid);
    let masked = |samples| LightFit::of_tile(Masked { samples, bits: &bits }, &heights, COLS, 2.0, COARSE_PX);
    // What a masked pixel contains does not matter.
    let mut other = image.clone();
    other[22 * COLS + 21] = f32::NAN;
    assert_eq!(masked(&image[..]), masked(&other[..]));
    // Squares without one of their cells do not count. The overlapping squares about a pixel count for little more than one.
    assert!((4.0..7.0).contains(&(clean.cells - fit(&image, &heights).cells)));
    assert!((8.0..14.0).contains(&(clean.cells - masked(&image[..]).cells)));
    let (found, clean) = (masked(&image[..]).estimate(None, None).unwrap(), clean.estimate(None, None).unwrap());
    assert!((found.light.east - clean.light.east).abs() < 0.03, "{found:?} for {clean:?}");
}

/// A twentieth of the pixels is dead: half of them NaN, half under the mask with wrong values.
#[test]
fn scattered_invalid_pixels_do_not_matter() {
    let light = Light::of(300.0, 1.0).unwrap();
    let (mut image, heights) = scene(light, 7.0);
    let heights = coarse(&heights);
    let clean = fit(&image, &heights);
    let mut valid = vec![true; image.len()];
    let dead = (0u32..).map(|i| i.wrapping_mul(2_654_435_761) >> 16);
    for (i, dead) in (0..image.len()).zip(dead) {
        match dead % 40 {
            0 => image[i] = f32::NAN,
            1 => (image[i], valid[i]) = (1e3, false),
            _ => {}
        }
    }
    let masked = Masked { samples: &image[..], bits: &bits(&valid) };
    let fit = LightFit::of_tile(masked, &heights, COLS, 2.0, COARSE_PX);
    assert!(fit.cells > 0.95 * clean.cells, "{} of {}", fit.cells, clean.cells);
    let (found, clean) = (fit.estimate(None, None).unwrap(), clean.estimate(None, None).unwrap());
    assert!((found.light.azimuth_deg() - clean.light.azimuth_deg()).abs() < 1.0, "{found:?} for {clean:?}");
    assert!((found.light.strength() / clean.light.strength() - 1.0).abs() < 0.02, "{found:?} for {clean:?}");
}

/// Half of the scene lies in the shadow of a mountain beyond its edge. The fit is that of the other half.
#[test]
fn cells_in_shadow_are_left_out() {
    let light = Light::of(300.0, 1.0).unwrap();
    let (mut image, heights) = scene(light, 7.0);
    let heights = coarse(&heights);
    let all = fit(&image, &heights);
    for (i, v) in image.iter_mut().enumerate() {
        if i % COLS >= COLS / 2 {
            *v *= 0.01;
        }
    }
    let whole = fit(&image, &heights);
    // Dead pixels in the shadow do not make it ground that is lit.
    for v in image.iter_mut().filter(|v| **v < 1.0).step_by(16) {
        *v = f32::NAN;
    }
    let fit = fit(&image, &heights);
    assert!((whole.cells - fit.cells).abs() < 0.02 * whole.cells, "{} for {}", fit.cells, whole.cells);
    assert!((0.4 * all.cells..0.6 * all.cells).contains(&fit.cells), "{} of {}", fit.cells, all.cells);
    let (found, clean) = (fit.estimate(None, None).unwrap(), all.estimate(None, None).unwrap());
    assert!((found.light.azimuth_deg() - clean.light.azimuth_deg()).abs() < 12.0, "{found:?} for {clean:?}");
    assert!(found.azimuth_sd_deg < 20.0 && found.trust > 0.8, "{found:?}");
}

#[test]
fn fits_add_up_and_tell_another_light() {
    let light = Light::of(300.0, 1.0).unwrap();
    let (image, heights) = scene(light, 7.0);
    let one = fit(&image, &coarse(&heights));
    let at = |fit: &LightFit| fit.estimate(None, None).unwrap();
    // Half of it twice is all of it; a part without weight is nothing.
    let mut halves = LightFit::default();
    halves.add_fit(&one, 0.5);
    halves.add_fit(&one, 0.5);
    halves.add_fit(&fit(&image.iter().map(|v| 9.0 - v).collect::<Vec<_>>(), &heights), 0.0);
    assert_eq!((at(&halves), halves.cells), (at(&one), one.cells));
    let chi = |azimuth, strength, spread| one.chi_squared(Light::of(azimuth, strength).unwrap(), spread).unwrap();
    let found = at(&one).light;
    assert!(one.chi_squared(Light::of(found.azimuth_deg(), 1.0).unwrap(), 0.2).unwrap() < 0.1);
    // 0.2 of the strength is one standard deviation, and so are 11 degrees; the fit has its own.
    assert!((0.6..1.2).contains(&chi(300.0, 1.2, 0.2)), "{}", chi(300.0, 1.2, 0.2));
    assert!((0.6..1.2).contains(&chi(311.5, 1.0, 0.2)), "{}", chi(311.5, 1.0, 0.2));
    assert!(chi(340.0, 1.0, 0.2) > 9.0 && chi(340.0, 1.0, 0.0) > 100.0);
    assert_eq!(LightFit::default().chi_squared(light, 0.2), None);
}

#[test]
fn what_is_known_is_kept_and_the_rest_fitted() {
    let truth = Light::of(300.0, 1.0).unwrap();
    let (image, heights) = scene(truth, 7.0);
    let fit = fit(&image, &coarse(&heights));
    let light = |fit: &LightFit, azimuth, elevation| fit.estimate(azimuth, elevation).map(|found| found.light);
    // With the Sun on the other side, and without any cell, there is no light to fit.
    let near = |a: Option<Light>, b: Option<Light>| (a.unwrap().east - b.unwrap().east).abs() < 1e-6;
    assert!(near(light(&fit, Some(120.0), Some(40.0)), Light::from_sun(120.0, 40.0)));
    assert!(near(light(&LightFit::default(), Some(300.0), Some(40.0)), Light::from_sun(300.0, 40.0)));
    assert_eq!(light(&LightFit::default(), Some(300.0), None), None);
    assert_eq!(light(&LightFit::default(), None, Some(40.0)), None);
    assert_eq!(light(&fit, Some(300.0), Some(-1.0)), None);
    assert_eq!(light(&fit, None, Some(f64::NAN)), None);
    assert_eq!(light(&fit, Some(f64::NAN), None), None);
    assert!((light(&fit, Some(310.0), None).unwrap().azimuth_deg() - 310.0).abs() < 1e-3);
    assert!((light(&fit, None, Some(40.0)).unwrap().azimuth_deg() - 300.0).abs() < 2.0);
    // This image has no noise, so the fit has more weight than the stated elevation.
    for elevation in [10.0, 30.0, 70.0] {
        let told = Light::from_sun(300.0, elevation).unwrap().strength();
        let drawn = light(&fit, None, Some(elevation)).unwrap().strength();
        assert!(drawn.ln().abs() < 0.12 * told.ln().abs(), "{elevation}: {drawn}, told {told}");
    }
}

#[test]
fn featureless_gappy_and_small_scenes_have_no_light() {
    let flat = vec![1.0f32; ROWS * COLS];
    let (image, heights) = scene(Light { east: 1.0, south: 0.0 }, 1.0);
    let none = |image: &[f32], heights: &[f32]| fit(image, heights).estimate(None, None).is_none();
    assert!(none(&image, &flat));
    assert!(none(&vec![0.0; ROWS * COLS], &heights));
    assert!(none(&vec![f32::NAN; ROWS * COLS], &heights));
    assert!(none(&image[..20 * COLS], &heights[..20 * COLS]));
    assert!(none(&image[1..], &heights));
    // An image without contrast has a light of strength 0.
    assert!(none(&flat, &heights));
    assert!(LightFit::of_tile(&[][..], &[], 0, 2.0, 8.0).estimate(None, None).is_none());
    for coarse_px in [0.0, f32::NAN, f32::INFINITY, -3.0, 1e9] {
        assert!(LightFit::cell_px(coarse_px) >= 4 && LightFit::cell_px(coarse_px) <= 256);
    }
}

#[test]
fn the_axis_turns_an_unsure_fit_and_leaves_its_end() {
    let light = Light::of(250.0, 0.3).unwrap();
    let (mut image, heights) = scene(light, 1.0);
    for (i, v) in image.iter_mut().enumerate() {
        let patch = (i / COLS / 12 * 40 + i % COLS / 12) as u32;
        *v *= 1.0 + (patch.wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32;
    }
    let fit = fit(&image, &coarse(&heights));
    let (alone, turned) = (fit.estimate(None, None).unwrap(), |azimuth_deg, sd_deg| {
        fit.with_axis(Some(Axis { azimuth_deg, sd_deg })).estimate(None, None).unwrap()
    });
    let sure = turned(70.0, 3.0);
    assert!((sure.light.azimuth_deg() - 250.0).abs() < 6.0, "{sure:?}, without axis {alone:?}");
    assert!(
        sure.azimuth_sd_deg < 4.0 && alone.azimuth_sd_deg > sure.azimuth_sd_deg,
        "{sure:?}, without axis {alone:?}"
    );
    assert!(sure.trust >= alone.trust);
    // An axis without an error is none that was measured: it turns nothing, and no light is related to it.
    let exact = turned(70.0, 0.0);
    assert_eq!((exact.light, exact.related), (alone.light, 0.0));
    // An axis that knows nothing changes nothing.
    assert!((turned(70.0, 1e9).light.east - alone.light.east).abs() < 1e-5);
    // Under a known azimuth the axis says how much of the contrast is relief: the more, the stronger the light.
    let told = |sd_deg| fit.with_axis(Some(Axis { azimuth_deg: 70.0, sd_deg })).estimate(Some(250.0), None).unwrap();
    let [all, little] = [6.0, 60.0].map(told);
    assert!(all.light.strength() > little.light.strength(), "{all:?} {little:?}");
    assert_eq!((all.azimuth_sd_deg, all.trust), (0.0, 1.0));
}

#[test]
fn the_contrast_of_ground_without_albedo_implies_the_lights_own_strength() {
    let (image, heights) = scene(Light::of(250.0, 0.3).unwrap(), 1.0);
    let axis = Axis { azimuth_deg: 70.0, sd_deg: 6.0 };
    let told = fit(&image, &coarse(&heights)).with_axis(Some(axis)).estimate(Some(250.0), None).unwrap();
    // It is drawn to the expected strength, which is six times as high, by less than that.
    assert!((f64::from(told.light.strength()) / 0.3).ln().abs() < 0.15, "{told:?}");
}

/// The fit of a mirrored or transposed scene is the mirrored or transposed fit, whatever remains at the edges.
#[test]
fn a_mirrored_scene_has_the_mirrored_light() {
    let light = Light::of(300.0, 1.0).unwrap();
    let (image, heights) = scene(light, 7.0);
    let heights = coarse(&heights);
    let light = |image: &[f32], heights: &[f32], cols| {
        LightFit::of_tile(image, heights, cols, 2.0, COARSE_PX).estimate(None, None).unwrap().light
    };
    let straight = light(&image, &heights, COLS);
    let turned =
        |place: fn(usize) -> usize| [&image, &heights].map(|map| (0..map.len()).map(|i| map[place(i)]).collect());
    let near = |a: f32, b: f32| assert!((a - b).abs() < 1e-4, "{a} and {b}");
    let [i, z]: [Vec<f32>; 2] = turned(|i| i / COLS * COLS + COLS - 1 - i % COLS);
    let found = light(&i, &z, COLS);
    near(found.east, -straight.east);
    near(found.south, straight.south);
    let [i, z]: [Vec<f32>; 2] = turned(|i| i % ROWS * COLS + i / ROWS);
    let found = light(&i, &z, ROWS);
    near(found.east, straight.south);
    near(found.south, straight.east);
}

/// Side of the cells of [`plain`], pixels.
const SIDE: usize = 12;

/// Returns the cell whose box begins here by sums over its pixels, written down plainly.
fn plain(maps: &Rectangle<'_, impl Samples>, top: usize, left: usize) -> Option<Cell> {
    let (image, heights) = (|i: usize| maps.image.at(i), maps.coarse_m);
    let counts = |i: usize| image(i).is_finite();
    let box_ = (top..top + SIDE).flat_map(|row| (left..left + SIDE).map(move |col| row * COLS + col));
    let near = |i: usize| [i - 1, i + 1, i - COLS, i + COLS].map(|i| f64::from(heights[i]));
    if !box_.clone().all(|i| near(i).iter().all(|z| z.is_finite())) {
        return None;
    }
    // At most an eighth of the pixels is invalid.
    if box_.clone().filter(|&i| !counts(i)).count() > SIDE * SIDE / 8 {
        return None;
    }
    // Sixteen squares under the tent.
    let half = SIDE / 2;
    let dark = |square: usize| {
        let (top, left) = (top - half + square / 4 * half, left - half + square % 4 * half);
        let pixels = (top..top + half).flat_map(|row| (left..left + half).map(move |col| row * COLS + col));
        let seen: Vec<usize> = pixels.filter(|&i| counts(i)).collect();
        !seen.is_empty() && seen.into_iter().all(|i| image(i) < 5.0)
    };
    if (0..16).any(dark) {
        return None;
    }
    let slope = |a: usize, b: usize, step: f64| {
        box_.clone().map(|i| near(i)[b] - near(i)[a]).sum::<f64>() / (SIDE * SIDE) as f64 / 2.0 / step
    };
    let (mut sum, mut weights) = (0.0, 0.0);
    for (row, col) in (0..2 * SIDE).flat_map(|row| (0..2 * SIDE).map(move |col| (row, col))) {
        let rise = |n: usize| n.min(2 * SIDE - 1 - n) as f64 + 0.5;
        let i = (top + row - SIDE / 2) * COLS + left + col - SIDE / 2;
        if counts(i) {
            sum += rise(row) * rise(col) * f64::from(image(i));
            weights += rise(row) * rise(col);
        }
    }
    Some([sum / weights, slope(0, 1, 2.0), slope(2, 3, 3.0)])
}

/// Cells against sums over their pixels, written down plainly; with voids, a mask, and pixels longer than wide.
#[test]
fn cells_are_means_under_a_box_and_a_tent() {
    let noise = |i: usize, k: usize| ((i * 2_654_435_761 + k * 40_503) >> 7 & 0xFFFF) as f32 / 65_536.0;
    let mut image: Vec<f32> = (0..ROWS * COLS).map(|i| 50.0 + 100.0 * noise(i, 1)).collect();
    let mut heights: Vec<f32> = (0..ROWS * COLS).map(|i| 30.0 * noise(i, 2)).collect();
    (70..82).for_each(|row| image[row * COLS + 30..][..12].fill(f32::NAN));
    heights[20 * COLS + 90] = f32::NEG_INFINITY;
    (100..ROWS).for_each(|row| image[row * COLS + 100..(row + 1) * COLS].fill(1.0));
    image[100 * COLS..].iter_mut().step_by(16).for_each(|v| *v = f32::NAN);
    let masked = |i: usize| (50..54).contains(&(i / COLS)) && (77..82).contains(&(i % COLS));
    let valid: Vec<bool> = (0..image.len()).map(|i| !masked(i)).collect();
    let pixel = PixelSize { row_m: 3.0, col_m: 2.0 };
    let maps = Rectangle {
        image: Masked { samples: &image[..], bits: &bits(&valid) },
        coarse_m: &heights,
        cols: COLS,
        pixel,
        half: SIDE / 2,
        dark_below: 5.0,
    };
    let (down, across) = (Places::of(ROWS, SIDE).unwrap(), Places::of(COLS, SIDE).unwrap());
    // The numbers of places along both sides. Cells about the void, the infinite height, the masked pixels and in the dark are left out.
    assert_eq!((down.count(1), across.count(1)), (18, 22));
    let few: Vec<_> = (0..16).map(|left| compared::<COLUMNS, 1>(&maps, &down, &across, left, COLUMNS)).collect();
    let many = [compared::<16, 2>(&maps, &down, &across, 0, 16), compared::<16, 2>(&maps, &down, &across, 16, 6)];
    for (found, columns, expected) in [(&few[..], 16 * COLUMNS, 60..200), (&many, 22, 40..100)] {
        let (count, left_out) = found.iter().fold((0, 0), |(a, b), (c, d)| (a + c, b + d));
        assert_eq!(count + left_out, 18 * columns);
        assert!(expected.contains(&left_out), "{left_out}");
    }
}

/// Compares columns of cells with [`plain`]; returns how many there are, and how many are left out.
fn compared<const WIDE: usize, const APART: usize>(
    maps: &Rectangle<'_, impl Samples>,
    down: &Places,
    across: &Places,
    first: usize,
    columns: usize,
) -> (usize, usize) {
    let (mut count, mut left_out) = (0, 0);
    let cells = CellColumns::<_, WIDE, APART>::new(maps, down, across.at(first), columns);
    for (top, row) in cells.enumerate() {
        assert!(row[columns..].iter().all(Option::is_none));
        for (column, cell) in row.into_iter().enumerate().take(columns) {
            let expected = plain(maps, down.at(top), across.at(first + PHASES / APART * column));
            assert_eq!(cell.is_some(), expected.is_some(), "{top} {first} {column}");
            let (Some(cell), Some(expected)) = (cell, expected) else {
                left_out += 1;
                continue;
            };
            cell.iter().zip(expected).for_each(|(a, b)| assert!((a - b).abs() < 1e-5 * (1.0 + b.abs()), "{a} {b}"));
            count += 1;
        }
    }
    (count, left_out)
}

/// Flight software adds one column of squares at a time, the ground many: the sums are the same bits, at every width and every edge.
#[test]
fn the_sums_of_many_columns_are_those_of_one_after_the_other() {
    let (mut image, heights) = scene(Light::of(300.0, 1.0).unwrap(), 7.0);
    image.iter_mut().step_by(97).for_each(|v| *v = f32::NAN);
    for (cell_px, cols) in [(4, COLS), (4, 100), (8, COLS), (12, COLS), (12, 36), (16, 50)] {
        let (image, heights) = (&image[..ROWS * cols], &heights[..ROWS * cols]);
        let part = FitPart { image, coarse_m: heights, cols, pixel: PixelSize::square(2.0), cell_px };
        let (brightness, mut single, mut all) = (Brightness::of(image), LightFit::default(), LightFit::default());
        (0..part.columns()).for_each(|column| part.add_to(&mut single, &brightness, column));
        part.add_all(&mut all, &brightness);
        assert_eq!(single, all, "{cell_px} {cols}");
        for behind in [part.columns() + 8, usize::MAX] {
            part.add_to(&mut single, &brightness, behind);
        }
        assert_eq!(single, all, "columns that do not exist");
        assert!(all.cells > 0.0);
    }
}
