//! Validation of a file: header, tensors and operators one by one, then all of them together (`schedule.rs`).

mod attention;
mod conv;
mod conv_weights;
mod layer_norm;
mod schedule;
mod upsample;
mod work;

use super::Model;
use crate::nn::file::{MAX_EXTENT, MAX_SAMPLES, ModelError, NONE, Operator, OperatorFault, word};
use crate::nn::input::{Illumination, TruthRange};
use crate::nn::tensor::{Dtype, Tensor};
use crate::part::part;
use crate::quant::{MULTIPLIER_LIMIT, SHIFT_LIMIT};
use crate::tile::Shape;
use work::Work;

/// Most reads of a tensor's record in the validation of one operator.
const TENSOR_READS: usize = 20;

/// Validates a model whose sections are found, and computes the memory and the work that a run needs. Adds its own work to `spent`, at
/// most [`crate::nn::file::MAX_WORK`] for each byte of the file.
pub(super) fn validate(model: &mut Model<'_>, spent: &mut u64) -> Result<(), ModelError> {
    let work = Work::new(model.raw.bytes().len());
    let checked = check(model, &work);
    *spent = work.spent();
    checked
}

fn check(model: &mut Model<'_>, work: &Work) -> Result<(), ModelError> {
    // Both checksums were compared before.
    work.spend(2 * model.raw.bytes().len())?;
    model.check_tensors(work)?;
    model.check_inputs()?;
    for (index, record) in model.operators.iter().enumerate() {
        work.spend(work::OPERATOR + TENSOR_READS * work::TENSOR)?;
        let refuse = |reason| ModelError::Operator { operator: index as u32, reason };
        let operator = Operator::decode(record).map_err(refuse)?;
        model.check_operator(work, &operator).map_err(refuse)?;
        let prepared = model.prepared(&operator);
        model.scratch_bytes = model.scratch_bytes.max(prepared.scratch_bytes());
        model.macs = model.macs.saturating_add(prepared.macs());
    }
    model.check_output()?;
    schedule::check(model, work)
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
        let end = offset as u64 + count as u64 * size as u64;
        if end > self.constants.0.len() as u64 {
            return Err(OperatorFault::Constants);
        }
        work.spend(end as usize - offset)?;
        Ok(part(self.constants.0, offset, end as usize - offset))
    }
}
