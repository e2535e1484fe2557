//! Smooth ground: a Gaussian low-pass of heights.

/// Width of the kernel on either side, in standard deviations.
const REACH: f32 = 3.0;

/// Smooths heights by a Gaussian of this standard deviation, pixels. Pixels at the edge repeat beyond it. Below 0.1 nothing changes.
pub(super) fn smooth(heights_m: Vec<f32>, [rows, cols]: [usize; 2], sigma_px: f32) -> Vec<f32> {
    if sigma_px < 0.1 {
        return heights_m;
    }
    let reach = (REACH * sigma_px).ceil() as isize;
    let weights: Vec<f32> = (-reach..=reach).map(|d| libm::expf(-0.5 * (d as f32 / sigma_px).powi(2))).collect();
    let sum: f32 = weights.iter().sum();
    let taps = || (-reach..=reach).zip(weights.iter().map(|w| w / sum));
    let mut across = vec![0.0; heights_m.len()];
    for (line, out) in heights_m.chunks_exact(cols).zip(across.chunks_exact_mut(cols)) {
        for (col, out) in out.iter_mut().enumerate() {
            *out = taps().map(|(d, w)| w * line[(col as isize + d).clamp(0, cols as isize - 1) as usize]).sum();
        }
    }
    let mut made = vec![0.0; heights_m.len()];
    for (row, out) in made.chunks_exact_mut(cols).enumerate() {
        for (d, w) in taps() {
            let from = (row as isize + d).clamp(0, rows as isize - 1) as usize;
            out.iter_mut().zip(&across[from * cols..][..cols]).for_each(|(out, v)| *out += w * v);
        }
    }
    made
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waves_fade_as_under_a_gaussian_and_the_mean_stays() {
        let (rows, cols, sigma) = (64, 80, 1.5f32);
        for length in [6.0f32, 12.0] {
            let wave = |i: usize| 100.0 + (std::f32::consts::TAU * (i % cols) as f32 / length).cos();
            let made = smooth((0..rows * cols).map(wave).collect(), [rows, cols], sigma);
            let kept = (-2.0 * (std::f32::consts::PI * sigma / length).powi(2)).exp();
            let line = 30 * cols;
            for (i, found) in made.iter().enumerate().skip(line + 20).take(40) {
                // The kernel ends at three standard deviations.
                assert!((found - 100.0 - kept * (wave(i) - 100.0)).abs() < 0.01, "{length}: {found} {}", wave(i));
            }
        }
        let rough: Vec<f32> = (0..rows * cols).map(|i| ((i * 7919) % 101) as f32).collect();
        assert_eq!(smooth(rough.clone(), [rows, cols], 0.05), rough);
    }
}
