//! Fourier transforms in place, without a second buffer: forward by decimation in frequency, backward by decimation in time, so that no
//! reordering is needed. Between the two, frequency k is at [`Order::place`].
//!
//! Lengths are products of 2, 3, 4 and 5. No crate without heap and std supports such lengths (powers of two would make a tile's field half
//! as large again).

use crate::part::{few, head, item, put_few};
use core::f64::consts::TAU;

/// Largest number of factors of a length.
const MAX_FACTORS: usize = 16;

/// A length and its factors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Order {
    len: usize,
    factors: [u8; MAX_FACTORS],
    count: usize,
}

impl Order {
    /// Returns the order of the smallest even length that is at least `len` and a product of 2, 3, 4 and 5.
    pub(super) fn at_least(len: usize) -> Self {
        let mut even = len.max(2).next_multiple_of(2);
        loop {
            if let Some(order) = Self::of(even) {
                return order;
            }
            even += 2;
        }
    }

    fn of(len: usize) -> Option<Self> {
        let (mut rest, mut factors, mut count) = (len, [1; MAX_FACTORS], 0);
        for factor in [4, 2, 3, 5] {
            while rest.is_multiple_of(factor) && rest > 1 {
                *factors.get_mut(count)? = factor as u8;
                (rest, count) = (rest / factor, count + 1);
            }
        }
        (rest == 1).then_some(Self { len, factors, count })
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Returns the index of frequency `k` after the forward transform.
    pub(super) fn place(&self, k: usize) -> usize {
        let (mut rest, mut span, mut place) = (k, self.len, 0);
        for &factor in head(&self.factors, self.count) {
            // By constants, because processors divide slowly by other numbers.
            let digit;
            (rest, digit, span) = match factor {
                2 => (rest / 2, rest % 2, span / 2),
                3 => (rest / 3, rest % 3, span / 3),
                4 => (rest / 4, rest % 4, span / 4),
                _ => (rest / 5, rest % 5, span / 5),
            };
            place += digit * span;
        }
        place
    }

    /// Fills `table`, two values per entry, with exp(-2 pi i k / len).
    pub(super) fn roots(&self, table: &mut [f32]) {
        for (k, root) in table.as_chunks_mut::<2>().0.iter_mut().enumerate() {
            let angle = -TAU * k as f64 / self.len as f64;
            *root = [libm::cos(angle) as f32, libm::sin(angle) as f32];
        }
    }
}

/// The places of the complex numbers of one or several transforms side by side in a field: number i of transform l has its real part at
/// `re + i * stride + l` and its imaginary part at `im + i * stride + l`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lanes {
    pub(super) re: usize,
    pub(super) im: usize,
    pub(super) stride: usize,
    pub(super) count: usize,
}

/// Direction of a transform. The backward transform is not divided by the length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    Forward,
    Backward,
}

/// Transforms all lanes. `roots` is the table from [`Order::roots`].
pub(super) fn transform(field: &mut [f32], order: &Order, roots: &[f32], lanes: Lanes, way: Way) {
    let factors = head(&order.factors, order.count);
    let mut span = order.len;
    if way == Way::Forward {
        for &factor in factors {
            stage(field, order.len, factor as usize, span, roots, lanes, way);
            span /= (factor as usize).max(1);
        }
    } else {
        span = 1;
        for &factor in factors.iter().rev() {
            span *= factor as usize;
            stage(field, order.len, factor as usize, span, roots, lanes, way);
        }
    }
}

/// Computes all butterflies of one factor: blocks of `span` numbers, each cut into `factor` parts.
fn stage(field: &mut [f32], len: usize, factor: usize, span: usize, roots: &[f32], lanes: Lanes, way: Way) {
    let (factor, span, len) = (factor.max(1), span.max(1), len.max(1));
    let (part, turns) = (span / factor, len / span);
    let sign = if way == Way::Forward { 1.0 } else { -1.0 };
    for j in 0..part {
        // Rotations of the parts. j p < span, so no root is beyond the table. Entries beyond `factor` are not read.
        let twiddles: [[f32; 2]; MAX_FACTOR] = core::array::from_fn(|p| {
            let at = 2 * j * p.min(factor - 1) * turns;
            [item(roots, at), sign * item(roots, at + 1)]
        });
        for block in (0..len).step_by(span) {
            let first = block + j;
            match factor {
                2 => butterflies::<2>(field, lanes, first, part, &twiddles, way),
                3 => butterflies::<3>(field, lanes, first, part, &twiddles, way),
                4 => butterflies::<4>(field, lanes, first, part, &twiddles, way),
                _ => butterflies::<5>(field, lanes, first, part, &twiddles, way),
            }
        }
    }
}

/// Largest factor of a length.
const MAX_FACTOR: usize = 5;
/// Number of lanes that are computed together.
pub(super) const GROUP: usize = 8;

/// Computes one butterfly of every lane.
fn butterflies<const F: usize>(
    field: &mut [f32],
    lanes: Lanes,
    first: usize,
    part: usize,
    twiddles: &[[f32; 2]; MAX_FACTOR],
    way: Way,
) {
    let mut lane = 0;
    while lane < lanes.count {
        let at: [usize; F] = core::array::from_fn(|p| (first + p * part) * lanes.stride + lane);
        if lanes.count - lane >= GROUP {
            butterfly::<F, GROUP>(field, lanes, at, twiddles, way);
            lane += GROUP;
        } else {
            butterfly::<F, 1>(field, lanes, at, twiddles, way);
            lane += 1;
        }
    }
}

fn butterfly<const F: usize, const G: usize>(
    field: &mut [f32],
    lanes: Lanes,
    at: [usize; F],
    twiddles: &[[f32; 2]; MAX_FACTOR],
    way: Way,
) {
    let mut z = [([0.0f32; G], [0.0f32; G]); F];
    for p in 0..F {
        z[p] = (few(field, lanes.re + at[p]), few(field, lanes.im + at[p]));
        if way == Way::Backward && p > 0 {
            z[p] = turned(z[p], twiddles[p]);
        }
    }
    short_transform(&mut z, way);
    for p in 0..F {
        if way == Way::Forward && p > 0 {
            z[p] = turned(z[p], twiddles[p]);
        }
        put_few(field, lanes.re + at[p], z[p].0);
        put_few(field, lanes.im + at[p], z[p].1);
    }
}

/// Complex numbers of several lanes: real and imaginary parts.
type Numbers<const G: usize> = ([f32; G], [f32; G]);

/// Transforms two to five numbers.
fn short_transform<const G: usize>(z: &mut [Numbers<G>], way: Way) {
    // cos and sin of one fifth and of two fifths of a turn.
    const C: [f32; 2] = [0.309_017, -0.809_017];
    const S: [f32; 2] = [0.951_056_5, 0.587_785_25];
    match z {
        [a, b] => (*a, *b) = (sum(*a, *b), difference(*a, *b)),
        [a, b, c] => {
            let (both, apart) = (sum(*b, *c), scaled(difference(*b, *c), 0.866_025_4));
            let (middle, aside) = (sum(*a, scaled(both, -0.5)), quarter(apart, way));
            (*a, *b, *c) = (sum(*a, both), sum(middle, aside), difference(middle, aside));
        }
        [a, b, c, d] => {
            let (even, odd) = ((sum(*a, *c), difference(*a, *c)), (sum(*b, *d), quarter(difference(*b, *d), way)));
            (*a, *b) = (sum(even.0, odd.0), sum(even.1, odd.1));
            (*c, *d) = (difference(even.0, odd.0), difference(even.1, odd.1));
        }
        [a, b, c, d, e] => {
            let (near, far) = ((sum(*b, *e), difference(*b, *e)), (sum(*c, *d), difference(*c, *d)));
            let level = |p: f32, q: f32| sum(*a, sum(scaled(near.0, p), scaled(far.0, q)));
            let aside = |p: f32, q: f32| quarter(sum(scaled(near.1, p), scaled(far.1, q)), way);
            let (one, two) = ((level(C[0], C[1]), aside(S[0], S[1])), (level(C[1], C[0]), aside(S[1], -S[0])));
            *a = sum(*a, sum(near.0, far.0));
            (*b, *e) = (sum(one.0, one.1), difference(one.0, one.1));
            (*c, *d) = (sum(two.0, two.1), difference(two.0, two.1));
        }
        _ => {}
    }
}

fn sum<const G: usize>(a: Numbers<G>, b: Numbers<G>) -> Numbers<G> {
    (core::array::from_fn(|g| a.0[g] + b.0[g]), core::array::from_fn(|g| a.1[g] + b.1[g]))
}

fn difference<const G: usize>(a: Numbers<G>, b: Numbers<G>) -> Numbers<G> {
    (core::array::from_fn(|g| a.0[g] - b.0[g]), core::array::from_fn(|g| a.1[g] - b.1[g]))
}

fn scaled<const G: usize>(a: Numbers<G>, by: f32) -> Numbers<G> {
    (a.0.map(|v| v * by), a.1.map(|v| v * by))
}

/// Rotates by a quarter of a turn: multiplies by -i forward, by i backward.
fn quarter<const G: usize>(a: Numbers<G>, way: Way) -> Numbers<G> {
    match way {
        Way::Forward => (a.1, a.0.map(|v| -v)),
        Way::Backward => (a.1.map(|v| -v), a.0),
    }
}

/// Multiplies by c + i s.
fn turned<const G: usize>(a: Numbers<G>, [c, s]: [f32; 2]) -> Numbers<G> {
    (core::array::from_fn(|g| a.0[g] * c - a.1[g] * s), core::array::from_fn(|g| a.0[g] * s + a.1[g] * c))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(n: usize) -> Vec<f32> {
        (0..n as u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 23) as f32 - 1.0).collect()
    }

    /// Returns frequency k by definition, in double precision.
    fn naive(re: &[f32], im: &[f32], k: usize) -> [f64; 2] {
        let n = re.len();
        let term = |j: usize| {
            let (sin, cos) = (-TAU * (j * k % n) as f64 / n as f64).sin_cos();
            let (x, y) = (f64::from(re[j]), f64::from(im[j]));
            [x * cos - y * sin, x * sin + y * cos]
        };
        (0..n).map(term).fold([0.0; 2], |[a, b], [x, y]| [a + x, b + y])
    }

    #[test]
    fn every_factor_transforms_as_defined_and_back() {
        for (len, lanes) in [(2, 1), (6, 3), (20, 1), (24, 11), (30, 8), (320, 9), (384, 1)] {
            let order = Order::of(len).unwrap();
            let mut roots = vec![0.0; 2 * len];
            order.roots(&mut roots);
            let input = noise(2 * len * lanes);
            let mut field = input.clone();
            let layout = Lanes { re: 0, im: lanes, stride: 2 * lanes, count: lanes };
            let column = |field: &[f32], start: usize, lane: usize| -> Vec<f32> {
                (0..len).map(|i| field[i * 2 * lanes + start + lane]).collect()
            };
            transform(&mut field, &order, &roots, layout, Way::Forward);
            for lane in [0, lanes - 1] {
                let (re, im) = (column(&input, 0, lane), column(&input, lanes, lane));
                for k in 0..len {
                    let expected = naive(&re, &im, k);
                    let at = order.place(k) * 2 * lanes + lane;
                    let found = [field[at], field[at + lanes]].map(f64::from);
                    let error = (found[0] - expected[0]).abs().max((found[1] - expected[1]).abs());
                    assert!(error < 2e-5 * (len as f64).sqrt(), "{len}, {k}: {error}");
                }
            }
            transform(&mut field, &order, &roots, layout, Way::Backward);
            for (found, expected) in field.iter().zip(&input) {
                assert!((found / len as f32 - expected).abs() < 1e-5, "{len}");
            }
        }
    }

    #[test]
    fn lengths_are_rounded_up_to_what_factors() {
        let len = |n| Order::at_least(n).len();
        assert_eq!([len(0), len(7), len(304), len(368), len(77)], [2, 8, 320, 384, 80]);
    }

    #[test]
    fn places_are_a_permutation() {
        let order = Order::of(360).unwrap();
        let mut places: Vec<usize> = (0..360).map(|k| order.place(k)).collect();
        places.sort_unstable();
        assert!(places.iter().copied().eq(0..360));
    }
}
