//! Compares lines with whole grids bit for bit, and footprints with a plane fitted by another method.

use super::*;
use crate::grid::GridView;
use crate::terrain::{hazard, hillshade, slope_deg};
use proptest::prelude::*;

/// All maps of a grid.
#[derive(Debug, PartialEq)]
struct WholeMaps {
    slope_deg: Vec<f32>,
    hillshade: Vec<u8>,
    footprint_slope_deg: Vec<f32>,
    roughness_m: Vec<f32>,
    hazard: Vec<u8>,
}

impl WholeMaps {
    fn new(len: usize) -> Self {
        let floats = || vec![-9.0; len];
        Self {
            slope_deg: floats(),
            hillshade: vec![99; len],
            footprint_slope_deg: floats(),
            roughness_m: floats(),
            hazard: vec![99; len],
        }
    }

    /// Returns the maps of one line.
    fn line(&mut self, row: u64, cols: usize) -> LineMaps<'_> {
        let range = row as usize * cols..(row as usize + 1) * cols;
        LineMaps {
            slope_deg: &mut self.slope_deg[range.clone()],
            hillshade: &mut self.hillshade[range.clone()],
            footprint_slope_deg: &mut self.footprint_slope_deg[range.clone()],
            roughness_m: &mut self.roughness_m[range.clone()],
            hazard: &mut self.hazard[range],
        }
    }
}

/// Pushes a grid line by line; all lines must be returned, in order.
fn run(lines: &mut TerrainLines<'_>, heights_m: &[f32]) -> WholeMaps {
    let cols = lines.options.cols;
    let (rows, mut maps, mut next) = ((heights_m.len() / cols) as u64, WholeMaps::new(heights_m.len()), 0);
    for (row, line) in heights_m.chunks(cols).enumerate() {
        let given = lines.push(line, &mut maps.line(next, cols)).unwrap();
        assert_eq!(given, (row >= lines.options.radius_px).then_some(next), "r lines later");
        next += u64::from(given.is_some());
    }
    while next < rows {
        assert_eq!(lines.finish(&mut maps.line(next, cols)).unwrap(), Some(next));
        next += 1;
    }
    assert_eq!(lines.finish(&mut maps.line(0, cols)).unwrap(), None);
    maps
}

fn options(cols: usize, radius_px: usize) -> LineOptions {
    let sun = Sun { azimuth_deg: 120.0, elevation_deg: 20.0, exaggeration: 2.5 };
    let limits = HazardLimits::new(15.0, 1.0).unwrap();
    LineOptions { cols, pixel: PixelSize { row_m: 3.0, col_m: 2.0 }, radius_px, sun, limits }
}

fn maps_of(options: LineOptions, heights_m: &[f32]) -> WholeMaps {
    let mut memory = vec![f32::NAN; options.memory_len()];
    run(&mut TerrainLines::new(options, &mut memory).unwrap(), heights_m)
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}

/// Returns slope and roughness by the normal equations of z = p x + q y + c over ground coordinates from the grid's corner, with all nine
/// sums and Cramer's rule.
fn naive(heights_m: &[f32], cols: usize, (row, col): (usize, usize), r: usize, pixel: PixelSize) -> Option<(f64, f64)> {
    let rows = heights_m.len() / cols;
    if row < r || col < r || row + r >= rows || col + r >= cols {
        return None;
    }
    let points = || {
        (row - r..=row + r)
            .flat_map(move |i| (col - r..=col + r).map(move |j| (i, j)))
            .map(|(i, j)| [j as f64 * pixel.col_m, i as f64 * pixel.row_m, 1.0, f64::from(heights_m[i * cols + j])])
    };
    if points().any(|p| p[3].is_nan()) {
        return None;
    }
    let sum = |a: usize, b: usize| points().map(|p| p[a] * p[b]).sum::<f64>();
    let system: [[f64; 4]; 3] = core::array::from_fn(|a| core::array::from_fn(|b| sum(a, b)));
    let determinant = |columns: [usize; 3]| {
        let [m, n, o] = system.map(|line| columns.map(|c| line[c]));
        m[0] * (n[1] * o[2] - n[2] * o[1]) - m[1] * (n[0] * o[2] - n[2] * o[0]) + m[2] * (n[0] * o[1] - n[1] * o[0])
    };
    let whole = determinant([0, 1, 2]);
    let [p, q, c] = [[3, 1, 2], [0, 3, 2], [0, 1, 3]].map(|columns| determinant(columns) / whole);
    let roughness_m = points().map(|g| (g[3] - p * g[0] - q * g[1] - c).abs()).fold(0.0, f64::max);
    Some((p.hypot(q).atan().to_degrees(), roughness_m))
}

/// Cramer's determinants cancel: products of about 1e13 leave about 1e6, with a relative error of 1e-9 (1e-16 of a double) at worst, over
/// heights of 10 m and slopes per 1 m. The maps are `f32`, too.
const TWIN: f64 = 1e-5;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn lines_give_what_grids_give_and_footprints_what_the_twin_fits(
        (rows, cols, radius_px) in (1usize..12, 1usize..14, 1usize..4),
        seed in prop::collection::vec((-10.0f32..10.0, 0u8..40), 12 * 14),
    ) {
        let heights_m: Vec<f32> =
            seed.iter().take(rows * cols).map(|&(h, void)| if void == 0 { f32::NAN } else { h }).collect();
        let (o, grid) = (options(cols, radius_px), GridView::new(&heights_m, rows, cols).unwrap());
        let found = maps_of(o, &heights_m);
        let (mut slopes, mut shades) = (vec![0.0; rows * cols], vec![0; rows * cols]);
        slope_deg(grid, o.pixel, &mut slopes).unwrap();
        hillshade(grid, o.pixel, o.sun, &mut shades).unwrap();
        prop_assert_eq!(bits(&found.slope_deg), bits(&slopes));
        prop_assert_eq!(&found.hillshade, &shades);
        for i in 0..rows * cols {
            let (slope_deg, roughness_m) = (found.footprint_slope_deg[i], found.roughness_m[i]);
            match naive(&heights_m, cols, (i / cols, i % cols), radius_px, o.pixel) {
                None => prop_assert!(slope_deg.is_nan() && roughness_m.is_nan() && found.hazard[i] == hazard::UNKNOWN),
                Some((twin_deg, twin_m)) => {
                    prop_assert!((f64::from(slope_deg) - twin_deg).abs() < TWIN, "{slope_deg} instead of {twin_deg}");
                    prop_assert!((f64::from(roughness_m) - twin_m).abs() < TWIN, "{roughness_m} instead of {twin_m}");
                    let expected = hazard::TOO_STEEP * u8::from(slope_deg > 15.0) + hazard::TOO_ROUGH * u8::from(roughness_m > 1.0);
                    prop_assert_eq!(found.hazard[i], expected);
                }
            }
        }
    }

    #[test]
    fn a_plane_has_no_roughness_and_its_own_slope(east in -64i32..64, south in -64i32..64, radius_px in 1usize..=MAX_RADIUS_PX) {
        // Sixteenths of a metre, so that every height is exact.
        let side = 2 * radius_px + 1;
        let heights_m: Vec<f32> = (0..side * side)
            .map(|i| (east * (i % side) as i32 + south * (i / side) as i32) as f32 / 16.0 - 1900.0)
            .collect();
        let o = options(side, radius_px);
        let (found, centre) = (maps_of(o, &heights_m), side * side / 2);
        prop_assert_eq!(found.roughness_m[centre], 0.0);
        prop_assert_eq!(found.footprint_slope_deg[centre], found.slope_deg[centre]);
        prop_assert_eq!(found.roughness_m.iter().filter(|r| r.is_finite()).count(), 1);
    }
}

#[test]
fn a_boulder_sticks_out_by_what_the_plane_leaves_of_it() {
    let (radius_px, side, height_m) = (2usize, 9usize, 0.75);
    let mut heights_m = vec![-1900.0f32; side * side];
    heights_m[4 * side + 4] += height_m;
    let found = maps_of(options(side, radius_px), &heights_m);
    let (n, squares) = (25.0, 50.0);
    for row in 2..7usize {
        for col in 2..7usize {
            // The plane takes up a share of the boulder's height, its leverage: 1/n + (x² + y²)/Σx².
            let (x, y) = (col.abs_diff(4) as f64, row.abs_diff(4) as f64);
            let expected = f64::from(height_m) * (1.0 - 1.0 / n - (x * x + y * y) / squares);
            let roughness_m = f64::from(found.roughness_m[row * side + col]);
            assert!((roughness_m - expected).abs() < 1e-7, "{row}, {col}: {roughness_m} m, expected {expected} m"); // f32
        }
    }
}

#[test]
fn maps_that_are_not_wanted_change_nothing_and_a_second_grid_begins_afresh() {
    let heights_m: Vec<f32> = (0..8 * 9).map(|i| (i * i % 37) as f32 / 4.0).collect();
    let o = options(9, 2);
    let expected = maps_of(o, &heights_m);
    let mut memory = vec![0.0; o.memory_len() + 5];
    let mut lines = TerrainLines::new(o, &mut memory).unwrap();
    run(&mut lines, &heights_m[..9 * 3]);
    let again = run(&mut lines, &heights_m);
    assert_eq!(bits(&again.slope_deg), bits(&expected.slope_deg));
    assert_eq!((&again.hillshade, &again.hazard), (&expected.hillshade, &expected.hazard));
    for (row, line) in heights_m.chunks(9).enumerate() {
        let (mut hazard, mut roughness_m, mut hillshade) = ([99; 9], [0.0; 9], [99; 9]);
        let mut maps = match row % 3 {
            0 => LineMaps { hazard: &mut hazard, ..LineMaps::default() },
            1 => LineMaps { roughness_m: &mut roughness_m, ..LineMaps::default() },
            _ => LineMaps { hillshade: &mut hillshade, ..LineMaps::default() },
        };
        let Some(given) = lines.push(line, &mut maps).unwrap() else { continue };
        let range = given as usize * 9..(given as usize + 1) * 9;
        match row % 3 {
            0 => assert_eq!(hazard, expected.hazard[range]),
            1 => assert_eq!(bits(&roughness_m), bits(&expected.roughness_m[range])),
            _ => assert_eq!(hillshade, expected.hillshade[range]),
        }
    }
}

#[test]
fn wrong_calls_are_refused_and_change_nothing() {
    let o = options(4, 1);
    let mut memory = [0.0; 12];
    let mut refused = |o: LineOptions, len: usize| TerrainLines::new(o, &mut memory[..len]).map(|_| ()).unwrap_err();
    assert_eq!(refused(o, 11), TerrainError::Length(LengthError { expected: 12, found: 11 }));
    assert_eq!(
        refused(LineOptions { cols: usize::MAX, ..o }, 12),
        LengthError { expected: usize::MAX, found: 12 }.into()
    );
    assert_eq!(refused(LineOptions { cols: 0, ..o }, 12), LengthError { expected: 1, found: 0 }.into());
    for found_px in [0, MAX_RADIUS_PX + 1, usize::MAX] {
        assert_eq!(refused(LineOptions { radius_px: found_px, ..o }, 12), TerrainError::Radius { found_px });
    }
    for size_m in [0.0, -1.0, f64::INFINITY] {
        let error = refused(LineOptions { pixel: PixelSize { row_m: 1.0, col_m: size_m }, ..o }, 12);
        assert_eq!(error, TerrainError::Pixel { found_m: size_m });
    }
    assert!(matches!(refused(LineOptions { pixel: PixelSize::square(f64::NAN), ..o }, 12), TerrainError::Pixel { .. }));

    let mut lines = TerrainLines::new(o, &mut memory).unwrap();
    let mut five = [7u8; 5];
    lines.push(&[1.0; 4], &mut LineMaps::default()).unwrap();
    assert!(lines.push(&[1.0; 5], &mut LineMaps::default()).is_err());
    assert!(lines.push(&[1.0; 4], &mut LineMaps { hazard: &mut five, ..LineMaps::default() }).is_err());
    assert_eq!(lines.push(&[1.0; 4], &mut LineMaps::default()), Ok(Some(0)), "the second line, not the third");
    assert!(lines.finish(&mut LineMaps { hillshade: &mut five, ..LineMaps::default() }).is_err());
    assert_eq!(five, [7; 5]);
    lines.push(&[1.0; 4], &mut LineMaps::default()).unwrap();
    assert_eq!(lines.finish(&mut LineMaps::default()), Ok(Some(2)));
    assert_eq!(lines.finish(&mut LineMaps::default()), Ok(None));

    let mut memory = [0.0; 20];
    let mut lines = TerrainLines::new(options(4, 2), &mut memory).unwrap();
    for _ in 0..2 {
        assert_eq!(lines.push(&[1.0; 4], &mut LineMaps::default()), Ok(None));
    }
    assert_eq!(lines.finish(&mut LineMaps::default()), Ok(Some(0)));
    let refused = lines.push(&[1.0; 4], &mut LineMaps::default());
    assert_eq!(refused, Err(TerrainError::Unfinished { lines: 1 }));
    assert_eq!(lines.finish(&mut LineMaps::default()), Ok(Some(1)));
    // All lines are returned: the next grid may begin, with or without a further call of `finish`.
    assert_eq!(lines.push(&[1.0; 4], &mut LineMaps::default()), Ok(None));
    assert_eq!(lines.finish(&mut LineMaps::default()), Ok(Some(0)));
}

#[test]
fn unsure_slopes_are_hazards_where_they_are_unsure() {
    let limits = HazardLimits::new(10.0, 5.0).unwrap().with_sigmas(2.0).unwrap();
    let o = LineOptions { limits, ..options(6, 2) };
    assert_eq!(o.memory_len(), 2 * options(6, 2).memory_len());
    let mut memory = vec![7.0; o.memory_len()];
    let mut lines = TerrainLines::new(o, &mut memory).unwrap();
    let (mut hazards, mut mask) = (vec![], [9; 6]);
    // Flat ground. The line 3 is unsure in column 3, the line 5 everywhere.
    for row in 0..9 {
        let mut sd = [0.02; 6];
        sd[3] = if row == 3 { 0.2 } else { 0.02 };
        let sd: &[f32] = if row == 5 { &[] } else { &sd };
        if lines
            .push_with(&[100.0; 6], sd, &mut LineMaps { hazard: &mut mask, ..LineMaps::default() })
            .unwrap()
            .is_some()
        {
            hazards.push(mask);
        }
    }
    while lines.finish(&mut LineMaps { hazard: &mut mask, ..LineMaps::default() }).unwrap().is_some() {
        hazards.push(mask);
    }
    use crate::terrain::hazard::{MAYBE_TOO_STEEP as M, UNKNOWN as U};
    assert_eq!(hazards[0], [U; 6]);
    assert_eq!([hazards[2], hazards[3]], [[U, U, 0, 0, U, U], [U, U, 0, M, U, U]]);
    assert_eq!([hazards[4], hazards[5], hazards[6]], [[U, U, 0, 0, U, U], [U, U, M, M, U, U], [U, U, 0, 0, U, U]]);
    assert!(matches!(lines.push_with(&[100.0; 6], &[0.0; 5], &mut LineMaps::default()), Err(TerrainError::Length(_))));
}

#[test]
fn lines_that_are_paused_between_two_calls_are_the_same() {
    let options = LineOptions {
        cols: 9,
        pixel: PixelSize::square(2.0),
        radius_px: 2,
        sun: Sun::default(),
        limits: HazardLimits::new(10.0, 0.3).unwrap().with_sigmas(1.0).unwrap(),
    };
    let grid: Vec<f32> = (0..9 * 11).map(|i| (i * 7919 % 13) as f32 * 0.2).collect();
    let maps = |paused: bool| {
        let mut memory = vec![0.0; options.memory_len()];
        let (mut at, mut all, mut mask) = (LinesPaused::default(), Vec::new(), [0; 9]);
        let mut lines = grid.chunks(9);
        loop {
            let mut terrain = TerrainLines::resume(options, &mut memory, at).unwrap();
            // One line per life if it is paused; all in one otherwise.
            loop {
                let mut out = LineMaps { hazard: &mut mask, ..LineMaps::default() };
                let (given, ended) = match lines.next() {
                    Some(line) => (terrain.push_with(line, &[0.05; 9], &mut out).unwrap(), false),
                    None => terrain.finish(&mut out).map(|given| (given, given.is_none())).unwrap(),
                };
                if let Some(row) = given {
                    all.push((row, mask));
                }
                at = terrain.pause();
                if ended {
                    assert_eq!(at, LinesPaused::default());
                    return all;
                }
                if paused {
                    break;
                }
            }
        }
    };
    assert_eq!(maps(true), maps(false));
    // Positions that do not exist begin a grid.
    let mut memory = vec![0.0; options.memory_len()];
    for (taken, given) in [(1, 2), (9, 6), (u64::MAX, u64::MAX), (u64::MAX, 0)] {
        let lines = TerrainLines::resume(options, &mut memory, LinesPaused { taken, given, finishing: true }).unwrap();
        assert_eq!(lines.pause(), LinesPaused::default());
    }
}
