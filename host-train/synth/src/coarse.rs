//! The coarse DTM: the terrain as in a global model (SLDEM2015), with its errors.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;

/// Pixel of SLDEM2015 at 512 pixels per degree, metres.
pub const COARSE_PIXEL_M: f64 = 59.2252938;
/// Number of whole coarse pixels beyond each edge of the scene, so that interpolation always has all neighbours.
const SPARE: usize = 2;
/// Range of the error's wavelengths, metres. Its correlation length (about a quarter wave) is a few hundred metres to a kilometre.
const ERROR_WAVELENGTH_M: std::ops::Range<f64> = 800.0..5000.0;
/// Share of the tracks with wrong heights in a striped coarse DTM (our choice).
const TRACKS_OFF: f64 = 0.3;
/// Greatest slant of the tracks against the grid's columns, columns per row (our choice).
const TRACK_LEAN: f64 = 0.15;
/// Number of plane waves in the error.
const ERROR_WAVES: usize = 24;

/// A coarse grid over a scene, with its own pixel phase.
#[derive(Debug, Clone, PartialEq)]
pub struct CoarseGrid {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Distance from the scene's upper edge south to the grid's upper edge, metres (negative if the grid begins north of it).
    pub south_m: f64,
    /// Distance from the scene's left edge east to the grid's left edge, metres (negative if the grid begins west of it).
    pub east_m: f64,
    /// Heights, metres, row-major.
    pub heights_m: Vec<f32>,
}

/// Returns the metres of terrain needed beyond the scene on each side, for a misregistration of at most `misregistration_m`.
pub(super) fn margin_m(misregistration_m: f64) -> f64 {
    (SPARE + 1) as f64 * COARSE_PIXEL_M + misregistration_m
}

/// Terrain with a border around the scene.
pub(super) struct Ground<'a> {
    /// Heights, row-major.
    pub heights_m: &'a [f32],
    /// Columns of `heights_m`.
    pub cols: usize,
    /// Number of pixels above and left of the scene.
    pub margin_px: usize,
    /// Pixel, metres.
    pub pixel_m: f64,
}

/// Errors of a coarse DTM.
pub(super) struct Flaws {
    /// RMS of the low-frequency error, metres.
    pub error_m: f64,
    /// Largest horizontal shift, metres.
    pub misregistration_m: f64,
}

/// Averages the ground over the pixels of a coarse grid. The grid is placed at random so that it covers a scene of `rows` × `cols` pixels,
/// and shifted by a random misregistration. Then adds the low-frequency error.
pub(super) fn observe(rng: &mut ChaCha8Rng, ground: &Ground, rows: usize, cols: usize, flaws: &Flaws) -> CoarseGrid {
    let mut place = |pixels: usize| {
        let start_m = -(SPARE as f64 + rng.random::<f64>()) * COARSE_PIXEL_M;
        let end_m = pixels as f64 * ground.pixel_m + SPARE as f64 * COARSE_PIXEL_M;
        (start_m, ((end_m - start_m) / COARSE_PIXEL_M).ceil() as usize)
    };
    let ((south_m, coarse_rows), (east_m, coarse_cols)) = (place(rows), place(cols));
    // Uniform over the disc.
    let shift_m = flaws.misregistration_m * rng.random::<f64>().sqrt();
    let (shift_south, shift_east) = libm::sincos(rng.random::<f64>() * TAU);
    let spans = |start_m: f64, shift_m: f64, count: usize| {
        let edge_px =
            move |k: usize| (start_m + shift_m + k as f64 * COARSE_PIXEL_M) / ground.pixel_m + ground.margin_px as f64;
        (0..count).map(|k| Span::new(edge_px(k), edge_px(k + 1))).collect::<Vec<_>>()
    };
    let row_spans = spans(south_m, shift_m * shift_south, coarse_rows);
    let col_spans = spans(east_m, shift_m * shift_east, coarse_cols);
    let mut heights_m = average(ground, &row_spans, &col_spans);
    add_error(rng, &mut heights_m, coarse_cols, flaws.error_m);
    CoarseGrid { rows: coarse_rows, cols: coarse_cols, south_m, east_m, heights_m }
}

/// Consecutive fine pixels and the weights of each in one coarse pixel.
struct Span {
    first: usize,
    weights: Vec<f64>,
}

impl Span {
    /// Returns the pixels between two edges in units of pixels, weighted by their overlap.
    fn new(from: f64, to: f64) -> Self {
        let first = from.floor() as usize;
        let overlap = |k: usize| ((k + 1) as f64).min(to) - (k as f64).max(from);
        let weights = (first..to.ceil() as usize).map(|k| overlap(k) / (to - from)).collect();
        Self { first, weights }
    }
}

fn average(ground: &Ground, row_spans: &[Span], col_spans: &[Span]) -> Vec<f32> {
    let mut out = Vec::with_capacity(row_spans.len() * col_spans.len());
    for rows in row_spans {
        // One coarse row at a time: first along the columns, then across.
        let mut column_means = vec![0.0f64; ground.cols];
        for (k, weight) in rows.weights.iter().enumerate() {
            let line = &ground.heights_m[(rows.first + k) * ground.cols..][..ground.cols];
            for (mean, height) in column_means.iter_mut().zip(line) {
                *mean += weight * f64::from(*height);
            }
        }
        out.extend(col_spans.iter().map(|cols| {
            let values = &column_means[cols.first..];
            cols.weights.iter().zip(values).map(|(weight, value)| weight * value).sum::<f64>() as f32
        }));
    }
    out
}

/// Adds a smooth random error with the given RMS over all scenes.
fn add_error(rng: &mut ChaCha8Rng, heights_m: &mut [f32], cols: usize, rms_m: f64) {
    let (shortest, longest) = (ERROR_WAVELENGTH_M.start, ERROR_WAVELENGTH_M.end);
    for _ in 0..ERROR_WAVES {
        let wavelength_px = shortest * libm::pow(longest / shortest, rng.random::<f64>()) / COARSE_PIXEL_M;
        let (south, east) = libm::sincos(rng.random::<f64>() * TAU);
        let phase = rng.random::<f64>() * TAU;
        let size: f64 = StandardNormal.sample(rng);
        let amplitude = size * rms_m * (2.0 / ERROR_WAVES as f64).sqrt();
        for (k, height) in heights_m.iter_mut().enumerate() {
            let along_px = (k / cols) as f64 * south + (k % cols) as f64 * east;
            *height += (amplitude * libm::cos(TAU * along_px / wavelength_px + phase)) as f32;
        }
    }
}

/// Adds the errors of laser tracks and of seams between stereo strips, `rms_m` together over many scenes. Heights are wrong along some of
/// the columns, which may be slanted, and there is one step across the scene. Each contributes half of the squared error.
pub(super) fn add_stripes(rng: &mut ChaCha8Rng, heights_m: &mut [f32], cols: usize, rms_m: f64) {
    if rms_m <= 0.0 {
        return;
    }
    let rows = heights_m.len() / cols;
    let gaussian = |rng: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(rng) };
    let lean = TRACK_LEAN * (2.0 * rng.random::<f64>() - 1.0);
    let shift = lean.abs() * rows as f64;
    let track_m = rms_m * (0.5 / TRACKS_OFF).sqrt();
    let tracks: Vec<f64> = (0..cols + shift.ceil() as usize + 1)
        .map(|_| if rng.random::<f64>() < TRACKS_OFF { track_m * gaussian(rng) } else { 0.0 })
        .collect();
    // A step up on one side of a line through the middle half of the grid, and an equal step down on the other. Its square does not depend
    // on the line.
    let (south, east) = libm::sincos(rng.random::<f64>() * TAU);
    let through = |rng: &mut ChaCha8Rng, size: usize| (0.25 + 0.5 * rng.random::<f64>()) * size as f64;
    let (row0, col0) = (through(rng, rows), through(rng, cols));
    let step_m = rms_m * 0.5f64.sqrt() * gaussian(rng);
    for (k, height) in heights_m.iter_mut().enumerate() {
        let (row, col) = ((k / cols) as f64, (k % cols) as f64);
        let track = tracks[(col + lean * row + if lean < 0.0 { shift } else { 0.0 }) as usize];
        let side = ((row - row0) * south + (col - col0) * east).signum();
        *height += (track + step_m * side) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    const MARGIN_PX: usize = 100;

    fn plane() -> Vec<f32> {
        // 2 m pixels: 0.1 m per metre south, -0.05 m per metre east, zero at the scene's corner.
        let height = |k: usize| {
            let (row, col) = ((k / 300) as f64 + 0.5 - MARGIN_PX as f64, (k % 300) as f64 + 0.5 - MARGIN_PX as f64);
            (0.2 * row - 0.1 * col) as f32
        };
        (0..280 * 300).map(height).collect()
    }

    #[test]
    fn averages_of_a_plane_are_the_plane_at_the_centres() {
        let heights_m = plane();
        let ground = Ground { heights_m: &heights_m, cols: 300, margin_px: MARGIN_PX, pixel_m: 2.0 };
        let flawless = Flaws { error_m: 0.0, misregistration_m: 0.0 };
        for seed in 0..5 {
            let coarse = observe(&mut ChaCha8Rng::seed_from_u64(seed), &ground, 80, 100, &flawless);
            for (k, height_m) in coarse.heights_m.iter().enumerate() {
                let south_m = coarse.south_m + ((k / coarse.cols) as f64 + 0.5) * COARSE_PIXEL_M;
                let east_m = coarse.east_m + ((k % coarse.cols) as f64 + 0.5) * COARSE_PIXEL_M;
                // A cut pixel counts with its centre's height. The error is at most 1/8 pixel's rise at each end of each side.
                let bound_m = 2.0 * 0.125 * (0.2 + 0.1) / (COARSE_PIXEL_M / 2.0);
                assert!((f64::from(*height_m) - (0.1 * south_m - 0.05 * east_m)).abs() < bound_m);
            }
            assert!(coarse.south_m <= -2.0 * COARSE_PIXEL_M && coarse.east_m <= -2.0 * COARSE_PIXEL_M);
            let below_m = coarse.south_m + coarse.rows as f64 * COARSE_PIXEL_M - 160.0;
            assert!(below_m >= 2.0 * COARSE_PIXEL_M, "{below_m} m below the scene");
        }
    }

    #[test]
    fn stripes_have_the_size_asked_for_and_run_down_the_columns() {
        let (mut square, mut down, mut across, mut count) = (0.0f64, 0.0f64, 0.0f64, 0.0);
        for seed in 0..600 {
            let mut heights_m = vec![0.0f32; 12 * 14];
            add_stripes(&mut ChaCha8Rng::seed_from_u64(seed), &mut heights_m, 14, 2.0);
            square += heights_m.iter().map(|v| f64::from(v * v)).sum::<f64>() / heights_m.len() as f64;
            let apart = |a: usize, b: usize| f64::from(heights_m[a] - heights_m[b]).powi(2);
            down += (0..11 * 14).map(|k| apart(k, k + 14)).sum::<f64>() / (11.0 * 14.0);
            across += (0..12 * 14).filter(|k| k % 14 < 13).map(|k| apart(k, k + 1)).sum::<f64>() / (12.0 * 13.0);
            count += 1.0;
        }
        let rms_m = (square / count).sqrt();
        assert!((rms_m / 2.0 - 1.0).abs() < 0.08, "{rms_m} m");
        assert!(down * 4.0 < across, "{} m down, {} m across", (down / count).sqrt(), (across / count).sqrt());
        let mut none = vec![1.0f32; 12];
        add_stripes(&mut ChaCha8Rng::seed_from_u64(1), &mut none, 4, 0.0);
        assert_eq!(none, [1.0; 12]);
    }

    #[test]
    fn errors_have_the_size_and_smoothness_asked_for() {
        let (mut square, mut difference, mut count) = (0.0f64, 0.0f64, 0.0);
        for seed in 0..300 {
            let mut heights_m = vec![0.0f32; 12 * 12];
            add_error(&mut ChaCha8Rng::seed_from_u64(seed), &mut heights_m, 12, 3.0);
            square += heights_m.iter().map(|v| f64::from(v * v)).sum::<f64>();
            difference += heights_m.windows(2).map(|w| f64::from(w[1] - w[0]).powi(2)).sum::<f64>();
            count += 144.0;
        }
        let rms_m = (square / count).sqrt();
        assert!((rms_m / 3.0 - 1.0).abs() < 0.1, "{rms_m} m");
        // Neighbours 59 m apart have similar errors.
        assert!((difference / count).sqrt() < 0.6 * rms_m);
    }
}
