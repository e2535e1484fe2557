//! Model files of a few operators, written only from the description of the format.

use crate::nn::file::{
    CHUNK_BYTES, CHUNK_RECORD_BYTES, Conv, Dtype, Edge, Entry, HEADER_BYTES, MAGIC, NONE, Operator, Tensor, VERSION,
    seal_file, word,
};

/// A model under construction.
#[derive(Clone)]
pub(crate) struct Draft {
    pub(crate) tensors: Vec<Tensor>,
    pub(crate) operators: Vec<Operator>,
    pub(crate) schedule: Vec<Entry>,
    pub(crate) constants: Vec<u8>,
    pub(crate) tile: (usize, usize),
    pub(crate) coarse: u32,
    pub(crate) output: u32,
}

impl Draft {
    /// Makes a draft with an image (tensor 0) of this size and nothing else.
    pub(crate) fn new(tile: (usize, usize)) -> Self {
        let none = Vec::new();
        let mut draft = Self {
            tensors: Vec::new(),
            operators: Vec::new(),
            schedule: Vec::new(),
            constants: none,
            tile,
            coarse: NONE,
            output: NONE,
        };
        draft.place(Tensor { lo: 0, hi: 255, ..map(Dtype::U8, tile, 1) });
        draft
    }

    /// Adds a tensor a few bytes behind the others.
    pub(crate) fn place(&mut self, tensor: Tensor) -> u32 {
        let end = self.tensors.iter().map(|t| t.offset + t.size_bytes()).max();
        let pitch = tensor.pitch.max(tensor.row_bytes());
        self.tensors.push(Tensor { offset: end.map_or(0, |end| end + 3), pitch, ..tensor });
        self.tensors.len() as u32 - 1
    }

    /// Adds constants; returns their offset.
    pub(crate) fn constant(&mut self, bytes: impl IntoIterator<Item = u8>) -> usize {
        let at = self.constants.len();
        self.constants.extend(bytes);
        at
    }

    /// Adds i32 constants.
    pub(crate) fn words(&mut self, values: impl IntoIterator<Item = i32>) -> usize {
        self.constant(values.into_iter().flat_map(i32::to_le_bytes))
    }

    /// Adds an operator.
    pub(crate) fn operator(&mut self, operator: Operator) -> usize {
        self.operators.push(operator);
        self.operators.len() - 1
    }

    /// Returns a convolution with weights and biases of 0.
    pub(crate) fn silent(&mut self, input: u32, out: u32, (kernel, stride, pad): (usize, usize, usize)) -> Conv {
        let (x, y) = (self.tensors[input as usize], self.tensors[out as usize]);
        let weights =
            self.constant(vec![0; kernel * 4 * (kernel * x.channels).div_ceil(4) * y.channels.next_multiple_of(32)]);
        // Biases of 0, multipliers of 1 (or 0.0).
        let bias = self.words(vec![0; y.channels]);
        let one = (y.dtype != Dtype::F32) as i32;
        let multipliers = self.words(vec![one; y.channels]);
        Conv {
            out,
            first: input,
            kernel_rows: kernel,
            kernel_cols: kernel,
            stride,
            stride_cols: stride,
            block: 1,
            pad,
            weights,
            bias,
            multipliers,
            shift: one as u32,
            ..EMPTY
        }
    }

    /// Adds a tensor of the tile's size that a silent convolution computes from the image.
    pub(crate) fn made(&mut self, tensor: Tensor) -> u32 {
        let out = self.place(tensor);
        let conv = self.silent(0, out, (1, 1, 0));
        self.operator(Operator::Conv(conv));
        out
    }

    /// Adds the output, computed from the image.
    pub(crate) fn finish(&mut self) {
        self.output = self.place(Tensor { lo: 0, hi: 0, ..map(Dtype::F32, self.tile, 1) });
        let conv = self.silent(0, self.output, (1, 1, 0));
        self.operator(Operator::Conv(conv));
    }

    /// Adds one entry per operator, in their order.
    pub(crate) fn in_order(&mut self) {
        let entry = |(index, op): (usize, &Operator)| {
            let count = op.steps(&self.tensors[op.output() as usize]);
            Entry { operator: index, first: 0, count }
        };
        self.schedule = self.operators.iter().enumerate().map(entry).collect();
    }

    /// Returns the bytes of the file.
    pub(crate) fn file(&self) -> Vec<u8> {
        let text = b"{}".to_vec();
        let mut sums = 0;
        let counted = |t: &Tensor| {
            let counted = Tensor { sums, ..*t };
            sums += t.ring;
            counted.encode()
        };
        let sections: [(usize, Vec<u8>, usize); 5] = [
            (word::TEXT, text, 2),
            (word::TENSORS, self.tensors.iter().flat_map(counted).collect(), self.tensors.len()),
            (word::OPERATORS, self.operators.iter().flat_map(Operator::encode).collect(), self.operators.len()),
            (word::SCHEDULE, self.schedule.iter().flat_map(Entry::encode).collect(), self.schedule.len()),
            (word::CONSTANTS, self.constants.clone(), self.constants.len()),
        ];
        let body: usize = sections.iter().map(|s| s.1.len()).sum();
        let chunks = body.div_ceil(CHUNK_BYTES);
        let mut bytes = vec![0; HEADER_BYTES + CHUNK_RECORD_BYTES * chunks];
        bytes[..8].copy_from_slice(&MAGIC);
        let set = |bytes: &mut [u8], index: usize, value: u32| {
            bytes[4 * index..4 * index + 4].copy_from_slice(&value.to_le_bytes());
        };
        for (index, section, count) in sections {
            let start = bytes.len() as u32;
            set(&mut bytes, index, start);
            set(&mut bytes, index + 1, count as u32);
            bytes.extend(section);
        }
        let file_bytes = bytes.len() as u32;
        let fields = [
            (word::VERSION, VERSION),
            (word::FILE_BYTES, file_bytes),
            (word::CHUNK_BYTES, CHUNK_BYTES as u32),
            (word::CHUNKS, chunks as u32),
            (word::TILE, self.tile.0 as u32),
            (word::TILE + 1, self.tile.1 as u32),
            (word::NR, 50f32.to_bits()),
            (word::IMAGE, 0),
            (word::COARSE, self.coarse),
            (word::OUTPUT, self.output),
        ];
        fields.into_iter().for_each(|(index, value)| set(&mut bytes, index, value));
        seal_file(&mut bytes);
        bytes
    }
}

/// Returns a tensor that keeps all rows, without margin; [`Draft::place`] makes the pitch large enough.
pub(crate) fn map(dtype: Dtype, (rows, cols): (usize, usize), channels: usize) -> Tensor {
    Tensor {
        sums: 0,
        dtype,
        rows,
        cols,
        channels,
        offset: 0,
        zero: 0,
        lo: 0,
        hi: 0,
        scale: 1.0,
        ring: rows,
        pitch: 0,
        margin: 0,
        edge: Edge::Zero,
    }
}

/// A convolution with all fields 0 or absent.
pub(crate) const EMPTY: Conv = Conv {
    out: 0,
    first: 0,
    second: None,
    kernel_rows: 1,
    kernel_cols: 1,
    stride: 1,
    stride_cols: 1,
    block: 1,
    pad: 0,
    fold: false,
    weights: 0,
    bias: 0,
    multipliers: 0,
    shift: 1,
    add: None,
    add_multipliers: 0,
    add_shift: 0,
    table: None,
    table_zero: 0,
    relu: false,
};
