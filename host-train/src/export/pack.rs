//! Weights in the order in which kernels read them.

use super::graph::Kernel;
use super::quantise::Integers;
use elunar_core::nn::kernels::panels;
use elunar_core::nn::{Dtype, Tensor, groups};

/// Filters of all output channels, real weights.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Filter {
    /// Kernel rows and columns.
    pub(crate) extent: (usize, usize),
    /// `[output][rows][cols][input]`.
    pub(crate) weights: Vec<f64>,
}

impl Filter {
    /// A kernel as it is.
    pub(crate) fn whole(kernel: &Kernel) -> Self {
        let weights = kernel.weights.iter().map(|w| *w as f64).collect();
        Self { extent: (kernel.side, kernel.side), weights }
    }
}

/// Constants of a convolution.
pub(crate) struct Packed {
    /// i8 `[variant][panel][source][kernel row][group][channel of the panel][4]`.
    pub(crate) weights: Vec<u8>,
    /// `[variant][output]`, with what the sources' zero codes contribute taken off (it may wrap).
    pub(crate) bias: Vec<i32>,
}

/// Packs the filters of `output` channels that read `sources` side by side.
pub(crate) fn pack(integers: &Integers, output: usize, sources: &[Tensor]) -> Packed {
    let input: usize = sources.iter().map(|t| t.channels).sum();
    let mut packed = Packed { weights: Vec::new(), bias: Vec::new() };
    for filter in &integers.filters {
        let (rows, cols) = filter.extent;
        let weight = |o: usize, row: usize, col: usize, channel: usize| {
            filter.weights[((o * rows + row) * cols + col) * input + channel]
        };
        for (first, width) in panels(output) {
            let mut skipped = 0;
            for source in sources {
                let samples = cols * source.channels;
                for row in 0..rows {
                    for group in 0..groups(samples) {
                        for o in first..first + width {
                            packed.weights.extend((4 * group..4 * group + 4).map(|k| {
                                let inside = o < output && k < samples;
                                let channel = skipped + k % source.channels;
                                if inside { weight(o, row, k / source.channels, channel) as u8 } else { 0 }
                            }));
                        }
                    }
                }
                skipped += source.channels;
            }
        }
        for (o, bias) in filter.bias.iter().enumerate() {
            let mut zeros = 0i64;
            let mut skipped = 0;
            for source in sources {
                // The planes of a 16-bit code 0 are 0 and 128.
                let zero = if source.dtype == Dtype::I16 { 128 * 256 } else { source.zero as i64 };
                for (row, col) in (0..rows * cols).map(|i| (i / cols, i % cols)) {
                    let sum: i64 = (0..source.channels).map(|c| weight(o, row, col, skipped + c) as i64).sum();
                    zeros += zero * sum;
                }
                skipped += source.channels;
            }
            packed.bias.push((*bias as i64 - zeros) as i32);
        }
    }
    packed
}
