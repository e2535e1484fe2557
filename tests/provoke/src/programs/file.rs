//! A program under construction, and its file with correct checksums.

use alloc::vec;
use alloc::vec::Vec;
use elunar_core::nn::Illumination;
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
    /// The light that the network knows.
    pub illumination: Illumination,
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

    /// Returns the bytes of the file.
    #[must_use]
    pub fn file(&self) -> Vec<u8> {
        let content = Content {
            tensors: &self.tensors,
            operators: &self.operators,
            schedule: &self.schedule,
            constants: &self.constants,
            tile: self.tile,
            illumination: self.illumination,
            roles: [0, self.coarse, self.tensors.len() as u32 - 1],
            self_test: (self.seed, 0),
            ..Content::default()
        };
        let mut bytes = vec![0; content.file_bytes()];
        content.write(&mut bytes).expect("a small file");
        bytes
    }
}
