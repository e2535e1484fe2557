//! A model file that can only hold what is legal: everything is judged here, once, before the first step.

use super::arena::OVERREAD;
use super::error::{ModelError, OperatorFault};
use super::format::{NONE, RawModel, i32_at, sealed, word};
use super::input::{Illumination, TruthRange};
use super::kernels::{PANEL, panelled, panels};
use super::maps::InputRules;
use super::ops::window_attention;
use super::prepared::Prepared;
use super::program::*;
use super::schedule;
use crate::part::{item, part};
use crate::photoclinometry::Photoclinometry;
use crate::quant::lut::{CODE_TABLE_LEN, EXP_COARSE, EXP_FINE};
use crate::quant::{MULTIPLIER_LIMIT, SHIFT_LIMIT};

/// Largest number of tensors or operators; bounds the time and the stack of validation.
pub const MAX_RECORDS: usize = 512;
/// Largest extent of a tensor along one axis.
pub const MAX_EXTENT: usize = 1 << 14;
/// Largest tensor, samples.
pub const MAX_SAMPLES: u64 = 1 << 28;
/// Largest number of channels a layer norm sees: keeps C·Σx² within `2^56`.
pub const MAX_NORM_CHANNELS: usize = 1 << 13;
/// Largest kernel side.
pub const MAX_KERNEL: usize = 15;
/// Most output rows in one step of a convolution: a unit of work must stay small.
pub const MAX_BLOCK: usize = 16;
/// Largest window side; its tokens' logits live on the stack.
pub const MAX_WINDOW: usize = 8;
/// Largest bias of a layer norm, before its shift.
const MAX_NORM_BIAS: i64 = 1 << 60;

/// A validated model, borrowing the file's bytes. Holding one proves that every operator stays inside its tensors, constants
/// and accumulators, and that no tensor is read before it is written or after it is overwritten.
#[derive(Debug, Clone, Copy)]
pub struct Model<'a> {
    pub(super) raw: RawModel<'a>,
    text: &'a str,
    tensors: &'a [[u8; TENSOR_BYTES]],
    operators: &'a [[u8; OPERATOR_BYTES]],
    schedule: &'a [[u8; ENTRY_BYTES]],
    constants: &'a [u8],
    pub(super) scratch_offset: usize,
    pub(super) scratch_bytes: usize,
    pub(super) sum_count: usize,
    pub(super) macs: u64,
}

impl<'a> Model<'a> {
    /// Judges a file: integrity first, then every record. Takes time proportional to the file, and no memory.
    ///
    /// # Errors
    /// The first violation found.
    pub fn new(bytes: &'a [u8]) -> Result<Self, ModelError> {
        let raw = RawModel::new(bytes)?;
        raw.verify()?;
        let mut model = Self::open(raw)?;
        model.check_tensors()?;
        model.check_inputs()?;
        for index in 0..model.operators.len() {
            let refuse = |reason| ModelError::Operator { operator: index as u32, reason };
            let operator = Operator::decode(&model.operators[index]).map_err(refuse)?;
            let scratch = model.check_operator(&operator).map_err(refuse)?;
            model.scratch_bytes = model.scratch_bytes.max(scratch);
            model.macs = model.macs.saturating_add(model.operator_macs(&operator));
        }
        model.check_output()?;
        schedule::check(&model)?;
        Ok(model)
    }

    /// Finds the sections, and judges nothing in them.
    pub(super) fn open(raw: RawModel<'a>) -> Result<Self, ModelError> {
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
            constants: section(word::CONSTANTS, 1)?,
            scratch_offset: 0,
            scratch_bytes: 0,
            sum_count: 0,
            macs: 0,
        })
    }

    fn check_tensors(&mut self) -> Result<(), ModelError> {
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
        let (rows, cols) = self.tile();
        let floats = [self.nr(), self.range_margin()];
        if !floats.iter().all(|v| v.is_finite() && *v >= 0.0)
            || self.nr() <= 0.0
            || self.raw.word(word::TARGET_RANGE) > 2
            || self.raw.word(word::ILLUMINATION) > 2
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
        if image != NONE && fits(image, self.image_maps()) && apart { Ok(()) } else { Err(ModelError::Header) }
    }

    fn check_output(&self) -> Result<(), ModelError> {
        let (rows, cols) = self.tile();
        let written = self.operators.last().and_then(|record| Operator::decode(record).ok()).map(|op| op.output());
        let output = self.output_tensor();
        if written != Some(output) {
            return Err(ModelError::Header);
        }
        let t = self.tensor(output);
        // Several columns may be channels of one pixel: the same bytes.
        let fits = (t.rows, t.cols * t.channels, t.ring) == (rows, cols, rows) && t.dtype == Dtype::F32;
        if fits { Ok(()) } else { Err(ModelError::Header) }
    }

    /// Judges one operator by itself; returns the scratch bytes it needs.
    fn check_operator(&self, operator: &Operator) -> Result<usize, OperatorFault> {
        let exists = |t: u32| (t as usize) < self.tensors.len();
        if !exists(operator.output()) || !operator.inputs().into_iter().flatten().all(exists) {
            return Err(OperatorFault::TensorIndex);
        }
        match operator {
            Operator::Conv(conv) => self.check_conv(conv),
            Operator::LayerNorm(norm) => self.check_layer_norm(norm),
            Operator::Attention(attention) => self.check_attention(attention),
            Operator::Enlarge(enlarge) => self.check_enlarge(enlarge),
        }
    }

    fn check_conv(&self, conv: &Conv) -> Result<usize, OperatorFault> {
        let out = self.tensor(conv.out);
        let sides = [conv.kernel_rows, conv.kernel_cols];
        let legal = sides.iter().all(|k| (1..=MAX_KERNEL).contains(k) && conv.pad < *k)
            && [conv.stride, conv.stride_cols].iter().all(|s| (1..=MAX_KERNEL).contains(s))
            && (1..=MAX_BLOCK).contains(&conv.block)
            && conv.add_shift <= MAX_ADD_SHIFT
            && (!conv.fold || (sides == [5, 5] && (conv.stride, conv.stride_cols) == (1, 1) && conv.pad == 2));
        if !legal {
            return Err(OperatorFault::Parameter);
        }
        if conv.sources().any(|s| self.tensor(s).dtype == Dtype::F32) {
            return Err(OperatorFault::Type);
        }
        let first = self.tensor(conv.first);
        let channels: usize = conv.sources().map(|s| self.tensor(s).channels).sum();
        let extent = |len: usize, kernel: usize, stride: usize| match conv.fold {
            true => (len >= 4).then_some(2 * len),
            false => (len + 2 * conv.pad).checked_sub(kernel).map(|n| n / stride + 1),
        };
        let fits = conv.sources().all(|s| {
            let t = self.tensor(s);
            let margin = if conv.fold { (2, Edge::Nearest) } else { (conv.pad, Edge::Zero) };
            (t.rows, t.cols) == (first.rows, first.cols)
                && (margin.0 == 0 || (t.margin >= margin.0 && t.edge == margin.1))
        }) && extent(first.rows, conv.kernel_rows, conv.stride) == Some(out.rows)
            && extent(first.cols, conv.kernel_cols, conv.stride_cols) == Some(out.cols)
            && channels <= MAX_EXTENT;
        if !fits {
            return Err(OperatorFault::Shape);
        }
        self.check_conv_finish(conv, &out)?;
        self.check_conv_weights(conv, &out)?;
        if conv.pad == 0 || conv.fold {
            return Ok(0);
        }
        // A row of zero codes for the padding, as long as what the kernel reads of a row.
        let line = |t: Tensor| t.plane_bytes() + conv.kernel_cols * t.channels + OVERREAD;
        Ok(conv.sources().map(|s| line(self.tensor(s))).max().unwrap_or(0))
    }

    fn check_enlarge(&self, op: &Enlarge) -> Result<usize, OperatorFault> {
        let (input, out) = (self.tensor(op.input), self.tensor(op.out));
        if input.dtype == Dtype::F32 || input.dtype != out.dtype {
            return Err(OperatorFault::Type);
        }
        let fits = (out.rows, out.cols, out.channels) == (2 * input.rows, 2 * input.cols, input.channels)
            && (out.zero, out.lo, out.hi) == (input.zero, input.lo, input.hi);
        if fits { Ok(0) } else { Err(OperatorFault::Shape) }
    }

    /// Requantisation, addition and table of a convolution.
    fn check_conv_finish(&self, conv: &Conv, out: &Tensor) -> Result<(), OperatorFault> {
        let float = out.dtype == Dtype::F32;
        if let Some(add) = conv.add {
            let add = self.tensor(add);
            // The output may hold several columns as channels.
            let row = |t: &Tensor| (t.rows, t.cols * t.channels);
            let alike = row(&add) == row(out) && (float || add.channels == out.channels);
            if !alike {
                return Err(OperatorFault::Shape);
            }
            if add.dtype == Dtype::F32 {
                return Err(OperatorFault::Type);
            }
        }
        if float {
            let scales = self.constant_slice(conv.multipliers, out.channels, 4)?.as_chunks::<4>().0;
            let legal = scales.iter().all(|&b| f32::from_le_bytes(b).is_finite());
            let plain = conv.table.is_none() && conv.shift == 0;
            return if legal && plain { Ok(()) } else { Err(OperatorFault::Constants) };
        }
        if conv.relu {
            return Err(OperatorFault::Parameter);
        }
        self.check_multipliers(conv.multipliers, out.channels, conv.shift)?;
        if conv.add.is_some() {
            self.check_multipliers(conv.add_multipliers, out.channels, conv.shift)?;
        }
        if let Some(table) = conv.table {
            let codes = self.constant_slice(table, CODE_TABLE_LEN, 1)?;
            if out.dtype != Dtype::U8 || !(0..=255).contains(&conv.table_zero) {
                return Err(OperatorFault::Type);
            }
            if !codes.iter().all(|&code| (out.lo..=out.hi).contains(&(code as i32))) {
                return Err(OperatorFault::Constants);
            }
        }
        Ok(())
    }

    /// The K limit: with the weights as they are, no finished sum can leave i32. Filling must be 0.
    fn check_conv_weights(&self, conv: &Conv, out: &Tensor) -> Result<(), OperatorFault> {
        let bias = self.constant_slice(conv.bias, conv.variants() * out.channels, 4)?.as_chunks::<4>().0;
        let mut at = conv.weights;
        for (first, width) in panels(out.channels) {
            // Largest sum of each kind; a pixel at a corner adds one of every kind.
            let mut largest = [[0u64; PANEL]; VARIANT_KINDS];
            for variant in 0..conv.variants() {
                // Largest sum of products, and what zero codes contribute.
                let (mut sums, mut zeros) = ([0u64; PANEL], [0i64; PANEL]);
                for source in conv.sources() {
                    let t = self.tensor(source);
                    at += self.add_weights(
                        conv.extent(variant),
                        &t,
                        (at, first, width, out.channels),
                        (&mut sums, &mut zeros),
                    )?;
                }
                let Some(largest) = largest.get_mut(conv.variant_kind(variant)) else { continue };
                let channels = largest.iter_mut().zip(sums).zip(zeros).take(width.min(out.channels - first));
                for (channel, ((largest, sum), zero)) in channels.enumerate() {
                    let bias = bias.get(variant * out.channels + first + channel).map_or(0, |&b| i32::from_le_bytes(b));
                    // Sums wrap, so the stored bias may have wrapped too.
                    let bias = ((bias as i64 + zero) as i32).unsigned_abs() as u64;
                    *largest = (*largest).max(sum + bias);
                }
            }
            for channel in 0..PANEL {
                if largest.iter().map(|kind| item(kind, channel)).sum::<u64>() > i32::MAX as u64 {
                    return Err(OperatorFault::Overflow);
                }
            }
        }
        Ok(())
    }

    /// Adds a set of filters of one source and one panel; returns its bytes.
    fn add_weights(
        &self,
        (rows, cols): (usize, usize),
        t: &Tensor,
        (at, first, width, channels): (usize, usize, usize, usize),
        (sums, zeros): (&mut [u64; PANEL], &mut [i64; PANEL]),
    ) -> Result<usize, OperatorFault> {
        let used = cols * t.channels;
        let (magnitude, zero) = (t.magnitude() as u64, if t.dtype == Dtype::I16 { 128 * 256 } else { t.zero as i64 });
        let weights = self.constant_slice(at, rows, 4 * width * groups(used))?;
        for (i, four) in weights.as_chunks::<4>().0.iter().enumerate() {
            let (channel, group) = (i % width.max(1), i / width.max(1) % groups(used).max(1));
            let (Some(sum), Some(total)) = (sums.get_mut(channel), zeros.get_mut(channel)) else { continue };
            for (b, &w) in four.iter().enumerate() {
                let w = w as i8;
                let filling = 4 * group + b >= used || first + channel >= channels;
                if w == i8::MIN || (filling && w != 0) {
                    return Err(OperatorFault::Constants);
                }
                *sum += w.unsigned_abs() as u64 * magnitude;
                *total += w as i64 * zero;
            }
        }
        Ok(weights.len())
    }

    fn check_layer_norm(&self, norm: &LayerNorm) -> Result<usize, OperatorFault> {
        let (input, out) = (self.tensor(norm.input), self.tensor(norm.out));
        if !(1..=2).contains(&norm.merge) || norm.epsilon < 1 || norm.epsilon > 1 << 56 {
            return Err(OperatorFault::Parameter);
        }
        if input.dtype == Dtype::F32 || out.dtype == Dtype::F32 {
            return Err(OperatorFault::Type);
        }
        let m = norm.merge;
        let fits = (input.rows, input.cols, out.channels) == (out.rows * m, out.cols * m, input.channels * m * m);
        if !fits || out.channels > MAX_NORM_CHANNELS {
            return Err(OperatorFault::Shape);
        }
        self.check_multipliers(norm.gains, out.channels, norm.shift)?;
        let biases = self.constant_slice(norm.biases, out.channels, 8)?.as_chunks::<8>().0;
        if biases.iter().any(|&b| i64::from_le_bytes(b).unsigned_abs() > MAX_NORM_BIAS as u64) {
            return Err(OperatorFault::Overflow);
        }
        Ok(0)
    }

    fn check_attention(&self, a: &Attention) -> Result<usize, OperatorFault> {
        let (input, out) = (self.tensor(a.input), self.tensor(a.out));
        let shifts = [a.shift_rows, a.shift_cols];
        if !(1..=MAX_WINDOW).contains(&a.window) || a.heads == 0 || shifts.iter().any(|s| *s >= a.window) {
            return Err(OperatorFault::Parameter);
        }
        // Codes from 1 on: -128 is no weight.
        if input.dtype != Dtype::U8 || input.zero != 128 || input.lo < 1 || out.dtype == Dtype::F32 {
            return Err(OperatorFault::Type);
        }
        let fits = (input.rows, input.cols, input.channels) == (out.rows, out.cols, 3 * out.channels)
            && a.heads <= out.channels
            && out.channels.is_multiple_of(a.heads)
            && shifts[0] < out.rows
            && shifts[1] < out.cols;
        if !fits {
            return Err(OperatorFault::Shape);
        }
        let (tokens, head) = (a.window * a.window, out.channels / a.heads);
        self.check_multipliers(a.logit_multipliers, a.heads, a.logit_shift)?;
        self.check_multipliers(a.multipliers, a.heads, a.shift)?;
        self.constant_slice(a.position_bias, a.heads, 2 * (2 * a.window - 1) * (2 * a.window - 1))?;
        let exp = self.constant_slice(a.exp_table, EXP_COARSE + EXP_FINE, 2)?.as_chunks::<2>().0;
        // The first entries are met by every row's maximum: they keep the sum above 2^13.
        let first = |i: usize| exp.get(i).is_some_and(|&e| i16::from_le_bytes(e) >= 1 << 14);
        if !first(0) || !first(EXP_COARSE) || exp.iter().any(|&e| i16::from_le_bytes(e) < 0) {
            return Err(OperatorFault::Constants);
        }
        if self.constant_slice(a.pad_codes, input.channels, 1)?.contains(&0) {
            return Err(OperatorFault::Constants);
        }
        if head > MAX_EXTENT / 2 || tokens as u64 * 127 * i16::MAX as u64 > i32::MAX as u64 {
            return Err(OperatorFault::Overflow);
        }
        Ok(window_attention::Layout::new(tokens, head).bytes())
    }

    fn check_multipliers(&self, offset: usize, count: usize, shift: u32) -> Result<(), OperatorFault> {
        if !(1..=SHIFT_LIMIT).contains(&shift) {
            return Err(OperatorFault::Parameter);
        }
        let values = self.constant_slice(offset, count, 4)?.as_chunks::<4>().0;
        let legal = values.iter().all(|&m| i32::from_le_bytes(m).unsigned_abs() <= MULTIPLIER_LIMIT as u32);
        if legal { Ok(()) } else { Err(OperatorFault::Overflow) }
    }

    fn constant_slice(&self, offset: usize, count: usize, size: usize) -> Result<&'a [u8], OperatorFault> {
        let end = offset as u64 + count as u64 * size as u64;
        if end > self.constants.len() as u64 {
            return Err(OperatorFault::Constants);
        }
        Ok(part(self.constants, offset, end as usize - offset))
    }

    // ---- what a validated model answers -------------------------------------------------------------------------------

    /// Tile rows and columns.
    pub fn tile(&self) -> (usize, usize) {
        (self.raw.word(word::TILE) as usize, self.raw.word(word::TILE + 1) as usize)
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
        TruthRange::of(self.raw.word(word::TARGET_RANGE))
    }

    /// Which light the network knows.
    pub fn illumination(&self) -> Illumination {
        Illumination::of(self.raw.word(word::ILLUMINATION))
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
        self.constants.len()
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

    /// Number of the tensor that takes the coarse DTM as codes, or [`NONE`].
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

    /// Constants from `offset` on, `len` bytes, both from a validated operator.
    #[inline]
    pub(crate) fn constants(&self, offset: usize, len: usize) -> &'a [u8] {
        part(self.constants, offset, len)
    }

    /// The i32 constant number `index` of the list at `offset`.
    #[inline]
    pub(crate) fn constant_i32(&self, offset: usize, index: usize) -> i32 {
        i32_at(self.constants, offset + 4 * index)
    }

    /// Units of work in step `step` of an operator: a panel of output channels, a row of pixels, or a window.
    pub fn units(&self, operator: &Operator) -> usize {
        self.prepared(operator).units()
    }

    /// An operator with its tensors, whether or not the records are as they were written.
    pub(super) fn prepared(&self, operator: &Operator) -> Prepared {
        let inputs = operator.inputs().map(|tensor| tensor.map(|tensor| self.tensor(tensor)));
        Prepared { operator: *operator, out: self.tensor(operator.output()), inputs }
    }

    /// Multiply-accumulates of one unit of one step (see [`Prepared::unit_macs`]).
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
