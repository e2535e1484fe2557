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
pub(super) const NEAR: f32 = 0.75;
pub(super) const FAR: f32 = 0.25;

/// Computes row `n` of the smoothed map, `n` in `2..2 * rows - 2`, from four phases `[2][2][rows, cols]`. Writes columns `2..2 * cols - 2`
/// of `out`. `columns` is working memory of `2 * cols`.
pub(super) fn row(arch: Arch, phases: [&[f32]; 4], cols: usize, n: usize, columns: &mut [f32], out: &mut [f32]) {
    let y = n / 2;
    let (even, odd) = columns.split_at_mut(cols);
    arch.dispatch(|| {
        for (q, to) in [&mut *even, &mut *odd].into_iter().enumerate() {
            let line = |p: usize, y: usize| &phases[2 * p + q][y * cols..][..cols];
            // (far, near, near, far)
            let [a, b, c, d] = if n.is_multiple_of(2) {
                [line(1, y), line(0, y), line(1, y - 1), line(0, y - 1)]
            } else {
                [line(0, y + 1), line(1, y), line(0, y), line(1, y - 1)]
            };
            for ((((to, a), b), c), d) in to.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                *to = FAR * (a + d) + NEAR * (b + c);
            }
        }
        let [even, odd] = [&*even, &*odd];
        let pairs = out[2..2 * cols - 2].chunks_exact_mut(2);
        let left = even[..cols - 2].iter().zip(&odd[..cols - 2]);
        let here = even[1..cols - 1].iter().zip(&odd[1..cols - 1]);
        for (((pair, (e0, o0)), (e1, o1)), e2) in pairs.zip(left).zip(here).zip(&even[2..]) {
            pair[0] = FAR * (o1 + e0) + NEAR * (e1 + o0);
            pair[1] = FAR * (e2 + o0) + NEAR * (o1 + e1);
        }
    });
}

/// Applies the transpose of [`row`] for row `y` of phase (p, q) to the gradient `[2 * rows, 2 * cols]` of the smoothed map. Only its rows
/// and columns from 2 to the second last but one count. `columns` is working memory of `2 * cols + 4`.
pub(super) fn transposed_row(
    arch: Arch,
    gradient: &[f32],
    [rows, cols]: [usize; 2],
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
            let Some(n) = n.checked_sub(1).filter(|n| (2..2 * rows - 2).contains(n)) else { continue };
            let line = &gradient[n * width..][..width];
            // Columns are shifted by one to the right, so that column -1 exists.
            columns[3..width - 1].iter_mut().zip(&line[2..width - 2]).for_each(|(to, from)| *to += weight * from);
        }
        let columns = &columns[q..][..width + 2];
        let quads = columns.chunks_exact(2).zip(columns[2..].chunks_exact(2));
        for (to, (a, b)) in out[..cols].iter_mut().zip(quads) {
            *to = FAR * (a[0] + b[1]) + NEAR * (a[1] + b[0]);
        }
    });
}
