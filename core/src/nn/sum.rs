//! A quick checksum for frequent checks: rows of the arena at every read, records of the program, the model after every tile.
//!
//! ```text
//! 16 lanes of u32, word i of the bytes (little-endian, the last one filled up with zeros) belongs to lane i mod 16
//!     lane = rotate(lane, 1) + word
//! seal of the lanes and the length:   for every word:  h = (h ^ word) * K;  h = h ^ (h >> 15)
//! ```
//! Every step is invertible, so every change within 64 bytes is detected. Of changes in two places about one in 2,000 is missed: both must
//! be in one lane, and their distance in bits must equal their distance in blocks. The checksum does not protect against intent. For
//! transfers the file has CRC32C.

/// Number of words side by side: four vectors of SSE, one of AVX-512.
const LANES: usize = 16;
/// An odd number with well mixed bits: 2^32 over the golden ratio.
const K: u32 = 0x9e37_79b1;

/// Returns the checksum of a row or a chunk.
#[inline(always)]
pub(crate) fn sum(bytes: &[u8]) -> u32 {
    let mut lanes = [0u32; LANES];
    let (blocks, rest) = bytes.as_chunks::<{ 4 * LANES }>();
    for block in blocks {
        add(&mut lanes, block);
    }
    if !rest.is_empty() {
        let mut block = [0; 4 * LANES];
        block.iter_mut().zip(rest).for_each(|(to, from)| *to = *from);
        add(&mut lanes, &block);
    }
    seal(lanes.into_iter().chain([bytes.len() as u32]))
}

/// Returns the checksum of floats: that of their bytes, the low ones first, so it does not depend on the processor.
pub(crate) fn sum_floats(values: &[f32]) -> u32 {
    let mut lanes = [0u32; LANES];
    let (blocks, rest) = values.as_chunks::<LANES>();
    let mut last = [0.0; LANES];
    last.iter_mut().zip(rest).for_each(|(to, from)| *to = *from);
    for block in blocks.iter().chain(if rest.is_empty() { None } else { Some(&last) }) {
        for (lane, value) in lanes.iter_mut().zip(block) {
            *lane = lane.rotate_left(1).wrapping_add(value.to_bits());
        }
    }
    seal(lanes.into_iter().chain([4 * values.len() as u32]))
}

#[inline(always)]
fn add(lanes: &mut [u32; LANES], block: &[u8; 4 * LANES]) {
    for (lane, word) in lanes.iter_mut().zip(block.as_chunks::<4>().0) {
        *lane = lane.rotate_left(1).wrapping_add(u32::from_le_bytes(*word));
    }
}

/// Returns the checksum of a few words.
#[inline]
pub(crate) fn seal(words: impl IntoIterator<Item = u32>) -> u32 {
    words.into_iter().fold(K, |h, word| {
        let h = (h ^ word).wrapping_mul(K);
        h ^ (h >> 15)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn bytes(len: usize, fill: u8) -> Vec<u8> {
        (0..len).map(|i| (i as u8).wrapping_mul(fill)).collect()
    }

    fn flip(bytes: &mut [u8], bit: usize) {
        bytes[bit / 8] ^= 1 << (bit % 8);
    }

    #[test]
    fn hardly_any_pair_far_apart_is_missed() {
        let (mut bytes, mut missed, mut pairs) = (bytes(640, 77), 0, 0);
        let before = sum(&bytes);
        for first in (0..5120).step_by(37) {
            for second in (first + 1..5120).step_by(23) {
                [first, second].into_iter().for_each(|bit| flip(&mut bytes, bit));
                (missed, pairs) = (missed + (sum(&bytes) == before) as usize, pairs + 1);
                [first, second].into_iter().for_each(|bit| flip(&mut bytes, bit));
            }
        }
        assert!(1000 * missed < pairs, "{missed} of {pairs}");
    }

    proptest! {
        #[test]
        fn every_flipped_bit_and_every_close_pair_shows(len in 1usize..300, fill: u8, first in 0usize..2400, gap in 1usize..64) {
            let mut bytes = bytes(len, fill);
            let before = sum(&bytes);
            let first = first % (8 * len);
            flip(&mut bytes, first);
            prop_assert_ne!(sum(&bytes), before);
            if first + gap < 8 * len {
                flip(&mut bytes, first + gap);
                prop_assert_ne!(sum(&bytes), before);
            }
        }

        #[test]
        fn floats_are_their_bytes(values in proptest::collection::vec(any::<f32>(), 0..99)) {
            let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            prop_assert_eq!(sum_floats(&values), sum(&bytes));
        }

        #[test]
        fn length_counts(len in 0usize..300) {
            let zeros = vec![0; len + 1];
            prop_assert_ne!(sum(&zeros), sum(&zeros[..len]));
        }
    }
}
