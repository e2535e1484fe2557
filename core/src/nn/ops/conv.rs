//! Convolution: one panel of output channels of one step.
//!
//! ```text
//! for every stretch of output pixels with the same filter            one stretch; 2 x 6 with a folded enlargement
//!     for as many pixels as the kernel takes at once
//!         acc = 0
//!         for every 16-bit source:  acc += high plane * weights
//!         acc *= 256
//!         for every source:         acc += low plane (or u8 codes) * weights
//!         round acc, add, clamp, look up, store                        finish.rs
//! ```
//! Nothing is copied: kernels read the rows where they lie. Rows above and below the map are a row of zero codes in scratch (or,
//! folded, the border row); columns left and right are the tensor's margin.

use super::finish::{Finish, Target};
use crate::nn::arena::{Arena, zero_code};
use crate::nn::kernels::{ACCUMULATORS, Isa, Patch, panel, panelled, pixels_at_once};
use crate::nn::model::{MAX_KERNEL, Model};
use crate::nn::program::{Conv, Dtype, PHASE_TAPS, PHASES, Phase, Tensor, groups};

/// A convolution with its tensors.
struct Job<'a, 'm> {
    model: &'a Model<'m>,
    conv: &'a Conv,
    out: Tensor,
    sources: [Option<Tensor>; 2],
    /// First channel and width of the panel.
    first: usize,
    width: usize,
}

/// Output pixels of one row that use the same filters.
#[derive(Clone, Copy)]
struct Stretch {
    /// Output row, first column, step between columns, pixels.
    row: usize,
    col: usize,
    col_step: usize,
    count: usize,
    /// First row and column of the first patch, in the input; outside is padding.
    input_row: isize,
    input_col: isize,
    /// Input columns from one patch to the next.
    input_step: usize,
    /// Set of filters and its kernel.
    variant: usize,
    kernel_rows: usize,
    kernel_cols: usize,
}

/// Runs unit `unit` (the number of the panel) of step `step`.
#[inline(always)]
pub(crate) fn run<I: Isa>(model: &Model<'_>, conv: &Conv, arena: &mut Arena<'_>, step: usize, unit: usize) -> u64 {
    let out = model.tensor(conv.out);
    let (first, width) = panel(out.channels, unit);
    let sources = [Some(model.tensor(conv.first)), conv.second.map(|t| model.tensor(t))];
    let job = Job { model, conv, sources, first, width, out };
    let mut cut = 0;
    let rows =
        if conv.fold { 2 * step..2 * step + 2 } else { conv.block * step..(conv.block * (step + 1)).min(job.out.rows) };
    for row in rows.clone() {
        cut += if conv.fold { job.folded_row::<I>(arena, row) } else { job.run::<I>(arena, &job.plain_row(row)) };
    }
    if first + width >= out.channels && out.margin > 0 {
        for row in rows {
            arena.fill_margins(&out, row);
        }
    }
    cut
}

impl Job<'_, '_> {
    #[inline(always)]
    fn plain_row(&self, row: usize) -> Stretch {
        let conv = self.conv;
        Stretch {
            row,
            col: 0,
            col_step: 1,
            count: self.out.cols,
            input_row: (row * conv.stride) as isize - conv.pad as isize,
            input_col: -(conv.pad as isize),
            input_step: conv.stride_cols,
            variant: 0,
            kernel_rows: conv.kernel_rows,
            kernel_cols: conv.kernel_cols,
        }
    }

    /// Six stretches: two columns at each border, and the even and the odd ones between.
    #[inline(always)]
    fn folded_row<I: Isa>(&self, arena: &mut Arena<'_>, row: usize) -> u64 {
        let (rows, cols) = (self.out.rows / 2, self.out.cols / 2);
        let down = Phase::of(row, rows);
        let mut cut = 0;
        for (col, count) in [(0, 1), (1, 1), (2, cols - 2), (3, cols - 2), (2 * cols - 2, 1), (2 * cols - 1, 1)] {
            let across = Phase::of(col, cols);
            let stretch = Stretch {
                row,
                col,
                col_step: 2,
                count,
                input_row: down.first,
                input_col: across.first,
                input_step: 1,
                variant: down.filter * PHASES + across.filter,
                kernel_rows: down.taps,
                kernel_cols: across.taps,
            };
            cut += self.run::<I>(arena, &stretch);
        }
        cut
    }

    /// Weights of one source for this panel: offset among the constants, and bytes.
    #[inline(always)]
    fn weights(&self, stretch: &Stretch, source: usize) -> &[u8] {
        // Groups of one source in a kernel row of so many columns.
        let of = |s: usize, cols: usize| self.sources[s].map_or(0, |t| groups(cols * t.channels));
        let both = |cols: usize| of(0, cols) + of(1, cols);
        let mut start = self.conv.weights;
        if self.conv.fold {
            // Groups of the filters before this one: whole rows of filters, then those of this row.
            let (down, across) = (stretch.variant / PHASES, stretch.variant % PHASES);
            let rows: usize = PHASE_TAPS[..down].iter().sum();
            let row: usize = PHASE_TAPS.iter().map(|&cols| both(cols)).sum();
            let before: usize = PHASE_TAPS[..across].iter().map(|&cols| both(cols)).sum();
            start += 4 * panelled(self.out.channels) * (rows * row + stretch.kernel_rows * before);
        }
        // Panels before this one hold `first` channels; the first source comes first.
        start += 4 * self.first * stretch.kernel_rows * both(stretch.kernel_cols);
        start += source * 4 * self.width * stretch.kernel_rows * of(0, stretch.kernel_cols);
        let mine = 4 * self.width * stretch.kernel_rows * of(source, stretch.kernel_cols);
        self.model.constants(start, mine)
    }

    #[inline(always)]
    fn run<I: Isa>(&self, arena: &mut Arena<'_>, stretch: &Stretch) -> u64 {
        let finish = Finish::new(self.model, self.conv, &self.out, (self.first, self.width), stretch.variant);
        let weights = [self.weights(stretch, 0), self.weights(stretch, 1)];
        let wide = self.sources.iter().flatten().any(|t| t.dtype == Dtype::I16);
        let mut acc = [0; ACCUMULATORS];
        let mut cut = 0;
        let mut done = 0;
        while done < stretch.count {
            // Blocks of nearly one size: small ones leave registers idle.
            let left = stretch.count - done;
            let now = left.div_ceil(left.div_ceil(pixels_at_once(self.width)));
            acc[..now * self.width].fill(0);
            if wide {
                for (source, t) in self.sources.iter().enumerate() {
                    if let Some(t) = t.as_ref().filter(|t| t.dtype == Dtype::I16) {
                        self.add::<I>(arena, &mut acc, stretch, (done, now), (t, 1), weights[source]);
                    }
                }
                acc[..now * self.width].iter_mut().for_each(|a| *a = a.wrapping_shl(8));
            }
            for (source, t) in self.sources.iter().enumerate() {
                if let Some(t) = t {
                    self.add::<I>(arena, &mut acc, stretch, (done, now), (t, 0), weights[source]);
                }
            }
            let col = stretch.col + done * stretch.col_step;
            let target = Target { row: stretch.row, col, col_step: stretch.col_step, pixels: now };
            cut += finish.run::<I>(arena, &acc, &target);
            done += now;
        }
        cut
    }

    /// Adds the products of one plane of one source.
    #[inline(always)]
    fn add<I: Isa>(
        &self,
        arena: &mut Arena<'_>,
        acc: &mut [i32; ACCUMULATORS],
        stretch: &Stretch,
        (done, now): (usize, usize),
        (t, plane): (&Tensor, usize),
        weights: &[u8],
    ) {
        let groups = groups(stretch.kernel_cols * t.channels);
        let stride = stretch.input_step * t.channels;
        let col = stretch.input_col + ((done * stretch.input_step + t.margin) as isize);
        // Margins are at least as wide as the padding.
        let col = col.max(0) as usize * t.channels + plane * t.plane_bytes();
        let mut starts = [0; MAX_KERNEL];
        for (k, start) in starts[..stretch.kernel_rows].iter_mut().enumerate() {
            let row = stretch.input_row + k as isize;
            let inside = row.clamp(0, t.rows as isize - 1);
            *start = if row == inside || self.conv.fold {
                t.row_offset(inside as usize) + col
            } else {
                let len = (now - 1) * stride + 4 * groups;
                arena.bytes[arena.scratch..arena.scratch + len].fill(zero_code(t, plane));
                arena.scratch
            };
        }
        let patch = Patch { bytes: arena.bytes, starts: &starts[..stretch.kernel_rows], stride, groups };
        I::gemm(acc, now, &patch, weights, self.width);
    }
}
