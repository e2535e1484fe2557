//! "Enlarge twofold by bilinear interpolation, then convolve 5x5 with zero padding" as filters on the small map.
//!
//! Both steps are linear. Along one axis, output 2i sees five samples of the enlarged map, each 3/4 of one and 1/4 of another sample
//! of the small map: together four. So does output 2i+1, with other weights. The two outermost outputs on each side lose
//! taps to the padding and get filters of their own; in two dimensions that makes 6 x 6 sets of filters, 16 products
//! instead of 25 inside.

use super::graph::Kernel;
use super::pack::Filter;
use elunar_core::nn::{PHASE_TAPS, PHASES};

/// Side of the kernels that can be folded.
const SIDE: usize = 5;

/// Weights of the small map's samples for each tap of a 5-tap filter: `[phase][sample][tap]`.
type Axis = [[[f64; SIDE]; 4]; PHASES];

/// All sets of filters, `[row phase][column phase]`, see [`elunar_core::nn::Phase`].
pub(super) fn fold(kernel: &Kernel) -> Vec<Filter> {
    let axis = axis();
    let mut filters = Vec::new();
    for (down, rows) in axis.iter().zip(PHASE_TAPS) {
        for (across, cols) in axis.iter().zip(PHASE_TAPS) {
            filters.push(folded(kernel, &down[..rows], &across[..cols]));
        }
    }
    filters
}

fn folded(kernel: &Kernel, down: &[[f64; SIDE]], across: &[[f64; SIDE]]) -> Filter {
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
    Filter { extent: (down.len(), across.len()), weights }
}

/// The filters along an axis, found on a small map long enough that its borders do not meet.
fn axis() -> Axis {
    const LEN: isize = 8;
    let mut axis = [[[0.0; SIDE]; 4]; PHASES];
    // One output of each phase.
    for index in [0, 1, LEN, LEN + 1, 2 * LEN - 2, 2 * LEN - 1] {
        let phase = elunar_core::nn::Phase::of(index as usize, LEN as usize);
        for tap in 0..SIDE as isize {
            let at = index + tap - 2;
            if !(0..2 * LEN).contains(&at) {
                continue; // zero padding
            }
            let near = at / 2;
            let far = if at % 2 == 0 { near - 1 } else { near + 1 };
            for (sample, share) in [(near, 0.75), (far, 0.25)] {
                // Beyond the border the border sample repeats; inner filters never see it here.
                let sample = sample.clamp(0, LEN - 1) - phase.first;
                axis[phase.filter][sample as usize][tap as usize] += share;
            }
        }
    }
    axis
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_core::nn::Phase;

    /// Samples of a one-channel map, enlarged as the network does.
    fn enlarge(map: &[f64], rows: usize, cols: usize) -> Vec<f64> {
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

    #[test]
    fn filters_equal_enlargement_and_convolution_at_every_pixel() {
        for (rows, cols) in [(4, 4), (5, 9), (8, 6)] {
            let map: Vec<f64> = (0..rows * cols).map(|i| ((i * 7919 % 101) as f64 - 50.0) / 9.0).collect();
            let weights: Vec<f32> = (0..25).map(|i| ((i * 31 % 17) as f32 - 8.0) / 5.0).collect();
            let kernel = Kernel { output: 1, input: 1, side: 5, weights: weights.clone(), bias: vec![0.0] };
            let (filters, large) = (fold(&kernel), enlarge(&map, rows, cols));
            for row in 0..2 * rows {
                for col in 0..2 * cols {
                    let mut expected = 0.0;
                    for (i, w) in weights.iter().enumerate() {
                        let (r, c) = ((row + i / 5).wrapping_sub(2), (col + i % 5).wrapping_sub(2));
                        if r < 2 * rows && c < 2 * cols {
                            expected += large[r * 2 * cols + c] * *w as f64;
                        }
                    }
                    let (down, across) = (Phase::of(row, rows), Phase::of(col, cols));
                    let filter = &filters[down.filter * PHASES + across.filter];
                    assert_eq!(filter.extent, (down.taps, across.taps));
                    let mut found = 0.0;
                    for (i, w) in filter.weights.iter().enumerate() {
                        let r = (down.first + (i / across.taps) as isize).clamp(0, rows as isize - 1) as usize;
                        let c = (across.first + (i % across.taps) as isize).clamp(0, cols as isize - 1) as usize;
                        found += map[r * cols + c] * w;
                    }
                    assert!((found - expected).abs() < 1e-9, "{row} {col} of {rows} x {cols}: {found} {expected}");
                }
            }
        }
    }
}
