//! Tensors: the properties of a map, and the place of its rows in the arena.

/// Sample type of a tensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dtype {
    /// One byte; value = code - zero.
    U8,
    /// Two planes in every row: first all low bytes, then all high bytes plus 128. Both planes are rows of u8, so a kernel for u8 also
    /// works on 16-bit maps. value = code = 256 * (high - 128) + low.
    I16,
    /// IEEE 754 single, little-endian: the result.
    F32,
}

impl Dtype {
    /// Bytes per sample.
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::I16 => 2,
            Self::F32 => 4,
        }
    }
}

/// The contents of a tensor's margin columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edge {
    /// The code of 0: zero padding.
    Zero,
    /// The nearest pixel of the row, for bilinear interpolation.
    Nearest,
}

/// A tensor `[rows, cols, channels]` in the arena. Row r is in slot `r mod ring`. Every row has `margin` more columns on both sides, so
/// that kernels can read over the border without a check.
#[derive(Debug, Clone, Copy)]
pub struct Tensor {
    /// Sample type.
    pub dtype: Dtype,
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub cols: usize,
    /// Number of channels.
    pub channels: usize,
    /// Offset in the arena, bytes.
    pub offset: usize,
    /// The code that stands for 0 (0 for I16).
    pub zero: i32,
    /// Smallest code its writer may store.
    pub lo: i32,
    /// Largest code its writer may store.
    pub hi: i32,
    /// Real value of one code step. The runner uses it for its inputs only (other tensors may have a scale per channel).
    pub scale: f32,
    /// Number of rows kept at a time; equal to `rows` if all are kept.
    pub ring: usize,
    /// Bytes from one row to the next in the arena; larger than a row if rows of another tensor are in between.
    pub pitch: usize,
    /// Number of margin columns before the first column and behind the last.
    pub margin: usize,
    /// The contents of the margin.
    pub edge: Edge,
    /// Index of the first row's checksum in the arena's list: the sum of the rings of the tensors before this one.
    pub sums: usize,
}

impl PartialEq for Tensor {
    /// Compares bits: within a run nothing is computed in floating point.
    fn eq(&self, other: &Self) -> bool {
        let parts = |tensor: &Self| {
            let Self { dtype, rows, cols, channels, offset, zero, lo, hi, scale, ring, pitch, margin, edge, sums } =
                *tensor;
            ((dtype, edge, zero, lo, hi, scale.to_bits()), [rows, cols, channels, offset, ring, pitch, margin, sums])
        };
        parts(self) == parts(other)
    }
}

impl Tensor {
    /// A tensor of one u8.
    pub(crate) const SINGLE: Self = Self::new(Dtype::U8, (1, 1), 1);

    /// Returns a tensor at the start of the arena that keeps all its rows, without margin, with codes of 0 alone and a step of 1.
    pub const fn new(dtype: Dtype, (rows, cols): (usize, usize), channels: usize) -> Self {
        Self {
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
            pitch: cols * channels * dtype.bytes(),
            margin: 0,
            edge: Edge::Zero,
            sums: 0,
        }
    }

    /// Number of samples.
    pub const fn len(&self) -> usize {
        self.rows * self.cols * self.channels
    }

    /// Returns whether the tensor has no samples (never in a validated model).
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of bytes from its first to its last in the arena.
    pub const fn size_bytes(&self) -> usize {
        (self.ring - 1) * self.pitch + self.row_bytes()
    }

    /// Number of bytes of one row, with margins and planes.
    pub const fn row_bytes(&self) -> usize {
        (self.cols + 2 * self.margin) * self.channels * self.dtype.bytes()
    }

    /// Number of bytes of one plane of a row: the whole row, except for I16.
    pub const fn plane_bytes(&self) -> usize {
        (self.cols + 2 * self.margin) * self.channels
    }

    /// Returns the slot of row `row`.
    #[inline(always)]
    pub const fn slot(&self, row: usize) -> usize {
        // Most tensors keep all rows, and a division is slow on small processors.
        if row < self.ring || self.ring == 0 { row } else { row % self.ring }
    }

    /// Returns the offset in the arena of row `row`, margin included.
    #[inline(always)]
    pub const fn row_offset(&self, row: usize) -> usize {
        self.offset + self.slot(row) * self.pitch
    }

    /// Returns the largest absolute value, in code steps from zero.
    pub fn magnitude(&self) -> i32 {
        (self.hi - self.zero).abs().max((self.lo - self.zero).abs())
    }

    /// Returns whether two tensors share arena bytes.
    pub const fn overlaps(&self, other: &Self) -> bool {
        let apart = self.offset >= other.offset + other.size_bytes() || other.offset >= self.offset + self.size_bytes();
        !apart && !self.alternates(other)
    }

    /// Returns whether the rows of two tensors alternate in memory.
    const fn alternates(&self, other: &Self) -> bool {
        let (first, second) = if self.offset <= other.offset { (self, other) } else { (other, self) };
        let skew = second.offset - first.offset;
        first.pitch == second.pitch && first.row_bytes() <= skew && skew + second.row_bytes() <= first.pitch
    }

    /// Returns whether two tensors are the same bytes read in the same way.
    pub fn coincides(&self, other: &Self) -> bool {
        let place = |t: &Self| (t.offset, t.pitch, t.dtype, t.rows, t.cols, t.channels, t.ring, t.margin);
        place(self) == place(other)
    }

    /// Returns how rows of this tensor are overwritten by `later`, if both are kept whole and have the same pitch: once `later` has n rows,
    /// the rows below n + the returned number are overwritten. `None` if rows do not follow each other in that way.
    pub fn overwritten_by(&self, later: &Self) -> Option<isize> {
        let whole = self.ring == self.rows && later.ring == later.rows && self.pitch == later.pitch;
        let end = (later.offset + later.row_bytes()) as isize - self.offset as isize;
        let pitch = isize::try_from(self.pitch).unwrap_or(isize::MAX).max(1);
        let rows = end.div_euclid(pitch) + (end.rem_euclid(pitch) != 0) as isize;
        whole.then_some(rows - 1)
    }
}
