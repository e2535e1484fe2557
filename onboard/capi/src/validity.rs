//! The validity of heights, one bit per pixel. It is computed when the tile begins, because images are not kept.

use elunar_core::nn::validity;

/// Number of pixels that are processed together.
const GROUP: usize = 64;

/// Writes the bits (lowest first; 1 for a valid height) and returns how many are 1. `bits` is long enough for the maps.
pub(crate) fn pack(image: &[f32], coarse_m: &[f32], valid: Option<&[bool]>, bits: &mut [u8]) -> u32 {
    bits.fill(0);
    let mut masks = valid.map(|mask| mask.chunks(GROUP));
    let groups = image.chunks(GROUP).zip(coarse_m.chunks(GROUP)).zip(bits.chunks_mut(GROUP / 8));
    let mut count = 0;
    for ((image, coarse_m), bits) in groups {
        let mut each = [false; GROUP];
        // Pixels beyond the end of a mask are masked.
        let mask = masks.as_mut().map(|masks| masks.next().unwrap_or(&[]));
        validity(image, coarse_m, mask, &mut each);
        for (byte, eight) in bits.iter_mut().zip(each.as_chunks::<8>().0) {
            *byte = eight.iter().rev().fold(0, |byte, &bit| byte << 1 | bit as u8);
            count += byte.count_ones();
        }
    }
    count
}

/// Returns the number of valid heights.
pub(crate) fn count(image: &[f32], coarse_m: &[f32], valid: Option<&[bool]>) -> u32 {
    let mut masks = valid.map(|mask| mask.chunks(GROUP));
    let mut count = 0;
    for (image, coarse_m) in image.chunks(GROUP).zip(coarse_m.chunks(GROUP)) {
        let mut bits = [0; GROUP / 8];
        let mask = masks.as_mut().map(|masks| masks.next().unwrap_or(&[]));
        count += pack(image, coarse_m, mask, &mut bits);
    }
    count
}

/// Writes each bit as a byte, 1 or 0.
pub(crate) fn unpack(bits: &[u8], out: &mut [u8]) {
    for (eight, &byte) in out.chunks_mut(8).zip(bits) {
        for (bit, out) in eight.iter_mut().enumerate() {
            *out = byte >> bit & 1;
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec::Vec;

    #[test]
    fn bits_say_what_the_core_says() {
        for len in [1, 7, 8, 64, 65, 200] {
            let image: Vec<f32> = (0..len).map(|i| if i % 5 == 1 { f32::NAN } else { i as f32 }).collect();
            let voids = [-3.4028227e38, 1e30, -1e32, f32::INFINITY];
            let coarse_m: Vec<f32> = (0..len).map(|i| if i % 7 == 2 { voids[i % 4] } else { -1900.0 }).collect();
            let mask: Vec<bool> = (0..len).map(|i| i % 3 != 0).collect();
            for valid in [None, Some(&mask[..])] {
                let mut expected = std::vec![false; len];
                validity(&image, &coarse_m, valid, &mut expected);
                assert!(expected.iter().skip(2).step_by(7).all(|valid| !valid));
                let mut bits = std::vec![0xff; len.div_ceil(8)];
                let mut bytes = std::vec![9; len];
                let found = pack(&image, &coarse_m, valid, &mut bits);
                unpack(&bits, &mut bytes);
                assert_eq!(bytes, expected.iter().map(|&v| v as u8).collect::<Vec<_>>(), "{len}");
                assert_eq!(found as usize, expected.iter().filter(|v| **v).count());
                assert_eq!(found, count(&image, &coarse_m, valid));
            }
        }
    }
}
