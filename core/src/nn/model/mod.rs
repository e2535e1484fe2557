//! A model file that can only hold what is legal: everything is validated once, before the first step (`validate/`). This is the view of it.

mod validate;
mod verdict;

pub use verdict::Verdict;

use super::file::{
    Conv, ENTRY_BYTES, Entry, MAX_RECORDS, ModelError, OPERATOR_BYTES, Operator, RawModel, TENSOR_BYTES, groups,
    panelled, sealed, word,
};
use super::input::{Illumination, TruthRange};
use super::maps::InputRules;
use super::ops::{Constants, Prepared};
use super::tensor::Tensor;
use crate::photoclinometry::Photoclinometry;
use crate::tile::Shape;

/// A validated model, borrowing the file's bytes. Holding one proves that every operator stays inside its tensors, constants
/// and accumulators, and that no tensor is read before it is written or after it is overwritten.
#[derive(Debug, Clone, Copy)]
pub struct Model<'a> {
    raw: RawModel<'a>,
    text: &'a str,
    tensors: &'a [[u8; TENSOR_BYTES]],
    operators: &'a [[u8; OPERATOR_BYTES]],
    schedule: &'a [[u8; ENTRY_BYTES]],
    constants: Constants<'a>,
    scratch_offset: usize,
    scratch_bytes: usize,
    sum_count: usize,
    macs: u64,
}

impl<'a> Model<'a> {
    /// Validates a file: integrity first, then every record. Takes time proportional to the file, and no memory.
    ///
    /// # Errors
    /// The first violation found.
    pub fn new(bytes: &'a [u8]) -> Result<Self, ModelError> {
        let raw = RawModel::new(bytes)?;
        raw.verify()?;
        let mut model = Self::open(raw)?;
        validate::validate(&mut model)?;
        Ok(model)
    }

    /// Finds the sections, and validates nothing in them.
    fn open(raw: RawModel<'a>) -> Result<Self, ModelError> {
        let count = |index: usize| raw.word(index) as usize;
        if count(word::TENSORS + 1) > MAX_RECORDS || !(1..=MAX_RECORDS).contains(&count(word::OPERATORS + 1)) {
            return Err(ModelError::Header);
        }
        let section = |index: usize, size: usize| raw.section(index, raw.word(index + 1) as u64 * size as u64);
        let text = core::str::from_utf8(section(word::TEXT, 1)?).map_err(|_| ModelError::Header)?;
        Ok(Self {
            raw,
            text,
            tensors: section(word::TENSORS, TENSOR_BYTES)?.as_chunks().0,
            operators: section(word::OPERATORS, OPERATOR_BYTES)?.as_chunks().0,
            schedule: section(word::SCHEDULE, ENTRY_BYTES)?.as_chunks().0,
            constants: Constants(section(word::CONSTANTS, 1)?),
            scratch_offset: 0,
            scratch_bytes: 0,
            sum_count: 0,
            macs: 0,
        })
    }

    /// Shape of the tile.
    pub fn tile(&self) -> Shape {
        Shape::new(self.raw.word(word::TILE) as usize, self.raw.word(word::TILE + 1) as usize)
    }

    /// Upper end of the normalised elevation range, NR (Eq. 1).
    pub fn nr(&self) -> f32 {
        f32::from_bits(self.raw.word(word::NR))
    }

    /// Share by which the coarse relief is widened below and above before normalisation.
    pub fn range_margin(&self) -> f32 {
        f32::from_bits(self.raw.word(word::RANGE_MARGIN))
    }

    /// Whose range normalised the truth.
    pub fn truth_range(&self) -> TruthRange {
        TruthRange::from_code(self.raw.word(word::TARGET_RANGE)).unwrap_or(TruthRange::Pixel)
    }

    /// Which light the network knows.
    pub fn illumination(&self) -> Illumination {
        Illumination::from_code(self.raw.word(word::ILLUMINATION)).unwrap_or(Illumination::Given)
    }

    /// How tiles are normalised.
    pub fn input_rules(&self) -> InputRules {
        let (nr, range_margin) = (self.nr(), self.range_margin());
        InputRules { nr, range_margin, truth_range: self.truth_range(), illumination: self.illumination() }
    }

    /// Samples of the image in every pixel: brightness, or the four maps of [`crate::photoclinometry::Guide`].
    pub fn image_maps(&self) -> usize {
        self.illumination().image_maps()
    }

    /// Descriptive JSON: name, network configuration.
    pub fn text(&self) -> &'a str {
        self.text
    }

    /// The file as it is.
    pub fn raw(&self) -> &RawModel<'a> {
        &self.raw
    }

    /// Multiply-accumulates per tile.
    pub fn macs(&self) -> u64 {
        self.macs
    }

    /// Bytes of constants: weights, biases, multipliers, tables.
    pub fn constants_bytes(&self) -> usize {
        self.constants.0.len()
    }

    /// First byte behind the tensors: where the scratch memory begins.
    pub fn scratch_offset(&self) -> usize {
        self.scratch_offset
    }

    /// Bytes of scratch memory.
    pub fn scratch_bytes(&self) -> usize {
        self.scratch_bytes
    }

    /// Number of tensors.
    pub fn tensor_count(&self) -> usize {
        self.tensors.len()
    }

    /// Number of operators.
    pub fn operator_count(&self) -> usize {
        self.operators.len()
    }

    /// Tensor `index`; for a number that the model does not have, a single byte at the start of the arena.
    #[inline]
    pub fn tensor(&self, index: u32) -> Tensor {
        self.tensors.get(index as usize).map_or(Tensor::SINGLE, |record| Tensor::read(record))
    }

    /// Operator `index`, or `None` beyond the last and if its record is not as it was written.
    pub fn operator(&self, index: usize) -> Option<Operator> {
        self.operators.get(index).and_then(|record| Operator::decode(record).ok())
    }

    /// Tensor `index`, if its record is as it was written.
    pub(super) fn sealed_tensor(&self, index: u32) -> Option<Tensor> {
        let record = self.tensors.get(index as usize)?;
        sealed(record).then(|| Tensor::read(record))
    }

    /// Values of scratch memory that beginning a tile in metres wants; 0 for models that are not given the light.
    pub fn scratch_len(&self) -> usize {
        match self.illumination() {
            Illumination::Given => Photoclinometry::new(self.tile()).scratch_len(),
            _ => 0,
        }
    }

    /// Checksums of rows that the arena holds: one per row kept.
    pub fn sum_count(&self) -> usize {
        self.sum_count
    }

    /// Number of entries of the schedule.
    pub fn entry_count(&self) -> usize {
        self.schedule.len()
    }

    /// Entry `index` of the schedule, or `None` beyond the last and if it is not as it was written.
    #[inline]
    pub fn entry(&self, index: usize) -> Option<Entry> {
        self.schedule.get(index).and_then(Entry::decode)
    }

    /// Number of the tensor that takes the image.
    pub fn image_tensor(&self) -> u32 {
        self.raw.word(word::IMAGE)
    }

    /// Number of the tensor that takes the coarse DTM as codes, or [`super::file::NONE`].
    pub fn coarse_tensor(&self) -> u32 {
        self.raw.word(word::COARSE)
    }

    /// Number of the tensor that holds the result.
    pub fn output_tensor(&self) -> u32 {
        self.raw.word(word::OUTPUT)
    }

    /// Seed of the self-test tile and checksum of its output.
    pub fn self_test(&self) -> (u32, u32) {
        (self.raw.word(word::SELF_TEST_SEED), self.raw.word(word::SELF_TEST_CRC))
    }

    /// The constants, for operators.
    #[inline]
    pub(crate) fn constants(&self) -> &Constants<'a> {
        &self.constants
    }

    /// Units of work in step `step` of an operator: a panel of output channels, a row of pixels, or a window.
    pub fn units(&self, operator: &Operator) -> usize {
        self.prepared(operator).units()
    }

    /// Operator `index` with its tensors; `None` if one of their records has changed since it was written.
    pub(super) fn ready(&self, index: usize) -> Option<Prepared> {
        let operator = self.operator(index)?;
        let mut inputs = [None; 3];
        for (slot, tensor) in inputs.iter_mut().zip(operator.inputs()) {
            if let Some(tensor) = tensor {
                *slot = Some(self.sealed_tensor(tensor)?);
            }
        }
        Some(Prepared { operator, out: self.sealed_tensor(operator.output())?, inputs })
    }

    /// An operator with its tensors, whether or not the records are as they were written.
    pub(crate) fn prepared(&self, operator: &Operator) -> Prepared {
        let inputs = operator.inputs().map(|tensor| tensor.map(|tensor| self.tensor(tensor)));
        Prepared { operator: *operator, out: self.tensor(operator.output()), inputs }
    }

    /// Multiply-accumulates of one unit of one step (a layer norm counts four per sample, an upsampling eight).
    pub fn unit_macs(&self, operator: &Operator, step: usize, unit: usize) -> u64 {
        self.prepared(operator).unit_macs(step, unit)
    }

    /// Multiply-accumulates of a whole operator.
    pub fn operator_macs(&self, operator: &Operator) -> u64 {
        self.prepared(operator).macs()
    }

    /// Bytes that the packed weights of a convolution take.
    pub fn weight_bytes(&self, conv: &Conv) -> usize {
        let out = self.tensor(conv.out);
        let of = |variant: usize| {
            let (rows, cols) = conv.extent(variant);
            rows * conv.sources().map(|s| groups(cols * self.tensor(s).channels)).sum::<usize>()
        };
        4 * panelled(out.channels) * (0..conv.variants()).map(of).sum::<usize>()
    }
}
