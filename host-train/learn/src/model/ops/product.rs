//! The inner loop of convolutions: sums of shifted lines, `out[m][n] = Σ_k weight[m][k] * line[shift[k] + n]`.
//!
//! A block of eight outputs by two or three vectors of pixels stays in registers while k runs, so memory is read once per block. Every sum runs
//! over k in order, whatever the number of threads.

use super::frame::Frame;
use super::scratch::Scratch;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Number of outputs computed together.
const BLOCK: usize = 8;
/// Greatest width of a block of pixels.
const MAX_WIDTH: usize = super::frame::SLACK;

/// Weights packed for the inner loop, and the position that each of them reads.
pub(super) struct Taps {
    outputs: usize,
    shifts: Vec<usize>,
    /// Blocks of outputs, each `[k][outputs of the block]`.
    packed: Scratch,
}

/// Returns the number of outputs of the block that starts at `m`: eight, then 4, 2 or 1 as needed.
fn block_at(m: usize, outputs: usize) -> usize {
    match outputs - m {
        1 => 1,
        2 => 2,
        3 | 4 => 4,
        _ => BLOCK,
    }
}

impl Taps {
    /// Packs weights. The weight of output `m < outputs` and shift k is `weights[output(m) + columns[k]]`; `shifts[k]` is as in
    /// [`Frame::neighbour`].
    pub(super) fn new(
        outputs: usize,
        shifts: Vec<usize>,
        weights: &[f32],
        output: impl Fn(usize) -> usize + Sync,
        columns: &[usize],
    ) -> Self {
        let depth = shifts.len();
        debug_assert_eq!(columns.len(), depth);
        let whole = outputs / BLOCK * BLOCK;
        let last = if whole < outputs { block_at(whole, outputs) } else { 0 };
        let mut packed = Scratch::new((whole + last) * depth);
        packed.par_chunks_mut((BLOCK * depth).max(1)).enumerate().for_each(|(i, to)| {
            let first = i * BLOCK;
            let block = block_at(first, outputs);
            let count = block.min(outputs - first);
            let rows: [&[f32]; BLOCK] = std::array::from_fn(|m| &weights[output(first + m.min(count - 1))..]);
            for (&k, to) in columns.iter().zip(to.chunks_exact_mut(block)) {
                let (real, rest) = to.split_at_mut(count);
                real.iter_mut().zip(rows).for_each(|(to, row)| *to = row[k]);
                rest.fill(0.0);
            }
        });
        Self { outputs, shifts, packed }
    }
}

/// The pixels to compute: `size` of them from `origin` on, in every image of the frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Area {
    /// First row and column.
    pub(super) origin: [usize; 2],
    /// Rows and columns.
    pub(super) size: [usize; 2],
}

/// Writes `[images, outputs, rows, columns]` of the area to `out`.
pub(super) fn multiply(taps: &Taps, lines: &[f32], frame: &Frame, area: Area, out: &mut [f32]) {
    let [rows, cols] = area.size;
    let tasks = frame.images * rows * cols;
    if tasks == 0 {
        return;
    }
    debug_assert_eq!(out.len(), tasks * taps.outputs);
    // Bands of some thousand pixels. With small maps, outputs are divided as well.
    let band = (4096 / cols).clamp(1, rows);
    let bands = rows.div_ceil(band);
    let parts = (16 / (frame.images * bands)).clamp(1, taps.outputs.div_ceil(BLOCK));
    let per_part = taps.outputs.div_ceil(parts).next_multiple_of(BLOCK);
    let parts = taps.outputs.div_ceil(per_part);
    let mut work: Vec<Vec<&mut [f32]>> = (0..frame.images * bands * parts).map(|_| Vec::new()).collect();
    for (plane, map) in out.chunks_exact_mut(rows * cols).enumerate() {
        let (image, m) = (plane / taps.outputs, plane % taps.outputs);
        for (i, strip) in map.chunks_mut(band * cols).enumerate() {
            work[(image * bands + i) * parts + m / per_part].push(strip);
        }
    }
    let arch = Arch::new();
    work.into_par_iter().enumerate().for_each(|(i, strips)| {
        let (place, part) = (i / parts, i % parts);
        let (image, top) = (place / bands, place % bands * band);
        let start = frame.at(image, area.origin[0] + top, area.origin[1]) - frame.front;
        arch.dispatch(Strip { taps, lines, start, pitch: frame.pitch, cols, first: part * per_part, strips });
    });
}

/// Some rows of some outputs of one image.
struct Strip<'a> {
    taps: &'a Taps,
    lines: &'a [f32],
    /// Position of the first pixel, without the front, which `shifts` includes.
    start: usize,
    pitch: usize,
    cols: usize,
    /// The first output, a multiple of [`BLOCK`].
    first: usize,
    /// One slice of whole rows per output.
    strips: Vec<&'a mut [f32]>,
}

impl WithSimd for Strip<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let end = (self.strips[0].len() / self.cols - 1) * self.pitch + self.cols;
        let whole = self.strips.len() / BLOCK * BLOCK;
        // Two or three vectors, whichever leaves fewer unused.
        let vectors = end.div_ceil(S::F32_LANES);
        let by_two = vectors.next_multiple_of(2) < vectors.next_multiple_of(3);
        if S::REGISTER_COUNT < 32 {
            self.blocks::<S, 8, 1>(simd, 0, whole, end);
        } else if by_two {
            self.blocks::<S, 8, 2>(simd, 0, whole, end);
        } else {
            self.blocks::<S, 8, 3>(simd, 0, whole, end);
        }
        if whole < self.strips.len() {
            let (from, to) = (whole, self.strips.len());
            match block_at(from, to) {
                1 => self.blocks::<S, 1, 8>(simd, from, to, end),
                2 => self.blocks::<S, 2, 4>(simd, from, to, end),
                4 if S::REGISTER_COUNT >= 32 => self.blocks::<S, 4, 6>(simd, from, to, end),
                4 => self.blocks::<S, 4, 2>(simd, from, to, end),
                _ if S::REGISTER_COUNT >= 32 => self.blocks::<S, 8, 3>(simd, from, to, end),
                _ => self.blocks::<S, 8, 1>(simd, from, to, end),
            }
        }
    }
}

impl Strip<'_> {
    /// Computes outputs `from..to` in blocks of `M` by `N` vectors of pixels.
    #[inline(always)]
    fn blocks<S: Simd, const M: usize, const N: usize>(&mut self, simd: S, from: usize, to: usize, end: usize) {
        let width = N * S::F32_LANES;
        let mut sums = [0.0; BLOCK * MAX_WIDTH];
        let depth = self.taps.shifts.len();
        for n in (0..end).step_by(width) {
            for m in (from..to).step_by(M) {
                let weights = &self.taps.packed[(self.first + m) * depth..][..M * depth];
                block::<S, M, N>(simd, weights, &self.taps.shifts, &self.lines[self.start + n..], &mut sums);
                let count = M.min(to - m);
                for (sums, strip) in sums.chunks_exact(width).zip(&mut self.strips[m..m + count]) {
                    scatter(sums, strip, n, self.pitch, self.cols);
                }
            }
        }
    }
}

/// Computes one block of sums: `sums[m * width..]` for each of M outputs.
#[inline(always)]
fn block<S: Simd, const M: usize, const N: usize>(
    simd: S,
    weights: &[f32],
    shifts: &[usize],
    lines: &[f32],
    sums: &mut [f32],
) {
    let width = N * S::F32_LANES;
    let mut acc = [[simd.splat_f32s(0.0); N]; M];
    for (weights, &shift) in weights.chunks_exact(M).zip(shifts) {
        let (line, _) = S::as_simd_f32s(&lines[shift..][..width]);
        let line: [S::f32s; N] = std::array::from_fn(|j| line[j]);
        for (acc, &weight) in acc.iter_mut().zip(weights) {
            let weight = simd.splat_f32s(weight);
            for (acc, &pixels) in acc.iter_mut().zip(&line) {
                *acc = simd.mul_add_e_f32s(weight, pixels, *acc);
            }
        }
    }
    // One by one, because a copy of rows would keep the sums in memory during the loop above.
    let sums = S::as_mut_simd_f32s(&mut sums[..M * width]).0;
    for i in 0..M {
        for j in 0..N {
            sums[i * N + j] = acc[i][j];
        }
    }
}

/// Copies a block of sums that starts at position `n` of a strip into its rows, without the values between rows.
#[inline(always)]
fn scatter(sums: &[f32], strip: &mut [f32], n: usize, pitch: usize, cols: usize) {
    let (mut y, mut x, mut from) = (n / pitch, n % pitch, 0);
    while from < sums.len() && y * cols < strip.len() {
        let count = (pitch - x).min(sums.len() - from);
        if x < cols {
            let kept = count.min(cols - x);
            strip[y * cols + x..][..kept].copy_from_slice(&sums[from..from + kept]);
        }
        (y, x, from) = (y + 1, 0, from + count);
    }
}
