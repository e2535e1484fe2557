//! Softmax of one query's logits in integers, not normalised.

use crate::part::{head, head_mut};
use crate::quant::limit::{larger, limit_wide};
use crate::quant::lut::{EXP_COARSE, EXP_FINE, exp_lookup};

/// Logits are cut here; far beyond any table.
pub(crate) const LOGIT_LIMIT: i64 = 1 << 24;
/// Most keys: tokens of the largest window.
pub(crate) const MAX_TOKENS: usize = 64;

/// One query's softmax, not normalised.
pub(crate) struct Softmax<'a> {
    /// q · k by key.
    pub(crate) products: &'a [i32; MAX_TOKENS],
    /// Keys.
    pub(crate) tokens: usize,
    /// Keys in a row of the window.
    pub(crate) width: usize,
    /// Position bias of the first key, little-endian i16; the next row of keys begins `bias_pitch` entries on.
    pub(crate) bias: &'a [[u8; 2]],
    pub(crate) bias_pitch: usize,
    pub(crate) multiplier: i32,
    pub(crate) shift: u32,
    /// Tables of the exponential.
    pub(crate) coarse: &'a [[u8; 2]; EXP_COARSE],
    pub(crate) fine: &'a [[u8; 2]; EXP_FINE],
}

impl Softmax<'_> {
    /// [`super::Isa::softmax`] in portable Rust.
    #[inline(always)]
    pub(crate) fn portable(&self, low: &mut [u8], high: &mut [u8]) -> i64 {
        let half = 1i64 << (self.shift.max(1) - 1);
        let mut logits = [0i32; MAX_TOKENS];
        // Below every logit: one that is cut, with the smallest bias.
        let mut largest = -2 * LOGIT_LIMIT as i32;
        let width = self.width.max(1);
        let rows = self.bias.chunks(self.bias_pitch.max(1)).zip(head_mut(&mut logits, self.tokens).chunks_mut(width));
        for ((bias, logits), products) in rows.zip(self.products.chunks(width)) {
            for ((logit, product), bias) in logits.iter_mut().zip(products).zip(bias) {
                let product = (*product as i64 * self.multiplier as i64 + half) >> self.shift;
                let product = limit_wide(product, -LOGIT_LIMIT, LOGIT_LIMIT) as i32;
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
