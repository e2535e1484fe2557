//! A validated model file: `validate/` checks everything once, before the first step. This is the view of the file.

mod validate;
mod verdict;

pub(super) use validate::COMPARED;
pub use validate::Validation;
pub use verdict::Verdict;

#[cfg(doc)]
use super::file::OperatorFault;
use super::file::{
    CHUNK_BYTES, Conv, ENTRY_BYTES, Entry, MAX_RECORDS, ModelError, OPERATOR_BYTES, Operator, RawModel, TENSOR_BYTES,
    groups, panelled, sealed, word,
};
use super::input::{Illumination, InputRules, TruthRange};
use super::ops::{Constants, Prepared};
use super::tensor::Tensor;
use crate::tile::Shape;

/// Cost of quantising a sample, in multiply-accumulates, and of making one of the self test, as counted on a Cortex-M7.
pub(crate) const QUANTISED: u64 = 50;
const MADE: u64 = 10;

/// A validated model, borrowing the file's bytes. Every operator of a `Model` stays inside its tensors, constants and accumulators, and no
/// tensor is read before it is written or after it is overwritten.
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
    /// Validates a file: integrity first, then every record. The time is proportional to the file's length; no memory is needed.
    ///
    /// # Errors
    /// The first violation found; [`ModelError::Work`] or [`OperatorFault::Work`] for a file that would take longer.
    pub fn new(bytes: &'a [u8]) -> Result<Self, ModelError> {
        Self::new_counted(bytes, &mut 0)
    }

    /// As [`Self::new`]; writes the work of the validation to `work`: at most [`MAX_WORK`](super::file::MAX_WORK) for each byte of the file.
    /// It is what was read of the file, counted each time: bytes for checksums and of constants, words of records. Each look at a pair of
    /// tensors, or at a link of a line of tensors that overwrite each other, adds 2.
    ///
    /// # Errors
    /// As [`Self::new`].
    #[doc(hidden)] // for tests
    pub fn new_counted(bytes: &'a [u8], work: &mut u64) -> Result<Self, ModelError> {
        let mut validation = Validation::default();
        let validated = validation.advance(bytes, u64::MAX);
        *work = validation.spent();
        validated?.ok_or(ModelError::Work)
    }

    /// Finds the sections without validating their contents.
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

    /// Returns the shape of the tile.
    pub fn tile(&self) -> Shape {
        Shape::new(self.raw.word(word::TILE) as usize, self.raw.word(word::TILE + 1) as usize)
    }

    /// Returns the upper end of the normalised elevation range, NR (Eq. 1).
    pub fn nr(&self) -> f32 {
        f32::from_bits(self.raw.word(word::NR))
    }

    /// Returns the share by which the coarse range is widened below and above before normalisation.
    pub fn range_margin(&self) -> f32 {
        f32::from_bits(self.raw.word(word::RANGE_MARGIN))
    }

    /// Returns which range normalised the truth.
    pub fn truth_range(&self) -> TruthRange {
        TruthRange::from_code(self.raw.word(word::TARGET_RANGE)).unwrap_or(TruthRange::Pixel)
    }

    /// Returns the light that the network knows.
    pub fn illumination(&self) -> Illumination {
        Illumination::from_code(self.raw.word(word::ILLUMINATION)).unwrap_or(Illumination::Given)
    }

    /// Returns how tiles are normalised.
    pub fn input_rules(&self) -> InputRules {
        let (nr, range_margin) = (self.nr(), self.range_margin());
        InputRules { nr, range_margin, truth_range: self.truth_range(), illumination: self.illumination() }
    }

    /// Number of samples of the image in every pixel: brightness alone, or the maps of a [`crate::photoclinometry::Guide`].
    pub fn image_maps(&self) -> usize {
        self.illumination().image_maps()
    }

    /// Returns the descriptive JSON: name, network configuration.
    pub fn text(&self) -> &'a str {
        self.text
    }

    /// Returns the file.
    pub fn raw(&self) -> &RawModel<'a> {
        &self.raw
    }

    /// Number of multiply-accumulates per tile.
    pub fn macs(&self) -> u64 {
        self.macs
    }

    /// Number of bytes of constants: weights, biases, multipliers, tables.
    pub fn constants_bytes(&self) -> usize {
        self.constants.0.len()
    }

    /// Offset of the scratch memory: the first byte behind the tensors.
    pub fn scratch_offset(&self) -> usize {
        self.scratch_offset
    }

    /// Number of bytes of scratch memory.
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

    /// Returns tensor `index`; for a number that the model does not have, a single byte at the start of the arena.
    #[inline]
    pub fn tensor(&self, index: u32) -> Tensor {
        self.tensors.get(index as usize).map_or(Tensor::SINGLE, |record| Tensor::read(record))
    }

    /// Returns operator `index`; `None` beyond the last, or if its record has changed.
    pub fn operator(&self, index: usize) -> Option<Operator> {
        self.operators.get(index).and_then(|record| Operator::decode(record).ok())
    }

    /// Returns tensor `index`; `None` beyond the last, or if its record has changed.
    pub(super) fn sealed_tensor(&self, index: u32) -> Option<Tensor> {
        let record = self.tensors.get(index as usize)?;
        sealed(record).then(|| Tensor::read(record))
    }

    /// Number of checksums of rows in the arena: one per row that is kept.
    pub fn sum_count(&self) -> usize {
        self.sum_count
    }

    /// Number of entries of the schedule.
    pub fn entry_count(&self) -> usize {
        self.schedule.len()
    }

    /// Returns entry `index` of the schedule; `None` beyond the last, or if it has changed.
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

    /// Returns the seed of the self-test tile and the checksum of its output.
    pub fn self_test(&self) -> (u32, u32) {
        (self.raw.word(word::SELF_TEST_SEED), self.raw.word(word::SELF_TEST_CRC))
    }

    /// Returns the constants.
    #[inline]
    pub(crate) fn constants(&self) -> &Constants<'a> {
        &self.constants
    }

    /// Number of units of work in a step of an operator: panels of output channels, rows of pixels, or windows.
    pub fn units(&self, operator: &Operator) -> usize {
        self.prepared(operator).units()
    }

    /// Returns operator `index` with its tensors; `None` if one of their records has changed.
    pub(super) fn ready(&self, index: usize) -> Option<Prepared> {
        let operator = self.operator(index)?;
        let mut inputs = [None; 3];
        for (slot, tensor) in inputs.iter_mut().zip(operator.inputs()) {
            if let Some(tensor) = tensor {
                *slot = Some(self.sealed_tensor(tensor)?);
            }
        }
        Some(Prepared { operator, out: self.sealed_tensor(operator.output())?, inputs, checked: false })
    }

    /// Returns an operator with its tensors, without a check of their records.
    pub(crate) fn prepared(&self, operator: &Operator) -> Prepared {
        let inputs = operator.inputs().map(|tensor| tensor.map(|tensor| self.tensor(tensor)));
        Prepared { operator: *operator, out: self.tensor(operator.output()), inputs, checked: false }
    }

    /// Number of multiply-accumulates of one unit of one step (a layer norm counts four per sample, an upsampling eight).
    pub fn unit_macs(&self, operator: &Operator, step: usize, unit: usize) -> u64 {
        self.prepared(operator).unit_macs(step, unit)
    }

    /// Work of one unit of one step, without the bytes that are compared or summed: what it takes of the budget of
    /// [`Runner::step`](super::Runner::step), in multiply-accumulates.
    pub fn unit_work(&self, operator: &Operator, step: usize, unit: usize) -> u64 {
        self.prepared(operator).unit_work(step, unit)
    }

    /// Returns a bound of the work of a unit, in multiply-accumulates and bytes that are compared or summed: a call of
    /// [`Runner::step`](super::Runner::step) exceeds its budget by less than this.
    pub fn largest_unit(&self) -> u64 {
        let operators = (0..self.operator_count()).filter_map(|index| self.operator(index));
        let largest = operators.map(|operator| self.prepared(&operator).largest_unit()).max().unwrap_or(0);
        // The first chunk of the model is compared together with the bytes before it.
        largest.max((self.raw.body_offset() + CHUNK_BYTES) as u64).max(self.row_macs())
    }

    /// Cost of loading a row of both inputs of the self test, in multiply-accumulates.
    pub(super) fn row_macs(&self) -> u64 {
        (QUANTISED + MADE) * ((self.image_maps() + 1) * self.tile().cols) as u64
    }

    /// Number of multiply-accumulates of a whole operator.
    pub fn operator_macs(&self, operator: &Operator) -> u64 {
        self.prepared(operator).macs()
    }

    /// Number of bytes of a convolution's packed weights.
    pub fn weight_bytes(&self, conv: &Conv) -> usize {
        let out = self.tensor(conv.out);
        let of = |variant: usize| {
            let (rows, cols) = conv.extent(variant);
            rows * conv.sources().map(|s| groups(cols * self.tensor(s).channels)).sum::<usize>()
        };
        4 * panelled(out.channels) * (0..conv.variants()).map(of).sum::<usize>()
    }
}
