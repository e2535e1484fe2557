//! Validation of a file in parts: checksums, tensors and operators one by one, then all of them together (`schedule.rs`).

mod attention;
mod conv;
mod conv_weights;
mod layer_norm;
mod schedule;
mod upsample;
mod work;

use super::Model;
use crate::nn::file::{
    MAX_EXTENT, MAX_SAMPLES, ModelError, NONE, OPERATOR_BYTES, Operator, OperatorFault, RawModel, word,
};
use crate::nn::input::{Illumination, TruthRange};
use crate::nn::tensor::{Dtype, Tensor};
use crate::part::part;
use crate::quant::{MULTIPLIER_LIMIT, SHIFT_LIMIT};
use crate::tile::Shape;
use crate::words::Words;
use work::Work;

/// Most reads of a tensor's record in the validation of one operator.
const TENSOR_READS: usize = 20;

/// Cost of comparing a byte with its checksums, and of validating what counts as one in [`work`], in multiply-accumulates, as counted on a
/// Cortex-M7.
pub(in crate::nn) const COMPARED: u64 = 6;
const VALIDATED: u64 = 20;

/// A part of the validation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Stage {
    /// The checksum of the list of checksums, then those of the chunks.
    #[default]
    Chunks,
    Tensors,
    Operators,
    /// All of them together.
    Schedule,
    Done,
}

/// A validation that can be done in parts: plain numbers.
///
/// ```
/// use elunar_core::nn::{Model, Validation};
///
/// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../host-train/models/nano.eld");
/// # let file = std::fs::read(path)?;
/// let mut validation = Validation::default();
/// // Each part costs about as much as five million multiply-accumulates.
/// let model = loop {
///     if let Some(model) = validation.advance(&file, 5_000_000)? {
///         break model;
///     }
/// };
/// assert_eq!(model.verdict(), Model::new(&file)?.verdict());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Validation {
    stage: Stage,
    /// Next chunk or operator, and next part of its weights.
    index: u32,
    part: u32,
    /// Work so far.
    spent: u64,
    scratch_offset: usize,
    scratch_bytes: usize,
    sum_count: usize,
    macs: u64,
}

impl Validation {
    /// Number of words of a validation.
    pub const WORDS: usize = 8;

    /// Returns the validation as words.
    #[must_use]
    pub fn to_words(mut self) -> [u64; Self::WORDS] {
        let mut words = [0; Self::WORDS];
        self.visit(&mut Words::writing(&mut words));
        words
    }

    /// Returns the validation of these words; `None` if they are not those of one.
    #[must_use]
    pub fn from_words(mut words: [u64; Self::WORDS]) -> Option<Self> {
        let (mut validation, mut words) = (Self::default(), Words::reading(&mut words));
        validation.visit(&mut words);
        words.is_legal().then_some(validation)
    }

    pub(in crate::nn) fn visit(&mut self, words: &mut Words<'_>) {
        use Stage::{Chunks, Done, Operators, Schedule, Tensors};
        words.choice(&mut self.stage, &[Chunks, Tensors, Operators, Schedule, Done]);
        words.u32(&mut self.index);
        words.u32(&mut self.part);
        words.u64(&mut self.spent);
        words.usize(&mut self.scratch_offset);
        words.usize(&mut self.scratch_bytes);
        words.usize(&mut self.sum_count);
        words.u64(&mut self.macs);
    }

    /// Returns whether all is validated: then [`Self::advance`] opens the model at once.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.stage == Stage::Done
    }

    /// Returns the work so far: at most [`crate::nn::file::MAX_WORK`] for each byte of the file.
    pub(in crate::nn) fn spent(&self) -> u64 {
        self.spent
    }

    /// Validates a part of a file of about so much cost, in multiply-accumulates, and at least a unit; returns the model when all is done. The
    /// bytes are the same in every call.
    ///
    /// # Errors
    /// As [`Model::new`].
    pub fn advance<'a>(&mut self, bytes: &'a [u8], budget: u64) -> Result<Option<Model<'a>>, ModelError> {
        let (raw, budget, mut cost) = (RawModel::new(bytes)?, budget.max(1), 0);
        while self.stage == Stage::Chunks {
            cost += self.compare(&raw)?;
            if cost >= budget {
                return Ok(None);
            }
        }
        let mut model = Model::open(raw)?;
        self.give(&mut model);
        while self.stage != Stage::Done {
            if cost >= budget {
                return Ok(None);
            }
            let before = self.spent;
            let work = Work::new(bytes.len(), self.spent);
            let checked = self.unit(&mut model, &work);
            self.take(&model, &work);
            checked?;
            cost += VALIDATED * (self.spent - before).max(1);
        }
        Ok(Some(model))
    }

    /// Compares the list of checksums, or a chunk; returns the cost.
    fn compare(&mut self, raw: &RawModel<'_>) -> Result<u64, ModelError> {
        if self.index == 0 && !raw.head_holds() {
            return Err(ModelError::ChunkChecksum { chunk: u32::MAX });
        }
        if self.index < raw.chunks() {
            if !raw.chunk_is_whole(self.index) {
                return Err(ModelError::ChunkChecksum { chunk: self.index });
            }
            self.index += 1;
        }
        if self.index >= raw.chunks() {
            (self.stage, self.index) = (Stage::Tensors, 0);
        }
        Ok(COMPARED * raw.body_offset().max(crate::nn::file::CHUNK_BYTES) as u64)
    }

    /// Validates tensors, a part of an operator, or the schedule.
    fn unit(&mut self, model: &mut Model<'_>, work: &Work) -> Result<(), ModelError> {
        match self.stage {
            Stage::Tensors => {
                // Both checksums were compared before.
                work.spend(2 * model.raw.bytes().len())?;
                model.check_tensors(work)?;
                model.check_inputs()?;
                self.stage = Stage::Operators;
            }
            Stage::Operators => match model.operators.get(self.index as usize) {
                None => {
                    model.check_output()?;
                    self.stage = Stage::Schedule;
                }
                Some(record) => self.operator(model, work, record)?,
            },
            _ => {
                schedule::check(model, work)?;
                self.stage = Stage::Done;
            }
        }
        Ok(())
    }

    /// Validates an operator, or the next part of its weights.
    fn operator(
        &mut self,
        model: &mut Model<'_>,
        work: &Work,
        record: &[u8; OPERATOR_BYTES],
    ) -> Result<(), ModelError> {
        let refuse = |reason| ModelError::Operator { operator: self.index, reason };
        let operator = Operator::decode(record).map_err(refuse)?;
        if self.part == 0 {
            work.spend(work::OPERATOR + TENSOR_READS * work::TENSOR)?;
            model.check_operator(work, &operator).map_err(refuse)?;
        }
        if let Operator::Conv(conv) = &operator
            && model.check_conv_weights(work, conv, self.part as usize).map_err(refuse)?
        {
            self.part += 1;
            return Ok(());
        }
        let prepared = model.prepared(&operator);
        model.scratch_bytes = model.scratch_bytes.max(prepared.scratch_bytes());
        model.macs = model.macs.saturating_add(prepared.macs());
        (self.index, self.part) = (self.index + 1, 0);
        Ok(())
    }

    fn give(&self, model: &mut Model<'_>) {
        (model.scratch_offset, model.scratch_bytes) = (self.scratch_offset, self.scratch_bytes);
        (model.sum_count, model.macs) = (self.sum_count, self.macs);
    }

    fn take(&mut self, model: &Model<'_>, work: &Work) {
        (self.scratch_offset, self.scratch_bytes) = (model.scratch_offset, model.scratch_bytes);
        (self.sum_count, self.macs, self.spent) = (model.sum_count, model.macs, work.spent());
    }
}

impl<'a> Model<'a> {
    fn check_tensors(&mut self, work: &Work) -> Result<(), ModelError> {
        work.spend(self.tensors.len() * work::TENSOR)?;
        for (index, record) in self.tensors.iter().enumerate() {
            let refuse = ModelError::Tensor { tensor: index as u32 };
            let t = Tensor::decode(record).ok_or(refuse)?;
            let extents = [t.rows, t.cols, t.channels];
            let samples = extents.iter().fold(1u64, |n, &e| n * e.min(MAX_EXTENT) as u64);
            let margins = 1 + (2 * t.margin / t.cols.max(1)) as u64;
            let bytes = t.ring as u64 * t.pitch as u64;
            if extents.iter().any(|e| !(1..=MAX_EXTENT).contains(e))
                || samples * margins > MAX_SAMPLES
                || t.pitch < t.row_bytes()
                || bytes > 4 * MAX_SAMPLES
                || t.offset > 1 << 30
            {
                return Err(refuse);
            }
            if t.sums != self.sum_count {
                return Err(refuse);
            }
            self.sum_count += t.ring;
            self.scratch_offset = self.scratch_offset.max(t.offset + t.size_bytes());
        }
        Ok(())
    }

    fn check_inputs(&self) -> Result<(), ModelError> {
        let Shape { rows, cols } = self.tile();
        let floats = [self.nr(), self.range_margin()];
        if !floats.iter().all(|v| v.is_finite() && *v >= 0.0)
            || self.nr() <= 0.0
            || TruthRange::from_code(self.raw.word(word::TARGET_RANGE)).is_none()
            || Illumination::from_code(self.raw.word(word::ILLUMINATION)).is_none()
        {
            return Err(ModelError::Header);
        }
        let fits = |index: u32, maps: usize| match self.tensors.get(index as usize) {
            None => index == NONE,
            Some(_) => {
                let t = self.tensor(index);
                (t.rows, t.cols, t.channels, t.ring) == (rows, cols, maps, rows) && t.dtype != Dtype::F32
            }
        };
        let (image, coarse) = (self.image_tensor(), self.coarse_tensor());
        let apart = coarse == NONE || (fits(coarse, 1) && image != coarse);
        if image == NONE || !fits(image, self.image_maps()) || !apart {
            return Err(ModelError::Header);
        }
        // Both are written before the first step.
        if coarse != NONE && self.tensor(image).overlaps(&self.tensor(coarse)) {
            return Err(ModelError::Tensor { tensor: coarse });
        }
        Ok(())
    }

    fn check_output(&self) -> Result<(), ModelError> {
        let Shape { rows, cols } = self.tile();
        let written = self.operators.last().and_then(|record| Operator::decode(record).ok()).map(|op| op.output());
        let output = self.output_tensor();
        if written != Some(output) {
            return Err(ModelError::Header);
        }
        let t = self.tensor(output);
        // The channels of a pixel may be several columns, with the same bytes.
        let fits = (t.rows, t.cols * t.channels, t.ring) == (rows, cols, rows) && t.dtype == Dtype::F32;
        if fits { Ok(()) } else { Err(ModelError::Header) }
    }

    /// Validates one operator by itself.
    fn check_operator(&self, work: &Work, operator: &Operator) -> Result<(), OperatorFault> {
        let exists = |t: u32| (t as usize) < self.tensors.len();
        if !exists(operator.output()) || !operator.inputs().into_iter().flatten().all(exists) {
            return Err(OperatorFault::TensorIndex);
        }
        match operator {
            Operator::Conv(conv) => self.check_conv(work, conv),
            Operator::LayerNorm(norm) => self.check_layer_norm(work, norm),
            Operator::Attention(attention) => self.check_attention(work, attention),
            Operator::Upsample2(upsample) => self.check_upsample(upsample),
        }
    }

    fn check_multipliers(&self, work: &Work, offset: usize, count: usize, shift: u32) -> Result<(), OperatorFault> {
        if !(1..=SHIFT_LIMIT).contains(&shift) {
            return Err(OperatorFault::Parameter);
        }
        let values = self.constant_slice(work, offset, count, 4)?.as_chunks::<4>().0;
        let legal = values.iter().all(|&m| i32::from_le_bytes(m).unsigned_abs() <= MULTIPLIER_LIMIT as u32);
        if legal { Ok(()) } else { Err(OperatorFault::Overflow) }
    }

    /// Returns constants that will be read once.
    fn constant_slice(&self, work: &Work, offset: usize, count: usize, size: usize) -> Result<&'a [u8], OperatorFault> {
        let len = usize::try_from(count as u64 * size as u64).map_err(|_| OperatorFault::Constants)?;
        work.spend(self.constants_from(offset, len)?.len())?;
        self.constants_from(offset, len)
    }

    fn constants_from(&self, offset: usize, len: usize) -> Result<&'a [u8], OperatorFault> {
        let exists = offset.checked_add(len).is_some_and(|end| end <= self.constants.0.len());
        if exists { Ok(part(self.constants.0, offset, len)) } else { Err(OperatorFault::Constants) }
    }
}
