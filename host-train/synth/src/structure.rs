//! Roughness of terrain: RMS height difference against distance, with values measured on the Moon.

/// RMS height differences of one NAC DTM, metres, at [`LAGS_M`].
#[derive(Debug, Clone, Copy)]
pub struct Reference {
    /// Site.
    pub site: &'static str,
    /// RMS height differences, metres.
    pub sigma_m: [f64; 6],
}

/// Distances of the reference, metres.
pub const LAGS_M: [f64; 6] = [2.0, 4.0, 8.0, 16.0, 32.0, 64.0];

/// Mare: whole strip NAC_DTM_APOLLO11, 2 m posts. Source: github.com/asrijanga/solar-system,
/// `public/data/moon/roughness.json` at commit 397f900; measured by its author.
pub const MARE: Reference = Reference { site: "NAC_DTM_APOLLO11", sigma_m: [0.12, 0.236, 0.461, 0.876, 1.627, 2.929] };

/// Highland: whole strip NAC_DTM_APOLLO16_1, 2 m posts; source as for [`MARE`].
pub const HIGHLAND: Reference =
    Reference { site: "NAC_DTM_APOLLO16_1", sigma_m: [0.239, 0.47, 0.917, 1.782, 3.455, 6.681] };

/// Returns the mean square height difference, m², over `lag_px` pixels, along rows and columns together. The field is row-major, `cols`
/// wide.
///
/// # Panics
/// If the field is not larger than the lag in both directions.
pub fn mean_square_difference(heights_m: &[f32], cols: usize, lag_px: usize) -> f64 {
    let rows = heights_m.len() / cols;
    assert!(rows > lag_px && cols > lag_px, "a field of {rows} x {cols} pixels has no lag of {lag_px}");
    let square = |a: f32, b: f32| f64::from(a - b) * f64::from(a - b);
    let across: f64 = heights_m
        .chunks_exact(cols)
        .map(|line| line.iter().zip(&line[lag_px..]).map(|(a, b)| square(*a, *b)).sum::<f64>())
        .sum();
    let down: f64 = heights_m.iter().zip(&heights_m[lag_px * cols..]).map(|(a, b)| square(*a, *b)).sum();
    (across + down) / (rows * (cols - lag_px) + (rows - lag_px) * cols) as f64
}
