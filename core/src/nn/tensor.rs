//! Tensors: what a map is and where its rows lie in the arena.

/// Sample type of a tensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dtype {
    /// One byte; value = code - zero.
    U8,
    /// Two planes in every row: first all low bytes, then all high bytes plus 128. So both planes are rows of u8, and a kernel
    /// for u8 serves 16-bit maps too. value = code = 256 * (high - 128) + low.
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

/// What a tensor's margin columns hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edge {
    /// The code of 0: zero padding.
    Zero,
    /// The nearest pixel of the row: what bilinear interpolation wants.
    Nearest,
}

/// A tensor `[rows, cols, channels]` in the arena. Row r lies in slot `r mod ring`; every row has `margin` columns more on both
/// sides, so that kernels read over the border without asking.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tensor {
    /// Sample type.
    pub dtype: Dtype,
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Channels.
    pub channels: usize,
    /// First byte in the arena.
    pub offset: usize,
    /// The code that stands for 0 (0 with I16).
    pub zero: i32,
    /// Smallest code its writer may store.
    pub lo: i32,
    /// Largest code its writer may store.
    pub hi: i32,
    /// Real value of one code step; the runner uses it for its inputs only (other tensors may have a scale per channel).
    pub scale: f32,
    /// Rows kept at a time; `rows` keeps all.
    pub ring: usize,
    /// Bytes from one row to the next in the arena; more than a row has if another tensor's rows lie between.
    pub pitch: usize,
    /// Columns before the first and behind the last.
    pub margin: usize,
    /// What the margin holds.
    pub edge: Edge,
    /// Number of its first row's checksum in the arena's list: the rings of the tensors before it together.
    pub sums: usize,
}

impl Tensor {
    /// One u8.
    pub(crate) const SINGLE: Self = Self {
        dtype: Dtype::U8,
        rows: 1,
        cols: 1,
        channels: 1,
        offset: 0,
        zero: 0,
        lo: 0,
        hi: 0,
        scale: 1.0,
        ring: 1,
        pitch: 1,
        margin: 0,
        edge: Edge::Zero,
        sums: 0,
    };

    /// Samples.
    pub const fn len(&self) -> usize {
        self.rows * self.cols * self.channels
    }

    /// Whether it has no samples (never in a validated model).
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes from its first to its last in the arena.
    pub const fn size_bytes(&self) -> usize {
        (self.ring - 1) * self.pitch + self.row_bytes()
    }

    /// Bytes of one row, margins and planes included.
    pub const fn row_bytes(&self) -> usize {
        (self.cols + 2 * self.margin) * self.channels * self.dtype.bytes()
    }

    /// Bytes of one plane of a row: all of it but for I16.
    pub const fn plane_bytes(&self) -> usize {
        (self.cols + 2 * self.margin) * self.channels
    }

    /// Which of the kept rows row `row` is.
    #[inline(always)]
    pub const fn slot(&self, row: usize) -> usize {
        // Most tensors keep all rows; a division is slow on small machines.
        if row < self.ring || self.ring == 0 { row } else { row % self.ring }
    }

    /// Place in the arena of row `row`, margin included.
    #[inline(always)]
    pub const fn row_offset(&self, row: usize) -> usize {
        self.offset + self.slot(row) * self.pitch
    }

    /// Largest absolute value, in code steps from zero.
    pub fn magnitude(&self) -> i32 {
        (self.hi - self.zero).abs().max((self.lo - self.zero).abs())
    }

    /// Whether two tensors share arena bytes.
    pub const fn overlaps(&self, other: &Self) -> bool {
        let apart = self.offset >= other.offset + other.size_bytes() || other.offset >= self.offset + self.size_bytes();
        !apart && !self.alternates(other)
    }

    /// Whether the rows of two tensors lie between each other.
    const fn alternates(&self, other: &Self) -> bool {
        let (first, second) = if self.offset <= other.offset { (self, other) } else { (other, self) };
        let skew = second.offset - first.offset;
        first.pitch == second.pitch && first.row_bytes() <= skew && skew + second.row_bytes() <= first.pitch
    }

    /// Whether two tensors are the very same bytes read in the same way.
    pub fn coincides(&self, other: &Self) -> bool {
        let place = |t: &Self| (t.offset, t.pitch, t.dtype, t.rows, t.cols, t.channels, t.ring, t.margin);
        place(self) == place(other)
    }

    /// Rows of this tensor that `later` overwrites, if both are kept whole and have one pitch: once `later` has n rows, those
    /// below n + the number returned. `None` if rows do not follow each other in that way.
    pub fn overwritten_by(&self, later: &Self) -> Option<isize> {
        let whole = self.ring == self.rows && later.ring == later.rows && self.pitch == later.pitch;
        let end = (later.offset + later.row_bytes()) as isize - self.offset as isize;
        let pitch = isize::try_from(self.pitch).unwrap_or(isize::MAX).max(1);
        let rows = end.div_euclid(pitch) + (end.rem_euclid(pitch) != 0) as isize;
        whole.then_some(rows - 1)
    }
}
