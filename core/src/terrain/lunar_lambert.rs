//! The reflectance of the lunar surface.

/// Returns the Lunar-Lambert weight L at phase angle `phase_deg` (McEwen 1991), clamped to [0, 1], because the polynomial leaves that range
/// beyond about 105 degrees. Reflectance is 2 L cos i / (cos i + cos e) + (1 - L) cos i for incidence i and emission e.
#[must_use]
pub fn lunar_lambert_weight(phase_deg: f64) -> f64 {
    let a = phase_deg;
    (1.0 - 0.019 * a + 2.42e-4 * a * a - 1.46e-6 * a * a * a).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_the_tabulated_ones() {
        // The cubic in the phase angle, calculated by hand to three decimals, and clamped beyond about 105°.
        for (alpha_deg, expected) in [(0.0, 1.0), (30.0, 0.608), (60.0, 0.416), (90.0, 0.186), (120.0, 0.0)] {
            assert!((lunar_lambert_weight(alpha_deg) - expected).abs() < 1e-3, "{alpha_deg}°");
        }
    }
}
