//! The weight gradient of convolutions: `out[m][r] = Σ_n gradient[m][n] * line[shift[r] + n]` over all pixels n.
//!
//! Pixels are divided into chunks that fit a core's cache. Chunks are summed in a fixed order, so the result does not depend on the number
//! of threads.

use super::frame::Frame;
use super::scratch::Scratch;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Number of pixels of a chunk.
const CHUNK: usize = 768;
/// Greatest number of parallel sums over chunks.
const GROUPS: usize = 8;
/// Least number of pieces of work, if there are that many shifts.
const PIECES: usize = 16;
/// Number of shifts computed together.
const SHIFTS: usize = 3;
/// Greatest number of outputs computed together.
const OUTPUTS: usize = 8;

/// Returns `[outputs, shifts]` of the `gradient`'s lines with the shifted `lines`. Both have the layout `frame`. Values between the pixels
/// of `gradient` must be zero.
pub(super) fn correlate(gradient: &[f32], lines: &[f32], shifts: &[usize], frame: &Frame) -> Vec<f32> {
    let outputs = gradient.len() / frame.length;
    let chunks = frame.span().div_ceil(CHUNK);
    let groups = chunks.min(GROUPS);
    let per_group = chunks.div_ceil(groups);
    let pieces = PIECES.div_ceil(groups).min(shifts.len().div_ceil(SHIFTS));
    let per_piece = shifts.len().div_ceil(pieces).next_multiple_of(SHIFTS);
    let pieces = shifts.len().div_ceil(per_piece);
    let arch = Arch::new();
    let sums: Vec<Vec<f32>> = (0..groups * pieces)
        .into_par_iter()
        .map(|i| {
            let (group, piece) = (i / pieces, i % pieces);
            let shifts = &shifts[piece * per_piece..shifts.len().min((piece + 1) * per_piece)];
            let mut out = vec![0.0; outputs * shifts.len()];
            let mut panel = Scratch::new(OUTPUTS * CHUNK);
            let (first, last) = (group * per_group, chunks.min((group + 1) * per_group));
            for start in (first..last).map(|chunk| chunk * CHUNK) {
                let length = CHUNK.min(frame.span() - start);
                let (panel, out) = (&mut *panel, &mut *out);
                arch.dispatch(Chunk { gradient, lines, shifts, frame, start, length, outputs, panel, out });
            }
            out
        })
        .collect();
    let mut total = vec![0.0; outputs * shifts.len()];
    for (i, sums) in sums.iter().enumerate() {
        let first = i % pieces * per_piece;
        let count = sums.len() / outputs;
        for (total, sums) in total.chunks_exact_mut(shifts.len()).zip(sums.chunks_exact(count)) {
            total[first..first + count].iter_mut().zip(sums).for_each(|(t, s)| *t += s);
        }
    }
    total
}

/// One chunk of pixels, all outputs, some shifts.
struct Chunk<'a> {
    gradient: &'a [f32],
    lines: &'a [f32],
    shifts: &'a [usize],
    frame: &'a Frame,
    start: usize,
    length: usize,
    outputs: usize,
    /// The gradients of a block of outputs, interleaved vector by vector.
    panel: &'a mut [f32],
    out: &'a mut [f32],
}

impl WithSimd for Chunk<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let mut m = 0;
        while m < self.outputs {
            let left = self.outputs - m;
            m += if S::REGISTER_COUNT >= 32 && left > 4 {
                self.block::<S, OUTPUTS>(simd, m)
            } else if left > 2 {
                self.block::<S, 4>(simd, m)
            } else {
                self.block::<S, 2>(simd, m)
            }
        }
    }
}

impl Chunk<'_> {
    /// Computes `M` outputs from `first` on, or as many as exist, with all shifts. Returns M.
    #[inline(always)]
    fn block<S: Simd, const M: usize>(&mut self, simd: S, first: usize) -> usize {
        // Beyond the last pixel the gradient is zero.
        let steps = self.length.div_ceil(S::F32_LANES);
        let length = steps * S::F32_LANES;
        let panel = &mut S::as_mut_simd_f32s(self.panel).0[..M * steps];
        let count = M.min(self.outputs - first);
        for i in 0..M {
            // Missing outputs repeat the last one.
            let line = (first + i.min(count - 1)) * self.frame.length + self.frame.front + self.start;
            let (line, _) = S::as_simd_f32s(&self.gradient[line..][..length]);
            panel.iter_mut().skip(i).step_by(M).zip(line).for_each(|(to, from)| *to = *from);
        }
        let mut sums = [simd.splat_f32s(0.0); OUTPUTS * SHIFTS];
        for r in (0..self.shifts.len()).step_by(SHIFTS) {
            let lines: [&[S::f32s]; SHIFTS] = std::array::from_fn(|j| {
                let shift = self.shifts[(r + j).min(self.shifts.len() - 1)];
                S::as_simd_f32s(&self.lines[shift + self.start..][..length]).0
            });
            products::<S, M>(simd, panel, lines, &mut sums);
            for (i, sums) in sums[..M * SHIFTS].chunks_exact(SHIFTS).take(count).enumerate() {
                let out = &mut self.out[(first + i) * self.shifts.len()..][..self.shifts.len()][r..];
                out.iter_mut().zip(sums).for_each(|(out, &lanes)| *out += simd.reduce_sum_f32s(lanes));
            }
        }
        M
    }
}

/// Adds the products of a panel `[steps][M]` with each line to sums.
#[inline(always)]
fn products<S: Simd, const M: usize>(simd: S, panel: &[S::f32s], lines: [&[S::f32s]; SHIFTS], sums: &mut [S::f32s]) {
    let mut acc = [[simd.splat_f32s(0.0); SHIFTS]; M];
    let [a, b, c] = lines;
    for (((gradient, &a), &b), &c) in panel.chunks_exact(M).zip(a).zip(b).zip(c) {
        for i in 0..M {
            acc[i][0] = simd.mul_add_e_f32s(gradient[i], a, acc[i][0]);
            acc[i][1] = simd.mul_add_e_f32s(gradient[i], b, acc[i][1]);
            acc[i][2] = simd.mul_add_e_f32s(gradient[i], c, acc[i][2]);
        }
    }
    // One by one, because a copy of rows would keep the sums in memory during the loop above.
    let sums = &mut sums[..M * SHIFTS];
    for i in 0..M {
        for j in 0..SHIFTS {
            sums[i * SHIFTS + j] = acc[i][j];
        }
    }
}
