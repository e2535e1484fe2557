//! A program under construction, and its file with correct checksums.

use elunar_core::nn::file::*;

/// A program of the integer runner. Tensor 0 takes the image.
#[derive(Debug, Clone)]
pub struct Program {
    /// All tensors.
    pub tensors: Vec<Tensor>,
    /// All operators; the last one writes the output, the last tensor.
    pub operators: Vec<Operator>,
    /// The order of their steps.
    pub schedule: Vec<Entry>,
    /// Weights, biases, multipliers, tables.
    pub constants: Vec<u8>,
    /// Rows and columns of the tile.
    pub tile: (usize, usize),
    /// Number of the tensor that takes the coarse DTM, or [`NONE`].
    pub coarse: u32,
    /// The header's word about the light.
    pub illumination: u32,
    /// Seed of the self test's tile.
    pub seed: u32,
}

impl Program {
    /// Adds constants; returns their offset.
    pub(super) fn constant(&mut self, bytes: impl IntoIterator<Item = u8>) -> usize {
        let at = self.constants.len();
        self.constants.extend(bytes);
        at
    }

    /// Adds i32 constants.
    pub(super) fn words(&mut self, values: impl IntoIterator<Item = i32>) -> usize {
        self.constant(values.into_iter().flat_map(i32::to_le_bytes).collect::<Vec<u8>>())
    }

    /// Returns the tensor with this number.
    pub(super) fn tensor(&self, number: u32) -> Tensor {
        self.tensors[number as usize]
    }

    /// Number of bytes from the arena's start to the end of the last tensor.
    #[must_use]
    pub fn end(&self) -> usize {
        self.tensors.iter().map(|t| t.offset + t.size_bytes()).max().unwrap_or(0)
    }

    /// Returns whether any two tensors share bytes.
    #[must_use]
    pub fn shares_bytes(&self) -> bool {
        let tensors = &self.tensors;
        (0..tensors.len()).any(|a| (0..a).any(|b| tensors[a].overlaps(&tensors[b])))
    }

    /// Writes the places of the tensors into [`Self::file`]'s bytes of the same program.
    pub(super) fn place(&self, bytes: &mut [u8]) {
        let start = u32_at(bytes, 4 * word::TENSORS) as usize;
        let mut sums = 0;
        for (t, record) in self.tensors.iter().zip(bytes[start..].chunks_exact_mut(TENSOR_BYTES)) {
            record.copy_from_slice(&Tensor { sums, ..*t }.encode());
            sums += t.ring;
        }
        seal_file(bytes);
    }

    /// Returns the bytes of the file.
    #[must_use]
    pub fn file(&self) -> Vec<u8> {
        let mut sums = 0;
        let mut tensors = Vec::new();
        for t in &self.tensors {
            tensors.extend(Tensor { sums, ..*t }.encode());
            sums += t.ring;
        }
        let sections: [(usize, Vec<u8>, usize); 5] = [
            (word::TEXT, b"{}".to_vec(), 2),
            (word::TENSORS, tensors, self.tensors.len()),
            (word::OPERATORS, self.operators.iter().flat_map(Operator::encode).collect(), self.operators.len()),
            (word::SCHEDULE, self.schedule.iter().flat_map(Entry::encode).collect(), self.schedule.len()),
            (word::CONSTANTS, self.constants.clone(), self.constants.len()),
        ];
        let chunks = sections.iter().map(|s| s.1.len()).sum::<usize>().div_ceil(CHUNK_BYTES);
        let mut bytes = vec![0; HEADER_BYTES + CHUNK_RECORD_BYTES * chunks];
        bytes[..8].copy_from_slice(&MAGIC);
        let mut fields = vec![
            (word::VERSION, VERSION),
            (word::CHUNK_BYTES, CHUNK_BYTES as u32),
            (word::CHUNKS, chunks as u32),
            (word::TILE, self.tile.0 as u32),
            (word::TILE + 1, self.tile.1 as u32),
            (word::NR, 50f32.to_bits()),
            (word::IMAGE, 0),
            (word::COARSE, self.coarse),
            (word::OUTPUT, self.tensors.len() as u32 - 1),
            (word::ILLUMINATION, self.illumination),
            (word::SELF_TEST_SEED, self.seed),
        ];
        for (index, section, count) in sections {
            fields.extend([(index, bytes.len() as u32), (index + 1, count as u32)]);
            bytes.extend(section);
        }
        fields.push((word::FILE_BYTES, bytes.len() as u32));
        for (index, value) in fields {
            bytes[4 * index..4 * index + 4].copy_from_slice(&value.to_le_bytes());
        }
        seal_file(&mut bytes);
        bytes
    }
}
