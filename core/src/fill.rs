//! Filling of voids, so that the network sees plausible ground everywhere. The result is masked again afterwards (our choice; the paper
//! does not mention voids).

use crate::error::{LengthError, same_length};
use crate::part::{head_mut, item, put};
use crate::words::Words;

/// Fills every invalid (not finite) sample of a row-major map, `cols` wide, with the value of the nearest valid sample. Distance is counted
/// in steps over 4 neighbours; of samples at the same distance, the first in reading order counts. Without a valid sample nothing changes.
/// `queue` is scratch memory of one value per sample; it keeps places as the bits of floats, so that any scratch memory serves.
///
/// ```
/// let gap = f32::NAN;
/// let mut samples = [1.0, gap, gap, gap, 5.0, gap, gap, gap, gap, 9.0];
/// elunar_core::fill::fill_gaps(&mut samples, 5, &mut [0.0; 10])?;
/// assert_eq!(samples, [1.0, 1.0, 1.0, 5.0, 5.0, 1.0, 1.0, 9.0, 9.0, 9.0]);
/// # Ok::<(), elunar_core::error::LengthError>(())
/// ```
///
/// # Errors
/// [`LengthError`] if the map does not consist of whole rows, or the queue is shorter than the map; nothing is changed then.
pub fn fill_gaps(samples: &mut [f32], cols: usize, queue: &mut [f32]) -> Result<(), LengthError> {
    let (len, found) = (samples.len(), queue.len());
    same_length(len - len.checked_rem(cols).unwrap_or(len), len)?;
    if found < len {
        return Err(LengthError { expected: len, found });
    }
    if samples.iter().any(|v| !v.is_finite()) {
        let mut fill = Fill::default();
        while !fill.advance(samples, cols, head_mut(queue, len), usize::MAX) {}
    }
    Ok(())
}

/// The position of [`fill_gaps`], which can be done in parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Fill {
    /// Number of samples seen.
    pub(crate) seen: usize,
    /// Number of places taken from the queue, and put there.
    pub(crate) next: usize,
    pub(crate) end: usize,
}

impl Fill {
    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        let Self { seen, next, end } = self;
        [seen, next, end].into_iter().for_each(|v| words.usize(v));
    }

    /// Looks at up to `most` samples; returns whether all is done. The map and the queue, as long as the map, are unchanged in between.
    pub(crate) fn advance(&mut self, samples: &mut [f32], cols: usize, queue: &mut [f32], most: usize) -> bool {
        // Only valid samples beside a void can spread. Each sample enters the queue once: here if it is valid, later if it is filled.
        let seen = self.seen.saturating_add(most).min(samples.len());
        for i in self.seen..seen {
            let gap = |n: usize| samples.get(n).is_some_and(|v| !v.is_finite());
            if !gap(i) && neighbours(i, cols).any(gap) {
                self.enqueue(queue, i);
            }
        }
        let more = most.saturating_sub(seen - self.seen);
        self.seen = seen;
        if seen < samples.len() {
            return false;
        }
        for _ in 0..more {
            if self.next >= self.end {
                break;
            }
            let i = item(queue, self.next).to_bits() as usize;
            let value = item(samples, i);
            for n in neighbours(i, cols) {
                if samples.get(n).is_some_and(|v| !v.is_finite()) {
                    put(samples, n, value);
                    self.enqueue(queue, n);
                }
            }
            self.next += 1;
        }
        self.next >= self.end
    }

    fn enqueue(&mut self, queue: &mut [f32], place: usize) {
        put(queue, self.end, f32::from_bits(place as u32));
        self.end += 1;
    }
}

/// Returns the neighbours of sample `i`, from top to bottom. Neighbours below the last row have an index beyond the map's end.
fn neighbours(i: usize, cols: usize) -> impl Iterator<Item = usize> {
    let cols = cols.max(1);
    let col = i % cols;
    let near =
        [i.checked_sub(cols), (col > 0).then(|| i.wrapping_sub(1)), (col + 1 < cols).then_some(i + 1), Some(i + cols)];
    near.into_iter().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Returns the distance of every sample to the nearest valid one, by definition over all pairs. Steps cross voids and valid samples
    /// alike, so voids do not change distances.
    fn naive(samples: &[f32], cols: usize) -> Vec<f32> {
        let apart = |a: usize, b: usize| (a / cols).abs_diff(b / cols) + (a % cols).abs_diff(b % cols);
        let nearest = |i: usize| (0..samples.len()).filter(|&n| samples[n].is_finite()).map(|n| apart(i, n)).min();
        (0..samples.len()).map(|i| nearest(i).map_or(f32::NAN, |d| d as f32)).collect()
    }

    proptest! {
        #[test]
        fn gaps_take_a_nearest_value(rows in 1_usize..8, cols in 1_usize..8, seed in any::<u64>(), share in 1_u64..100) {
            let mut state = seed;
            let mut next = || { state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407); state >> 33 };
            let before: Vec<f32> = (0..rows * cols).map(|i| if next() % 100 < share { f32::NAN } else { i as f32 }).collect();
            let mut after = before.clone();
            fill_gaps(&mut after, cols, &mut vec![7.0; rows * cols]).unwrap();
            let distance = naive(&before, cols);
            for i in 0..rows * cols {
                if distance[i].is_nan() {
                    prop_assert!(after[i].is_nan());
                    continue;
                }
                // The value is the index of the sample it was taken from.
                let from = after[i] as usize;
                let apart = (i / cols).abs_diff(from / cols) + (i % cols).abs_diff(from % cols);
                prop_assert!(before[from].is_finite() && apart as f32 == distance[i], "{} from {}", i, from);
            }
        }
    }

    #[test]
    fn short_queues_and_broken_rows_are_refused() {
        let mut samples = [1.0, f32::NAN, 3.0, 4.0];
        assert_eq!(fill_gaps(&mut samples, 2, &mut [0.0; 3]), Err(LengthError { expected: 4, found: 3 }));
        assert_eq!(fill_gaps(&mut samples, 3, &mut [0.0; 4]), Err(LengthError { expected: 3, found: 4 }));
        assert!(fill_gaps(&mut samples, 0, &mut [0.0; 4]).is_err());
        assert!(samples[1].is_nan());
        fill_gaps(&mut samples, 2, &mut [0.0; 4]).unwrap();
        assert_eq!(samples, [1.0, 1.0, 3.0, 4.0]);
        assert_eq!(fill_gaps(&mut [], 0, &mut []), Ok(()));
        let mut nothing = [f32::NAN; 4];
        fill_gaps(&mut nothing, 2, &mut [0.0; 4]).unwrap();
        assert!(nothing.iter().all(|v| v.is_nan()));
    }
}
