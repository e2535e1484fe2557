//! Weights in the order in which kernels read them.

use super::graph::LayerWeights;
use elunar_core::nn::file::{Dtype, Tensor, groups, panels};

/// Filters of all output channels, with real weights.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Filter {
    /// Kernel rows and columns.
    pub(crate) extent: (usize, usize),
    /// Weights `[output][rows][cols][input]`.
    pub(crate) weights: Vec<f64>,
    /// Whether its sums are added to those of another filter. That filter has the bias.
    pub(crate) correction: bool,
}

impl Filter {
    /// Makes a filter from an unchanged kernel.
    pub(crate) fn whole(kernel: &LayerWeights) -> Self {
        let weights = kernel.weights.iter().map(|w| *w as f64).collect();
        Self { extent: (kernel.side, kernel.side), weights, correction: false }
    }
}

/// Symmetric i8 weights with one scale per output channel, and the bias in steps of the accumulator.
pub(crate) struct Integers {
    /// Weights of each set of filters.
    pub(crate) filters: Vec<IntegerFilter>,
    /// Real value of one step of the accumulator, per output channel.
    pub(crate) scales: Vec<f64>,
}

/// One set of filters.
pub(crate) struct IntegerFilter {
    /// Kernel rows and columns.
    pub(crate) extent: (usize, usize),
    /// Weights `[output][rows][cols][input]`, -127..=127.
    pub(crate) weights: Vec<i8>,
    /// Bias `[output]`.
    pub(crate) bias: Vec<i32>,
}

/// Constants of a convolution.
pub(crate) struct Packed {
    /// Weights, i8 `[panel][variant][source][kernel row][group][channel of the panel][4]`.
    pub(crate) weights: Vec<u8>,
    /// Bias `[variant][output]`, minus the contribution of the sources' zero codes (the difference may wrap).
    pub(crate) bias: Vec<i32>,
}

/// Packs the filters of `output` channels that read the channels of all `sources`.
pub(crate) fn pack(integers: &Integers, output: usize, sources: &[Tensor]) -> Packed {
    let input: usize = sources.iter().map(|t| t.channels).sum();
    let mut packed = Packed { weights: Vec::new(), bias: Vec::new() };
    for panel in panels(output) {
        for filter in &integers.filters {
            pack_panel(filter, (output, input), panel, sources, &mut packed.weights);
        }
    }
    for filter in &integers.filters {
        let taps = filter.weights.len() / output;
        for (weights, bias) in filter.weights.chunks_exact(taps).zip(&filter.bias) {
            let mut zeros = 0i64;
            for pixel in weights.chunks_exact(input) {
                let mut skipped = 0;
                for source in sources {
                    // A 16-bit code 0 has the planes 0 and 128.
                    let zero = if source.dtype == Dtype::I16 { 128 * 256 } else { source.zero as i64 };
                    zeros += zero * pixel[skipped..skipped + source.channels].iter().map(|w| *w as i64).sum::<i64>();
                    skipped += source.channels;
                }
            }
            packed.bias.push((*bias as i64 - zeros) as i32);
        }
    }
    packed
}

/// Packs one panel (first channel and width) of one set of filters.
fn pack_panel(
    filter: &IntegerFilter,
    (output, input): (usize, usize),
    (first, width): (usize, usize),
    sources: &[Tensor],
    packed: &mut Vec<u8>,
) {
    let (rows, cols) = filter.extent;
    let mut skipped = 0;
    for source in sources {
        let samples = cols * source.channels;
        for (row, group) in (0..rows).flat_map(|row| (0..groups(samples)).map(move |group| (row, group))) {
            for o in first..first + width {
                packed.extend((4 * group..4 * group + 4).map(|k| {
                    let inside = o < output && k < samples;
                    let (col, channel) = (k / source.channels, skipped + k % source.channels);
                    if inside { filter.weights[((o * rows + row) * cols + col) * input + channel] as u8 } else { 0 }
                }));
            }
        }
        skipped += source.channels;
    }
}
