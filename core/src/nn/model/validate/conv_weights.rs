//! Validation of convolutions: with the stored weights, no finished sum can overflow i32.

use super::work::Work;
use crate::nn::file::{Conv, MAX_OUTPUT, OperatorFault, VARIANT_KINDS};
use crate::nn::model::Model;
use crate::nn::panels::{groups, panelled, panels};
use crate::nn::tensor::{Dtype, Tensor};
use crate::part::item;

/// Number of channels that are validated together: the narrowest panel, of which all others are multiples.
const TOGETHER: usize = 8;

impl Model<'_> {
    /// Validates that no finished sum of a few channels can overflow i32 with the stored weights (the K limit), and that filling is 0: those from
    /// `TOGETHER * part` on. Returns whether there are more.
    pub(super) fn check_conv_weights(&self, work: &Work, conv: &Conv, part: usize) -> Result<bool, OperatorFault> {
        let (out, first) = (self.tensor(conv.out), part.saturating_mul(TOGETHER));
        let (first_source, second_source) = (self.tensor(conv.first), conv.second.map(|second| self.tensor(second)));
        let sources = || [Some(&first_source), second_source.as_ref()].into_iter().flatten();
        let of_row = |variant: usize, width: usize, t: &Tensor| 4 * width * groups(conv.extent(variant).1 * t.channels);
        let bytes = |width: usize| -> usize {
            let of = |variant| sources().map(|t| conv.extent(variant).0 * of_row(variant, width, t)).sum::<usize>();
            (0..conv.variants()).map(of).sum()
        };
        let mut at = conv.weights;
        let mut found = None;
        for (start, width) in panels(out.channels) {
            if first < start + width {
                found = Some((start, width));
                break;
            }
            at = at.saturating_add(bytes(width));
        }
        let Some((start, width)) = found else { return Ok(false) };
        let bias = self.constant_slice(work, conv.bias, conv.variants() * out.channels, 4)?.as_chunks::<4>().0;
        // Largest sum of each kind; a pixel at a corner adds one variant of every kind.
        let mut largest = [[0u64; TOGETHER]; VARIANT_KINDS];
        for variant in 0..conv.variants() {
            let lanes = (first - start, width);
            let mut panel = Panel { lanes, first, channels: out.channels, sums: [0; TOGETHER], zeros: [0; TOGETHER] };
            let (rows, cols) = conv.extent(variant);
            for t in sources() {
                let len = rows * of_row(variant, width, t);
                // The other channels of the panel are validated in other parts.
                work.spend(len / width.div_ceil(TOGETHER).max(1))?;
                panel.add(self.constants_from(at, len)?, t, cols)?;
                at += len;
            }
            let Some(largest) = largest.get_mut(conv.variant_kind(variant)) else { continue };
            let channels = largest.iter_mut().zip(panel.sums).zip(panel.zeros);
            for (channel, ((largest, sum), zero)) in channels.enumerate().take(out.channels.saturating_sub(first)) {
                let bias = bias.get(variant * out.channels + first + channel).map_or(0, |&b| i32::from_le_bytes(b));
                // Sums wrap, so the stored bias may have wrapped too.
                let bias = ((bias as i64 + zero) as i32).unsigned_abs() as u64;
                *largest = (*largest).max(sum + bias);
            }
        }
        for channel in 0..TOGETHER {
            let sum = largest.iter().map(|kind| item(kind, channel)).sum::<u64>();
            if sum > i32::MAX as u64 || !self.heights_are_finite(conv, &out, first + channel, sum) {
                return Err(OperatorFault::Overflow);
            }
        }
        Ok(first + TOGETHER < panelled(out.channels))
    }

    /// Returns whether an f32 output stays within [`MAX_OUTPUT`] for sums up to `sum`. Its scales were read before.
    fn heights_are_finite(&self, conv: &Conv, out: &Tensor, channel: usize, sum: u64) -> bool {
        if out.dtype != Dtype::F32 || channel >= out.channels {
            return true;
        }
        let scale = f32::from_bits(self.constants.i32_at(conv.multipliers, channel) as u32);
        let added = conv.add.map_or(0.0, |add| {
            let add = self.tensor(add);
            f64::from(add.magnitude()) * f64::from(add.scale)
        });
        let largest = sum as f64 * f64::from(scale.abs()) + added;
        largest <= MAX_OUTPUT * f64::from(self.nr()) && largest <= f64::from(f32::MAX / 2.0)
    }
}

/// Some of the channels of a panel of a convolution's output, and what a set of filters can give in each of them.
struct Panel {
    /// First of the channels in the panel, and the panel's width.
    lanes: (usize, usize),
    /// First of the channels, and number of channels of the output.
    first: usize,
    channels: usize,
    /// Largest sums of products.
    sums: [u64; TOGETHER],
    /// Contributions of zero codes.
    zeros: [i64; TOGETHER],
}

impl Panel {
    /// Adds the weights of one source, `cols` columns in a kernel row.
    fn add(&mut self, weights: &[u8], t: &Tensor, cols: usize) -> Result<(), OperatorFault> {
        let used = cols * t.channels;
        let (magnitude, zero) = (t.magnitude() as u64, if t.dtype == Dtype::I16 { 128 * 256 } else { t.zero as i64 });
        let (lane, width) = self.lanes;
        for (row, fours) in weights.as_chunks::<4>().0.chunks_exact(width.max(1)).enumerate() {
            let group = row % groups(used).max(1);
            let sums = self.sums.iter_mut().zip(&mut self.zeros);
            for (channel, (four, (sum, total))) in fours.iter().skip(lane).zip(sums).enumerate() {
                for (b, &w) in four.iter().enumerate() {
                    let w = w as i8;
                    let filling = 4 * group + b >= used || self.first + channel >= self.channels;
                    if w == i8::MIN || (filling && w != 0) {
                        return Err(OperatorFault::Constants);
                    }
                    *sum += w.unsigned_abs() as u64 * magnitude;
                    *total += w as i64 * zero;
                }
            }
        }
        Ok(())
    }
}
