//! Layer norm over channels in integers: one row of pixels.
//!
//! With S = Σx, Q = Σx² over the C channels of a pixel (x in code steps): C·Q − S² is C² times the variance, exact in i64, and
//! d = C·x − S is C times the distance from the mean. So y = d / √(C·Q − S² + C²ε), without any division by C.

use crate::nn::arena::{Arena, Row};
use crate::nn::model::Model;
use crate::nn::program::LayerNorm;
use crate::quant::rsqrt::ReciprocalRoot;

/// Channels held on the stack at a time.
const BLOCK: usize = 64;

/// Runs step `row`.
#[inline(always)]
pub(crate) fn run(model: &Model<'_>, norm: &LayerNorm, arena: &mut Arena<'_>, row: usize) -> u64 {
    let (input, out) = (model.tensor(norm.input), model.tensor(norm.out));
    let channels = out.channels;
    let gains = model.constants(norm.gains, 4 * channels).as_chunks::<4>().0;
    let biases = model.constants(norm.biases, 8 * channels).as_chunks::<8>().0;
    let half = 1i64 << (norm.shift.max(1) - 1);
    let (zero, lo, hi) = (out.zero as i64, out.lo as i64, out.hi as i64);
    let floor = if out.lo == out.zero { i64::MIN } else { lo };
    let m = norm.merge;
    let rows = [Row::of(&input, m * row), Row::of(&input, m * row + m - 1)];
    let to = Row::of(&out, row);
    // Channels from `first` on that lie in one input pixel and fit into a block. Order 00, 10, 01, 11: rows fastest, as in
    // the reference.
    let block = |bytes: &[u8], col: usize, first: usize, x: &mut [i32; BLOCK]| {
        let (place, channel) = (first / input.channels, first % input.channels);
        let count = (input.channels - channel).min(BLOCK);
        let from = (col * m + place / m) * input.channels + channel;
        rows[place % m].values(bytes, from, &mut x[..count]);
        count
    };
    let mut cut = 0;
    for col in 0..out.cols {
        let (mut sum, mut squares, mut done) = (0i64, 0i64, 0);
        while done < channels {
            let mut x = [0i32; BLOCK];
            done += block(arena.bytes, col, done, &mut x);
            let (mut part, mut part_squares) = (0i32, 0i64);
            for &x in &x {
                part += x;
                part_squares += (x * x) as i64;
            }
            (sum, squares) = (sum + part as i64, squares + part_squares);
        }
        let root = ReciprocalRoot::of(channels as i64 * squares - sum * sum + norm.epsilon);
        done = 0;
        while done < channels {
            let (mut x, mut codes) = ([0i32; BLOCK], [0i32; BLOCK]);
            let count = block(arena.bytes, col, done, &mut x);
            let (gains, biases) = (&gains[done..done + count], &biases[done..done + count]);
            let mut cuts = 0i64;
            for (((code, &x), &gain), &bias) in codes.iter_mut().zip(&x).zip(gains).zip(biases) {
                // Both factors fit into 32 bits: |d| < 2^29, |y| < 2^16 √C.
                let y = root.times((channels as i32 * x) as i64 - sum) as i32;
                let v = y as i64 * i32::from_le_bytes(gain) as i64 + i64::from_le_bytes(bias) + half;
                let v = (v >> (norm.shift & 63)) + zero;
                cuts += (v > hi) as i64 + (v < floor) as i64;
                *code = v.clamp(lo, hi) as i32;
            }
            to.store(arena.bytes, col * channels + done, &codes[..count]);
            (done, cut) = (done + count, cut + cuts as u64);
        }
    }
    arena.fill_margins(&out, row);
    cut
}
