//! Model files of a few operators.

use crate::nn::file::{Content, Conv, Dtype, Entry, NONE, Operator, Tensor};

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
        draft.place(Tensor { lo: 0, hi: 255, ..Tensor::new(Dtype::U8, tile, 1) });
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
            ..Conv::default()
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
        self.output = self.place(Tensor { lo: 0, hi: 0, ..Tensor::new(Dtype::F32, self.tile, 1) });
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
        let content = Content {
            tensors: &self.tensors,
            operators: &self.operators,
            schedule: &self.schedule,
            constants: &self.constants,
            tile: self.tile,
            roles: [0, self.coarse, self.output],
            ..Content::default()
        };
        let mut bytes = vec![0; content.file_bytes()];
        content.write(&mut bytes).unwrap();
        bytes
    }
}
