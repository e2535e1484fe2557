//! Damaged files.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// Damages a file in one to three places: a byte changed, the end cut off, a piece removed or doubled, or one of `pieces` inserted. Pieces
/// with a meaning in the format test more than random bytes do.
pub fn mutate(bytes: &mut Vec<u8>, pieces: &[&str], rng: &mut ChaCha8Rng) {
    for _ in 0..rng.random_range(1..4) {
        let at = rng.random_range(0..=bytes.len());
        let end = (at + rng.random_range(0..12)).min(bytes.len());
        match rng.random_range(0..5) {
            0 if at < bytes.len() => bytes[at] = rng.random(),
            1 => bytes.truncate(at),
            2 => drop(bytes.drain(at..end)),
            3 => drop(bytes.splice(at..at, pieces[rng.random_range(0..pieces.len())].bytes())),
            _ => {
                let copy = bytes[at..end].to_vec();
                drop(bytes.splice(at..at, copy));
            }
        }
    }
}
