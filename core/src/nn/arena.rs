//! Reading and writing tensors in the caller's bytes.

use super::kernels::Le16;
use super::program::{Dtype, Tensor};

/// The two parts of the lent memory.
#[derive(Debug)]
pub(crate) struct Arena<'m> {
    /// Tensors at their planned offsets.
    pub(crate) tensors: &'m mut [u8],
    /// Scratch memory of the operator at work.
    pub(crate) scratch: &'m mut [Le16],
}

impl<'m> Arena<'m> {
    /// Divides `bytes`, which are long enough.
    pub(crate) fn new(bytes: &'m mut [u8], scratch_offset: usize, scratch_bytes: usize) -> Self {
        let (tensors, rest) = bytes.split_at_mut(scratch_offset);
        Self { tensors, scratch: rest[..scratch_bytes].as_chunks_mut().0 }
    }

    /// The value (zero point removed) of sample `index`.
    #[inline(always)]
    pub(crate) fn value(&self, tensor: &Tensor, index: usize) -> i32 {
        value(self.tensors, tensor, index)
    }

    /// Stores a code at sample `index`; it is within the tensor's limits.
    #[inline(always)]
    pub(crate) fn store(&mut self, tensor: &Tensor, index: usize, code: i32) {
        match tensor.dtype {
            Dtype::U8 => self.tensors[tensor.offset + index] = code as u8,
            _ => {
                let at = tensor.offset + 2 * index;
                [self.tensors[at], self.tensors[at + 1]] = (code as i16).to_le_bytes();
            }
        }
    }

    /// The f32 at sample `index`.
    #[inline(always)]
    pub(crate) fn float(&self, tensor: &Tensor, index: usize) -> f32 {
        let at = tensor.offset + 4 * index;
        self.tensors[at..].first_chunk().map_or(0.0, |&b| f32::from_le_bytes(b))
    }

    /// Stores an f32 at sample `index`.
    #[inline(always)]
    pub(crate) fn store_float(&mut self, tensor: &Tensor, index: usize, value: f32) {
        let at = tensor.offset + 4 * index;
        self.tensors[at..at + 4].copy_from_slice(&value.to_le_bytes());
    }

    /// Bytes of one row of a tensor.
    #[inline(always)]
    pub(crate) fn row(&self, tensor: &Tensor, row: usize) -> &[u8] {
        let start = tensor.offset + row * tensor.row_bytes();
        &self.tensors[start..start + tensor.row_bytes()]
    }
}

/// The value (zero point removed) of sample `index`.
#[inline(always)]
pub(crate) fn value(tensors: &[u8], tensor: &Tensor, index: usize) -> i32 {
    let code = match tensor.dtype {
        Dtype::U8 => tensors[tensor.offset + index] as i32,
        _ => {
            let at = tensor.offset + 2 * index;
            i16::from_le_bytes([tensors[at], tensors[at + 1]]) as i32
        }
    };
    code - tensor.zero
}

/// A sample type that rows are read from, with its zero point removed.
pub(crate) trait Sample: Copy {
    /// `bytes` as samples.
    fn cast(bytes: &[u8]) -> &[Self];
    /// The code.
    fn code(self) -> i32;
}

impl Sample for u8 {
    #[inline(always)]
    fn cast(bytes: &[u8]) -> &[Self] {
        bytes
    }
    #[inline(always)]
    fn code(self) -> i32 {
        self as i32
    }
}

impl Sample for Le16 {
    #[inline(always)]
    fn cast(bytes: &[u8]) -> &[Self] {
        bytes.as_chunks().0
    }
    #[inline(always)]
    fn code(self) -> i32 {
        i16::from_le_bytes(self) as i32
    }
}
