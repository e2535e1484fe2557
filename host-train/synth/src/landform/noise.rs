//! Smooth random fields of one wavelength.

use elunar_raster::resample::{PixelMap, resample_bicubic};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Share of the half wave in the field, so that contours are not round (our choice).
const HALF_WAVE: f32 = 0.35;

/// A field with a standard deviation of about one.
pub(crate) struct Noise(Vec<f32>);

impl Noise {
    /// Draws a field of waves of about `wave_px` pixels, at least 4.
    pub(super) fn draw(rng: &mut ChaCha8Rng, size: [usize; 2], wave_px: f32) -> Self {
        Self::sum(wave_px, |spacing_px| lattice(rng, size, spacing_px))
    }

    /// Draws such a field whose waves are `stretch` times as long in the direction `angle`, radians from the columns' to the rows'.
    pub(super) fn draw_stretched(
        rng: &mut ChaCha8Rng,
        size: [usize; 2],
        wave_px: f32,
        (stretch, angle): (f32, f32),
    ) -> Self {
        Self::sum(wave_px, |spacing_px| stretched_lattice(rng, size, [spacing_px, spacing_px * stretch], angle))
    }

    fn sum(wave_px: f32, mut lattice: impl FnMut(f32) -> Vec<f32>) -> Self {
        let mut field = lattice(0.5 * wave_px.max(4.0));
        let finer = lattice(0.25 * wave_px.max(4.0));
        field.iter_mut().zip(finer).for_each(|(v, finer)| *v += HALF_WAVE * finer);
        Self(field)
    }

    /// Returns the values, row-major.
    pub(crate) fn values(&self) -> impl Iterator<Item = f32> + '_ {
        self.0.iter().copied()
    }

    /// Returns the value of a pixel.
    pub(crate) fn at(&self, pixel: usize) -> f32 {
        self.0[pixel]
    }
}

/// Returns normal numbers on a lattice of this spacing, interpolated.
fn lattice(rng: &mut ChaCha8Rng, [rows, cols]: [usize; 2], spacing_px: f32) -> Vec<f32> {
    let [down, across] = [rows, cols].map(|n| (n as f32 / spacing_px).ceil() as usize + 4);
    let nodes: Vec<f32> = (0..down * across).map(|_| StandardNormal.sample(rng)).collect();
    let step = 1.0 / f64::from(spacing_px);
    // The lattice begins at a random place before the grid.
    let [row0, col0] = [0; 2].map(|_: i32| 1.0 + rng.random::<f64>());
    let map = PixelMap { row0, row_per_row: step, row_per_col: 0.0, col0, col_per_row: 0.0, col_per_col: step };
    resample_bicubic(&nodes, down, across, &map, rows, cols)
}

/// Returns normal numbers on a lattice of these spacings, across and along an angle, interpolated.
fn stretched_lattice(rng: &mut ChaCha8Rng, [rows, cols]: [usize; 2], spacing_px: [f32; 2], angle: f32) -> Vec<f32> {
    let (sin, cos) = libm::sincos(f64::from(angle));
    let [across_step, along_step] = spacing_px.map(|spacing_px| 1.0 / f64::from(spacing_px));
    // It covers the grid's diagonal in every direction.
    let diagonal = libm::hypot(rows as f64, cols as f64);
    let [down, across] = [across_step, along_step].map(|step| (diagonal * step).ceil() as usize + 4);
    let nodes: Vec<f32> = (0..down * across).map(|_| StandardNormal.sample(rng)).collect();
    // The middle of the grid lies at a random place near the lattice's.
    let (row, col) = (0.5 * rows as f64, 0.5 * cols as f64);
    let mut begin = |nodes: usize, middle: f64| 0.5 * (nodes as f64 - 1.0) - middle + rng.random::<f64>() - 0.5;
    let map = PixelMap {
        row0: begin(down, across_step * (row * cos - col * sin)),
        row_per_row: across_step * cos,
        row_per_col: -across_step * sin,
        col0: begin(across, along_step * (row * sin + col * cos)),
        col_per_row: along_step * sin,
        col_per_col: along_step * cos,
    };
    resample_bicubic(&nodes, down, across, &map, rows, cols)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn fields_have_a_spread_of_one_and_longer_waves_are_smoother() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut rises = [20.0, 80.0].map(|wave_px| {
            let noise = Noise::draw(&mut rng, [300, 400], wave_px);
            let values: Vec<f32> = noise.values().collect();
            let mean_square = values.iter().map(|v| v * v).sum::<f32>() / values.len() as f32;
            assert!((0.5..1.3).contains(&mean_square.sqrt()), "{mean_square}");
            assert_eq!(noise.at(7), values[7]);
            values.windows(2).map(|w| (w[1] - w[0]).powi(2)).sum::<f32>()
        });
        rises.sort_by(f32::total_cmp);
        assert!(rises[1] / rises[0] > 5.0, "{rises:?}");
    }

    #[test]
    fn stretched_fields_are_smoother_along_their_angle() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let (rows, cols) = (200, 260);
        for (angle, along_cols) in [(0.0, true), (std::f32::consts::FRAC_PI_2, false)] {
            let noise = Noise::draw_stretched(&mut rng, [rows, cols], 12.0, (8.0, angle));
            let rise = |step: usize| {
                let rises = (0..(rows - 1) * cols - 1).map(|at| (noise.at(at + step) - noise.at(at)).powi(2));
                rises.sum::<f32>()
            };
            let (across, down) = (rise(1), rise(cols));
            assert!(if along_cols { down > 8.0 * across } else { across > 8.0 * down }, "{angle}: {across} and {down}");
        }
    }
}
