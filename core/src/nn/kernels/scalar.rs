//! The specification of the matrix product, in registers' worth of portable Rust.

use super::{Accumulators, Isa, Patch};

/// Name of this kernel by the rule `{isa}-{types}-{variant}`.
pub(super) const NAME: &str = "scalar-u8i8-4x2";

/// Plain Rust.
pub(super) struct Scalar;

/// Pixels and channels whose sums are kept in registers.
const PIXELS: usize = 4;
const CHANNELS: usize = 2;

impl Isa for Scalar {
    #[inline(always)]
    fn gemm(acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        if !patch.fits(pixels, weights, width) {
            return;
        }
        let mut first = 0;
        while first < pixels {
            let count = (pixels - first).min(PIXELS);
            let mut channel = 0;
            while channel < width {
                if count == PIXELS {
                    block::<PIXELS>(acc, first, channel, patch, weights, width);
                } else {
                    (first..first + count).for_each(|p| block::<1>(acc, p, channel, patch, weights, width));
                }
                channel += CHANNELS;
            }
            first += count;
        }
    }
}

/// `P` pixels from `first` on against [`CHANNELS`] channels from `channel` on.
#[inline(always)]
fn block<const P: usize>(
    acc: &mut Accumulators,
    first: usize,
    channel: usize,
    patch: &Patch<'_>,
    weights: &[u8],
    width: usize,
) {
    let mut sums = [[0i32; CHANNELS]; P];
    let (bytes, len) = (patch.bytes, 4 * patch.groups);
    for (&start, weights) in patch.starts.iter().zip(weights.chunks_exact(len * width)) {
        let start = start + first * patch.stride;
        let rows: [&[u8]; P] = core::array::from_fn(|p| &bytes[start + p * patch.stride..][..len]);
        for (g, weights) in weights.chunks_exact(4 * width).enumerate() {
            let w = &weights[4 * channel..][..4 * CHANNELS];
            for b in 0..4 {
                for p in 0..P {
                    let x = rows[p][4 * g + b] as i32;
                    for c in 0..CHANNELS {
                        sums[p][c] = sums[p][c].wrapping_add(x * (w[4 * c + b] as i8) as i32);
                    }
                }
            }
        }
    }
    for (p, sums) in sums.iter().enumerate() {
        for (c, sum) in sums.iter().enumerate() {
            let at = &mut acc[(first + p) * width + channel + c];
            *at = at.wrapping_add(*sum);
        }
    }
}
