//! The bilinear filter after a transposed convolution: it interleaves the phases of one map and smooths them. Also its transpose.
//!
//! Bilinear upsampling by two puts zeros between the pixels and filters with (1, 3, 3, 1)/4 at -1 .. 2. Along one axis, with V0 and V1 the
//! even and odd pixels of the filter's input:
//!
//! ```text
//! out[2y]     = (V1[y] + 3 V0[y] + 3 V1[y-1] + V0[y-1]) / 4
//! out[2y + 1] = (V0[y+1] + 3 V1[y] + 3 V0[y] + V1[y-1]) / 4
//! ```

use pulp::Arch;

/// Weights of the two nearest and the two farther pixels.
const NEAR: f32 = 0.75;
const FAR: f32 = 0.25;

/// Computes row `n` of the smoothed map from four phases `[2][2][rows, cols]`, which are zero beyond their edges. `columns` is working
/// memory of `3 * cols + 4`.
pub(super) fn row(arch: Arch, phases: [&[f32]; 4], cols: usize, n: usize, columns: &mut [f32], out: &mut [f32]) {
    let y = n / 2;
    let (here, before) = (Some(y), y.checked_sub(1));
    columns.fill(0.0);
    let (zeros, columns) = columns.split_at_mut(cols);
    let zeros = &*zeros;
    // Each with a zero before and after it.
    let (even, odd) = columns.split_at_mut(cols + 2);
    arch.dispatch(|| {
        for (q, to) in [&mut *even, &mut *odd].into_iter().enumerate() {
            let line = |p: usize, y: Option<usize>| {
                let phase = phases[2 * p + q];
                y.filter(|y| y * cols < phase.len()).map_or(zeros, |y| &phase[y * cols..][..cols])
            };
            // (far, near, near, far)
            let [a, b, c, d] = if n.is_multiple_of(2) {
                [line(1, here), line(0, here), line(1, before), line(0, before)]
            } else {
                [line(0, Some(y + 1)), line(1, here), line(0, here), line(1, before)]
            };
            for ((((to, a), b), c), d) in to[1..].iter_mut().zip(a).zip(b).zip(c).zip(d) {
                *to = FAR * (a + d) + NEAR * (b + c);
            }
        }
        let [even, odd] = [&*even, &*odd];
        let left = even[..cols].iter().zip(&odd[..cols]);
        let here = even[1..].iter().zip(&odd[1..]);
        for (((pair, (e0, o0)), (e1, o1)), e2) in out.chunks_exact_mut(2).zip(left).zip(here).zip(&even[2..]) {
            pair[0] = FAR * (o1 + e0) + NEAR * (e1 + o0);
            pair[1] = FAR * (e2 + o0) + NEAR * (o1 + e1);
        }
    });
}

/// Applies the transpose of [`row`] for row `y` of phase (p, q) to the gradient `[2 * rows, 2 * cols]` of the smoothed map. `columns` is
/// working memory of `2 * cols + 4`.
pub(super) fn transposed_row(
    arch: Arch,
    gradient: &[f32],
    cols: usize,
    [p, q]: [usize; 2],
    y: usize,
    columns: &mut [f32],
    out: &mut [f32],
) {
    let width = 2 * cols;
    let columns = &mut columns[..width + 4];
    arch.dispatch(|| {
        columns.fill(0.0);
        // The rows for which this one has the weights far, near, near, far.
        for (n, weight) in (2 * y + p..).zip([FAR, NEAR, NEAR, FAR]) {
            let Some(n) = n.checked_sub(1).filter(|n| n * width < gradient.len()) else { continue };
            let line = &gradient[n * width..][..width];
            // Columns are shifted by one to the right, so that column -1 exists.
            columns[1..=width].iter_mut().zip(line).for_each(|(to, from)| *to += weight * from);
        }
        let columns = &columns[q..][..width + 2];
        let quads = columns.chunks_exact(2).zip(columns[2..].chunks_exact(2));
        for (to, (a, b)) in out[..cols].iter_mut().zip(quads) {
            *to = FAR * (a[0] + b[1]) + NEAR * (a[1] + b[0]);
        }
    });
}
