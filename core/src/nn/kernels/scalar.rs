//! The specification of the matrix product, in portable Rust with sums that fit into registers.
//!
//! ```text
//! sums of PIXELS x CHANNELS stay in registers
//! for every row r of the patch and every group g:
//!     for b in 0..4, every pixel p and channel c:
//!         sum[p][c] += x[starts[r] + p*stride + 4g + b] * w[r][g][c][b]
//! ```

use super::requantise::{Requantise, Target};
use super::{Accumulators, Isa, Patch};
use crate::part::part_mut;

/// Plain Rust.
#[derive(Default)]
pub(crate) struct Scalar;

/// Pixels and channels whose sums are kept in registers: 16 sums for 32 registers, 4 for ARM's 16, 32 for SSE.
const PIXELS: usize = if cfg!(target_arch = "arm") { 2 } else { 4 };
const CHANNELS: usize = match PIXELS {
    _ if VECTORS => 8,
    pixels => pixels,
};
/// Whether the compiler has SSE2's `pmaddwd` for [`by_neighbours`]; without it that order is slower.
const VECTORS: bool = cfg!(target_arch = "x86_64");

impl Isa for Scalar {
    const NAME: &str = match (PIXELS, CHANNELS) {
        (2, 2) => "scalar-u8i8-2x2",
        (4, 8) => "scalar-u8i8-4x8",
        _ => "scalar-u8i8-4x4",
    };

    #[inline(always)]
    fn gemm(&mut self, acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        product(acc, pixels, patch, weights, width);
    }

    #[inline(always)]
    fn requantise(requantise: &Requantise<'_>, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
        // The compiler vectorises the code for these two targets.
        if cfg!(any(target_arch = "x86_64", target_arch = "aarch64")) {
            requantise.portable(bytes, acc, target)
        } else {
            requantise.by_channels(bytes, acc, target)
        }
    }
}

/// Not inlined, because the convolutions and the attention use the same code.
#[inline(never)]
fn product(acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
    if !patch.fits(pixels, weights, width) {
        return;
    }
    for channel in (0..width).step_by(CHANNELS) {
        let mut first = 0;
        while first < pixels {
            first += if pixels - first >= PIXELS {
                block::<PIXELS>(acc, first, channel, patch, weights, width)
            } else {
                block::<1>(acc, first, channel, patch, weights, width)
            };
        }
    }
}

/// Computes `P` pixels from `first` on against [`CHANNELS`] channels from `channel` on.
#[inline(always)]
#[expect(clippy::needless_range_loop, reason = "lists of one known length side by side")]
fn block<const P: usize>(
    acc: &mut Accumulators,
    first: usize,
    channel: usize,
    patch: &Patch<'_>,
    weights: &[u8],
    width: usize,
) -> usize {
    let (stride, groups) = (patch.stride, patch.groups);
    let mut sums = [[0i32; CHANNELS]; P];
    let (mut weights, _) = weights.as_chunks::<4>();
    for &start in patch.starts {
        // Groups of four codes, in slices of one known length, so that the loop checks no bounds.
        let mut codes: [&[[u8; 4]]; P] = [&[]; P];
        for p in 0..P {
            let at = start + (first + p) * stride;
            match patch.bytes.get(at..).and_then(|bytes| bytes.as_chunks().0.get(..groups)) {
                Some(fours) => codes[p] = fours,
                None => return P,
            }
        }
        for g in 0..groups {
            let Some(w) = weights.get(g * width + channel..).and_then(|w| w.first_chunk::<CHANNELS>()) else {
                return P;
            };
            if VECTORS {
                for p in 0..P {
                    by_neighbours(&mut sums[p], codes[p][g], w);
                }
                continue;
            }
            for b in 0..4 {
                for p in 0..P {
                    for c in 0..CHANNELS {
                        sums[p][c] = sums[p][c].wrapping_add(codes[p][g][b] as i32 * (w[c][b] as i8) as i32);
                    }
                }
            }
        }
        weights = weights.get(groups * width..).unwrap_or_default();
    }
    for (p, sums) in sums.iter().enumerate() {
        for (at, sum) in part_mut(acc, (first + p) * width + channel, CHANNELS).iter_mut().zip(sums) {
            *at = at.wrapping_add(*sum);
        }
    }
    P
}

/// Adds a group's products of one pixel. Neighbours are added first, as the instruction for vectors of i16 does.
#[inline(always)]
fn by_neighbours(sums: &mut [i32; CHANNELS], x: [u8; 4], w: &[[u8; 4]; CHANNELS]) {
    let x = x.map(|x| x as i16 as i32);
    for (sum, w) in sums.iter_mut().zip(w) {
        let w = w.map(|w| w as i8 as i16 as i32);
        let (first, second) = (x[0] * w[0] + x[1] * w[1], x[2] * w[2] + x[3] * w[3]);
        *sum = sum.wrapping_add(first).wrapping_add(second);
    }
}
