//! A second way to the sum of a stretch's matrix products (Huang and Abraham, "Algorithm-based fault tolerance for matrix operations", 1984),
//! modulo 255:
//!
//! ```text
//! Σ over pixels p of acc[p][c]  =  Σ over rows r and bytes j of  (Σ over p of x[starts[r] + p*stride + j])  *  w[r][j][c]
//! ```
//! The right side is one pixel more for the kernel. Modulo 255 the sum over pixels is a byte like any code, and no power of two is 0, so a
//! flipped bit of a sum shows. Of other errors of a channel one in 255 is missed. Sums of codes, unlike finished sums, may wrap; those of a block
//! of pixels and one plane are exact up to [`MOST_PRODUCTS`].

use crate::nn::arena::Arena;
use crate::nn::kernels::{Accumulators, Isa, Patch};
use crate::nn::panels::PANEL;
use crate::part::{copy, head, head_mut, part, part_mut};

/// Number of bytes of a row's patch that are summed together.
pub(super) const TOGETHER: usize = 512;
/// Number of bytes whose sums stay in registers.
const VECTOR: usize = 16;
/// Most bytes of the patches that fill whole vectors together.
const LONGEST: usize = 128;
/// Every second byte of a word.
const EVEN: u32 = 0x00ff_00ff;
/// Number of pixels after which the sums of two bytes side by side are folded: 255 * 128 + 510 < 2^16.
const FOLDED: usize = 128;

/// Fewest pixels whose products have a second sum. One pixel more is a large share of fewer.
pub(crate) const LEAST_PIXELS: usize = 16;

/// Most products of codes and weights whose sum stays within 32 bits.
pub(super) const MOST_PRODUCTS: usize = i32::MAX as usize / (255 * 127);

/// Sums of the channels of a panel.
pub(super) type Sums = [i32; PANEL];

/// The sums of a stretch's products, modulo 255.
#[derive(Clone, Copy)]
pub(super) struct Witness {
    /// By the sum of the patches.
    expected: Sums,
    /// Of all pixels.
    found: Sums,
    /// What was added to the sums of the block's pixels beside their products.
    more: Sums,
}

/// Returns a number that is the same modulo 255, from -2^15 to 2^17.
#[inline(always)]
const fn fold(sum: i32) -> i32 {
    (sum >> 16) + (sum & 0xffff)
}

/// Adds up the sums of some pixels.
#[inline(always)]
pub(super) fn panel_sums(acc: &Accumulators, pixels: usize, width: usize) -> Sums {
    match width {
        32 => sums_of::<32>(acc, pixels),
        16 => sums_of::<16>(acc, pixels),
        _ => sums_of::<8>(acc, pixels),
    }
}

#[inline(always)]
fn sums_of<const W: usize>(acc: &Accumulators, pixels: usize) -> Sums {
    let (mut sums, mut panel) = ([0; PANEL], [0i32; W]);
    for pixel in head(acc.as_chunks::<W>().0, pixels) {
        for c in 0..W {
            panel[c] = panel[c].wrapping_add(pixel[c]);
        }
    }
    copy(head_mut(&mut sums, W), &panel);
    sums
}

impl Witness {
    /// Begins with the products of the patches' sum, both planes alike.
    #[inline(always)]
    pub(super) fn new(products: &Accumulators) -> Self {
        let mut expected = [0; PANEL];
        copy(&mut expected, head(products, PANEL));
        Self { expected: expected.map(fold), found: [0; PANEL], more: [0; PANEL] }
    }

    /// Leaves out `more`, which is added to a pixel of the block.
    #[inline(always)]
    pub(super) fn leave_out(&mut self, more: &[i32]) {
        self.more.iter_mut().zip(more).for_each(|(sum, more)| *sum = sum.wrapping_add(*more));
    }

    /// Notes a block: the sums of its pixels, and those of their high planes.
    #[inline(always)]
    pub(super) fn note(&mut self, sums: &Sums, high: &Sums) {
        for c in 0..PANEL {
            let low = sums[c].wrapping_sub(self.more[c]).wrapping_sub(high[c] << 8);
            self.found[c] += fold(low) + fold(high[c]);
        }
        self.more = [0; PANEL];
    }

    /// Returns whether both ways lead to the same sums.
    #[inline(always)]
    pub(super) fn holds(&self, width: usize) -> bool {
        let pairs = self.expected.iter().zip(&self.found).take(width);
        pairs.fold(0, |off, (expected, found)| off | (expected.wrapping_sub(*found) % 255)) == 0
    }
}

/// The patches of a stretch in one row of one source.
#[derive(Debug)]
pub(super) struct PatchRow {
    /// First byte of the first patch.
    pub(super) start: usize,
    /// Bytes from one patch to the next, and number of patches.
    pub(super) stride: usize,
    pub(super) count: usize,
    /// Four-byte groups of a patch.
    pub(super) groups: usize,
    /// The code that all bytes have instead, in a row outside the map.
    pub(super) outside: Option<u8>,
}

impl PatchRow {
    /// Adds the products of the sum of the patches. `sums` is scratch memory.
    #[inline(always)]
    pub(super) fn add_products<I: Isa>(
        &self,
        isa: &mut I,
        arena: &Arena<'_>,
        acc: &mut Accumulators,
        weights: &[u8],
        width: usize,
        sums: &mut [u8; TOGETHER],
    ) {
        for first in (0..4 * self.groups).step_by(TOGETHER) {
            let sums = head_mut(sums, TOGETHER.min(4 * self.groups - first));
            match self.outside {
                Some(code) => sums.fill(folded(self.count as u32 * code as u32)),
                None => self.sum(arena.bytes, first, sums),
            }
            let patch = Patch { bytes: sums, starts: &[0], stride: 0, groups: sums.len() / 4 };
            isa.gemm(acc, 1, &patch, part(weights, first * width, sums.len() * width), width);
        }
    }

    /// Writes the sums of bytes from `first` of the patches on, modulo 255.
    #[inline(always)]
    fn sum(&self, bytes: &[u8], first: usize, sums: &mut [u8]) {
        if cfg!(any(target_feature = "neon", target_feature = "sse2", target_feature = "simd128")) {
            self.sum_by::<Wide>(bytes, first, sums);
        } else {
            self.sum_by::<Words<{ VECTOR / 4 }>>(bytes, first, sums);
        }
    }

    #[inline(always)]
    fn sum_by<L: Lanes>(&self, bytes: &[u8], first: usize, sums: &mut [u8]) {
        let (stride, start) = (self.stride, self.start + first);
        let direct = stride.min(sums.len());
        // Patches that follow each other without a gap are summed by as many together as fill whole vectors.
        let together = VECTOR >> stride.trailing_zeros().min(VECTOR.trailing_zeros());
        let long = together * stride;
        if together > 1 && direct == stride && long <= LONGEST {
            let mut wide = [0; LONGEST];
            let wide = head_mut(&mut wide, long);
            let all = Run { start, stride: long, count: self.count / together };
            for at in (0..long).step_by(VECTOR) {
                all.write::<L>(bytes, at, wide);
            }
            let done = all.count * long;
            let rest = part(bytes, start + done, self.count * stride - done);
            let mut totals = [0; LONGEST / 2];
            let totals = head_mut(&mut totals, stride);
            for one in wide.chunks(stride.max(1)).chain(rest.chunks(stride.max(1))) {
                totals.iter_mut().zip(one).for_each(|(total, byte)| *total += *byte as u16);
            }
            sums.iter_mut().zip(totals).for_each(|(to, total)| *to = folded(*total as u32));
        } else {
            let run = Run { start, stride, count: self.count };
            let whole = direct - direct % VECTOR;
            for at in (0..whole).step_by(VECTOR) {
                run.write::<L>(bytes, at, sums);
            }
            for at in (whole..direct).step_by(4) {
                run.write::<Words<1>>(bytes, at, sums);
            }
        }
        // A byte of the second patch is one of the first patch, a stride later.
        let last = start + self.count.saturating_sub(1) * stride;
        for at in (direct..sums.len()).step_by(direct.max(1)) {
            let Some((before, now)) = sums.split_at_mut_checked(at) else { return };
            let len = direct.min(now.len());
            let now = head_mut(now, len);
            let before = part(before, at - direct, now.len());
            let (gone, come) = (part(bytes, start + at - direct, now.len()), part(bytes, last + at, now.len()));
            for (((to, before), gone), come) in now.iter_mut().zip(before).zip(gone).zip(come) {
                *to = folded(*before as u32 + *come as u32 + 255 - *gone as u32);
            }
        }
    }
}

/// Bytes that lie `stride` apart, `count` times.
struct Run {
    start: usize,
    stride: usize,
    count: usize,
}

impl Run {
    /// Writes the sums from byte `at` on.
    #[inline(always)]
    fn write<L: Lanes>(&self, bytes: &[u8], at: usize, to: &mut [u8]) {
        let (mut sums, from) = (L::ZERO, self.start + at);
        let Some(before) = self.count.checked_sub(1) else { return };
        // The last one may lie at the end of the bytes, without what follows it in the others' stride.
        for first in (0..before).step_by(FOLDED) {
            let count = FOLDED.min(before - first);
            let some = part(bytes, from + first * self.stride, count * self.stride);
            some.chunks_exact(self.stride.max(1)).for_each(|from| sums.add(from));
            sums.fold();
        }
        sums.add(part(bytes, from + before * self.stride, L::BYTES));
        sums.write(part_mut(to, at, L::BYTES.min(to.len() - at)));
    }
}

/// Sums of bytes side by side, in registers.
trait Lanes {
    const ZERO: Self;
    /// Number of bytes.
    const BYTES: usize;
    /// Adds the first bytes; at most [`FOLDED`] times, then they are folded.
    fn add(&mut self, from: &[u8]);
    /// Makes the sums smaller, the same modulo 255.
    fn fold(&mut self);
    /// Writes them modulo 255.
    fn write(&self, to: &mut [u8]);
}

/// For vectors.
struct Wide([u16; VECTOR]);

impl Lanes for Wide {
    const ZERO: Self = Self([0; VECTOR]);
    const BYTES: usize = VECTOR;

    #[inline(always)]
    fn add(&mut self, from: &[u8]) {
        let Some(from) = from.first_chunk::<VECTOR>() else { return };
        self.0.iter_mut().zip(from).for_each(|(sum, byte)| *sum = sum.wrapping_add(*byte as u16));
    }

    #[inline(always)]
    fn fold(&mut self) {
        self.0 = self.0.map(|sum| (sum & 0xff) + (sum >> 8));
    }

    #[inline(always)]
    fn write(&self, to: &mut [u8]) {
        to.iter_mut().zip(self.0).for_each(|(to, sum)| *to = folded(sum as u32));
    }
}

/// For registers of 32 bits: every second byte of a word in one, the others in another.
struct Words<const W: usize> {
    even: [u32; W],
    odd: [u32; W],
}

impl<const W: usize> Lanes for Words<W> {
    const ZERO: Self = Self { even: [0; W], odd: [0; W] };
    const BYTES: usize = 4 * W;

    #[inline(always)]
    fn add(&mut self, from: &[u8]) {
        let Some(words) = from.as_chunks::<4>().0.first_chunk::<W>() else { return };
        for ((even, odd), word) in self.even.iter_mut().zip(&mut self.odd).zip(words) {
            let word = u32::from_le_bytes(*word);
            *even = even.wrapping_add(word & EVEN);
            *odd = odd.wrapping_add(word >> 8 & EVEN);
        }
    }

    #[inline(always)]
    fn fold(&mut self) {
        let fold = |sums: u32| (sums & EVEN) + (sums >> 8 & EVEN);
        (self.even, self.odd) = (self.even.map(fold), self.odd.map(fold));
    }

    #[inline(always)]
    fn write(&self, to: &mut [u8]) {
        let bytes = (0..W).flat_map(|k| [self.even[k], self.odd[k], self.even[k] >> 16, self.odd[k] >> 16]);
        to.iter_mut().zip(bytes).for_each(|(to, sum)| *to = folded(sum & 0xffff));
    }
}

/// Returns a number below 2^24 modulo 255, as 0 to 255.
#[inline(always)]
const fn folded(sum: u32) -> u8 {
    let sum = (sum & 0xff) + (sum >> 8 & 0xff) + (sum >> 16);
    let sum = (sum & 0xff) + (sum >> 8);
    ((sum & 0xff) + (sum >> 8)) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::kernels::ACCUMULATORS;
    use crate::nn::tests::Random;

    #[test]
    fn a_sum_of_patches_is_that_of_their_bytes() {
        let mut random = Random::new(7);
        for _ in 0..3000 {
            let r = &mut random;
            let mut few_or_many = |many| if r.one_in(2) { r.size(1, 9) } else { r.size(1, many) };
            let (stride, groups, count, start) = (few_or_many(70), few_or_many(150), few_or_many(700), few_or_many(9));
            let high = r.one_in(3);
            let len = start + (count - 1) * stride + 4 * groups;
            let bytes: Vec<u8> = r.bytes(len).into_iter().map(|code| if high { code | 0xf0 } else { code }).collect();
            let row = PatchRow { start, stride, count, groups, outside: None };
            let first = 4 * r.size(0, groups - 1);
            for by in [PatchRow::sum_by::<Wide>, PatchRow::sum_by::<Words<4>>] {
                let mut sums = vec![0; 4 * groups - first];
                by(&row, &bytes, first, &mut sums);
                for (j, sum) in sums.iter().enumerate() {
                    let expected: u32 = (0..count).map(|p| bytes[start + p * stride + first + j] as u32).sum();
                    assert_eq!(expected % 255, *sum as u32 % 255, "byte {j} of {row:?}");
                }
            }
        }
    }

    #[test]
    fn every_flipped_bit_of_a_sum_shows() {
        let mut random = Random::new(8);
        let mut acc = [0; ACCUMULATORS];
        acc.iter_mut().for_each(|sum| *sum = random.within(-1 << 26, 1 << 26) as i32);
        for width in [8, 16, 32] {
            let witness = Witness::new(&acc);
            let more = panel_sums(&acc, 10, width);
            let rest: Vec<i32> = more.iter().zip(&acc).map(|(all, first)| all - first).collect();
            let holds = |acc: &Accumulators| {
                let mut witness = witness;
                witness.leave_out(&rest);
                witness.note(&panel_sums(acc, 10, width), &[0; PANEL]);
                witness.holds(width)
            };
            assert!(holds(&acc));
            for bit in 0..32 * 10 * width {
                let mut acc = acc;
                acc[bit / 32] ^= 1 << (bit % 32);
                assert!(!holds(&acc), "bit {bit} of width {width}");
            }
        }
    }
}
