//! How large random programs may be.

/// Largest sizes of a program.
#[derive(Debug, Clone, Copy)]
pub struct Sizes {
    /// Most rows and columns of a tile.
    pub tile: (usize, usize),
    /// Most operators before the one that writes the output; attention counts as one.
    pub operators: usize,
    /// Numbers of channels of a convolution, and of a head of attention.
    pub channels: &'static [usize],
    /// See [`Self::channels`].
    pub head_channels: &'static [usize],
    /// Largest window of attention.
    pub window: usize,
    /// Most bytes of the arena.
    pub arena_bytes: usize,
    /// Most bytes of the constants. A program is drawn in a time that grows with them, and run in one that hardly does.
    pub constant_bytes: usize,
}

impl Sizes {
    /// For campaigns: channels at and beside the widths of kernels.
    pub const USUAL: Self = Self {
        tile: (20, 14),
        operators: 6,
        channels: &[1, 2, 3, 4, 7, 8, 9, 12, 15, 16, 17, 24, 25, 32, 40],
        head_channels: &[1, 2, 3, 4, 5, 8, 9, 17],
        window: 8,
        arena_bytes: 1 << 19,
        constant_bytes: 1 << 15,
    };

    /// For an interpreter, and as first files for fuzzing.
    pub const SMALL: Self = Self {
        tile: (6, 6),
        operators: 4,
        channels: &[1, 2, 3, 4, 7, 8, 9, 17, 33],
        head_channels: &[1, 2, 3, 5],
        window: 3,
        arena_bytes: 1 << 14,
        constant_bytes: 5 << 9,
    };
}
