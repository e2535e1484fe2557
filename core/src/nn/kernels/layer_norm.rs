//! Layer norm over channels in integers, for some pixels of a row.
//!
//! With S = Σx, Q = Σx² over the C channels of a pixel (x in code steps): C·Q − S² is C² times the variance, exact in i64, and d = C·x − S
//! is C times the distance from the mean. So y = d / √(C·Q − S² + C²ε) needs no division by C.

use crate::nn::arena::Row;
use crate::nn::tensor::Tensor;
use crate::part::{head, head_mut, part};
use crate::quant::limit::limit_wide;
use crate::quant::rsqrt::ReciprocalRoot;

/// Number of channels on the stack at a time, and number of pixels that share their gains.
const BLOCK: usize = 64;
pub(crate) const PIXELS: usize = 16;
/// Channels in the innermost loop. It is a constant, so that the compiler can use vectors of any length.
const LANES: usize = 8;

/// One output row.
pub(crate) struct Job<'a> {
    pub(crate) input: &'a Tensor,
    pub(crate) out: &'a Tensor,
    /// 1, or 2 to gather 2x2 neighbours first.
    pub(crate) merge: usize,
    /// Little-endian i32 `[channels]`.
    pub(crate) gains: &'a [u8],
    /// Little-endian i64 `[channels]`.
    pub(crate) biases: &'a [u8],
    /// Right shift after gain and bias.
    pub(crate) shift: u32,
    /// C²ε.
    pub(crate) epsilon: i64,
    /// The input rows of the pixels' upper and lower half; both are the same row without merging.
    pub(crate) rows: [Row; 2],
    pub(crate) to: Row,
}

impl Job<'_> {
    /// Reads the channels from `first` on that belong to one input pixel and fit into a block; the rest of `x` is 0. Order 00, 10, 01, 11:
    /// rows fastest, as in the reference.
    #[inline(always)]
    fn load(&self, bytes: &[u8], col: usize, first: usize, x: &mut [i32; BLOCK]) -> usize {
        let (m, channels) = (self.merge.max(1), self.input.channels.max(1));
        let (place, channel) = (first / channels, first % channels);
        let count = (channels - channel).min(BLOCK);
        let from = (col * m + place / m) * channels + channel;
        let [upper, lower] = &self.rows;
        if place % m == 0 { upper } else { lower }.values(bytes, from, head_mut(x, count));
        count
    }

    /// Returns S and 1/√(V + C²ε) of a pixel.
    #[inline(always)]
    fn statistics(&self, bytes: &[u8], col: usize) -> (i64, ReciprocalRoot) {
        let (mut sums, mut squares) = ([0i32; LANES], [0i64; LANES]);
        let mut done = 0;
        while done < self.out.channels {
            let mut x = [0i32; BLOCK];
            let count = self.load(bytes, col, done, &mut x);
            for group in 0..BLOCK / LANES {
                if group * LANES >= count {
                    break;
                }
                for k in 0..LANES {
                    let x = x[group * LANES + k];
                    sums[k] += x;
                    squares[k] += x as i64 * x as i64;
                }
            }
            done += count;
        }
        let (mut sum, mut square) = (0i64, 0i64);
        for k in 0..LANES {
            sum += sums[k] as i64;
            square += squares[k];
        }
        let variance = self.out.channels as i64 * square - sum * sum;
        (sum, ReciprocalRoot::of(variance + self.epsilon))
    }

    /// The portable version of [`super::Isa::layer_norm`].
    #[inline(always)]
    pub(crate) fn portable(&self, bytes: &mut [u8], col: usize, pixels: usize) -> u64 {
        let channels = self.out.channels;
        let mut statistics = [(0, ReciprocalRoot::of(1)); PIXELS];
        for (p, statistics) in statistics.iter_mut().take(pixels).enumerate() {
            *statistics = self.statistics(bytes, col + p);
        }
        let mut cut = 0;
        let mut done = 0;
        while done < channels {
            let count = (self.input.channels - done % self.input.channels.max(1)).clamp(1, BLOCK);
            let (mut gains, mut biases) = ([0i32; BLOCK], [0i64; BLOCK]);
            let list = part(self.gains, 4 * done, 4 * count).as_chunks::<4>().0;
            for (gain, &b) in gains.iter_mut().zip(list) {
                *gain = i32::from_le_bytes(b);
            }
            let list = part(self.biases, 8 * done, 8 * count).as_chunks::<8>().0;
            for (bias, &b) in biases.iter_mut().zip(list) {
                *bias = i64::from_le_bytes(b);
            }
            for (p, (sum, root)) in statistics.iter().take(pixels).enumerate() {
                let (mut x, mut codes) = ([0i32; BLOCK], [0i32; BLOCK]);
                self.load(bytes, col + p, done, &mut x);
                cut += self.scale(&x, (*sum, *root), (&gains, &biases), &mut codes, count);
                self.to.store(bytes, (col + p) * channels + done, head(&codes, count));
            }
            done += count;
        }
        cut
    }

    #[inline(always)]
    #[expect(clippy::needless_range_loop, reason = "iterators over four lists at once hide the constant bounds")]
    fn scale(
        &self,
        x: &[i32; BLOCK],
        (sum, root): (i64, ReciprocalRoot),
        (gains, biases): (&[i32; BLOCK], &[i64; BLOCK]),
        codes: &mut [i32; BLOCK],
        count: usize,
    ) -> u64 {
        let (out, shift) = (self.out, self.shift & 63);
        let half = 1i64 << (self.shift.max(1) - 1);
        let (zero, lo, hi) = (out.zero as i64, out.lo as i64, out.hi as i64);
        let floor = if out.lo == out.zero { i64::MIN } else { lo };
        let channels = out.channels as i32;
        let mut cuts = [0i64; LANES];
        // The compiler vectorises loops with constant bounds and without checks.
        for group in 0..BLOCK / LANES {
            if group * LANES >= count {
                break;
            }
            for k in 0..LANES {
                let at = group * LANES + k;
                // All factors fit into 32 bits: |d| < 2^29, |y| < 2^16 √C.
                let y = root.times((channels * x[at]) as i64 - sum) as i32;
                let v = ((y as i64 * gains[at] as i64 + biases[at] + half) >> shift) + zero;
                cuts[k] += (v > hi) as i64 + (v < floor) as i64;
                codes[at] = limit_wide(v, lo, hi) as i32;
            }
        }
        // Lanes beyond the last channel have gain and bias 0, so they are never cut.
        let mut cut = 0;
        for one in cuts {
            cut += one as u64;
        }
        cut
    }
}
