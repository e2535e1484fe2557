//! The tile of the built-in self test. It is computed from a seed, so that the file stores four bytes instead of a tile.

/// Returns sample `index` of the self-test image, in [0, 1): waves and noise, so that every range of codes occurs.
pub(crate) fn image_sample(seed: u32, cols: usize, index: usize) -> f32 {
    let cols = cols.max(1);
    let (row, col) = ((index / cols) as u32, (index % cols) as u32);
    let wave = (3 * row + 5 * col) & 127;
    let triangle = if wave < 64 { wave } else { 127 - wave };
    (triangle << 17 | hash(seed, index as u32) >> 15) as f32 / (1 << 23) as f32
}

/// Returns sample `index` of the self-test coarse DTM, in [0, nr): a staircase of 16x16 blocks.
pub(crate) fn coarse_sample(seed: u32, cols: usize, index: usize, nr: f32) -> f32 {
    let cols = cols.max(1);
    let block = (index / cols / 16) * cols.div_ceil(16) + index % cols / 16;
    nr * ((hash(!seed, block as u32) >> 8) as f32 / (1 << 24) as f32)
}

/// Returns a 32-bit hash (the finaliser of MurmurHash3).
fn hash(seed: u32, index: u32) -> u32 {
    let mut h = seed ^ index.wrapping_mul(0x9e37_79b9);
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_stay_in_range_and_vary() {
        let image: Vec<f32> = (0..64 * 96).map(|i| image_sample(7, 96, i)).collect();
        let coarse: Vec<f32> = (0..64 * 96).map(|i| coarse_sample(7, 96, i, 50.0)).collect();
        assert!(image.iter().all(|v| (0.0..1.0).contains(v)) && coarse.iter().all(|v| (0.0..50.0).contains(v)));
        assert_ne!(image[0], image[4096]);
        assert_eq!(coarse[0], coarse[15]);
        assert_ne!(coarse[0], coarse[16]);
    }
}
