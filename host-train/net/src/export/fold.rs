//! "Upsample twofold by bilinear interpolation, then convolve 5x5 with zero padding" as filters on the small map.
//!
//! Both steps are linear. Along one axis, output 2i depends on five samples of the upsampled map. Each of these is 3/4 of one sample and
//! 1/4 of another sample of the small map. Together they are four samples. Output 2i+1 also depends on four samples, with other weights. In
//! two dimensions this makes four sets of filters with 16 products instead of 25.
//!
//! The filters use a repeated border, but the convolution has zeros there: beyond the border, the upsampled map would equal the border
//! sample. In the two outermost outputs on each side, this adds one product with the border sample. A correction subtracts it: along an
//! axis (filter - correction), in two dimensions (filter - correction) x (filter - correction). That makes 12 x 12 weights instead of 25.

use super::graph::LayerWeights;
use super::pack::Filter;
use elunar_core::nn::file::{PHASE_TAPS, PHASES, Phase};

/// Side of the kernels that can be folded.
const SIDE: usize = 5;

/// Weights of the small map's samples for each tap of a 5-tap filter: `[phase][sample][tap]`.
type Axis = [[[f64; SIDE]; 4]; PHASES];

/// Returns all sets of filters and corrections, `[row phase][column phase]`, see [`elunar_core::nn::file::Phase`].
pub(super) fn fold(kernel: &LayerWeights) -> Vec<Filter> {
    let axis = axis();
    let mut filters = Vec::new();
    for (row_phase, (down, rows)) in axis.iter().zip(PHASE_TAPS).enumerate() {
        for (col_phase, (across, cols)) in axis.iter().zip(PHASE_TAPS).enumerate() {
            let filter = folded(kernel, &down[..rows], &across[..cols]);
            filters.push(Filter { correction: row_phase > 1 || col_phase > 1, ..filter });
        }
    }
    filters
}

fn folded(kernel: &LayerWeights, down: &[[f64; SIDE]], across: &[[f64; SIDE]]) -> Filter {
    let mut weights = Vec::with_capacity(kernel.output * down.len() * across.len() * kernel.input);
    for filter in kernel.weights.chunks_exact(SIDE * SIDE * kernel.input) {
        for row in down {
            for col in across {
                for channel in 0..kernel.input {
                    let mut sum = 0.0;
                    for (r, down) in row.iter().enumerate() {
                        for (c, across) in col.iter().enumerate() {
                            sum += down * across * filter[(r * SIDE + c) * kernel.input + channel] as f64;
                        }
                    }
                    weights.push(sum);
                }
            }
        }
    }
    Filter { extent: (down.len(), across.len()), weights, correction: false }
}

/// Computes the filters along an axis, on a small map that is long enough to keep its borders apart.
fn axis() -> Axis {
    const LEN: isize = 8;
    let mut axis = [[[0.0; SIDE]; 4]; PHASES];
    for index in [LEN, LEN + 1] {
        let phase = Phase::of(index as usize, LEN as usize);
        for tap in 0..SIDE as isize {
            let at = index + tap - 2;
            let near = at / 2;
            let far = if at % 2 == 0 { near - 1 } else { near + 1 };
            for (sample, share) in [(near, 0.75), (far, 0.25)] {
                axis[phase.filter][(sample - phase.first) as usize][tap as usize] += share;
            }
        }
    }
    for index in [0, 1, 2 * LEN - 2, 2 * LEN - 1] {
        let Some((number, _)) = Phase::of(index as usize, LEN as usize).correction else { continue };
        for tap in 0..SIDE as isize {
            let padding = !(0..2 * LEN).contains(&(index + tap - 2));
            axis[number][0][tap as usize] = if padding { -1.0 } else { 0.0 };
        }
    }
    axis
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Upsamples a one-channel map as the network does.
    fn upsample(map: &[f64], rows: usize, cols: usize) -> Vec<f64> {
        let axis = |index: usize, len: usize| {
            let near = (index / 2) as isize;
            let far = if index.is_multiple_of(2) { near - 1 } else { near + 1 };
            (near as usize, far.clamp(0, len as isize - 1) as usize)
        };
        let mut out = Vec::new();
        for row in 0..2 * rows {
            for col in 0..2 * cols {
                let ((r0, r1), (c0, c1)) = (axis(row, rows), axis(col, cols));
                let at = |r: usize, c: usize| map[r * cols + c];
                out.push((9.0 * at(r0, c0) + 3.0 * at(r0, c1) + 3.0 * at(r1, c0) + at(r1, c1)) / 16.0);
            }
        }
        out
    }

    /// Returns the phases of an output along an axis, and the samples that each of them reads.
    fn parts(index: usize, len: usize) -> Vec<(usize, Vec<usize>)> {
        let phase = Phase::of(index, len);
        let taps = PHASE_TAPS[phase.filter] as isize;
        let samples = (phase.first..phase.first + taps).map(|s| s.clamp(0, len as isize - 1) as usize).collect();
        let correction = phase.correction.map(|(number, at)| (number, vec![at]));
        std::iter::once((phase.filter, samples)).chain(correction).collect()
    }

    #[test]
    fn filters_equal_upsampling_and_convolution_at_every_pixel() {
        for (rows, cols) in [(4, 4), (5, 9), (8, 6)] {
            let map: Vec<f64> = (0..rows * cols).map(|i| ((i * 7919 % 101) as f64 - 50.0) / 9.0).collect();
            let weights: Vec<f32> = (0..25).map(|i| ((i * 31 % 17) as f32 - 8.0) / 5.0).collect();
            let kernel = LayerWeights { output: 1, input: 1, side: 5, weights: weights.clone(), bias: vec![0.0] };
            let (filters, large) = (fold(&kernel), upsample(&map, rows, cols));
            for row in 0..2 * rows {
                for col in 0..2 * cols {
                    let mut expected = 0.0;
                    for (i, w) in weights.iter().enumerate() {
                        let (r, c) = ((row + i / 5).wrapping_sub(2), (col + i % 5).wrapping_sub(2));
                        if r < 2 * rows && c < 2 * cols {
                            expected += large[r * 2 * cols + c] * *w as f64;
                        }
                    }
                    let mut found = 0.0;
                    for ((row_phase, down), (col_phase, across)) in parts(row, rows)
                        .into_iter()
                        .flat_map(|down| parts(col, cols).into_iter().map(move |across| (down.clone(), across)))
                    {
                        let filter = &filters[row_phase * PHASES + col_phase];
                        assert_eq!(filter.extent, (down.len(), across.len()));
                        assert_eq!(filter.correction, row_phase > 1 || col_phase > 1);
                        for (i, w) in filter.weights.iter().enumerate() {
                            found += map[down[i / across.len()] * cols + across[i % across.len()]] * w;
                        }
                    }
                    assert!((found - expected).abs() < 1e-9, "{row} {col} of {rows} x {cols}: {found} {expected}");
                }
            }
        }
    }
}
