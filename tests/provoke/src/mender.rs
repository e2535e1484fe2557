//! Changes of model files whose checksums are mended afterwards, for fuzzing beyond the checksums.

use crate::Random;
use crate::model::{changed, sections, sound_models};
use crate::programs::{Sizes, program};
use elunar_core::nn::file::{
    CHUNK_BYTES, CHUNK_RECORD_BYTES, HEADER_BYTES, MAGIC, VERSION, seal_file, set_word, u32_at, word,
};

/// Makes everything right that a validation checks before it looks at records: magic, version, length, number of chunks, checksums.
pub fn mend(bytes: &mut [u8]) {
    if bytes.len() < HEADER_BYTES {
        return;
    }
    // A chunk record belongs to each chunk of the body, so that a file of n bytes has as many chunks as this.
    let chunks = (bytes.len() - HEADER_BYTES).div_ceil(CHUNK_BYTES + CHUNK_RECORD_BYTES);
    bytes[..8].copy_from_slice(&MAGIC);
    let fields = [
        (word::VERSION, VERSION as usize),
        (word::FILE_BYTES, bytes.len()),
        (word::CHUNK_BYTES, CHUNK_BYTES),
        (word::CHUNKS, chunks),
    ];
    for (index, value) in fields {
        set_word(bytes, index, value as u32);
    }
    seal_file(bytes);
}

/// Changes the model in the first `len` bytes, mostly under valid checksums; returns its new length.
///
/// `general(bytes, len)` is a mutator that knows nothing of models: it changes the first `len` bytes and returns the new length.
pub fn mutate(
    bytes: &mut [u8],
    len: usize,
    seed: u32,
    general: impl FnOnce(&mut [u8], usize, usize) -> usize,
) -> usize {
    let (mut random, most) = (Random::of_seed(seed.into()), bytes.len());
    let mut below = |n: u64| (random.number() >> 16) % n;
    match below(32) {
        // As it is, so that the checks of checksums are fuzzed, too.
        0 => return general(bytes, len, most),
        1 => return another(&mut random, bytes).unwrap_or(len),
        _ if len < HEADER_BYTES => return another(&mut random, bytes).unwrap_or(len),
        2..=9 => {
            let len = general(bytes, len, most);
            mend(&mut bytes[..len]);
            return len;
        }
        _ => {}
    }
    let model = &mut bytes[..len];
    for _ in 0..1 + below(4) {
        let (start, size) = sections(model)[below(5) as usize];
        let words = size.min(len.saturating_sub(start)) / 4;
        if words > 0 {
            let at = start + 4 * below(words as u64) as usize;
            let old = u32_at(model, at);
            let new = changed(old, below(256) as u8, below(1 << 32) as u32);
            set_word(model, at / 4, new);
        }
    }
    mend(model);
    len
}

/// Writes a sound model or a small random program; returns its length, or `None` if there is no room.
fn another(random: &mut Random, bytes: &mut [u8]) -> Option<usize> {
    let models = sound_models();
    let file = match random.number() >> 61 {
        0 => models[(random.number() >> 32) as usize % models.len()].to_vec(),
        _ => core::iter::repeat_with(|| program(random, &Sizes::SMALL)).take(20).flatten().next()?.file(),
    };
    bytes.get_mut(..file.len())?.copy_from_slice(&file);
    Some(file.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec;
    use elunar_core::nn::{Model, ModelError};

    #[test]
    fn whole_models_stay_as_they_are() {
        for sound in sound_models() {
            let mut bytes = sound.to_vec();
            mend(&mut bytes);
            assert!(bytes == sound);
        }
    }

    #[test]
    fn mutants_get_past_the_checksums() {
        let general = |bytes: &mut [u8], len: usize, _most: usize| {
            bytes[len / 2] ^= 8;
            len
        };
        let (mut bytes, mut len) = (vec![0; 1 << 17], 0);
        let (mut accepted, mut records, mut sums) = (0, 0, 0);
        for seed in 0..4000 {
            len = mutate(&mut bytes, len, seed, general);
            match Model::new(&bytes[..len]) {
                Ok(_) => accepted += 1,
                Err(ModelError::ChunkChecksum { .. } | ModelError::HeaderChecksum) => sums += 1,
                Err(_) => records += 1,
            }
        }
        std::println!("{accepted} accepted, {records} refused for their contents, {sums} for their checksums");
        assert!(accepted > 100 && records > 1000 && sums < 400, "{accepted} {records} {sums}");
    }
}
