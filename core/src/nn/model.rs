//! A model file that can only hold what is legal: everything is judged here, once, before the first step.

use super::error::{ModelError, OperatorFault};
use super::format::{NONE, RawModel, i32_at, i64_at, u32_at, word};
use super::kernels::{CHANNEL_GROUP, Le16, padded};
use super::program::*;
use crate::quant::lut::CODE_TABLE_LEN;
use crate::quant::{MULTIPLIER_LIMIT, SHIFT_LIMIT};

/// Largest number of tensors or operators; bounds the time of validation.
pub const MAX_RECORDS: usize = 1024;
/// Largest extent of a tensor along one axis.
pub const MAX_EXTENT: usize = 1 << 14;
/// Largest tensor, samples.
pub const MAX_SAMPLES: u64 = 1 << 28;
/// Largest number of channels a layer norm sees: keeps C·Σx² within `2^56`.
pub const MAX_NORM_CHANNELS: usize = 1 << 13;
/// Largest kernel side.
pub const MAX_KERNEL: usize = 15;
/// Largest window side; its tokens' logits live on the stack.
pub const MAX_WINDOW: usize = 16;
/// Largest scratch memory of one operator; keeps the arena addressable on 32-bit machines.
const MAX_SCRATCH_BYTES: u64 = 1 << 30;
/// Largest bias of a layer norm, before its shift.
const MAX_NORM_BIAS: i64 = 1 << 60;

/// Whose minimum and relief normalised the truth in training.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TruthRange {
    /// The truth's own.
    Own,
    /// The coarse tile's.
    Reference,
}

/// Which light the network knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Illumination {
    /// The Sun anywhere.
    Any,
    /// The Sun in the north-west quadrant of the grid: the caller mirrors tiles lit from elsewhere, and the heights back.
    Northwest,
}

/// A validated model, borrowing the file's bytes. Holding one proves that every operator stays inside its tensors, constants
/// and accumulators, and that no tensor is read before it is written or after it is overwritten.
#[derive(Debug, Clone, Copy)]
pub struct Model<'a> {
    raw: RawModel<'a>,
    text: &'a str,
    tensors: &'a [[u8; TENSOR_BYTES]],
    operators: &'a [[u8; OPERATOR_BYTES]],
    constants: &'a [u8],
    scratch_offset: usize,
    scratch_bytes: usize,
    macs: u64,
}

/// Sizes of a convolution's work, derived from its tensors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConvShape {
    /// Rows of the (enlarged) input.
    pub in_rows: usize,
    /// Columns of the (enlarged) input.
    pub in_cols: usize,
    /// Channels of all sources.
    pub in_channels: usize,
    /// Weights per output channel and kernel row, padding included.
    pub segment: usize,
    /// Scratch samples per kernel row.
    pub row_samples: usize,
}

impl ConvShape {
    fn scratch_bytes(&self, conv: &Conv) -> u64 {
        (conv.kernel_rows * size_of::<Le16>()) as u64 * self.row_samples as u64
    }
}

impl<'a> Model<'a> {
    /// Judges a file: integrity first, then every record. Takes time proportional to the file, and no memory.
    ///
    /// # Errors
    /// The first violation found.
    pub fn new(bytes: &'a [u8]) -> Result<Self, ModelError> {
        let raw = RawModel::new(bytes)?;
        raw.verify()?;
        let count = |index: usize| raw.word(index) as usize;
        if count(word::TENSORS + 1) > MAX_RECORDS || !(1..=MAX_RECORDS).contains(&count(word::OPERATORS + 1)) {
            return Err(ModelError::Header);
        }
        let section = |index: usize, size: usize| raw.section(index, raw.word(index + 1) as u64 * size as u64);
        let text = core::str::from_utf8(section(word::TEXT, 1)?).map_err(|_| ModelError::Header)?;
        let mut model = Self {
            raw,
            text,
            tensors: section(word::TENSORS, TENSOR_BYTES)?.as_chunks().0,
            operators: section(word::OPERATORS, OPERATOR_BYTES)?.as_chunks().0,
            constants: section(word::CONSTANTS, 1)?,
            scratch_offset: 0,
            scratch_bytes: 0,
            macs: 0,
        };
        model.check_tensors()?;
        model.check_inputs()?;
        for index in 0..model.operators.len() {
            let refuse = |reason| ModelError::Operator { operator: index as u32, reason };
            let operator = Operator::decode(&model.operators[index]).map_err(refuse)?;
            let scratch = model.check_operator(&operator).map_err(refuse)?;
            model.check_liveness(index, &operator).map_err(refuse)?;
            model.scratch_bytes = model.scratch_bytes.max(scratch);
            model.macs = model.macs.saturating_add(model.operator_macs(&operator));
        }
        model.check_output()?;
        Ok(model)
    }

    fn check_tensors(&mut self) -> Result<(), ModelError> {
        for (index, record) in self.tensors.iter().enumerate() {
            let refuse = ModelError::Tensor { tensor: index as u32 };
            let t = Tensor::decode(record).ok_or(refuse)?;
            let extents = [t.rows, t.cols, t.channels];
            let samples = extents.iter().fold(1u64, |n, &e| n * e.min(MAX_EXTENT) as u64);
            if extents.iter().any(|e| !(1..=MAX_EXTENT).contains(e)) || samples > MAX_SAMPLES || t.offset > 1 << 30 {
                return Err(refuse);
            }
            self.scratch_offset = self.scratch_offset.max(t.offset + t.size_bytes());
        }
        Ok(())
    }

    fn check_inputs(&self) -> Result<(), ModelError> {
        let (rows, cols) = self.tile();
        let floats = [self.nr(), self.range_margin()];
        if !floats.iter().all(|v| v.is_finite() && *v >= 0.0)
            || self.nr() <= 0.0
            || self.raw.word(word::TARGET_RANGE) > 1
            || self.raw.word(word::ILLUMINATION) > 1
        {
            return Err(ModelError::Header);
        }
        let fits = |index: u32, float: bool| match self.tensors.get(index as usize) {
            None => index == NONE,
            Some(_) => {
                let t = self.tensor(index);
                (t.rows, t.cols, t.channels) == (rows, cols, 1) && (t.dtype == Dtype::F32) == float
            }
        };
        let inputs = [self.image_tensor(), self.coarse_tensor(), self.coarse_f32_tensor()];
        let roles_fit = inputs[0] != NONE && fits(inputs[0], false) && fits(inputs[1], false) && fits(inputs[2], true);
        let present = || inputs.iter().filter(|&&i| i != NONE);
        let apart = present().enumerate().all(|(n, &a)| {
            present().skip(n + 1).all(|&b| a != b && roles_fit && !self.tensor(a).overlaps(&self.tensor(b)))
        });
        if roles_fit && apart { Ok(()) } else { Err(ModelError::Header) }
    }

    fn check_output(&self) -> Result<(), ModelError> {
        let (rows, cols) = self.tile();
        let written = self.operators.last().and_then(|record| Operator::decode(record).ok()).map(|op| op.output());
        let output = self.output_tensor();
        if written != Some(output) {
            return Err(ModelError::Header);
        }
        let t = self.tensor(output);
        let fits = (t.rows, t.cols, t.channels, t.dtype) == (rows, cols, 1, Dtype::F32);
        if fits { Ok(()) } else { Err(ModelError::Header) }
    }

    /// A tensor read by operator `index` must have one earlier writer, with nothing else written over it since; the output must
    /// not overlap what is read, but for an added tensor that coincides with it (each sample is read before it is written).
    fn check_liveness(&self, index: usize, operator: &Operator) -> Result<(), OperatorFault> {
        let out_index = operator.output();
        let out = self.tensor(out_index);
        let earlier = |i: usize| Operator::decode(&self.operators[i]).map(|op| op.output());
        let is_input = |t: u32| [self.image_tensor(), self.coarse_tensor(), self.coarse_f32_tensor()].contains(&t);
        for (slot, input) in operator.inputs().into_iter().enumerate() {
            let Some(input) = input else { continue };
            let tensor = self.tensor(input);
            let mut live = is_input(input);
            for i in 0..index {
                let written = earlier(i)?;
                if written == input {
                    live = true;
                } else if self.tensor(written).overlaps(&tensor) {
                    live = false;
                }
            }
            if !live {
                return Err(OperatorFault::Liveness);
            }
            let in_place = slot == 2 && out.coincides(&tensor);
            if out.overlaps(&tensor) && !in_place {
                return Err(OperatorFault::Overlap);
            }
        }
        for i in 0..index {
            if earlier(i)? == out_index {
                return Err(OperatorFault::Overlap);
            }
        }
        if is_input(out_index) { Err(OperatorFault::Overlap) } else { Ok(()) }
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
        }
    }

    fn check_conv(&self, conv: &Conv) -> Result<usize, OperatorFault> {
        let out = self.tensor(conv.out);
        let sides = [conv.kernel_rows, conv.kernel_cols];
        let legal = sides.iter().all(|k| (1..=MAX_KERNEL).contains(k) && conv.pad < *k)
            && (1..=MAX_KERNEL).contains(&conv.stride)
            && conv.add_shift <= MAX_ADD_SHIFT
            && conv.sources().all(|s| s.shift <= if s.up { 4 } else { 0 });
        if !legal {
            return Err(OperatorFault::Parameter);
        }
        if conv.sources().any(|s| self.tensor(s.tensor).dtype == Dtype::F32) {
            return Err(OperatorFault::Type);
        }
        let shape = self.conv_shape(conv);
        let size = |s: &Source| self.source_extent(s);
        let extent = |len: usize, kernel: usize| (len + 2 * conv.pad).checked_sub(kernel).map(|n| n / conv.stride + 1);
        let fits = conv.sources().all(|s| size(&s) == (shape.in_rows, shape.in_cols))
            && extent(shape.in_rows, conv.kernel_rows) == Some(out.rows)
            && extent(shape.in_cols, conv.kernel_cols) == Some(out.cols)
            && shape.in_rows.max(shape.in_cols).max(shape.in_channels) <= MAX_EXTENT
            && shape.scratch_bytes(conv) <= MAX_SCRATCH_BYTES;
        if !fits {
            return Err(OperatorFault::Shape);
        }
        self.check_conv_finish(conv, &out)?;
        self.check_conv_weights(conv, &out, &shape)?;
        Ok(shape.scratch_bytes(conv) as usize)
    }

    /// Requantisation, addition and table of a convolution.
    fn check_conv_finish(&self, conv: &Conv, out: &Tensor) -> Result<(), OperatorFault> {
        let float = out.dtype == Dtype::F32;
        if let Some(add) = conv.add {
            let add = self.tensor(add);
            if (add.rows, add.cols, add.channels) != (out.rows, out.cols, out.channels) {
                return Err(OperatorFault::Shape);
            }
            if (add.dtype == Dtype::F32) != float {
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

    /// The K limit, exactly: with the weights as they are, no accumulator can leave i32.
    fn check_conv_weights(&self, conv: &Conv, out: &Tensor, shape: &ConvShape) -> Result<(), OperatorFault> {
        let mut largest = 0;
        for source in conv.sources() {
            let magnitude = self.tensor(source.tensor).magnitude();
            let read = if source.up { (magnitude * 16 + 15) >> source.shift } else { magnitude };
            largest = largest.max(read);
        }
        if largest > i16::MAX as i32 {
            return Err(OperatorFault::Overflow);
        }
        let weights = self.constant_slice(conv.weights, out.channels, conv.kernel_rows * shape.segment)?;
        let bias = self.constant_slice(conv.bias, out.channels, 4)?;
        for (o, rows) in weights.chunks_exact(conv.kernel_rows * shape.segment).enumerate() {
            let mut sum = 0u64;
            for segment in rows.chunks_exact(shape.segment) {
                let (used, rest) = segment.split_at(conv.kernel_cols * shape.in_channels);
                if rest.iter().any(|&w| w != 0) {
                    return Err(OperatorFault::Constants);
                }
                sum += used.iter().map(|&w| (w as i8).unsigned_abs() as u64).sum::<u64>();
            }
            if sum * largest as u64 + i32_at(bias, 4 * o).unsigned_abs() as u64 > i32::MAX as u64 {
                return Err(OperatorFault::Overflow);
            }
        }
        Ok(())
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
        Ok(padded(out.channels) * size_of::<Le16>())
    }

    fn check_attention(&self, a: &Attention) -> Result<usize, OperatorFault> {
        let (input, out) = (self.tensor(a.input), self.tensor(a.out));
        let shifts = [a.shift_rows, a.shift_cols];
        if !(1..=MAX_WINDOW).contains(&a.window) || a.heads == 0 || shifts.iter().any(|s| *s >= a.window) {
            return Err(OperatorFault::Parameter);
        }
        if input.dtype == Dtype::F32 || out.dtype == Dtype::F32 {
            return Err(OperatorFault::Type);
        }
        let fits = (input.rows, input.cols, input.channels) == (out.rows, out.cols, 3 * out.channels)
            && a.heads <= out.channels
            && out.channels % a.heads == 0;
        if !fits {
            return Err(OperatorFault::Shape);
        }
        let (tokens, head) = (a.window * a.window, out.channels / a.heads);
        self.check_multipliers(a.logit_multipliers, a.heads, a.logit_shift)?;
        self.check_multipliers(a.multipliers, a.heads, a.shift)?;
        self.constant_slice(a.position_bias, a.heads, 2 * (2 * a.window - 1) * (2 * a.window - 1))?;
        let exp = self.constant_slice(a.exp_table, a.exp_len, 2)?.as_chunks::<2>().0;
        // The first entry is met by every row's maximum: it keeps the sum away from 0.
        if exp.first().is_none_or(|&e| i16::from_le_bytes(e) < 1 << 14)
            || exp.iter().any(|&e| i16::from_le_bytes(e) < 0)
        {
            return Err(OperatorFault::Constants);
        }
        let pad = self.constant_slice(a.pad_codes, input.channels, 2)?.as_chunks::<2>().0;
        let pad_magnitude = pad.iter().map(|&p| i16::from_le_bytes(p).unsigned_abs() as u64).max().unwrap_or(0);
        let magnitude = pad_magnitude.max(input.magnitude() as u64);
        let overflow = head as u64 * magnitude * magnitude > i32::MAX as u64
            || tokens as u64 * magnitude * i16::MAX as u64 > i32::MAX as u64
            || magnitude > i16::MAX as u64;
        if overflow {
            return Err(OperatorFault::Overflow);
        }
        Ok(size_of::<Le16>() * (2 * tokens * padded(head) + head * padded(tokens) + padded(tokens)))
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
        Ok(&self.constants[offset..end as usize])
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
        if self.raw.word(word::TARGET_RANGE) == 0 { TruthRange::Own } else { TruthRange::Reference }
    }

    /// Which light the network knows.
    pub fn illumination(&self) -> Illumination {
        if self.raw.word(word::ILLUMINATION) == 0 { Illumination::Any } else { Illumination::Northwest }
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
    pub fn tensor(&self, index: u32) -> Tensor {
        self.tensors.get(index as usize).and_then(|record| Tensor::decode(record)).unwrap_or(Tensor::SINGLE)
    }

    /// Operator `index`, or `None` beyond the last.
    pub fn operator(&self, index: usize) -> Option<Operator> {
        self.operators.get(index).and_then(|record| Operator::decode(record).ok())
    }

    /// Number of the tensor that takes the image.
    pub fn image_tensor(&self) -> u32 {
        self.raw.word(word::IMAGE)
    }

    /// Number of the tensor that takes the coarse DTM as codes, or [`NONE`].
    pub fn coarse_tensor(&self) -> u32 {
        self.raw.word(word::COARSE)
    }

    /// Number of the tensor that takes the coarse DTM as f32, or [`NONE`].
    pub fn coarse_f32_tensor(&self) -> u32 {
        self.raw.word(word::COARSE_F32)
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
        self.constants.get(offset..offset + len).unwrap_or(&[])
    }

    /// The i32 constant number `index` of the list at `offset`.
    #[inline]
    pub(crate) fn constant_i32(&self, offset: usize, index: usize) -> i32 {
        i32_at(self.constants, offset + 4 * index)
    }

    /// The i64 constant number `index` of the list at `offset`.
    #[inline]
    pub(crate) fn constant_i64(&self, offset: usize, index: usize) -> i64 {
        i64_at(self.constants, offset + 8 * index)
    }

    /// The f32 constant number `index` of the list at `offset`.
    #[inline]
    pub(crate) fn constant_f32(&self, offset: usize, index: usize) -> f32 {
        f32::from_bits(u32_at(self.constants, offset + 4 * index))
    }

    fn source_extent(&self, source: &Source) -> (usize, usize) {
        let (t, factor) = (self.tensor(source.tensor), if source.up { 2 } else { 1 });
        (t.rows * factor, t.cols * factor)
    }

    /// Sizes of a convolution's work.
    pub fn conv_shape(&self, conv: &Conv) -> ConvShape {
        let (in_rows, in_cols) = self.source_extent(&conv.first);
        let in_channels = conv.sources().map(|s| self.tensor(s.tensor).channels).sum();
        let segment = conv.segment(in_channels);
        // The last segment of a row may read up to one lane block beyond it, against zero weights.
        let row_samples = padded((in_cols + 2 * conv.pad) * in_channels) + padded(1);
        ConvShape { in_rows, in_cols, in_channels, segment, row_samples }
    }

    /// Units of work of an operator: one row of some output channels, one row of pixels, or one head in one window.
    pub fn units(&self, operator: &Operator) -> usize {
        let out = self.tensor(operator.output());
        match operator {
            Operator::Conv(_) => out.rows * out.channels.div_ceil(CHANNEL_GROUP),
            Operator::LayerNorm(_) => out.rows,
            Operator::Attention(a) => out.rows.div_ceil(a.window) * out.cols.div_ceil(a.window) * a.heads,
        }
    }

    /// Multiply-accumulates of unit `unit` of an operator. A layer norm counts four per sample.
    pub fn unit_macs(&self, operator: &Operator, unit: usize) -> u64 {
        let out = self.tensor(operator.output());
        match operator {
            Operator::Conv(conv) => {
                let first = unit % out.channels.div_ceil(CHANNEL_GROUP) * CHANNEL_GROUP;
                let channels = (out.channels - first).min(CHANNEL_GROUP);
                self.taps(conv) * (out.cols * channels) as u64
            }
            Operator::LayerNorm(_) => 4 * (out.cols * out.channels) as u64,
            Operator::Attention(a) => 2 * (out.channels / a.heads) as u64 * (a.window as u64).pow(4),
        }
    }

    /// Multiply-accumulates of a whole operator.
    pub fn operator_macs(&self, operator: &Operator) -> u64 {
        match operator {
            Operator::Conv(conv) => self.taps(conv).saturating_mul(self.tensor(conv.out).len() as u64),
            _ => (self.units(operator) as u64).saturating_mul(self.unit_macs(operator, 0)),
        }
    }

    /// Weights per output channel.
    fn taps(&self, conv: &Conv) -> u64 {
        (conv.kernel_rows * conv.kernel_cols * self.conv_shape(conv).in_channels) as u64
    }
}
