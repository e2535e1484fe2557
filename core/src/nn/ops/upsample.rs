//! Bilinear upsampling: two output rows from three input rows.

use super::Prepared;
use crate::nn::arena::{Arena, high, join};
use crate::nn::tensor::{Dtype, Tensor};
use crate::part::{item, put};

/// Runs step `step`: output rows 2 step and 2 step + 1.
#[inline(always)]
pub(crate) fn run(prepared: &Prepared, arena: &mut Arena<'_>, step: usize) -> u64 {
    let (input, out) = (prepared.input(0), prepared.out);
    for odd in 0..2 {
        let (near, far) = taps(2 * step + odd, input.rows);
        for col in 0..out.cols {
            let (left, right) = taps(col, input.cols);
            pixel(arena, (&input, near, far), (left, right), (&out, 2 * step + odd, col));
        }
        arena.fill_margins(&out, 2 * step + odd);
    }
    0
}

/// Computes one output pixel: 9/16 of the nearest sample, 3/16 of each of its two neighbours, 1/16 of the diagonal one.
#[inline(always)]
fn pixel(
    arena: &mut Arena<'_>,
    (input, near, far): (&Tensor, usize, usize),
    (left, right): (usize, usize),
    (out, row, col): (&Tensor, usize, usize),
) {
    let at = |row: usize, col: usize| input.row_offset(row) + (input.margin + col) * input.channels;
    let (a, b, c, d) = (at(near, left), at(near, right), at(far, left), at(far, right));
    let (plane, to) = (input.plane_bytes(), out.row_offset(row) + (out.margin + col) * out.channels);
    let mix = |a: i32, b: i32, c: i32, d: i32| (9 * a + 3 * (b + c) + d + 8) >> 4;
    for k in 0..input.channels {
        if input.dtype == Dtype::U8 {
            let x = |at: usize| item(arena.bytes, at + k) as i32;
            let code = mix(x(a), x(b), x(c), x(d)) as u8;
            put(arena.bytes, to + k, code);
        } else {
            let x = |at: usize| join(item(arena.bytes, at + k), item(arena.bytes, at + plane + k));
            let code = mix(x(a), x(b), x(c), x(d));
            put(arena.bytes, to + k, code as u8);
            put(arena.bytes, to + out.plane_bytes() + k, high(code));
        }
    }
}

/// Returns the two input samples of output `index`, for twofold bilinear upsampling with half-pixel centres: 3/4 of the first and 1/4 of
/// the second. Beyond the border the border sample repeats.
#[inline(always)]
fn taps(index: usize, len: usize) -> (usize, usize) {
    let near = index / 2;
    let far = if index.is_multiple_of(2) { near.saturating_sub(1) } else { (near + 1).min(len - 1) };
    (near, far)
}

#[cfg(test)]
mod tests {
    use super::taps;

    #[test]
    fn bilinear_taps_are_those_of_half_pixel_centres() {
        for len in 1..6 {
            for index in 0..2 * len {
                let centre = ((index as f64 + 0.5) / 2.0 - 0.5).clamp(0.0, (len - 1) as f64);
                let (near, far) = taps(index, len);
                assert_eq!(0.75 * near as f64 + 0.25 * far as f64, centre, "output {index} of {len}");
            }
        }
    }
}
