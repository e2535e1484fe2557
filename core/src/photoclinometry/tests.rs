//! Compares with a simple implementation in double precision, and with known ground.

use super::*;
use crate::norm::NormError;
use crate::norm::{ElevationScale, Mirror};
use crate::tile::Shape;
use crate::words::Words;
use core::f64::consts::TAU;

const PLAIN: (&Share, f32) = (&Share::WHOLE, 1.0);

/// A complex field, row-major.
type Field = Vec<[f64; 2]>;

/// Returns the discrete Fourier transform by definition, along one axis after the other.
fn naive_transform(field: &Field, (rows, cols): (usize, usize), sign: f64) -> Field {
    let line = |values: &[[f64; 2]]| -> Field {
        let n = values.len();
        let one = |k: usize| {
            values.iter().enumerate().fold([0.0, 0.0], |[x, y], (j, [re, im])| {
                let (sin, cos) = (sign * TAU * (j * k % n) as f64 / n as f64).sin_cos();
                [x + re * cos - im * sin, y + re * sin + im * cos]
            })
        };
        (0..n).map(one).collect()
    };
    let across: Field = field.chunks(cols).flat_map(line).collect();
    let mut out = vec![[0.0; 2]; rows * cols];
    for col in 0..cols {
        let column: Field = (0..rows).map(|row| across[row * cols + col]).collect();
        line(&column).into_iter().enumerate().for_each(|(row, v)| out[row * cols + col] = v);
    }
    out
}

/// Returns the relief by the formula, from the unexplained slope.
fn naive_relief(slope: &[f64], plan: &Photoclinometry, [east, south]: [f64; 2], coarse_px: f64) -> Vec<f64> {
    let (Shape { rows, cols }, (height, width)) = (plan.tile, (plan.rows.len(), plan.cols.len()));
    let (top, left) = plan.corner();
    // Reflects the index until it is inside the tile.
    let inside = |mut i: isize, n: isize| {
        while !(0..n).contains(&i) {
            i = if i < 0 { -i } else { 2 * (n - 1) - i };
        }
        i as usize
    };
    let padded: Field = (0..height * width)
        .map(|i| {
            let row = inside((i / width) as isize - top as isize, rows as isize);
            let col = inside((i % width) as isize - left as isize, cols as isize);
            [slope[row * cols + col], 0.0]
        })
        .collect();
    let mut spectrum = naive_transform(&padded, (height, width), -1.0);
    let wave = |k: usize, n: usize| TAU * if 2 * k > n { k as f64 - n as f64 } else { k as f64 } / n as f64;
    for (i, v) in spectrum.iter_mut().enumerate() {
        let (m, k) = (i / width, i % width);
        let (down, across) = (wave(m, height), wave(k, width));
        let along = east * across + south * down;
        let all = along * along + f64::from(SMOOTHNESS) * (across * across + down * down) + (1.4 * coarse_px).powi(-2);
        let gain = if 2 * m == height || 2 * k == width { 0.0 } else { along / all };
        *v = [v[1] * gain, -v[0] * gain];
    }
    let field = naive_transform(&spectrum, (height, width), 1.0);
    let at = |row: usize, col: usize| field[(top + row) * width + left + col][0] / (height * width) as f64;
    (0..rows * cols).map(|i| at(i / cols, i % cols)).collect()
}

/// Returns the relief of maps without voids.
fn relief(
    plan: &Photoclinometry,
    (image, coarse): (&[f32], &[f32]),
    light: Light,
    coarse_px: f32,
    weight: (&Share, f32),
) -> Vec<f32> {
    let shading = Shading::new(image, light).unwrap();
    let mut scratch = vec![9.0; plan.scratch_len()];
    let row = |map: &[f32], row: usize, out: &mut [f32]| out.copy_from_slice(&map[row * out.len()..][..out.len()]);
    let (bright, heights) =
        (|r: usize, out: &mut [f32]| row(image, r, out), |r: usize, out: &mut [f32]| row(coarse, r, out));
    let found = plan
        .relief(
            &LitTile { brightness: bright, coarse: heights, shading: &shading, light, coarse_px },
            weight.0,
            weight.1,
            &mut scratch,
        )
        .unwrap();
    (0..plan.tile.rows).flat_map(|r| found.part(r * plan.tile.cols, plan.tile.cols).to_vec()).collect()
}

fn noise(n: usize) -> Vec<f32> {
    (0..n as u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 23) as f32 - 1.0).collect()
}

#[test]
fn the_relief_is_that_of_the_formula() {
    let (rows, cols) = (20, 29);
    let plan = Photoclinometry::new(Shape::new(rows, cols));
    let light = Light { east: 1.5, south: 0.8 };
    let image: Vec<f32> = noise(rows * cols).iter().map(|v| 100.0 + 20.0 * v).collect();
    let coarse: Vec<f32> = noise(2 * rows * cols)[rows * cols..].iter().map(|v| 0.1 * v).collect();
    let found = relief(&plan, (&image, &coarse), light, 7.0, PLAIN);

    let mean = image.iter().map(|v| f64::from(*v)).sum::<f64>() / (rows * cols) as f64;
    let strength = f64::from(light.strength());
    let direction = [f64::from(light.east) / strength, f64::from(light.south) / strength];
    let z = |r: usize, c: usize| f64::from(coarse[r * cols + c]);
    let mut slope: Vec<f64> = (0..rows * cols)
        .map(|i| {
            let (r, c) = (i / cols, i % cols);
            let (r0, r1, c0, c1) =
                (r.saturating_sub(1), (r + 1).min(rows - 1), c.saturating_sub(1), (c + 1).min(cols - 1));
            let known = direction[0] * (z(r, c1) - z(r, c0)) / (c1 - c0) as f64
                + direction[1] * (z(r1, c) - z(r0, c)) / (r1 - r0) as f64;
            (f64::from(image[i]) / mean - 1.0) / strength - known
        })
        .collect();
    let mean = slope.iter().sum::<f64>() / slope.len() as f64;
    slope.iter_mut().for_each(|v| *v -= mean);
    let expected = naive_relief(&slope, &plan, direction, 7.0);
    let largest = expected.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    for (found, expected) in found.iter().zip(&expected) {
        assert!((f64::from(*found) - expected).abs() < 1e-5 * largest.max(1.0), "{found} for {expected}");
    }
    assert!(largest > 0.05, "the relief must not be empty: {largest}");
}

#[test]
fn craters_come_back() {
    let (rows, cols) = (96, 128);
    let plan = Photoclinometry::new(Shape::new(rows, cols));
    let light = Light { east: 0.9, south: 0.6 };
    // The ground has Gaussian pits.
    let pits = [(30.0, 40.0, 6.0, 1.5), (60.0, 90.0, 9.0, 2.0), (70.0, 30.0, 4.0, 1.0f32)];
    let height = |r: f32, c: f32| -> f32 {
        let pit = |&(y, x, size, depth): &(f32, f32, f32, f32)| {
            -depth * (-((r - y).powi(2) + (c - x).powi(2)) / (2.0 * size * size)).exp()
        };
        pits.iter().map(pit).sum()
    };
    let at = |i: usize| ((i / cols) as f32, (i % cols) as f32);
    let image: Vec<f32> = (0..rows * cols)
        .map(|i| {
            let (r, c) = at(i);
            let (x, y) = (height(r, c + 0.5) - height(r, c - 0.5), height(r + 0.5, c) - height(r - 0.5, c));
            500.0 * (1.0 + light.east * x + light.south * y)
        })
        .collect();
    let coarse = vec![-3.0; rows * cols];
    let found = relief(&plan, (&image, &coarse), light, 30.0, PLAIN);
    let truth: Vec<f32> = (0..rows * cols).map(|i| height(at(i).0, at(i).1)).collect();
    let mean = |v: &[f32]| v.iter().sum::<f32>() / v.len() as f32;
    let (a, b) = (mean(&found), mean(&truth));
    let product = |x: &[f32], p: f32, y: &[f32], q: f32| x.iter().zip(y).map(|(x, y)| (x - p) * (y - q)).sum::<f32>();
    let correlation =
        product(&found, a, &truth, b) / (product(&found, a, &found, a).sqrt() * product(&truth, b, &truth, b).sqrt());
    // The weight of slopes across the light is a twentieth of the misfit's: recovered pits are elongated along it.
    assert!(correlation > 0.85, "correlation {correlation}");
}

#[test]
fn gaps_leave_the_coarse_dtm_and_odd_arguments_are_harmless() {
    let plan = Photoclinometry::new(Shape::new(16, 16));
    let (light, image) = (Light { east: 1.0, south: 0.0 }, vec![1.0, 2.0]);
    let shading = Shading::new(&image[..], light).unwrap();
    let mut scratch = vec![f32::NAN; plan.scratch_len()];
    let (dark, level) = (|_: usize, out: &mut [f32]| out.fill(f32::NAN), |_: usize, out: &mut [f32]| out.fill(4.0));
    for coarse_px in [30.0, 0.0, f32::NAN] {
        let tile = LitTile { brightness: dark, coarse: level, shading: &shading, light, coarse_px };
        let relief = plan.relief(&tile, PLAIN.0, PLAIN.1, &mut scratch).unwrap();
        assert!((0..16).all(|row| relief.part(16 * row, 16) == [0.0; 16]));
        let beyond = crate::part::defaults::Expected::new();
        assert!(relief.part(100 * 100, 16).is_empty() && beyond.count() == 1);
    }
    let tile = LitTile { brightness: dark, coarse: level, shading: &shading, light, coarse_px: 30.0 };
    let short = plan.relief(&tile, PLAIN.0, PLAIN.1, &mut scratch[1..]);
    assert_eq!(short.unwrap_err().expected, plan.scratch_len());
    let scale = ElevationScale::from_pixel(&[1.0; 9], None, 2.0, 50.0).unwrap();
    let (mirror, weight) = (Mirror::default(), Weight::Trust { trust: 1.0, long_share: None });
    let tile = GuideInput { image: &image[..], coarse_m: &image, mirror, coarse_px: 30.0, weight };
    assert!(matches!(Guide::new(&plan, tile, &scale, light, &mut scratch), Err(NormError::Length(_))));
    for (i, n, expected) in [(-1, 5, 1), (5, 5, 3), (8, 5, 0), (-30, 2, 0), (3, 1, 0)] {
        assert_eq!(mirrored(i, n), expected, "{i} of {n}");
    }
}

/// Returns the contrast of an image above level ground.
fn contrast(plan: &Photoclinometry, image: &[f32], light: Light) -> Contrast {
    let shading = Shading::new(image, light).unwrap();
    let mut scratch = vec![f32::NAN; plan.scratch_len()];
    let bright = |row: usize, out: &mut [f32]| out.copy_from_slice(&image[row * out.len()..][..out.len()]);
    let level = |_: usize, out: &mut [f32]| out.fill(0.0);
    plan.contrast(
        &LitTile { brightness: bright, coarse: level, shading: &shading, light, coarse_px: 30.0 },
        &mut scratch,
    )
    .unwrap()
}

/// Returns noise with waves of 4 pixels and more: means over 4 x 4 values.
fn rough(rows: usize, cols: usize, seed: usize) -> Vec<f32> {
    // The finaliser of MurmurHash3: numbers without a pattern.
    let random = |i: usize| {
        let mut x = i as u32;
        for factor in [0x85EB_CA6B_u32, 0xC2B2_AE35] {
            x = (x ^ (x >> 15)).wrapping_mul(factor);
        }
        (x ^ (x >> 16)) as f32 / (1u32 << 31) as f32 - 1.0
    };
    let at = |r: usize, c: usize| random(seed + r * (cols + 4) + c + 1);
    let mean = |i: usize| (0..16).map(|j| at(i / cols + j / 4, i % cols + j % 4)).sum::<f32>() / 16.0;
    (0..rows * cols).map(mean).collect()
}

/// Returns the image of ground and albedo, both rough.
fn lit(rows: usize, cols: usize, light: Light, relief: f32, albedo: f32) -> Vec<f32> {
    let (ground, patches) = (rough(rows + 1, cols + 1, 0), rough(rows, cols, 54_321));
    let z = |r: usize, c: usize| relief * ground[r * (cols + 1) + c];
    let bright = |i: usize| {
        let (r, c) = (i / cols, i % cols);
        light.east * (z(r, c + 1) - z(r, c)) + light.south * (z(r + 1, c) - z(r, c)) + albedo * patches[i]
    };
    (0..rows * cols).map(|i| 100.0 * (1.0 + bright(i))).collect()
}

#[test]
fn the_share_of_relief_is_found() {
    let (rows, cols) = (96, 120);
    let plan = Photoclinometry::new(Shape::new(rows, cols));
    for azimuth in [270.0, 315.0, 20.0] {
        let light = Light::of(azimuth, 1.0).unwrap();
        let of =
            |relief, albedo| contrast(&plan, &lit(rows, cols, light, relief, albedo), light).share(light).octave(2);
        let (ground, patches) = (of(0.4, 0.0), of(0.0, 0.3));
        let between = of(0.2, 0.2);
        assert!(ground > 0.9, "{azimuth}: {ground}");
        assert!(patches < 0.25, "{azimuth}: {patches}");
        assert!(between < ground && between > patches, "{azimuth}: {between}");
    }
    // Relief lit from the side that was not stated.
    let (lit_from, stated) = (Light::of(270.0, 1.0).unwrap(), Light::of(0.0, 1.0).unwrap());
    let found = contrast(&plan, &lit(rows, cols, lit_from, 0.4, 0.0), stated);
    assert!(found.share(stated).octave(2) < 0.05);
    let axis = found.axis().unwrap();
    assert!((axis.azimuth_deg - 90.0).abs() < 6.0 && axis.sd_deg < 10.0, "{axis:?}");
}

/// Tests the spectrum against the transform by definition.
#[test]
fn the_power_of_octaves_is_that_of_the_definition() {
    let (rows, cols) = (12, 17);
    let plan = Photoclinometry::new(Shape::new(rows, cols));
    let light = Light { east: 1.2, south: 0.5 };
    let image: Vec<f32> = noise(rows * cols).iter().map(|v| 100.0 + 20.0 * v).collect();
    let shading = Shading::new(&image[..], light).unwrap();
    let mut scratch = vec![f32::NAN; plan.scratch_len()];
    let bright = |row: usize, out: &mut [f32]| out.copy_from_slice(&image[row * out.len()..][..out.len()]);
    let level = |_: usize, out: &mut [f32]| out.fill(0.0);
    let found = plan
        .contrast(
            &LitTile { brightness: bright, coarse: level, shading: &shading, light, coarse_px: 30.0 },
            &mut scratch,
        )
        .unwrap();

    let (height, width, (top, left)) = (plan.rows.len(), plan.cols.len(), plan.corner());
    let slopes: Vec<f64> = image.iter().map(|&v| f64::from(shading.along(v, light.strength()))).collect();
    let mean = slopes.iter().sum::<f64>() / slopes.len() as f64;
    // The taper rises from the edge to a quarter of the side.
    let along = |i: usize, n: usize| {
        let from_edge = (i as f64 + 0.5).min(n as f64 - 0.5 - i as f64);
        (core::f64::consts::FRAC_PI_2 * (4.0 * from_edge / n as f64).min(1.0)).sin().powi(2)
    };
    let taper = |i: usize| along(i / cols, rows) * along(i % cols, cols);
    let mut field = vec![[0.0; 2]; height * width];
    for (i, slope) in slopes.iter().enumerate() {
        field[(top + i / cols) * width + left + i % cols][0] = taper(i) * (slope - mean);
    }
    let total: f64 = field.iter().map(|v| v[0] * v[0]).sum();
    let squares: f64 = (0..rows * cols).map(|i| taper(i).powi(2)).sum();
    let spectrum = naive_transform(&field, (height, width), -1.0);
    let wave = |k: usize, n: usize| TAU * if 2 * k > n { k as f64 - n as f64 } else { k as f64 } / n as f64;
    let mut octaves = [Power::default(); OCTAVES];
    for (i, v) in spectrum.iter().enumerate() {
        let (m, k) = (i / width, i % width);
        if (m, k) == (0, 0) || 2 * m == height || 2 * k == width {
            continue;
        }
        let (down, across) = (wave(m, height), wave(k, width));
        let (all, power) = (across * across + down * down, v[0] * v[0] + v[1] * v[1]);
        // Both halves are summed here, so every wave counts twice.
        let sum = &mut octaves[share::octave(all as f32)];
        sum.total += 0.5 * power;
        sum.cos += 0.5 * power * (across * across - down * down) / all;
        sum.sin += 0.5 * power * 2.0 * across * down / all;
        sum.waves += 0.5;
    }
    let size = (height * width) as f64;
    let (found, expected) =
        (found.share(light), Contrast::new(octaves, squares / size, 2.0 / (size * squares)).share(light));
    for octave in 0..OCTAVES {
        assert!((found.octave(octave) - expected.octave(octave)).abs() < 1e-4, "{octave}: {found:?} for {expected:?}");
    }
    for trust in [0.0, 1.0] {
        assert!(
            (found.open_slope(trust) / expected.open_slope(trust) - 1.0).abs() < 1e-4,
            "{found:?} for {expected:?}"
        );
    }
    // Parseval's theorem: all variance is in the octaves, but for the highest frequencies.
    let variance = 2.0 * octaves.iter().map(|p| p.total).sum::<f64>() / size;
    assert!(variance > 0.8 * total && variance < 1.0001 * total, "{variance} of {total}");
}

#[test]
fn trust_is_a_factor_and_albedo_flattens_the_relief() {
    let (rows, cols) = (48, 64);
    let plan = Photoclinometry::new(Shape::new(rows, cols));
    let light = Light::of(290.0, 1.0).unwrap();
    let (image, level) = (lit(rows, cols, light, 0.4, 0.3), vec![0.0; rows * cols]);
    let found = contrast(&plan, &image, light).share(light);
    let of = |share: &Share, trust| relief(&plan, (&image, &level), light, 20.0, (share, trust));
    let size = |map: &[f32]| map.iter().map(|v| v * v).sum::<f32>().sqrt();
    let (whole, weighed, half) = (of(&Share::WHOLE, 1.0), of(&found, 1.0), of(&found, 0.5));
    assert!(size(&weighed) < 0.8 * size(&whole), "{} of {}", size(&weighed), size(&whole));
    weighed.iter().zip(&half).for_each(|(a, b)| assert!((0.5 * a - b).abs() < 1e-5));
    assert!(of(&found, 0.0).iter().all(|v| *v == 0.0));
}

/// A slope in shadow may be steeper than the darkest brightness says. The relief does not flatten it.
#[test]
fn dark_pixels_do_not_flatten_slopes() {
    let (rows, cols) = (48, 64);
    let plan = Photoclinometry::new(Shape::new(rows, cols));
    let light = Light { east: 4.0, south: 0.0 };
    let dark = |i: usize| (30..38).contains(&(i % cols));
    // A scarp of 0.6 where the darkest brightness says 0.25.
    let coarse: Vec<f32> = (0..rows * cols).map(|i| -0.6 * ((i % cols) as f32 - 29.5).clamp(0.0, 8.0)).collect();
    let largest = |dark_brightness: f32| {
        let image: Vec<f32> = (0..rows * cols).map(|i| if dark(i) { dark_brightness } else { 100.0 }).collect();
        let relief = relief(&plan, (&image, &coarse), light, 30.0, PLAIN);
        relief.iter().fold(0.0f32, |most, h| most.max(h.abs()))
    };
    // A tenth of the mean is the limit.
    assert!(largest(0.0) < 0.6, "{}", largest(0.0));
    assert!(largest(20.0) > 1.0, "{}", largest(20.0));
}

/// A pixel as bright as the limit of dark pixels is lit: its slope is what its brightness says.
#[test]
fn pixels_at_the_limit_are_lit() {
    let (rows, cols) = (48, 64);
    let plan = Photoclinometry::new(Shape::new(rows, cols));
    let light = Light { east: 4.0, south: 0.0 };
    let shading = Shading::new(&[99.0, 101.0][..], light).unwrap();
    let coarse: Vec<f32> = (0..rows * cols).map(|i| -0.6 * ((i % cols) as f32 - 29.5).clamp(0.0, 8.0)).collect();
    let largest = |dark: f32| {
        let bright = |_: usize, out: &mut [f32]| {
            out.fill(100.0);
            out[30..38].fill(dark);
        };
        let heights = |row: usize, out: &mut [f32]| out.copy_from_slice(&coarse[row * cols..][..cols]);
        let mut scratch = vec![0.0; plan.scratch_len()];
        let tile = LitTile { brightness: bright, coarse: heights, shading: &shading, light, coarse_px: 30.0 };
        let relief = plan.relief(&tile, PLAIN.0, PLAIN.1, &mut scratch).unwrap();
        (0..rows).flat_map(|row| relief.part(row * cols, cols)).fold(0.0f32, |most, h| most.max(h.abs()))
    };
    let limit = shading.dark_below();
    assert!(largest(limit) > 1.0 && largest(limit.next_down()) < 0.6, "{}", largest(limit));
}

/// Flight software plans by the stated cost of a unit: the cost of each pass is that of the field, and grows with it.
#[test]
fn the_cost_of_each_pass_grows_with_the_field() {
    let light = Light { east: 1.0, south: 0.5 };
    let share = Share::WHOLE;
    let costs = |rows: usize, cols: usize, task: &Task<'_>| {
        let plan = Photoclinometry::new(Shape::new(rows, cols));
        let shading = Shading::new(&[99.0, 101.0][..], light).unwrap();
        let (bright, level) = (|_: usize, out: &mut [f32]| out.fill(100.0), |_: usize, out: &mut [f32]| out.fill(0.0));
        let tile = LitTile { brightness: bright, coarse: level, shading: &shading, light, coarse_px: 30.0 };
        let (mut work, mut scratch, mut costs) = (FieldWork::default(), vec![0.0; plan.scratch_len()], vec![0; 10]);
        loop {
            let pass = work.pass as usize;
            match plan.advance(&mut work, task, &tile, &mut scratch).unwrap() {
                Some(cost) => costs[pass] += cost,
                None => return costs,
            }
        }
    };
    for task in [Task::Contrast, Task::Relief { share: &share, trust: 1.0 }] {
        let one = costs(80, 80, &task);
        // Each pass changes the 128 x 128 values of the field, each of them by several operations.
        let passes = one.iter().take_while(|cost| **cost > 0);
        assert!(passes.clone().count() >= 8 && passes.clone().all(|cost| *cost >= 5 * 128 * 128), "{one:?}");
        for (rows, cols) in [(208, 80), (80, 208)] {
            // With its margins of 24 pixels the field is twice as large, the tile 2.6 times. Tables follow the longer side.
            for (pass, (one, two)) in
                one.iter().zip(costs(rows, cols, &task)).enumerate().filter(|(_, (one, _))| **one > 0)
            {
                let ratio = two as f64 / *one as f64;
                assert!((1.8..=2.7).contains(&ratio), "{rows} x {cols}, pass {pass}: {ratio}");
            }
        }
    }
}

/// The position of the work is written and read as words, after every unit.
#[test]
fn work_goes_on_from_its_words() {
    let (rows, cols) = (40, 56);
    let plan = Photoclinometry::new(Shape::new(rows, cols));
    let light = Light::of(300.0, 1.2).unwrap();
    let image = lit(rows, cols, light, 0.1, 0.02);
    let shading = Shading::new(&image[..], Contrast::ALONG_ROWS).unwrap();
    let shown = &image[..];
    let tile = Contrast::level(&shown, plan.tile, 12.0, &shading);
    let (mut work, mut scratch) = (FieldWork::default(), vec![0.0; plan.scratch_len()]);
    while plan.advance(&mut work, &Task::Contrast, &tile, &mut scratch).unwrap().is_some() {
        let mut words = [0; 64];
        work.visit(&mut Words::writing(&mut words));
        let mut read = FieldWork::default();
        read.visit(&mut Words::reading(&mut words));
        assert_eq!(read, work);
        work = read;
    }
    assert_eq!(plan.measured(&work), plan.contrast(&tile, &mut scratch).unwrap());
}

/// A wide shadow shows nothing of the ground in it, and changes nothing beside it.
#[test]
fn wide_shadows_hide_the_ground() {
    let (rows, cols) = (64, 96);
    let plan = Photoclinometry::new(Shape::new(rows, cols));
    let light = Light::of(290.0, 1.0).unwrap();
    let (lit, level) = (lit(rows, cols, light, 0.4, 0.3), vec![0.0; rows * cols]);
    let shadowed = |from: usize, to: usize| -> Vec<f32> {
        (0..rows * cols).map(|i| if (from..to).contains(&(i % cols)) { 0.01 } else { 1.0 } * lit[i]).collect()
    };
    // Coarse pixels of 8 pixels: from 32 pixels on the ground is hidden.
    let of = |image: &[f32]| relief(&plan, (image, &level), light, 8.0, PLAIN);
    let (whole, half) = (of(&lit), of(&shadowed(cols / 2, cols)));
    let of_cols = |map: &[f32], from: usize, to: usize| {
        map.iter().enumerate().filter(|(i, _)| (from..to).contains(&(i % cols))).map(|(_, v)| v * v).sum::<f32>().sqrt()
    };
    let apart: Vec<f32> = whole.iter().zip(&half).map(|(a, b)| a - b).collect();
    assert!(of_cols(&apart, 4, 32) < 0.2 * of_cols(&whole, 4, 32), "{}", of_cols(&apart, 4, 32));
    assert!(of_cols(&half, 66, 96) < 0.1 * of_cols(&whole, 66, 96), "{}", of_cols(&half, 66, 96));
    // In a narrower shadow the ground falls away from the light.
    assert!(of_cols(&of(&shadowed(40, 60)), 40, 60) > 2.0 * of_cols(&whole, 40, 60));
}

#[test]
fn slopes_are_those_of_the_heights_and_the_light_is_named() {
    let (rows, cols) = (40, 56);
    let light = Light::of(300.0, 1.2).unwrap();
    let image = lit(rows, cols, light, 0.1, 0.02);
    let coarse_m: Vec<f32> =
        (0..rows * cols).map(|i| 3.0 * (i / cols) as f32 - ((i % cols) as f32 * 0.2).sin()).collect();
    let scale = ElevationScale::from_pixel(&coarse_m, None, 2.0, 50.0).unwrap();
    let plan = Photoclinometry::new(Shape::new(rows, cols));
    for mirror in [Mirror::default(), Mirror { rows: true, cols: false }] {
        let mut scratch = vec![0.0; plan.scratch_len()];
        let weight = Weight::Trust { trust: 0.8, long_share: None };
        let tile = GuideInput { image: &image[..], coarse_m: &coarse_m, mirror, coarse_px: 12.0, weight };
        let guide = Guide::new(&plan, tile, &scale, light, &mut scratch).unwrap();
        let shading = Shading::new(&image[..], light).unwrap();
        let (mut maps, mut plain) = (vec![0.0; SLOPED_MAPS * image.len()], vec![0.0; MAPS * image.len()]);
        let (mut heights, mut again) = (vec![0.0; image.len()], vec![0.0; image.len()]);
        guide.fill_sloped(&mut maps, &mut heights).unwrap();
        guide.fill(&mut plain, &mut again).unwrap();
        assert_eq!(heights, again);
        let height = |row: usize, col: usize| heights[row * cols + col];
        for (i, (maps, plain)) in maps.chunks(SLOPED_MAPS).zip(plain.chunks(MAPS)).enumerate() {
            let (row, col) = (i / cols, i % cols);
            // In units of 0.1, over two pixels, at the border over one.
            let slope = |n: usize, at: usize, height: &dyn Fn(usize) -> f32| {
                let (from, to) = (at.max(1) - 1, (at + 1).min(n - 1));
                10.0 * (height(to) - height(from)) / (to - from) as f32
            };
            let east = slope(cols, col, &|col| height(row, col));
            let south = slope(rows, row, &|row| height(row, col));
            assert_eq!(maps[..MAPS], *plain);
            // What is kept of the slopes, and what they leave open, in 0.1 of slope.
            let [east_shown, south_shown] = shading.slopes(image[mirror.source(i, Shape::new(rows, cols))]);
            let (kept, open) = (0.8 * guide.share().mean(), 10.0 * guide.share().open_slope(0.8));
            let expected = [kept * east_shown, kept * south_shown, maps[2], open].map(|v| v.clamp(-LIMIT, LIMIT));
            assert!(maps.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4), "{i}: {maps:?} {expected:?}");
            assert!((maps[4] - east.clamp(-LIMIT, LIMIT)).abs() < 1e-3, "{i}: {} {east}", maps[4]);
            assert!((maps[5] - south.clamp(-LIMIT, LIMIT)).abs() < 1e-3, "{i}: {} {south}", maps[5]);
            assert!((maps[6] - light.east / light.strength()).abs() < 1e-6);
            assert!((maps[7] - light.south / light.strength()).abs() < 1e-6);
        }
        // A part of a row is that of the whole.
        let mut part = [[0.0; SLOPED_MAPS]; 11];
        guide.sloped_image(5 * cols + 13, &mut part);
        assert_eq!(part.as_flattened(), &maps[SLOPED_MAPS * (5 * cols + 13)..][..SLOPED_MAPS * 11]);
        assert!(guide.fill_sloped(&mut plain, &mut heights).is_err());
    }
}
