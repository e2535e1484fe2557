//! Work on a row of half a spectrum: some waves side by side, so that vectors hold them.

use super::share::{self, Power, Weights};
use super::{OCTAVES, Photoclinometry};
use crate::part::{copy, head, head_mut, put};

/// Number of waves that are computed together.
const TOGETHER: usize = 16;

/// Some waves of a row: wave numbers across, and the squares of whole wave numbers, radians per pixel.
struct Waves {
    across: [f32; TOGETHER],
    squares: [f32; TOGETHER],
}

impl Waves {
    /// Returns the waves from frequency `first` of `width` on in a row with the wave number `down`.
    #[inline(always)]
    fn from(first: usize, width: usize, down: f32) -> Self {
        let mut waves = Self { across: [0.0; TOGETHER], squares: [0.0; TOGETHER] };
        for i in 0..TOGETHER {
            let across = Photoclinometry::wave(first + i, width);
            (waves.across[i], waves.squares[i]) = (across, across * across + down * down);
        }
        waves
    }
}

/// What the gain of a wave depends on.
#[derive(Clone, Copy)]
pub(super) struct Gain<'a> {
    pub(super) direction: [f32; 2],
    pub(super) weights: &'a Weights,
    pub(super) scale: f32,
    pub(super) stiffness: f32,
}

impl Gain<'_> {
    /// Returns the gain of a wave from its wave number, that squared, and the weight of slopes.
    #[inline(always)]
    pub(super) fn of(&self, [across, down]: [f32; 2], square: f32, weight: f32) -> f32 {
        let [east, south] = self.direction;
        let along = east * across + south * down;
        self.scale * along / (along * along + weight * square + self.stiffness)
    }
}

/// Multiplies the waves of a row, without that of frequency 0, by -i and a gain ([`Photoclinometry::filter`]), or by 0 if they are removed. The row
/// has the wave number `down`, and `width` columns.
pub(super) fn filter(re: &mut [f32], im: &mut [f32], (down, width): (f32, usize), gain: Gain<'_>, is_removed: bool) {
    let lines = re.get_mut(1..).unwrap_or_default().chunks_mut(TOGETHER);
    let lines = lines.zip(im.get_mut(1..).unwrap_or_default().chunks_mut(TOGETHER));
    for (first, (re, im)) in (1..).step_by(TOGETHER).zip(lines) {
        let waves = Waves::from(first, width, down);
        let weights = gain.weights.of(&waves.squares);
        let mut gains = [0.0; TOGETHER];
        for i in 0..TOGETHER {
            let found = gain.of([waves.across[i], down], waves.squares[i], weights[i]);
            gains[i] = if is_removed { 0.0 } else { found };
        }
        for ((re, im), gain) in re.iter_mut().zip(im).zip(gains) {
            // Multiplication by -i.
            (*re, *im) = (*im * gain, -*re * gain);
        }
    }
}

/// Adds the power of a row's waves, without that of frequency 0, to their octaves, one after the other. The row has the wave number `down`, and
/// `width` columns.
pub(super) fn power(re: &[f32], im: &[f32], (down, width): (f32, usize), octaves: &mut [Power; OCTAVES]) {
    let (a, last_a) = re.get(1..).unwrap_or_default().as_chunks::<TOGETHER>();
    let (b, last_b) = im.get(1..).unwrap_or_default().as_chunks::<TOGETHER>();
    // The last waves, with zeros behind them.
    let mut last = [[0.0; TOGETHER]; 2];
    for (to, from) in last.iter_mut().zip([last_a, last_b]) {
        copy(head_mut(to, from.len()), from);
    }
    let [a_end, b_end] = &last;
    let lines = a.iter().zip(b).map(|(a, b)| (a, b, TOGETHER));
    let lines = lines.chain(core::iter::once((a_end, b_end, last_a.len())));
    // The octave that the waves are in, and its sums: neighbours are mostly in one.
    let (mut at, mut sums) = (0, octaves[0]);
    for (first, (a, b, count)) in (1..).step_by(TOGETHER).zip(lines) {
        let waves = Waves::from(first, width, down);
        let mut octave = [0; TOGETHER];
        let [mut total, mut cos, mut sin] = [[0.0; TOGETHER]; 3];
        for i in 0..TOGETHER {
            let (power, across, square) = (a[i] * a[i] + b[i] * b[i], waves.across[i], waves.squares[i]);
            octave[i] = share::octave(square);
            total[i] = power;
            cos[i] = power * ((across * across - down * down) / square);
            sin[i] = power * (2.0 * across * down / square);
        }
        for (i, &octave) in head(&octave, count).iter().enumerate() {
            if octave != at {
                put(octaves, at, sums);
                (at, sums) = (octave, octaves.get(octave).copied().unwrap_or_default());
            }
            sums.add(total[i], cos[i], sin[i]);
        }
    }
    put(octaves, at, sums);
}
