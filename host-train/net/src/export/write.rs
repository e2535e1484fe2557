//! The bytes of a model file.

use elunar_core::nn::file::{
    CHUNK_BYTES, CHUNK_RECORD_BYTES, Entry, HEADER_BYTES, MAGIC, Operator, Tensor, VERSION, seal_file, word,
};
use elunar_core::nn::{Illumination, TruthRange};

/// Content of a file, without checksums and offsets.
#[derive(Debug, Clone)]
pub struct Content<'a> {
    /// Descriptive JSON.
    pub text: &'a str,
    /// Tensors with their places in the arena.
    pub tensors: &'a [Tensor],
    /// Operators. The last one writes the output.
    pub operators: &'a [Operator],
    /// Schedule: the order of the operators' steps.
    pub schedule: &'a [Entry],
    /// Constants: weights, biases, multipliers, tables, at the offsets that the operators name.
    pub constants: &'a [u8],
    /// Tile rows and columns.
    pub tile: (usize, usize),
    /// Upper end of the normalised elevation range, NR (Eq. 1).
    pub nr: f32,
    /// Share of the coarse relief by which its range is widened below and above.
    pub range_margin: f32,
    /// Which DTM's range normalised the truth in training.
    pub truth_range: TruthRange,
    /// Light for which the network was trained.
    pub illumination: Illumination,
    /// Numbers of the image, coarse and output tensors; [`elunar_core::nn::file::NONE`] for coarse codes that no operator reads.
    pub roles: [u32; 3],
    /// Seed of the self test's tile, and CRC32C of its output.
    pub self_test: (u32, u32),
}

/// Lays out a file and computes its checksums.
pub fn file_bytes(content: &Content<'_>) -> Vec<u8> {
    let sections: [(usize, Vec<u8>, usize); 5] = [
        (word::TEXT, content.text.as_bytes().to_vec(), content.text.len()),
        (word::TENSORS, content.tensors.iter().flat_map(Tensor::encode).collect(), content.tensors.len()),
        (word::OPERATORS, content.operators.iter().flat_map(Operator::encode).collect(), content.operators.len()),
        (word::SCHEDULE, content.schedule.iter().flat_map(Entry::encode).collect(), content.schedule.len()),
        (word::CONSTANTS, content.constants.to_vec(), content.constants.len()),
    ];
    let body_bytes: usize = sections.iter().map(|(_, bytes, _)| bytes.len().next_multiple_of(8)).sum();
    let chunks = body_bytes.div_ceil(CHUNK_BYTES);
    let mut bytes = vec![0; HEADER_BYTES + CHUNK_RECORD_BYTES * chunks];
    bytes[..8].copy_from_slice(&MAGIC);
    for (index, section, count) in &sections {
        let offset = bytes_len(&bytes);
        set_word(&mut bytes, *index, offset);
        set_word(&mut bytes, index + 1, *count as u32);
        bytes.extend_from_slice(section);
        let padding = section.len().next_multiple_of(8) - section.len();
        bytes.extend(std::iter::repeat_n(0, padding));
    }
    let len = bytes_len(&bytes);
    let fields = [
        (word::VERSION, VERSION),
        (word::FILE_BYTES, len),
        (word::CHUNK_BYTES, CHUNK_BYTES as u32),
        (word::CHUNKS, chunks as u32),
        (word::TILE, content.tile.0 as u32),
        (word::TILE + 1, content.tile.1 as u32),
        (word::NR, content.nr.to_bits()),
        (word::RANGE_MARGIN, content.range_margin.to_bits()),
        (word::TARGET_RANGE, content.truth_range.code()),
        (word::ILLUMINATION, content.illumination.code()),
        (word::IMAGE, content.roles[0]),
        (word::COARSE, content.roles[1]),
        (word::OUTPUT, content.roles[2]),
        (word::SELF_TEST_SEED, content.self_test.0),
        (word::SELF_TEST_CRC, content.self_test.1),
    ];
    fields.into_iter().for_each(|(index, value)| set_word(&mut bytes, index, value));
    seal_file(&mut bytes);
    bytes
}

fn set_word(bytes: &mut [u8], index: usize, value: u32) {
    bytes[4 * index..4 * index + 4].copy_from_slice(&value.to_le_bytes());
}

fn bytes_len(bytes: &[u8]) -> u32 {
    u32::try_from(bytes.len()).expect("models are below 4 GiB")
}
