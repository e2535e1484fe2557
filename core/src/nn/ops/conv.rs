//! Convolution: one panel of output channels of one step.
//!
//! ```text
//! for every stretch of output pixels with the same filter            a row; with a folded upsampling, every second pixel of it
//!     for as many pixels as the kernel takes at once
//!         acc = products of the filter                                  [and of the row's correction]
//!         [at the first and the last pixel: += products of the corrections for the column]
//!         round acc, add, clamp, look up, store                        kernels/requantise.rs
//!
//! products of some filters:
//!     acc = 0
//!     for every 16-bit source:  acc += high plane * weights
//!     acc *= 256
//!     for every source:         acc += low plane (or u8 codes) * weights
//! ```
//! Nothing is copied: kernels read rows in place. Rows above and below the map are a row of zero codes in scratch memory (or, if folded,
//! the border row); columns left and right are the tensor's margin.

use super::requantise::requantise;
use super::witness::{LEAST_PIXELS, MOST_PRODUCTS, PatchRow, Sums, TOGETHER, Witness, panel_sums};
use super::{Constants, Prepared};
use crate::nn::arena::{Arena, zero_code};
use crate::nn::file::{Conv, MAX_KERNEL, PHASE_TAPS, PHASES, Phase};
use crate::nn::kernels::requantise::{Requantise, Target};
use crate::nn::kernels::{ACCUMULATORS, Accumulators, Isa, Patch, Product, pixels_at_once};
use crate::nn::panels::{PANEL, groups, panel};
use crate::nn::tensor::{Dtype, Tensor};
use crate::part::{head, head_mut, item, part, part_mut};
use core::hint::black_box;

/// A convolution with its tensors.
struct Job<'a, 'm> {
    constants: &'a Constants<'m>,
    conv: &'a Conv,
    out: Tensor,
    sources: [Option<Tensor>; 2],
    add: Option<Tensor>,
    /// First channel of the panel, and its width.
    first: usize,
    width: usize,
    /// Whether one of the sources has 16 bits.
    wide: bool,
    /// Where `out`, `sources` and `add` are from.
    prepared: &'a Prepared,
}

/// A set of filters, and the place of its first patch.
#[derive(Clone, Copy)]
struct Filter<'m> {
    variant: usize,
    /// First row and column of the patch in the input; places outside are padding.
    row: isize,
    col: isize,
    /// Kernel rows and columns.
    rows: usize,
    cols: usize,
    /// Weights of each source.
    weights: [&'m [u8]; 2],
}

/// Output pixels of one row that use the same filters.
#[derive(Clone, Copy)]
struct Stretch<'m> {
    /// Output row, first column, step between columns, number of pixels.
    row: usize,
    col: usize,
    col_step: usize,
    count: usize,
    /// Input columns from one patch to the next.
    input_step: usize,
    filters: [Option<Filter<'m>>; 2],
}

/// Patches side by side that are multiplied by the same filters.
struct Patches<'f, 'm> {
    filters: &'f [Option<Filter<'m>>; 2],
    /// Columns from the filters' first patch to the first of these.
    skip: usize,
    count: usize,
    /// Input columns from one patch to the next.
    input_step: usize,
}

/// Runs unit `unit` (the number of the panel) of step `step`.
#[inline(always)]
pub(crate) fn run<I: Isa>(
    isa: &mut I,
    constants: &Constants<'_>,
    conv: &Conv,
    prepared: &Prepared,
    arena: &mut Arena<'_>,
    step: usize,
    unit: usize,
) -> Option<u64> {
    let out = prepared.out;
    let (first, width) = panel(out.channels, unit);
    let [first_source, second_source, add] = prepared.inputs;
    let sources = [first_source, second_source];
    let wide = sources.iter().flatten().any(|t| t.dtype == Dtype::I16);
    let job = Job { constants, conv, sources, add, first, width, wide, out, prepared };
    let (begin, made) = (conv.step_rows() * step, conv.step_rows());
    let rows = begin..(begin + made).min(job.out.rows);
    let filter = job.filter(0, 0, 0);
    let (phases, every) = if conv.fold { (4, 2) } else { (1, 1) };
    let (mut cut, mut sums) = (0, [[0; ACCUMULATORS]; 2]);
    let mut lists: Lists<'_> = [List { products: [Product::NOTHING; MOST_TOGETHER], len: 0 }; PLANES];
    // All rows with the same filter before the next filter, so that its weights stay in the cache.
    for phase in 0..phases {
        for row in rows.clone().skip(phase / 2).step_by(every) {
            let stretch = if conv.fold { job.folded(row, phase % 2) } else { job.plain(row, filter) };
            let numbers = job.numbers(stretch.variants());
            cut += job.run(isa, arena, &mut sums, &stretch, &numbers, I::TOGETHER.then_some(&mut lists))?;
        }
    }
    if first + width >= out.channels && out.margin > 0 {
        for row in rows {
            arena.fill_margins(&out, row);
        }
    }
    Some(cut)
}

impl Stretch<'_> {
    /// The sets of filters.
    #[inline(always)]
    fn variants(&self) -> [Option<usize>; 2] {
        self.filters.map(|filter| filter.map(|f| f.variant))
    }
}

impl<'m> Job<'_, 'm> {
    /// Returns the constants that round the sums of some sets of filters.
    #[inline(always)]
    fn numbers(&self, variants: [Option<usize>; 2]) -> Requantise<'_> {
        requantise(self.constants, self.conv, &self.out, self.add, self.first, self.width, variants)
    }

    /// Returns a whole row as a stretch.
    #[inline(always)]
    fn plain(&self, row: usize, filter: Filter<'m>) -> Stretch<'m> {
        let (conv, pad) = (self.conv, self.conv.pad as isize);
        let filter = Filter { row: (row * conv.stride) as isize - pad, col: -pad, ..filter };
        let (count, input_step) = (self.out.cols, conv.stride_cols);
        Stretch { row, col: 0, col_step: 1, count, input_step, filters: [Some(filter), None] }
    }

    /// Returns every second pixel of a row as a stretch, from the first or (`odd` 1) the second pixel on.
    #[inline(always)]
    fn folded(&self, row: usize, odd: usize) -> Stretch<'m> {
        let (down, across) = (Phase::of(row, self.out.rows / 2), Phase::of(odd, self.out.cols / 2));
        let filter = self.filter(down.filter * PHASES + odd, down.first, across.first);
        let correction =
            down.correction.map(|(number, at)| self.filter(number * PHASES + odd, at as isize, across.first));
        let filters = [Some(filter), correction];
        Stretch { row, col: odd, col_step: 2, count: self.out.cols / 2, input_step: 1, filters }
    }

    /// Returns the corrections for a column of a row.
    #[inline(always)]
    fn corrections(&self, row: usize, col: usize) -> [Option<Filter<'m>>; 2] {
        let (down, across) = (Phase::of(row, self.out.rows / 2), Phase::of(col, self.out.cols / 2));
        let Some((number, left)) = across.correction else { return [None; 2] };
        let filter = self.filter(down.filter * PHASES + number, down.first, left as isize);
        let corner =
            down.correction.map(|(above, top)| self.filter(above * PHASES + number, top as isize, left as isize));
        [Some(filter), corner]
    }

    /// Returns a set of filters whose first patch begins at a row and column.
    #[inline(always)]
    fn filter(&self, variant: usize, row: isize, col: isize) -> Filter<'m> {
        let conv = self.conv;
        let (rows, cols) = conv.extent(variant);
        // Number of groups of one source, or of both, in a kernel row of `cols` columns.
        let of = |source: usize, cols: usize| self.sources[source].map_or(0, |t| groups(cols * t.channels));
        let both = |cols: usize| of(0, cols) + of(1, cols);
        // Number of groups of the sets before this one, and of all sets: whole rows of sets, then those of this row.
        let (before, all) = if conv.fold {
            let (down, across) = (variant / PHASES, variant % PHASES);
            let sum = |taps: &[usize]| taps.iter().map(|&cols| both(cols)).sum::<usize>();
            let row = sum(&PHASE_TAPS);
            let above: usize = PHASE_TAPS.iter().take(down).sum();
            (above * row + rows * sum(head(&PHASE_TAPS, across)), PHASE_TAPS.iter().sum::<usize>() * row)
        } else {
            (0, rows * both(cols))
        };
        // The panels before this one have `first` channels in total. The first source comes first.
        let start = conv.weights + 4 * (self.first * all + self.width * before);
        let bytes = |source: usize| 4 * self.width * rows * of(source, cols);
        let weights = [self.constants.slice(start, bytes(0)), self.constants.slice(start + bytes(0), bytes(1))];
        Filter { variant, row, col, rows, cols, weights }
    }

    /// Computes a stretch; `None` if its products differ from their checksums, or its constants have changed.
    #[inline(always)]
    fn run<I: Isa>(
        &self,
        isa: &mut I,
        arena: &mut Arena<'_>,
        sums: &mut [Accumulators; 2],
        stretch: &Stretch<'m>,
        numbers: &Requantise<'_>,
        lists: Option<&mut Lists<'m>>,
    ) -> Option<u64> {
        let checked = self.prepared.checked
            && stretch.count >= LEAST_PIXELS
            && self.taps(stretch) * pixels_at_once(self.width) <= MOST_PRODUCTS;
        if checked {
            self.sum_products(isa, arena, &mut sums[0], stretch);
        }
        let mut witness = Witness::new(&sums[0]);
        let mut lists = lists.and_then(|lists| self.list(stretch, lists).then_some(lists));
        let mut cut = 0;
        let mut done = 0;
        while done < stretch.count {
            let left = stretch.count - done;
            // The checksum of a larger block would not stay within 32 bits.
            let now = I::block(left, self.width).min(if checked { pixels_at_once(self.width) } else { left });
            let (filters, input_step) = (&stretch.filters, stretch.input_step);
            let patches = Patches { filters, skip: done * input_step, count: now, input_step };
            let high = self.products(isa, arena, &mut sums[0], &patches, lists.as_deref_mut());
            if self.conv.fold {
                for pixel in [0, stretch.count - 1] {
                    if (done..done + now).contains(&pixel) {
                        let corrections = self.corrections(stretch.row, stretch.col + 2 * pixel);
                        self.correct(isa, arena, sums, pixel - done, &corrections, &mut witness);
                    }
                }
            }
            let col = stretch.col + done * stretch.col_step;
            let target = Target { row: stretch.row, col, col_step: stretch.col_step, pixels: now };
            cut += numbers.run::<I>(arena, &sums[0], &target);
            if checked {
                witness.note(&panel_sums(&sums[0], now, self.width), &high);
            }
            done += now;
        }
        if checked {
            // The constants, too, were in memory without a checksum for the time of a stretch. The compiler must read them again.
            let &Prepared { out, inputs: [.., add], .. } = black_box(self.prepared);
            let constants = black_box(self.constants);
            let again = requantise(constants, self.conv, &out, add, self.first, self.width, stretch.variants());
            if !witness.holds(self.width) || *numbers != again {
                return None;
            }
        }
        Some(cut)
    }

    /// Sets the sums of one pixel to the products of the sum of a stretch's patches, both planes alike.
    #[inline(always)]
    fn sum_products<I: Isa>(&self, isa: &mut I, arena: &mut Arena<'_>, acc: &mut Accumulators, stretch: &Stretch<'m>) {
        head_mut(acc, self.width).fill(0);
        let mut sums = [0; TOGETHER];
        for filter in stretch.filters.iter().flatten() {
            for (source, t) in self.sources.iter().enumerate() {
                let Some(t) = t else { continue };
                let weights = item(&filter.weights, source);
                let groups = groups(filter.cols * t.channels);
                let bytes = 4 * self.width * groups;
                for plane in 0..t.dtype.bytes().min(2) {
                    for k in 0..filter.rows {
                        let (start, inside) = self.start(filter, t, plane, k, 0);
                        let row = PatchRow {
                            start,
                            stride: stretch.input_step * t.channels,
                            count: stretch.count,
                            groups,
                            outside: (!inside).then(|| zero_code(t, plane)),
                        };
                        let weights = part(weights, k * bytes, bytes);
                        row.add_products(isa, arena, acc, weights, self.width, &mut sums);
                    }
                }
            }
        }
    }

    /// Returns where a kernel row of a filter's patch begins, `skip` columns after the first patch, and whether the row is inside the map.
    #[inline(always)]
    fn start(&self, filter: &Filter<'_>, t: &Tensor, plane: usize, k: usize, skip: usize) -> (usize, bool) {
        // Margins are at least as wide as the padding.
        let col = (filter.col + (skip + t.margin) as isize).max(0) as usize * t.channels;
        let row = filter.row + k as isize;
        let inside = row.min(t.rows as isize - 1).max(0);
        (t.row_offset(inside as usize) + col + plane * t.plane_bytes(), row == inside || self.conv.fold)
    }

    /// Adds the corrections for an output pixel to its sums, `acc[pixel]`.
    #[inline(always)]
    fn correct<I: Isa>(
        &self,
        isa: &mut I,
        arena: &mut Arena<'_>,
        [acc, more]: &mut [Accumulators; 2],
        pixel: usize,
        corrections: &[Option<Filter<'m>>; 2],
        witness: &mut Witness,
    ) {
        if corrections.iter().all(Option::is_none) {
            return;
        }
        self.products(isa, arena, more, &Patches { filters: corrections, skip: 0, count: 1, input_step: 1 }, None);
        for filter in corrections.iter().flatten() {
            let first = filter.variant * self.out.channels + self.first;
            let channels = self.width.min(self.out.channels - self.first);
            for (c, more) in more.iter_mut().take(channels).enumerate() {
                *more = more.wrapping_add(self.constants.i32_at(self.conv.bias, first + c));
            }
        }
        witness.leave_out(head(more, self.width));
        for (acc, more) in part_mut(acc, pixel * self.width, self.width).iter_mut().zip(&*more) {
            *acc = acc.wrapping_add(*more);
        }
    }

    /// Number of products of a pixel.
    #[inline(always)]
    fn taps(&self, stretch: &Stretch<'_>) -> usize {
        let channels: usize = self.sources.iter().flatten().map(|t| t.channels).sum();
        stretch.filters.iter().flatten().map(|filter| filter.rows * filter.cols * channels).sum()
    }

    /// Sets `acc` to the products of the patches and their filters, which `lists` may have for both planes; returns the sums of the high
    /// planes over the pixels, which only a checked stretch needs.
    #[inline(always)]
    fn products<I: Isa>(
        &self,
        isa: &mut I,
        arena: &mut Arena<'_>,
        acc: &mut Accumulators,
        patches: &Patches<'_, 'm>,
        mut lists: Option<&mut Lists<'m>>,
    ) -> Sums {
        let (mut begun, mut high) = (false, [0; PANEL]);
        if self.wide {
            match lists.as_deref_mut().and_then(|lists| lists.get_mut(1)) {
                Some(list) => list.next(isa, arena, acc, patches.count, self.width, &mut begun),
                None => self.plane(isa, arena, acc, patches, 1, &mut begun),
            }
            if self.prepared.checked {
                high = panel_sums(acc, patches.count, self.width);
            }
            head_mut(acc, patches.count * self.width).iter_mut().for_each(|a| *a = a.wrapping_shl(8));
        }
        match lists.and_then(|lists| lists.first_mut()) {
            Some(list) => list.next(isa, arena, acc, patches.count, self.width, &mut begun),
            None => self.plane(isa, arena, acc, patches, 0, &mut begun),
        }
        high
    }

    /// Adds the products of one plane of all sources; the first products replace the sums.
    #[inline(always)]
    fn plane<I: Isa>(
        &self,
        isa: &mut I,
        arena: &mut Arena<'_>,
        acc: &mut Accumulators,
        patches: &Patches<'_, 'm>,
        plane: usize,
        begun: &mut bool,
    ) {
        let &Patches { filters, skip, count, input_step } = patches;
        for filter in filters.iter().flatten() {
            for (source, t) in self.sources.iter().enumerate() {
                let Some(t) = t.as_ref().filter(|t| plane == 0 || t.dtype == Dtype::I16) else { continue };
                let (groups, stride) = (groups(filter.cols * t.channels), input_step * t.channels);
                let mut starts = [0; MAX_KERNEL];
                for (k, start) in starts.iter_mut().take(filter.rows).enumerate() {
                    let (at, inside) = self.start(filter, t, plane, k, skip);
                    *start = if inside {
                        at
                    } else {
                        let len = (count - 1) * stride + 4 * groups;
                        part_mut(arena.bytes, arena.scratch, len).fill(zero_code(t, plane));
                        arena.scratch
                    };
                }
                let weights = item(&filter.weights, source);
                let patch = Patch { bytes: arena.bytes, starts: head(&starts, filter.rows), stride, groups };
                if *begun {
                    isa.gemm(acc, count, &patch, weights, self.width);
                } else {
                    isa.gemm_from_zero(acc, count, &patch, weights, self.width);
                }
                *begun = true;
            }
        }
    }

    /// Lists the products of a stretch, low planes first; returns false if a row is outside the map.
    #[inline(always)]
    fn list(&self, stretch: &Stretch<'m>, lists: &mut Lists<'m>) -> bool {
        lists.iter_mut().for_each(|list| list.len = 0);
        for filter in stretch.filters.iter().flatten() {
            for (source, t) in self.sources.iter().enumerate() {
                let Some(t) = t else { continue };
                for (plane, list) in lists.iter_mut().enumerate().take(t.dtype.bytes().min(2)) {
                    let Some(product) = list.products.get_mut(list.len) else { return false };
                    list.len += 1;
                    for (k, start) in product.starts.iter_mut().take(filter.rows).enumerate() {
                        let (at, inside) = self.start(filter, t, plane, k, 0);
                        if !inside {
                            return false;
                        }
                        *start = at;
                    }
                    (product.rows, product.groups) = (filter.rows, groups(filter.cols * t.channels));
                    (product.stride, product.weights) =
                        (stretch.input_step * t.channels, item(&filter.weights, source));
                }
            }
        }
        true
    }
}

/// Two sources, each with two sets of filters.
const MOST_TOGETHER: usize = 4;

/// The planes of a stretch whose products are listed: none, and so no memory, where no kernel computes them together.
const PLANES: usize = if cfg!(target_arch = "x86_64") { 2 } else { 0 };

/// The products of a stretch, low planes first.
type Lists<'m> = [List<'m>; PLANES];

/// The products of one plane of a stretch, which are computed together.
#[derive(Clone, Copy)]
struct List<'m> {
    products: [Product<'m>; MOST_TOGETHER],
    len: usize,
}

impl List<'_> {
    /// Computes the products of the next `pixels` pixels; the first ones of a block replace the sums.
    #[inline(always)]
    fn next<I: Isa>(
        &mut self,
        isa: &mut I,
        arena: &Arena<'_>,
        acc: &mut Accumulators,
        pixels: usize,
        width: usize,
        begun: &mut bool,
    ) {
        let products = head_mut(&mut self.products, self.len);
        isa.products(acc, pixels, arena.bytes, products, width, !*begun);
        *begun = true;
        for product in products {
            for start in product.starts.iter_mut().take(product.rows) {
                *start += pixels * product.stride;
            }
        }
    }
}
