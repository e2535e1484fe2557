//! Exponential function and GELU in operations that compilers turn into vector instructions. Their errors are a few units in the last
//! place.

use std::f32::consts::{FRAC_1_SQRT_2, LOG2_E};

/// Returns e to the power of `x`. The argument is limited to numbers whose result is neither infinite nor subnormal.
#[inline(always)]
pub(super) fn exp(x: f32) -> f32 {
    // Adding and subtracting it rounds to a whole number, which is then in the lowest bits of the sum.
    const ROUND: f32 = 12_582_912.0;
    let x = x.clamp(-87.0, 88.0);
    let sum = x * LOG2_E + ROUND;
    let n = sum - ROUND;
    // ln 2 in two parts; the product with the first is exact.
    let r = (x - n * 0.693_359_4) + n * 2.121_944_4e-4;
    // Coefficients of the Cephes library.
    let p = 1.987_569_1e-4;
    let p = p * r + 1.398_2e-3;
    let p = p * r + 8.333_452e-3;
    let p = p * r + 4.166_579_6e-2;
    let p = p * r + 1.666_666_5e-1;
    let p = p * r + 0.5;
    let power = f32::from_bits((sum.to_bits() << 23).wrapping_add(1.0f32.to_bits()));
    (p * r * r + r + 1.0) * power
}

/// Returns the error function: a quotient of polynomials, as in XLA and Eigen. From 4 on it is 1 in single precision.
#[inline(always)]
fn erf(x: f32) -> f32 {
    let x = x.clamp(-4.0, 4.0);
    let s = x * x;
    let p = -2.726_142_3e-10;
    let p = p * s + 2.770_681_4e-8;
    let p = p * s - 2.101_024_1e-6;
    let p = p * s - 5.692_506_4e-5;
    let p = p * s - 7.349_906_4e-4;
    let p = p * s - 2.954_6e-3;
    let p = p * s - 1.609_603_3e-2;
    let q = -1.456_607_2e-5;
    let q = q * s - 2.133_740_6e-4;
    let q = q * s - 1.682_827e-3;
    let q = q * s - 7.373_329_2e-3;
    let q = q * s - 1.426_474e-2;
    x * p / q
}

/// Returns x times the probability that a normal number is below x.
#[inline(always)]
pub(super) fn gelu(x: f32) -> f32 {
    0.5 * x * (1.0 + erf(x * FRAC_1_SQRT_2))
}

/// Returns the derivative of [`gelu`].
#[inline(always)]
pub(super) fn gelu_slope(x: f32) -> f32 {
    const DENSITY_AT_0: f32 = 0.398_942_3;
    0.5 * (1.0 + erf(x * FRAC_1_SQRT_2)) + x * DENSITY_AT_0 * exp(-0.5 * x * x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_equal_those_of_the_library() {
        for i in -40_000..40_000 {
            let x = i as f32 * 2e-3;
            let exact = f64::from(x).exp();
            assert!((f64::from(exp(x)) - exact).abs() <= 3e-7 * exact, "exp({x})");
            let exact = libm::erf(f64::from(x));
            assert!((f64::from(erf(x)) - exact).abs() <= 5e-7, "erf({x}): {} {exact}", erf(x));
        }
        assert!(exp(-1000.0) < 1e-37);
    }
}
