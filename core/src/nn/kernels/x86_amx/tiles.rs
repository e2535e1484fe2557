//! The instructions: shapes of tiles, and the sums of one block of pixels.

use crate::nn::file::MAX_KERNEL;
use crate::nn::kernels::Product;
use crate::part::item;
use core::arch::asm;

/// Groups of four codes in a whole tile, and pixels.
const TILE: usize = 16;
/// Most rows of the products that are computed together: two sources with two sets of filters.
pub(super) const MOST_ROWS: usize = 4 * MAX_KERNEL;

/// The shapes of the tiles: of sums, and of two pairs of tiles of codes and weights.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Shapes {
    /// Pixels of a tile.
    pixels: usize,
    /// Channels of a panel.
    width: usize,
    /// Groups of the first and of the second pair; 0 for a pair that is not used.
    groups: [usize; 2],
}

impl Shapes {
    /// Returns the shapes for as many of the products as two pairs of tiles serve, and the number of these products, at least one; `None`
    /// if there are none.
    #[inline(always)]
    pub(super) fn of(pixels: usize, width: usize, products: &[Product<'_>]) -> Option<(Self, usize)> {
        let mut pairs = Pairs::default();
        let together = products.iter().take_while(|product| pairs.take(product.groups)).count();
        let pixels = pixels.div_ceil(pixels.div_ceil(TILE).max(1));
        (together > 0).then_some((Self { pixels, width, groups: pairs.0 }, together))
    }

    /// Lists the rows of products for a block of pixels.
    #[inline(always)]
    pub(super) fn rows<'r>(
        &self,
        rows: &'r mut [Row; MOST_ROWS],
        bytes: &[u8],
        products: &[Product<'_>],
        pixels: usize,
    ) -> &'r [Row] {
        let mut len = 0;
        for product in products {
            let (whole, rest) = (product.groups / TILE, product.groups % TILE);
            let [first, second] = self.groups;
            let counts = match rest {
                0 => [whole, 0],
                _ if rest == first => [1, 0],
                _ => [whole, 1],
            };
            debug_assert!(rest == 0 || rest == first || rest == second);
            let bytes_of_row = 4 * product.groups * self.width;
            for k in 0..product.rows {
                let start = bytes.as_ptr().wrapping_add(item(&product.starts, k));
                let at = |tile: usize| start.wrapping_add(self.first(tile, pixels) * product.stride);
                let weights = product.weights.as_ptr().wrapping_add(k * bytes_of_row);
                if let Some(row) = rows.get_mut(len) {
                    *row = Row { codes: [at(0), at(1), at(2), at(3)], weights, stride: product.stride, counts };
                }
                len += 1;
            }
        }
        rows.get(..len).unwrap_or_default()
    }

    /// The first pixel of a tile. The last tile may overlap the one before it, and missing tiles are the last one.
    #[inline(always)]
    fn first(&self, tile: usize, pixels: usize) -> usize {
        (tile * self.pixels).min(pixels.saturating_sub(self.pixels))
    }
}

/// The groups of two pairs of tiles.
#[derive(Default)]
struct Pairs([usize; 2]);

impl Pairs {
    /// Returns whether rows of `groups` groups can be computed, too, and takes them in then.
    #[inline(always)]
    fn take(&mut self, groups: usize) -> bool {
        let (whole, rest) = (groups / TILE, groups % TILE);
        let [mut first, mut second] = self.0;
        if whole > 0 && first != TILE {
            if second != 0 {
                return false;
            }
            (first, second) = (TILE, first);
        }
        if rest > 0 && rest != first && rest != second {
            match (first, second) {
                (0, _) => first = rest,
                (_, 0) => second = rest,
                _ => return false,
            }
        }
        self.0 = [first, second];
        true
    }
}

/// One row of a product, as the loop reads it.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
pub(super) struct Row {
    /// First codes of the four tiles of pixels.
    codes: [*const u8; 4],
    weights: *const u8,
    /// Bytes from pixel to pixel.
    stride: usize,
    /// Tiles of the first and of the second pair.
    counts: [usize; 2],
}

impl Row {
    pub(super) const NOTHING: Self =
        Self { codes: [core::ptr::null(); 4], weights: core::ptr::null(), stride: 0, counts: [0; 2] };
}

/// The operand of `ldtilecfg`.
#[repr(C, align(64))]
struct Configuration {
    palette: u8,
    start: u8,
    reserved: [u8; 14],
    row_bytes: [u16; 16],
    rows: [u8; 16],
}

/// Sets the shapes of all tiles: 0 to 3 are sums, 4 and 5 codes and weights of the first pair, 6 and 7 of the second.
///
/// # Safety
/// The processor has AMX, and the operating system allows it.
#[inline(never)]
pub(super) unsafe fn configure(shapes: &Shapes) {
    let mut c = Configuration { palette: 1, start: 0, reserved: [0; 14], row_bytes: [0; 16], rows: [0; 16] };
    let channel_bytes = 4 * shapes.width.min(TILE) as u16;
    let [first, second] = shapes.groups.map(|groups| groups.max(1));
    let tiles = [
        (shapes.pixels, channel_bytes),
        (shapes.pixels, channel_bytes),
        (shapes.pixels, channel_bytes),
        (shapes.pixels, channel_bytes),
        (shapes.pixels, 4 * first as u16),
        (first, channel_bytes),
        (shapes.pixels, 4 * second as u16),
        (second, channel_bytes),
    ];
    for ((rows, row_bytes), tile) in c.rows.iter_mut().zip(&mut c.row_bytes).zip(tiles) {
        (*rows, *row_bytes) = (tile.0 as u8, tile.1);
    }
    // SAFETY: guaranteed by the caller; the configuration is legal: palette 1, 1 to 16 rows of 4 to 64 bytes.
    unsafe {
        asm!(
            "ldtilecfg [{}]", in(reg) &c, options(nostack, preserves_flags),
            out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
            out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
        );
    }
}

/// Gives the tiles back, so that the operating system need not save them.
///
/// # Safety
/// The processor has AMX.
#[inline(always)]
pub(super) unsafe fn release() {
    // SAFETY: guaranteed by the caller.
    unsafe {
        asm!(
            "tilerelease", options(nomem, nostack, preserves_flags),
            out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
            out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
        );
    }
}

/// Where the sums of the tiles of pixels are, and bytes from pixel to pixel and from group to group of the weights.
#[repr(C)]
struct Block {
    sums: [*mut i32; 4],
    pitch: usize,
}

/// Makes a function that computes some tiles of sums: `$zero` or `$load` begins them, `$first` and `$second` add the products of one pair of
/// tiles of codes and weights, `$store` ends them.
macro_rules! tiles {
    ($name:ident, zero: [$($zero:literal)+], load: [$($load:literal)+], first: [$($first:literal)+], second: [$($second:literal)+],
     store: [$($store:literal)+]) => {
        /// # Safety
        /// AMX is configured for the rows, whose addresses are readable; there is at least one. The sums are writable.
        unsafe fn $name(block: &Block, rows: &[Row], from_zero: bool) {
            // SAFETY: guaranteed by the caller.
            unsafe {
                asm!(
                    "mov {x0}, [{block}]",
                    "mov {x1}, [{block} + 8]",
                    "mov {x2}, [{block} + 16]",
                    "mov {x3}, [{block} + 24]",
                    "test {n:e}, {n:e}",
                    "jz 2f",
                    $($zero,)+
                    "jmp 3f",
                    "2:",
                    $($load,)+
                    "3:",
                    "mov {x0}, [{row}]",
                    "mov {x1}, [{row} + 8]",
                    "mov {x2}, [{row} + 16]",
                    "mov {x3}, [{row} + 24]",
                    "mov {w}, [{row} + 32]",
                    "mov {stride}, [{row} + 40]",
                    "mov {n}, [{row} + 48]",
                    "test {n}, {n}",
                    "jz 5f",
                    "4:",
                    $($first,)+
                    "add {x0}, 64",
                    "add {x1}, 64",
                    "add {x2}, 64",
                    "add {x3}, 64",
                    "lea {w}, [{w} + 8*{pitch}]",
                    "lea {w}, [{w} + 8*{pitch}]",
                    "dec {n}",
                    "jnz 4b",
                    "5:",
                    "cmp qword ptr [{row} + 56], 0",
                    "je 6f",
                    $($second,)+
                    "6:",
                    "add {row}, 64",
                    "cmp {row}, {end}",
                    "jne 3b",
                    "mov {x0}, [{block}]",
                    "mov {x1}, [{block} + 8]",
                    "mov {x2}, [{block} + 16]",
                    "mov {x3}, [{block} + 24]",
                    $($store,)+
                    block = in(reg) block,
                    pitch = in(reg) block.pitch,
                    row = inout(reg) rows.as_ptr() => _,
                    end = in(reg) rows.as_ptr_range().end,
                    n = inout(reg) from_zero as usize => _,
                    x0 = out(reg) _, x1 = out(reg) _, x2 = out(reg) _, x3 = out(reg) _,
                    w = out(reg) _, stride = out(reg) _,
                    options(nostack),
                    out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                    out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                );
            }
        }
    };
}

tiles!(
    one,
    zero: [
        "tilezero tmm0"
    ],
    load: [
        "tileloadd tmm0, [{x0} + {pitch}*1]"
    ],
    first: [
        "tileloadd tmm5, [{w} + {pitch}*1]"
        "tileloadd tmm4, [{x0} + {stride}*1]"
        "tdpbusd tmm0, tmm4, tmm5"
    ],
    second: [
        "tileloadd tmm7, [{w} + {pitch}*1]"
        "tileloadd tmm6, [{x0} + {stride}*1]"
        "tdpbusd tmm0, tmm6, tmm7"
    ],
    store: [
        "tilestored [{x0} + {pitch}*1], tmm0"
    ]
);

tiles!(
    two,
    zero: [
        "tilezero tmm0"
        "tilezero tmm1"
    ],
    load: [
        "tileloadd tmm0, [{x0} + {pitch}*1]"
        "tileloadd tmm1, [{x1} + {pitch}*1]"
    ],
    first: [
        "tileloadd tmm5, [{w} + {pitch}*1]"
        "tileloadd tmm4, [{x0} + {stride}*1]"
        "tdpbusd tmm0, tmm4, tmm5"
        "tileloadd tmm4, [{x1} + {stride}*1]"
        "tdpbusd tmm1, tmm4, tmm5"
    ],
    second: [
        "tileloadd tmm7, [{w} + {pitch}*1]"
        "tileloadd tmm6, [{x0} + {stride}*1]"
        "tdpbusd tmm0, tmm6, tmm7"
        "tileloadd tmm6, [{x1} + {stride}*1]"
        "tdpbusd tmm1, tmm6, tmm7"
    ],
    store: [
        "tilestored [{x0} + {pitch}*1], tmm0"
        "tilestored [{x1} + {pitch}*1], tmm1"
    ]
);

tiles!(
    three,
    zero: [
        "tilezero tmm0"
        "tilezero tmm1"
        "tilezero tmm2"
    ],
    load: [
        "tileloadd tmm0, [{x0} + {pitch}*1]"
        "tileloadd tmm1, [{x1} + {pitch}*1]"
        "tileloadd tmm2, [{x2} + {pitch}*1]"
    ],
    first: [
        "tileloadd tmm5, [{w} + {pitch}*1]"
        "tileloadd tmm4, [{x0} + {stride}*1]"
        "tdpbusd tmm0, tmm4, tmm5"
        "tileloadd tmm4, [{x1} + {stride}*1]"
        "tdpbusd tmm1, tmm4, tmm5"
        "tileloadd tmm4, [{x2} + {stride}*1]"
        "tdpbusd tmm2, tmm4, tmm5"
    ],
    second: [
        "tileloadd tmm7, [{w} + {pitch}*1]"
        "tileloadd tmm6, [{x0} + {stride}*1]"
        "tdpbusd tmm0, tmm6, tmm7"
        "tileloadd tmm6, [{x1} + {stride}*1]"
        "tdpbusd tmm1, tmm6, tmm7"
        "tileloadd tmm6, [{x2} + {stride}*1]"
        "tdpbusd tmm2, tmm6, tmm7"
    ],
    store: [
        "tilestored [{x0} + {pitch}*1], tmm0"
        "tilestored [{x1} + {pitch}*1], tmm1"
        "tilestored [{x2} + {pitch}*1], tmm2"
    ]
);

tiles!(
    four,
    zero: [
        "tilezero tmm0"
        "tilezero tmm1"
        "tilezero tmm2"
        "tilezero tmm3"
    ],
    load: [
        "tileloadd tmm0, [{x0} + {pitch}*1]"
        "tileloadd tmm1, [{x1} + {pitch}*1]"
        "tileloadd tmm2, [{x2} + {pitch}*1]"
        "tileloadd tmm3, [{x3} + {pitch}*1]"
    ],
    first: [
        "tileloadd tmm5, [{w} + {pitch}*1]"
        "tileloadd tmm4, [{x0} + {stride}*1]"
        "tdpbusd tmm0, tmm4, tmm5"
        "tileloadd tmm4, [{x1} + {stride}*1]"
        "tdpbusd tmm1, tmm4, tmm5"
        "tileloadd tmm4, [{x2} + {stride}*1]"
        "tdpbusd tmm2, tmm4, tmm5"
        "tileloadd tmm4, [{x3} + {stride}*1]"
        "tdpbusd tmm3, tmm4, tmm5"
    ],
    second: [
        "tileloadd tmm7, [{w} + {pitch}*1]"
        "tileloadd tmm6, [{x0} + {stride}*1]"
        "tdpbusd tmm0, tmm6, tmm7"
        "tileloadd tmm6, [{x1} + {stride}*1]"
        "tdpbusd tmm1, tmm6, tmm7"
        "tileloadd tmm6, [{x2} + {stride}*1]"
        "tdpbusd tmm2, tmm6, tmm7"
        "tileloadd tmm6, [{x3} + {stride}*1]"
        "tdpbusd tmm3, tmm6, tmm7"
    ],
    store: [
        "tilestored [{x0} + {pitch}*1], tmm0"
        "tilestored [{x1} + {pitch}*1], tmm1"
        "tilestored [{x2} + {pitch}*1], tmm2"
        "tilestored [{x3} + {pitch}*1], tmm3"
    ]
);

tiles!(
    one_wide,
    zero: [
        "tilezero tmm0"
        "tilezero tmm1"
    ],
    load: [
        "tileloadd tmm0, [{x0} + {pitch}*1]"
        "tileloadd tmm1, [{x0} + {pitch}*1 + 64]"
    ],
    first: [
        "tileloadd tmm5, [{w} + {pitch}*1]"
        "tileloadd tmm4, [{x0} + {stride}*1]"
        "tdpbusd tmm0, tmm4, tmm5"
        "tileloadd tmm5, [{w} + {pitch}*1 + 64]"
        "tdpbusd tmm1, tmm4, tmm5"
    ],
    second: [
        "tileloadd tmm7, [{w} + {pitch}*1]"
        "tileloadd tmm6, [{x0} + {stride}*1]"
        "tdpbusd tmm0, tmm6, tmm7"
        "tileloadd tmm7, [{w} + {pitch}*1 + 64]"
        "tdpbusd tmm1, tmm6, tmm7"
    ],
    store: [
        "tilestored [{x0} + {pitch}*1], tmm0"
        "tilestored [{x0} + {pitch}*1 + 64], tmm1"
    ]
);

tiles!(
    two_wide,
    zero: [
        "tilezero tmm0"
        "tilezero tmm1"
        "tilezero tmm2"
        "tilezero tmm3"
    ],
    load: [
        "tileloadd tmm0, [{x0} + {pitch}*1]"
        "tileloadd tmm1, [{x0} + {pitch}*1 + 64]"
        "tileloadd tmm2, [{x1} + {pitch}*1]"
        "tileloadd tmm3, [{x1} + {pitch}*1 + 64]"
    ],
    first: [
        "tileloadd tmm5, [{w} + {pitch}*1]"
        "tileloadd tmm4, [{x0} + {stride}*1]"
        "tdpbusd tmm0, tmm4, tmm5"
        "tileloadd tmm5, [{w} + {pitch}*1 + 64]"
        "tdpbusd tmm1, tmm4, tmm5"
        "tileloadd tmm4, [{x1} + {stride}*1]"
        "tdpbusd tmm3, tmm4, tmm5"
        "tileloadd tmm5, [{w} + {pitch}*1]"
        "tdpbusd tmm2, tmm4, tmm5"
    ],
    second: [
        "tileloadd tmm7, [{w} + {pitch}*1]"
        "tileloadd tmm6, [{x0} + {stride}*1]"
        "tdpbusd tmm0, tmm6, tmm7"
        "tileloadd tmm7, [{w} + {pitch}*1 + 64]"
        "tdpbusd tmm1, tmm6, tmm7"
        "tileloadd tmm6, [{x1} + {stride}*1]"
        "tdpbusd tmm3, tmm6, tmm7"
        "tileloadd tmm7, [{w} + {pitch}*1]"
        "tdpbusd tmm2, tmm6, tmm7"
    ],
    store: [
        "tilestored [{x0} + {pitch}*1], tmm0"
        "tilestored [{x0} + {pitch}*1 + 64], tmm1"
        "tilestored [{x1} + {pitch}*1], tmm2"
        "tilestored [{x1} + {pitch}*1 + 64], tmm3"
    ]
);

/// Computes the products of all rows for a block of pixels: sums from 0, or (`from_zero` false) added to those at `acc`.
///
/// # Safety
/// AMX is configured with `shapes`; the rows are those of [`Shapes::rows`], readable, at least one; `acc` has room for the sums of all pixels.
#[inline(always)]
pub(super) unsafe fn compute(acc: *mut i32, shapes: &Shapes, pixels: usize, rows: &[Row], from_zero: bool) {
    let sums = [0, 1, 2, 3].map(|tile| acc.wrapping_add(shapes.first(tile, pixels) * shapes.width));
    let block = Block { sums, pitch: 4 * shapes.width };
    // SAFETY: guaranteed by the caller.
    unsafe {
        match (shapes.width > TILE, pixels.div_ceil(shapes.pixels.max(1))) {
            (true, 1) => one_wide(&block, rows, from_zero),
            (true, _) => two_wide(&block, rows, from_zero),
            (false, 1) => one(&block, rows, from_zero),
            (false, 2) => two(&block, rows, from_zero),
            (false, 3) => three(&block, rows, from_zero),
            (false, _) => four(&block, rows, from_zero),
        }
    }
}
