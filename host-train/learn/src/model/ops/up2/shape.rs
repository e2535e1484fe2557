//! Sizes of the operator.

/// Smallest side of the small map. Below it, the plain order is as fast.
pub(in super::super) const MIN_SIDE: usize = 3;

/// Side of a kernel.
pub(super) const SIDE: usize = 5;
/// Number of weights of a kernel.
pub(super) const KERNEL: usize = SIDE * SIDE;

/// Sizes of the operator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in super::super) struct Up2Shape {
    /// Images.
    pub(in super::super) images: usize,
    /// Channels in and out.
    pub(in super::super) channels: [usize; 2],
    /// Rows and columns of the small map, at least [`MIN_SIDE`].
    pub(in super::super) small: [usize; 2],
}

impl Up2Shape {
    /// Returns the number of values of the input, the weight and the output.
    pub(in super::super) fn lengths(&self) -> [usize; 3] {
        let ([input, output], [rows, cols]) = (self.channels, self.small);
        let pixels = self.images * rows * cols;
        [pixels * input, input * output * KERNEL, 4 * pixels * output]
    }
}
