//! The constants of one panel that requantise a convolution's accumulators.

use super::Constants;
use crate::nn::file::Conv;
use crate::nn::kernels::requantise::Requantise;
use crate::nn::panels::PANEL;
use crate::nn::tensor::{Dtype, Tensor};
use crate::quant::lut::CODE_TABLE_LEN;

/// Reads the constants for channels `first` to `first + width` of an output. `variants` are the sets of filters whose biases are added.
#[inline(always)]
pub(super) fn requantise<'a>(
    constants: &Constants<'a>,
    conv: &Conv,
    out: &'a Tensor,
    add: Option<Tensor>,
    first: usize,
    width: usize,
    variants: [Option<usize>; 2],
) -> Requantise<'a> {
    let channels = out.channels.saturating_sub(first).min(width);
    let list = |offset: usize, skip: usize| {
        let mut values = [0; PANEL];
        let bytes = constants.slice(offset + 4 * (skip + first), 4 * channels).as_chunks::<4>().0;
        for (value, &b) in values.iter_mut().zip(bytes) {
            *value = i32::from_le_bytes(b);
        }
        values
    };
    let mut bias = [0; PANEL];
    for variant in variants.into_iter().flatten() {
        let one: [i32; PANEL] = list(conv.bias, variant * out.channels);
        for c in 0..PANEL {
            bias[c] = i32::wrapping_add(bias[c], one[c]);
        }
    }
    let added = conv.add.is_some() && out.dtype != Dtype::F32;
    let table = conv.table.map(|table| constants.slice(table, CODE_TABLE_LEN));
    let (zero, lo, hi) = match table {
        Some(_) => (conv.table_zero as i64, 0, 255),
        None => (out.zero as i64, out.lo as i64, out.hi as i64),
    };
    Requantise {
        out,
        first,
        channels,
        width,
        bias,
        multiplier: list(conv.multipliers, 0),
        add,
        add_multiplier: if added { list(conv.add_multipliers, 0) } else { [0; PANEL] },
        add_shift: conv.add_shift,
        half: 1 << (conv.shift.max(1) - 1),
        shift: conv.shift & 63,
        table,
        zero,
        lo,
        hi,
        // Two kinds of cuts do not count as saturation: a cut at the zero point is a ReLU, and a table continues with its end values.
        floor: if table.is_some() || out.lo == out.zero { i64::MIN } else { lo },
        ceiling: if table.is_some() { i64::MAX } else { hi },
        relu: conv.relu,
    }
}

#[cfg(test)]
mod tests;
