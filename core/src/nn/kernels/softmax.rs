//! Softmax of one query's logits in integers, without the normalisation.

use crate::part::{head, head_mut};
use crate::quant::limit::{Alone, larger};
use crate::quant::lut::{EXP_COARSE, EXP_FINE, exp_lookup};

/// Limit of absolute logits; far beyond every table.
pub(crate) const LOGIT_LIMIT: i64 = 1 << 24;
/// Largest number of keys: tokens of the largest window.
pub(crate) const MAX_TOKENS: usize = 64;

/// The logits of one query.
pub(crate) struct Softmax<'a> {
    /// q · k of each key.
    pub(crate) products: &'a [i32; MAX_TOKENS],
    /// Number of keys.
    pub(crate) tokens: usize,
    /// Number of keys in a row of the window.
    pub(crate) width: usize,
    /// Position bias of the first key, little-endian i16. The next row of keys begins `bias_pitch` entries later.
    pub(crate) bias: &'a [[u8; 2]],
    pub(crate) bias_pitch: usize,
    pub(crate) multiplier: i32,
    pub(crate) shift: u32,
    /// Tables of the exponential.
    pub(crate) coarse: &'a [[u8; 2]; EXP_COARSE],
    pub(crate) fine: &'a [[u8; 2]; EXP_FINE],
}

impl Softmax<'_> {
    /// The portable version of [`super::Isa::softmax`].
    #[inline(always)]
    pub(crate) fn portable(&self, low: &mut [u8], high: &mut [u8]) -> i64 {
        let (half, alone) = (1i64 << (self.shift.max(1) - 1), Alone::new());
        let mut logits = [0i32; MAX_TOKENS];
        // Below every logit, also below a cut logit with the smallest bias.
        let mut largest = -2 * LOGIT_LIMIT as i32;
        let width = self.width.max(1);
        let rows = self.bias.chunks(self.bias_pitch.max(1)).zip(head_mut(&mut logits, self.tokens).chunks_mut(width));
        for ((bias, logits), products) in rows.zip(self.products.chunks(width)) {
            for ((logit, product), bias) in logits.iter_mut().zip(products).zip(bias) {
                let product = (*product as i64 * self.multiplier as i64 + half) >> self.shift;
                let product = alone.limit(product, -LOGIT_LIMIT, LOGIT_LIMIT) as i32;
                *logit = product + i16::from_le_bytes(*bias) as i32;
                largest = larger(largest, *logit);
            }
        }
        let mut sum = 0;
        for ((logit, low), high) in head(&logits, self.tokens).iter().zip(low.iter_mut()).zip(high.iter_mut()) {
            let e = exp_lookup(self.coarse, self.fine, largest - logit);
            (*low, *high) = (e as u8, (e >> 8) as u8);
            sum += e as i64;
        }
        for plane in [low, high] {
            plane.get_mut(self.tokens..).unwrap_or_default().fill(0);
        }
        sum
    }
}

#[cfg(test)]
mod tests;
