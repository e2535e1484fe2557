//! The record of a tensor.

use super::bytes::u32_at;
use super::limits::MAX_MARGIN;
use super::seal::{seal_record, sealed};
use crate::nn::tensor::{Dtype, Edge, Tensor};

/// Bytes of a tensor record.
pub const TENSOR_BYTES: usize = 60;

impl Tensor {
    /// Reads a record; `None` if a field is outside its type's range, or the record's seal is broken.
    pub fn decode(record: &[u8]) -> Option<Self> {
        sealed(record).then_some(())?;
        let word = |i: usize| u32_at(record, 4 * i);
        let tensor = Self { dtype: Dtype::from_code(word(0))?, ..Self::read(record) };
        let (low, high) = match tensor.dtype {
            Dtype::U8 => (0, 255),
            Dtype::I16 => (-32767, 32767),
            Dtype::F32 => (0, 0),
        };
        let codes = [tensor.lo, tensor.zero, tensor.hi];
        let legal = codes.iter().all(|c| (low..=high).contains(c))
            && tensor.lo <= tensor.hi
            && (tensor.dtype == Dtype::U8 || tensor.zero == 0)
            && (1..=tensor.rows).contains(&tensor.ring)
            && tensor.margin <= MAX_MARGIN
            && (1..=1 << 24).contains(&tensor.pitch)
            && (tensor.dtype != Dtype::F32 || tensor.margin == 0);
        (legal && Edge::from_code(word(11)).is_some() && tensor.scale.is_finite() && tensor.scale > 0.0)
            .then_some(tensor)
    }

    /// Reads a record that [`Self::decode`] has accepted.
    #[inline]
    pub(crate) fn read(record: &[u8]) -> Self {
        let word = |i: usize| u32_at(record, 4 * i);
        Self {
            dtype: Dtype::from_code(word(0)).unwrap_or(Dtype::U8),
            rows: word(1) as usize,
            cols: word(2) as usize,
            channels: word(3) as usize,
            offset: word(4) as usize,
            zero: word(5) as i32,
            lo: word(6) as i32,
            hi: word(7) as i32,
            scale: f32::from_bits(word(8)),
            ring: word(9) as usize,
            margin: word(10) as usize,
            edge: Edge::from_code(word(11)).unwrap_or(Edge::Nearest),
            pitch: word(12) as usize,
            sums: word(13) as usize,
        }
    }

    /// Returns the record's bytes.
    pub fn encode(&self) -> [u8; TENSOR_BYTES] {
        let words = [
            self.dtype.code(),
            self.rows as u32,
            self.cols as u32,
            self.channels as u32,
            self.offset as u32,
            self.zero as u32,
            self.lo as u32,
            self.hi as u32,
            self.scale.to_bits(),
            self.ring as u32,
            self.margin as u32,
            self.edge.code(),
            self.pitch as u32,
            self.sums as u32,
        ];
        let mut record = [0; TENSOR_BYTES];
        record.as_chunks_mut::<4>().0.iter_mut().zip(words).for_each(|(bytes, word)| *bytes = word.to_le_bytes());
        seal_record(&mut record);
        record
    }
}
