//! Writes a model file: the one writer, of the exporter and of every test.

use super::checksums::seal_file;
use super::entry::Entry;
use super::layout::{CHUNK_BYTES, CHUNK_RECORD_BYTES, HEADER_BYTES, MAGIC, NONE, VERSION, word};
use super::operator::{OPERATOR_BYTES, Operator};
use super::tensor::TENSOR_BYTES;
use super::{ENTRY_BYTES, Tensor};
use crate::nn::input::{Illumination, TruthRange};
use crate::part::{copy, part_mut};

/// What a file says, without offsets and checksums.
#[derive(Debug, Clone)]
pub struct Content<'a> {
    /// Descriptive JSON.
    pub text: &'a str,
    /// Tensors with their places in the arena. Their `sums` are counted by the writer.
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
    /// Numbers of the image, coarse and output tensors; [`NONE`] for coarse codes that no operator reads.
    pub roles: [u32; 3],
    /// Seed of the self test's tile, and CRC32C of its output.
    pub self_test: (u32, u32),
    /// Sections begin this many bytes apart, or a multiple: 8 in shipped files; 1 is legal, too.
    pub alignment: usize,
}

impl Default for Content<'_> {
    /// A file without records: tensor 0 takes the image, and no tensor the coarse DTM.
    fn default() -> Self {
        Self {
            text: "{}",
            tensors: &[],
            operators: &[],
            schedule: &[],
            constants: &[],
            tile: (0, 0),
            nr: 50.0,
            range_margin: 0.0,
            truth_range: TruthRange::Own,
            illumination: Illumination::Any,
            roles: [0, NONE, NONE],
            self_test: (0, 0),
            alignment: 1,
        }
    }
}

impl Content<'_> {
    /// Number of bytes of the file.
    #[must_use]
    pub fn file_bytes(&self) -> usize {
        let body = self.body_bytes();
        HEADER_BYTES + CHUNK_RECORD_BYTES * body.div_ceil(CHUNK_BYTES) + body
    }

    fn body_bytes(&self) -> usize {
        let sections = [
            self.text.len(),
            TENSOR_BYTES * self.tensors.len(),
            OPERATOR_BYTES * self.operators.len(),
            ENTRY_BYTES * self.schedule.len(),
            self.constants.len(),
        ];
        sections.map(|len| len.next_multiple_of(self.alignment.max(1))).iter().sum()
    }

    /// Writes the file with its checksums; `None` if `out` has not [`Self::file_bytes`] bytes, or the file has 4 GiB or more.
    #[must_use]
    pub fn write(&self, out: &mut [u8]) -> Option<()> {
        let len = u32::try_from(self.file_bytes()).ok().filter(|len| *len as usize == out.len())?;
        let chunks = self.body_bytes().div_ceil(CHUNK_BYTES);
        out.fill(0);
        copy(part_mut(out, 0, MAGIC.len()), &MAGIC);
        for (index, value) in [
            (word::VERSION, VERSION),
            (word::FILE_BYTES, len),
            (word::CHUNK_BYTES, CHUNK_BYTES as u32),
            (word::CHUNKS, chunks as u32),
            (word::TILE, self.tile.0 as u32),
            (word::TILE + 1, self.tile.1 as u32),
            (word::NR, self.nr.to_bits()),
            (word::RANGE_MARGIN, self.range_margin.to_bits()),
            (word::TARGET_RANGE, self.truth_range.code()),
            (word::ILLUMINATION, self.illumination.code()),
            (word::IMAGE, self.roles[0]),
            (word::COARSE, self.roles[1]),
            (word::OUTPUT, self.roles[2]),
            (word::SELF_TEST_SEED, self.self_test.0),
            (word::SELF_TEST_CRC, self.self_test.1),
        ] {
            set_word(out, index, value);
        }
        let mut sums = 0;
        let tensors = self.tensors.iter().map(|tensor| {
            let counted = Tensor { sums, ..*tensor };
            sums += tensor.ring;
            counted.encode()
        });
        let (start, alignment) = (HEADER_BYTES + CHUNK_RECORD_BYTES * chunks, self.alignment.max(1));
        let mut body = Body { out: &mut *out, at: start, alignment };
        body.section(word::TEXT, self.text.bytes().map(|byte| [byte]));
        body.section(word::TENSORS, tensors);
        body.section(word::OPERATORS, self.operators.iter().map(Operator::encode));
        body.section(word::SCHEDULE, self.schedule.iter().map(Entry::encode));
        body.section(word::CONSTANTS, self.constants.iter().map(|&byte| [byte]));
        seal_file(out);
        Some(())
    }
}

/// Writes a word of the header.
pub fn set_word(bytes: &mut [u8], index: usize, value: u32) {
    copy(part_mut(bytes, 4 * index, 4), &value.to_le_bytes());
}

/// The sections, written one after the other.
struct Body<'a> {
    out: &'a mut [u8],
    at: usize,
    alignment: usize,
}

impl Body<'_> {
    /// Writes records, and the header's words `index` and `index + 1` about them.
    fn section<const N: usize>(&mut self, index: usize, records: impl ExactSizeIterator<Item = [u8; N]>) {
        set_word(self.out, index, self.at as u32);
        set_word(self.out, index + 1, records.len() as u32);
        for record in records {
            copy(part_mut(self.out, self.at, N), &record);
            self.at += N;
        }
        self.at = self.at.next_multiple_of(self.alignment);
    }
}
