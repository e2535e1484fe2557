//! Bicubic interpolation between the samples of a grid by Catmull–Rom (our choice: it passes through the samples, and it is local, so a
//! void in a coarse DTM affects only its own neighbourhood).
//!
//! Beyond its outermost samples the grid is continued in a straight line ([`continued`]), up to the outer edge of the outermost pixels
//! ([`EDGE_PX`]). Further out there is no value.

/// Largest distance of a position beyond the centre of an outermost sample, in samples: half a pixel, plus slack against rounding for
/// positions on the outer edge.
pub const EDGE_PX: f64 = 0.5 + 1e-9;

/// Returns the Catmull–Rom weights of the four samples around a point at fraction `t` after the second sample. They sum to one.
#[must_use]
pub fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (-t + 2.0 * t2 - t3), 0.5 * (2.0 - 5.0 * t2 + 3.0 * t3), 0.5 * (t + 4.0 * t2 - 3.0 * t3), 0.5 * (t3 - t2)]
}

/// Returns sample `k` (1 or 2) beyond the outermost sample of a line, `edge`. `inner` is the neighbour of `edge`, or `edge` itself if the
/// line has one sample.
#[must_use]
pub fn continued(edge: f32, inner: f32, k: usize) -> f32 {
    edge - k as f32 * (inner - edge)
}

/// Returns the value at the fractions `down` and `across`, each in 0 to 1, after the second row and the second column of `around`. If one
/// of the sixteen samples is invalid (not finite), the result is the bilinear interpolation of the inner four. If an invalid one of these
/// four has a weight, the result is not finite.
///
/// ```
/// use elunar_core::resample::bicubic;
///
/// let plane = [[0.0, 1.0, 2.0, 3.0]; 4];
/// assert_eq!(bicubic(&plane, 0.25, 0.5), 1.5);
/// ```
#[must_use]
pub fn bicubic(around: &[[f32; 4]; 4], down: f32, across: f32) -> f32 {
    bicubic_at(around, Fraction::new(down), Fraction::new(across))
}

/// A fraction of the distance between two samples, with its weights: all pixels of a row or column share them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fraction {
    fraction: f32,
    weights: [f32; 4],
}

impl Fraction {
    /// Finds the weights of a fraction, 0 to 1.
    #[must_use]
    pub fn new(fraction: f32) -> Self {
        Self { fraction, weights: catmull_rom(fraction) }
    }
}

/// As [`bicubic`], with weights that were found before.
#[must_use]
#[inline]
pub fn bicubic_at(around: &[[f32; 4]; 4], down: Fraction, across: Fraction) -> f32 {
    let (rows, cols) = (down.weights, across.weights);
    let mut sum = 0.0;
    for (weight, line) in rows.iter().zip(around) {
        sum += weight * (cols[0] * line[0] + cols[1] * line[1] + cols[2] * line[2] + cols[3] * line[3]);
    }
    if sum.is_finite() { sum } else { bilinear(around, down.fraction, across.fraction) }
}

fn bilinear(around: &[[f32; 4]; 4], down: f32, across: f32) -> f32 {
    let corners = [
        ((1.0 - down) * (1.0 - across), around[1][1]),
        ((1.0 - down) * across, around[1][2]),
        (down * (1.0 - across), around[2][1]),
        (down * across, around[2][2]),
    ];
    corners.iter().filter(|(weight, _)| *weight > 0.0).map(|(weight, value)| weight * value).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Keys' kernel with a = -1/2, as a function of the distance.
    fn keys(x: f64) -> f64 {
        let x = x.abs();
        if x < 1.0 {
            1.5 * x * x * x - 2.5 * x * x + 1.0
        } else if x < 2.0 {
            -0.5 * x * x * x + 2.5 * x * x - 4.0 * x + 2.0
        } else {
            0.0
        }
    }

    fn around() -> [[f32; 4]; 4] {
        core::array::from_fn(|r| core::array::from_fn(|c| ((r * 37 + c * 61 + r * r * c * 13) % 97) as f32))
    }

    #[test]
    fn matches_the_cubic_formula_written_out() {
        for (down, across) in [(0.0, 0.0), (0.3, 0.7), (1.0, 0.5), (0.9, 0.1)] {
            let mut expected = 0.0;
            for (r, line) in around().iter().enumerate() {
                for (c, v) in line.iter().enumerate() {
                    expected += f64::from(*v) * keys(1.0 + down - r as f64) * keys(1.0 + across - c as f64);
                }
            }
            // 40 roundings of numbers up to 100.
            assert!((f64::from(bicubic(&around(), down as f32, across as f32)) - expected).abs() < 1e-3);
        }
    }

    #[test]
    fn holes_leave_the_inner_four_and_spoil_those() {
        let mut far = around();
        far[0][3] = f32::NAN;
        let inner = |down: f32, across: f32| {
            let [top, bottom] = [1, 2].map(|r| around()[r][1] * (1.0 - across) + around()[r][2] * across);
            top * (1.0 - down) + bottom * down
        };
        assert!((bicubic(&far, 0.25, 0.5) - inner(0.25, 0.5)).abs() < 1e-4);
        let mut near = around();
        near[2][2] = f32::INFINITY;
        assert!(!bicubic(&near, 0.25, 0.5).is_finite());
        assert_eq!(bicubic(&near, 0.0, 0.0), around()[1][1], "what has no weight does no harm");
    }
}
