//! The matrix products of a network's convolutions.

use elunar_core::nn::file::{
    Conv, Dtype, MAX_KERNEL, Operator, PHASE_TAPS, Tensor, groups, panel_count, panelled, panels,
};
use elunar_core::nn::{Kernel, MatrixProduct, Model};

/// The products of one step of a convolution with one of its sources: all output channels of the step's output pixels (one row or several).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct StepShape {
    /// Output channels.
    pub channels: usize,
    /// Sets of filters applied in a step, each with its own weights: 1, or 4 with a folded upsampling.
    pub sets: usize,
    /// Output rows for which a panel's weights are used, one after the other.
    pub lines: usize,
    /// Input rows from one of these output rows to the next.
    pub line_step: usize,
    /// Output pixels in a row, per set.
    pub pixels: usize,
    /// Bytes from one pixel's codes to the next.
    pub stride: usize,
    /// Kernel rows.
    pub rows: usize,
    /// Samples of a kernel row: kernel columns times channels of the source.
    pub samples: usize,
    /// Samples that an output channel reads: fewer if neighbouring columns are computed as channels of one pixel.
    pub read: usize,
}

/// A shape, and its number of uses in a network.
#[derive(Debug, Clone, Copy)]
pub struct Use {
    /// The shape.
    pub shape: StepShape,
    /// Number of uses per tile.
    pub times: u64,
    /// Bytes from one input row to the next, in the first operator of this shape.
    pub pitch: usize,
}

impl StepShape {
    /// Number of four-byte groups of a kernel row.
    pub fn groups(&self) -> usize {
        groups(self.samples)
    }

    /// Number of multiply-accumulates of a step as kernels compute them: filled up to whole panels and groups.
    pub fn macs(&self) -> u64 {
        (self.sets * self.lines * self.pixels * panelled(self.channels) * self.rows * 4 * groups(self.samples)) as u64
    }

    /// Share of [`Self::macs`] that is neither filling nor a product with a weight that is always 0.
    pub fn useful(&self) -> f64 {
        let filled = panelled(self.channels) * 4 * groups(self.samples);
        (self.channels * self.read) as f64 / filled as f64
    }

    /// Number of bytes of weights that a step reads.
    pub fn weight_bytes(&self) -> usize {
        self.sets * panelled(self.channels) * self.rows * 4 * groups(self.samples)
    }

    /// Returns the widths of the panels as text.
    pub fn widths(&self) -> String {
        let widths: Vec<usize> = panels(self.channels).map(|(_, width)| width).collect();
        let (whole, rest) = widths.split_at(widths.iter().filter(|&&w| w == widths[0]).count());
        let mut text = if whole.len() > 1 { format!("{}x{}", whole.len(), widths[0]) } else { widths[0].to_string() };
        rest.iter().for_each(|width| text.push_str(&format!("+{width}")));
        text
    }

    /// Returns a name for criterion.
    pub fn id(&self) -> String {
        let Self { channels, sets, lines, pixels, stride, rows, samples, .. } = self;
        format!("c{channels}x{sets}-p{lines}x{pixels}-s{stride}-k{rows}x{samples}")
    }
}

/// Returns the products of a model's convolutions, those with most multiply-accumulates first, equal ones together. The border filters of a
/// folded upsampling count as inner filters; products inside attention are left out.
pub fn of(model: &Model<'_>) -> Vec<Use> {
    let mut found: Vec<Use> = Vec::new();
    for operator in (0..).map_while(|i| model.operator(i)) {
        let Operator::Conv(conv) = operator else { continue };
        let out = model.tensor(conv.out);
        for source in conv.sources().map(|index| model.tensor(index)) {
            let planes = if source.dtype == Dtype::I16 { 2 } else { 1 };
            let (shape, times) = (shape(&conv, &out, &source), planes * operator.steps(&out) as u64);
            match found.iter_mut().find(|use_| use_.shape == shape) {
                Some(use_) => use_.times += times,
                None => found.push(Use { shape, times, pitch: source.pitch }),
            }
        }
    }
    found.sort_by_key(|use_| std::cmp::Reverse(use_.times * use_.shape.macs()));
    found
}

fn shape(conv: &Conv, out: &Tensor, source: &Tensor) -> StepShape {
    let (channels, stride) = (out.channels, conv.stride_cols * source.channels);
    if conv.fold {
        // Inner filters have four taps in both directions; two rows and two columns of phases make four sets.
        let taps = PHASE_TAPS[0];
        let samples = taps * source.channels;
        let pixels = out.cols / 2;
        let lines = conv.block.min(out.rows / 2);
        return StepShape {
            channels,
            sets: 4,
            lines,
            line_step: 1,
            pixels,
            stride,
            rows: taps,
            samples,
            read: samples,
        };
    }
    let samples = conv.kernel_cols * source.channels;
    // Columns that are computed as channels of one pixel read the kernel of all of them; each column uses its own part.
    let read = (conv.kernel_cols - (conv.stride_cols - conv.stride)) * source.channels;
    let (lines, line_step) = (conv.block.min(out.rows), conv.stride);
    StepShape { channels, sets: 1, lines, line_step, pixels: out.cols, stride, rows: conv.kernel_rows, samples, read }
}

/// A shape with its own memory in the runner's layout: input rows with their pitch, weights one panel after the other.
#[derive(Debug)]
pub struct Products {
    shape: StepShape,
    pitch: usize,
    codes: Vec<u8>,
    weights: Vec<u8>,
}

impl Products {
    /// Makes the memory for a use.
    pub fn new(use_: &Use) -> Self {
        let (shape, pitch) = (use_.shape, use_.pitch);
        assert!(shape.rows <= MAX_KERNEL && panel_count(shape.channels) > 0, "{shape:?}");
        let rows = (shape.lines - 1) * shape.line_step + shape.rows;
        let row = (shape.pixels - 1) * shape.stride + 4 * groups(shape.samples);
        let fill = |len: usize, factor: usize| (0..len).map(|i| (i * factor % 251) as u8).collect();
        Self { shape, pitch, codes: fill((rows - 1) * pitch + row, 7), weights: fill(shape.weight_bytes(), 5) }
    }

    /// Computes all products of one step, in blocks of pixels as the runner does, with only the first `groups` of every kernel row.
    ///
    /// # Panics
    /// If the kernel refuses the product, which would be an error of this function.
    pub fn run(&self, kernel: &Kernel, groups: usize) {
        let shape = &self.shape;
        let starts: [usize; MAX_KERNEL] = std::array::from_fn(|row| row * self.pitch);
        let starts = &starts[..shape.rows];
        let mut acc = [0; 320];
        let mut offset = 0;
        for (_, width) in panels(shape.channels) {
            let bytes = 4 * width * shape.rows * groups;
            for _ in 0..shape.sets {
                let weights = &self.weights[offset..offset + bytes];
                for line in 0..shape.lines {
                    let codes = &self.codes[line * shape.line_step * self.pitch..];
                    let mut done = 0;
                    while done < shape.pixels {
                        // Blocks of nearly equal size.
                        let left = shape.pixels - done;
                        let now = left.div_ceil(left.div_ceil(Kernel::pixels_at_once(width)));
                        let (bytes, stride) = (&codes[done * shape.stride..], shape.stride);
                        let product = MatrixProduct { pixels: now, width, bytes, starts, stride, groups, weights };
                        kernel
                            .matrix_product(&mut acc[..now * width], &product)
                            .unwrap_or_else(|what| panic!("{shape:?}: {what}"));
                        done += now;
                    }
                }
                offset += bytes;
            }
        }
        std::hint::black_box(&acc);
    }
}
