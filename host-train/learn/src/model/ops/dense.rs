//! Products of small matrices that fit a core's cache: a tile of tokens times the weights of a layer, or the gradient of either.
//!
//! Rows of the right matrix and of the result are whole vectors, with zeros after the last real column ([`padded`]). Sums run over the
//! depth in order.

use super::scratch::Scratch;
use pulp::{Arch, Simd, WithSimd};

/// Number of columns to a multiple of which rows are padded.
const LANES: usize = 16;

/// Returns the length of a padded row of `columns` numbers.
pub(super) fn padded(columns: usize) -> usize {
    columns.next_multiple_of(LANES)
}

/// A left matrix, whose element (i, k) is at `i * row + k * column`.
#[derive(Clone, Copy)]
pub(super) struct Left<'a> {
    numbers: &'a [f32],
    row: usize,
    column: usize,
}

impl<'a> Left<'a> {
    /// A matrix of rows at distance `pitch`.
    pub(super) fn rows(numbers: &'a [f32], pitch: usize) -> Self {
        Self { numbers, row: pitch, column: 1 }
    }

    /// The transpose of a matrix of rows at distance `pitch`.
    pub(super) fn columns(numbers: &'a [f32], pitch: usize) -> Self {
        Self { numbers, row: 1, column: pitch }
    }
}

/// A matrix of padded rows at distance `.1`.
pub(super) type Right<'a> = (&'a [f32], usize);

/// Adds `left` `[m, depth]` times `right` `[depth, n]` to `out` `[m, n]`, whose rows are at distance `out.1`. `n` is a padded number of
/// columns.
pub(super) fn add_product(arch: Arch, [m, n, depth]: [usize; 3], left: Left, right: Right, out: (&mut [f32], usize)) {
    debug_assert!(n.is_multiple_of(LANES));
    arch.dispatch(Product { size: [m, n, depth], left, right, out });
}

struct Product<'a> {
    size: [usize; 3],
    left: Left<'a>,
    right: Right<'a>,
    out: (&'a mut [f32], usize),
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let n = self.size[1];
        let mut j = 0;
        while j < n {
            j += match (n - j) / S::F32_LANES {
                1 => self.columns::<S, 1>(simd, j),
                2 | 4 => self.columns::<S, 2>(simd, j),
                _ => self.columns::<S, 3>(simd, j),
            };
        }
    }
}

impl Product<'_> {
    /// Computes N vectors of columns from `j` on. Returns the number of columns.
    #[inline(always)]
    fn columns<S: Simd, const N: usize>(&mut self, simd: S, j: usize) -> usize {
        let m = self.size[0];
        let mut i = 0;
        while i < m {
            i += match m - i {
                8.. if S::REGISTER_COUNT >= 32 => self.block::<S, 8, N>(simd, i, j),
                4.. => self.block::<S, 4, N>(simd, i, j),
                _ => self.block::<S, 1, N>(simd, i, j),
            };
        }
        N * S::F32_LANES
    }

    /// Computes M rows by N vectors. Returns M.
    #[inline(always)]
    fn block<S: Simd, const M: usize, const N: usize>(&mut self, simd: S, i: usize, j: usize) -> usize {
        let Left { numbers, row, column } = self.left;
        let (right, pitch) = self.right;
        let rows: [&[f32]; M] = std::array::from_fn(|m| &numbers[(i + m) * row..]);
        let mut acc = [[simd.splat_f32s(0.0); N]; M];
        for k in 0..self.size[2] {
            let (line, _) = S::as_simd_f32s(&right[k * pitch + j..][..N * S::F32_LANES]);
            let line: [S::f32s; N] = std::array::from_fn(|n| line[n]);
            let at = k * column;
            for (acc, row) in acc.iter_mut().zip(&rows) {
                let factor = simd.splat_f32s(row[at]);
                for (acc, &line) in acc.iter_mut().zip(&line) {
                    *acc = simd.mul_add_e_f32s(factor, line, *acc);
                }
            }
        }
        let (out, pitch) = &mut self.out;
        for m in 0..M {
            let out = S::as_mut_simd_f32s(&mut out[(i + m) * *pitch + j..][..N * S::F32_LANES]).0;
            for n in 0..N {
                out[n] = simd.add_f32s(out[n], acc[m][n]);
            }
        }
        M
    }
}

/// Copies a matrix to padded rows.
pub(super) fn pack(from: &[f32], columns: usize) -> Scratch {
    let wide = padded(columns);
    let mut to = Scratch::new(from.len() / columns * wide);
    for (to, from) in to.chunks_exact_mut(wide).zip(from.chunks_exact(columns)) {
        to[..columns].copy_from_slice(from);
        to[columns..].fill(0.0);
    }
    to
}

/// Copies the transpose of a matrix to padded rows.
pub(super) fn pack_transposed(from: &[f32], columns: usize) -> Scratch {
    let rows = from.len() / columns;
    let mut to = Scratch::new(columns * padded(rows));
    transpose((from, columns), [rows, columns], &mut to);
    to
}

/// Copies the transpose of `size` rows and columns of a matrix, whose rows are at distance `from.1`, to padded rows.
pub(super) fn transpose(from: (&[f32], usize), [rows, columns]: [usize; 2], to: &mut [f32]) {
    let wide = padded(rows);
    for (c, to) in to.chunks_exact_mut(wide).take(columns).enumerate() {
        to[rows..].fill(0.0);
        to.iter_mut().zip(from.0[c..].iter().step_by(from.1)).take(rows).for_each(|(to, from)| *to = *from);
    }
}

/// Removes the padding of rows of `columns` numbers.
pub(super) fn unpack(from: &[f32], columns: usize) -> Vec<f32> {
    from.chunks_exact(padded(columns)).flat_map(|row| &row[..columns]).copied().collect()
}

/// Divides a buffer into parts of these lengths.
pub(super) fn parts<const N: usize>(mut buffer: &mut [f32], lengths: [usize; N]) -> [&mut [f32]; N] {
    lengths.map(|length| {
        let (part, rest) = std::mem::take(&mut buffer).split_at_mut(length);
        buffer = rest;
        part
    })
}

/// Adds rows to `sum`.
pub(super) fn add_rows(rows: &[f32], sum: &mut [f32]) {
    for row in rows.chunks_exact(sum.len()) {
        sum.iter_mut().zip(row).for_each(|(sum, row)| *sum += row);
    }
}

/// Adds lists of the same length in order.
pub(super) fn total(lists: Vec<Vec<f32>>) -> Vec<f32> {
    let mut lists = lists.into_iter();
    let mut total = lists.next().unwrap_or_default();
    lists.for_each(|list| add_rows(&list, &mut total));
    total
}
