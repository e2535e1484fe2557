//! AMX: `tdpbusd` multiplies a tile of 16 pixels x 64 codes by a tile of 64 weights x 16 channels, and adds the products to 16 x 16 sums.
//!
//! ```text
//! up to four tiles of sums stay in registers: 64 pixels x 16 (or 8) channels, or 32 pixels x 32 channels
//! for every row r of every product and every 16 groups of it:
//!     B = weights of these groups                     as they lie in the file: [group][channel][4] is the order that AMX wants
//!     for every 16 pixels:
//!         A = 64 codes of each pixel                  read where they lie
//!         sums += A * B
//! ```
//! A row whose number of groups is no multiple of 16 ends with a smaller pair of tiles. Tiles of pixels may overlap: both compute the same.
//! Few products are computed by AVX-512, which does everything else, too.
#![allow(unsafe_code)]

mod tiles;

use super::layer_norm::Job;
use super::requantise::{Requantise, Target};
use super::softmax::Softmax;
use super::x86_avx512::Avx512;
use super::{Accumulators, Isa, Patch, Product, evenly};
use crate::nn::file::MAX_KERNEL;
use crate::part::{copy, head_mut};
use tiles::{MOST_ROWS, Row, Shapes};

/// Everything but matrix products.
type Rest = Avx512<true>;

/// AMX with 8-bit integers, beside AVX-512 with VBMI.
pub(crate) struct Amx {
    /// The configuration of the tiles.
    configured: Option<Shapes>,
    /// Space for the rows of a block.
    rows: [Row; MOST_ROWS],
}

impl Default for Amx {
    #[inline(always)]
    fn default() -> Self {
        Self { configured: None, rows: [Row::NOTHING; MOST_ROWS] }
    }
}

/// Products of four below this number are faster without tiles.
const FEWEST: usize = 512;

impl Isa for Amx {
    const NAME: &str = "amx-u8i8-32x32";
    const TOGETHER: bool = true;

    #[inline(always)]
    fn block(left: usize, width: usize) -> usize {
        let most = most_pixels(width);
        // Whole tiles as long as they come out even.
        if left.is_multiple_of(16) { left.min(most) } else { evenly(left, most) }
    }

    #[inline(always)]
    fn gemm(&mut self, acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        self.one(acc, pixels, patch, weights, width, false);
    }

    #[inline(always)]
    fn gemm_from_zero(
        &mut self,
        acc: &mut Accumulators,
        pixels: usize,
        patch: &Patch<'_>,
        weights: &[u8],
        width: usize,
    ) {
        self.one(acc, pixels, patch, weights, width, true);
    }

    #[inline(always)]
    fn products(
        &mut self,
        acc: &mut Accumulators,
        pixels: usize,
        bytes: &[u8],
        products: &[Product<'_>],
        width: usize,
        from_zero: bool,
    ) {
        self.compute(acc, pixels, bytes, products, width, from_zero);
    }

    #[inline(always)]
    fn requantise(requantise: &Requantise<'_>, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
        Rest::requantise(requantise, bytes, acc, target)
    }

    #[inline(always)]
    fn layer_norm(job: &Job<'_>, bytes: &mut [u8], col: usize, pixels: usize) -> u64 {
        Rest::layer_norm(job, bytes, col, pixels)
    }

    #[inline(always)]
    fn softmax(softmax: &Softmax<'_>, low: &mut [u8], high: &mut [u8]) -> i64 {
        Rest::softmax(softmax, low, high)
    }
}

impl Drop for Amx {
    #[inline(always)]
    fn drop(&mut self) {
        if self.configured.is_some() {
            // SAFETY: only a processor with AMX has configured tiles.
            unsafe { tiles::release() };
        }
    }
}

impl Amx {
    /// Computes one product, which may have more rows than a [`Product`] lists.
    #[inline(always)]
    fn one(
        &mut self,
        acc: &mut Accumulators,
        pixels: usize,
        patch: &Patch<'_>,
        weights: &[u8],
        width: usize,
        from_zero: bool,
    ) {
        let rows = patch.starts.len();
        if rows <= MAX_KERNEL && pixels * rows * patch.groups * width >= 16 * FEWEST {
            let mut starts = [0; MAX_KERNEL];
            copy(head_mut(&mut starts, rows), patch.starts);
            let product = Product { starts, rows, stride: patch.stride, groups: patch.groups, weights };
            self.compute(acc, pixels, patch.bytes, &[product], width, from_zero);
        } else if from_zero {
            Rest::default().gemm_from_zero(acc, pixels, patch, weights, width);
        } else {
            Rest::default().gemm(acc, pixels, patch, weights, width);
        }
    }

    /// Computes products, as many together as two shapes of tiles serve.
    #[inline(always)]
    fn compute(
        &mut self,
        acc: &mut Accumulators,
        pixels: usize,
        bytes: &[u8],
        products: &[Product<'_>],
        width: usize,
        mut from_zero: bool,
    ) {
        let groups: usize = products.iter().map(|product| product.rows * product.groups).sum();
        if pixels * groups * width < 16 * FEWEST || pixels > most_pixels(width) {
            return Rest::default().products(acc, pixels, bytes, products, width, from_zero);
        }
        if !products.iter().all(|product| product.patch(bytes).fits(pixels, product.weights, width)) {
            return;
        }
        let mut rest = products;
        while let Some((shapes, together)) = Shapes::of(pixels, width, rest) {
            let (now, later) = rest.split_at_checked(together).unwrap_or_default();
            if self.configured != Some(shapes) {
                // SAFETY: the processor has AMX, and the operating system allows it (see `nn/dispatch`).
                unsafe { tiles::configure(&shapes) };
                self.configured = Some(shapes);
            }
            let rows = shapes.rows(&mut self.rows, bytes, now, pixels);
            if !rows.is_empty() {
                // SAFETY: as above; `fits` bounds every address, and `acc` has room for all pixels.
                unsafe { tiles::compute(acc.as_mut_ptr(), &shapes, pixels, rows, from_zero) };
            } else if from_zero {
                head_mut(acc, pixels * width).fill(0);
            }
            (rest, from_zero) = (later, false);
        }
    }
}

/// Most pixels whose sums four tiles hold.
const fn most_pixels(width: usize) -> usize {
    if width == 32 { 32 } else { 64 }
}
