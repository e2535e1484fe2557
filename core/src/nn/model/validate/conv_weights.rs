//! Validation of convolutions: with the stored weights, no finished sum can overflow i32.

use super::work::Work;
use crate::nn::file::{Conv, MAX_OUTPUT, OperatorFault, VARIANT_KINDS};
use crate::nn::model::Model;
use crate::nn::panels::{PANEL, groups, panels};
use crate::nn::tensor::{Dtype, Tensor};
use crate::part::item;

impl Model<'_> {
    /// Validates that no finished sum of a panel of channels can overflow i32 with the stored weights (the K limit), and that filling is 0.
    /// Returns whether there are more panels.
    pub(super) fn check_conv_panel(&self, work: &Work, conv: &Conv, panel: usize) -> Result<bool, OperatorFault> {
        let out = self.tensor(conv.out);
        let (first_source, second_source) = (self.tensor(conv.first), conv.second.map(|second| self.tensor(second)));
        let sources = || [Some(&first_source), second_source.as_ref()].into_iter().flatten();
        let of_row = |variant: usize, width: usize, t: &Tensor| 4 * width * groups(conv.extent(variant).1 * t.channels);
        let bytes = |width: usize| -> usize {
            let of = |variant| sources().map(|t| conv.extent(variant).0 * of_row(variant, width, t)).sum::<usize>();
            (0..conv.variants()).map(of).sum()
        };
        let mut all = panels(out.channels);
        let before = all.by_ref().take(panel).map(|(_, width)| bytes(width)).sum::<usize>();
        let Some((first, width)) = all.next() else { return Ok(false) };
        let bias = self.constant_slice(work, conv.bias, conv.variants() * out.channels, 4)?.as_chunks::<4>().0;
        let mut at = conv.weights.saturating_add(before);
        // Largest sum of each kind; a pixel at a corner adds one variant of every kind.
        let mut largest = [[0u64; PANEL]; VARIANT_KINDS];
        for variant in 0..conv.variants() {
            let mut panel = Panel { first, width, channels: out.channels, sums: [0; PANEL], zeros: [0; PANEL] };
            let (rows, cols) = conv.extent(variant);
            for t in sources() {
                let weights = self.constant_slice(work, at, rows, of_row(variant, width, t))?;
                panel.add(weights, t, cols)?;
                at += weights.len();
            }
            let Some(largest) = largest.get_mut(conv.variant_kind(variant)) else { continue };
            let channels = largest.iter_mut().zip(panel.sums).zip(panel.zeros).take(width.min(out.channels - first));
            for (channel, ((largest, sum), zero)) in channels.enumerate() {
                let bias = bias.get(variant * out.channels + first + channel).map_or(0, |&b| i32::from_le_bytes(b));
                // Sums wrap, so the stored bias may have wrapped too.
                let bias = ((bias as i64 + zero) as i32).unsigned_abs() as u64;
                *largest = (*largest).max(sum + bias);
            }
        }
        for channel in 0..PANEL {
            let sum = largest.iter().map(|kind| item(kind, channel)).sum::<u64>();
            if sum > i32::MAX as u64 || !self.heights_are_finite(conv, &out, first + channel, sum) {
                return Err(OperatorFault::Overflow);
            }
        }
        Ok(all.next().is_some())
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

/// A panel of a convolution's output channels, and what a set of filters can give in each of them.
struct Panel {
    /// First channel, width, and number of channels of the output.
    first: usize,
    width: usize,
    channels: usize,
    /// Largest sums of products.
    sums: [u64; PANEL],
    /// Contributions of zero codes.
    zeros: [i64; PANEL],
}

impl Panel {
    /// Adds the weights of one source, `cols` columns in a kernel row.
    fn add(&mut self, weights: &[u8], t: &Tensor, cols: usize) -> Result<(), OperatorFault> {
        let used = cols * t.channels;
        let (magnitude, zero) = (t.magnitude() as u64, if t.dtype == Dtype::I16 { 128 * 256 } else { t.zero as i64 });
        for (i, four) in weights.as_chunks::<4>().0.iter().enumerate() {
            let (channel, group) = (i % self.width.max(1), i / self.width.max(1) % groups(used).max(1));
            let (Some(sum), Some(total)) = (self.sums.get_mut(channel), self.zeros.get_mut(channel)) else { continue };
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
        Ok(())
    }
}
