//! What of the coarse DTM's slopes is relief.
//!
//! A regression on slopes with errors finds a light that is too weak, so its relief is too high. Laser tracks and seams leave stripes and steps in a
//! coarse DTM: slopes across them alone. Ground has about the same mean square slope in all directions. So a ratio of the mean square slopes along
//! the steepest direction and across it above 1.5 counts as error, and the more the larger it is: of 1.5^2 and more, ground that is alike in all
//! directions remains (our choice). The contrast must have room for it: ground that is steeper in one direction, as a valley, shows that in its
//! image. Without the error a light must not explain more than 0.75 of the contrast (our choice).

use super::square;

/// Largest ratio of the mean square slopes along the steepest direction and across it that is all relief.
const STEEPER_MAX: f64 = 1.5;
/// Largest share of the contrast that is explained without the error.
const EXPLAINED_MAX: f64 = 0.75;

/// Products of an octave as they would be without the error of the slopes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Relief {
    /// Sums of products of slopes: xx, xy, yy.
    pub(super) slopes: [f64; 3],
    /// With the slopes' products C, and R the relief's: R C^-1 R, the precision of a light R^-1 v in units of the noise's.
    pub(super) precision: [f64; 3],
    /// The precision times this light, R C^-1 v.
    pub(super) vector: [f64; 2],
}

impl Relief {
    /// Takes the error out of sums of products of contrast and slopes: II, Ix, Iy, xx, xy, yy.
    pub(super) fn of([ii, ix, iy, xx, xy, yy]: [f64; 6]) -> Self {
        let (mean, half) = (0.5 * (xx + yy), libm::hypot(0.5 * (xx - yy), xy));
        let (least, most) = (mean - half, mean + half);
        // The projection onto the steepest direction.
        let steepest = [xx - least, xy, yy - least].map(|v| v / (2.0 * half));
        let along = square(steepest, [ix, iy]);
        let room = EXPLAINED_MAX - (ix * ix + iy * iy - along) / (least * ii);
        let ratio = most / least;
        let of_relief = (STEEPER_MAX * STEEPER_MAX / ratio).clamp(1.0, STEEPER_MAX);
        let kept = if room > 0.0 { (of_relief / ratio).max(along / (most * ii * room)).min(1.0) } else { 1.0 };
        let whole = Self { slopes: [xx, xy, yy], precision: [xx, xy, yy], vector: [ix, iy] };
        if kept >= 1.0 {
            return whole;
        }
        let less = |part: f64| [0, 1, 2].map(|i| whole.slopes[i] - part * most * steepest[i]);
        let turned = [steepest[0] * ix + steepest[1] * iy, steepest[1] * ix + steepest[2] * iy];
        Self {
            slopes: less(1.0 - kept),
            precision: less(1.0 - kept * kept),
            vector: [ix - (1.0 - kept) * turned[0], iy - (1.0 - kept) * turned[1]],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the light that products show.
    fn light(relief: &Relief) -> [f64; 2] {
        let ([xx, xy, yy], [x, y]) = (relief.precision, relief.vector);
        let determinant = xx * yy - xy * xy;
        [(yy * x - xy * y) / determinant, (xx * y - xy * x) / determinant]
    }

    /// Returns products of ground with a mean square slope of 1 in every direction and this light. Slopes have an error of this mean square from one
    /// direction, contrast has noise.
    fn products([x, y]: [f64; 2], (turn, error): (f64, f64), noise: f64) -> [f64; 6] {
        let (sin, cos) = turn.sin_cos();
        [x * x + y * y + noise, x, y, 1.0 + error * cos * cos, error * cos * sin, 1.0 + error * sin * sin]
    }

    #[test]
    fn slopes_of_one_direction_alone_are_error() {
        for turn in [0.0, 0.4, 1.3, 2.9] {
            let made = products([0.6, 0.8], (turn, 9.0), 1.0);
            let relief = Relief::of(made);
            let (found, raw) = (
                light(&relief),
                light(&Relief { slopes: [0.0; 3], precision: [made[3], made[4], made[5]], vector: [made[1], made[2]] }),
            );
            // Along the error, a regression has a tenth of the light.
            let along = |light: [f64; 2]| light[0] * turn.cos() + light[1] * turn.sin();
            assert!((along(raw) - 0.1 * along([0.6, 0.8])).abs() < 1e-12, "{raw:?}");
            assert!((found[0] - 0.6).abs() < 1e-12 && (found[1] - 0.8).abs() < 1e-12, "{turn}: {found:?}");
            // The relief's own slopes are alike in all directions; the light is less sure than without error.
            let sure = |products| square(products, [turn.cos(), turn.sin()]);
            assert!(
                (sure(relief.slopes) - 1.0).abs() < 1e-12 && (sure(relief.precision) - 0.1).abs() < 1e-12,
                "{relief:?}"
            );
        }
        // Part of a smaller ratio may be of the ground.
        let along = |error: f64| Relief::of(products([0.6, 0.8], (0.0, error), 1.0)).slopes[0];
        for (error, kept) in [(0.25, 1.25), (0.5, 1.5), (0.8, 1.25), (1.25, 1.0), (3.0, 1.0)] {
            assert!((along(error) - kept).abs() < 1e-12, "{error}: {}", along(error));
        }
    }

    #[test]
    fn relief_that_the_image_shows_is_kept() {
        // Slopes of the first direction are three times as steep as across, and the image shows them.
        let ground = [9.0 * 0.36 + 0.64, 9.0 * 0.6, 0.8, 9.0, 0.0, 1.0];
        assert_eq!(Relief::of(ground).slopes, [9.0, 0.0, 1.0]);
        // With three times as much noise as shading there is room for some of it: so much that 0.75 of the contrast are explained.
        let [shown, ..] = ground;
        let [xx, xy, yy] = Relief::of([4.0 * shown, 9.0 * 0.6, 0.8, 9.0, 0.0, 1.0]).slopes;
        let explained = (9.0_f64 * 0.6).powi(2) / xx + 0.64;
        assert!(
            (explained / (4.0 * shown) - EXPLAINED_MAX).abs() < 1e-12 && xy == 0.0 && yy == 1.0,
            "{xx} {explained}"
        );
    }

    #[test]
    fn ground_alike_in_all_directions_and_any_numbers_stay() {
        for products in [
            [2.0, 0.6, 0.8, 1.2, 0.1, 1.0],
            [1.0, 0.0, 0.0, 1.0, 0.0, 1.0],
            [0.0; 6],
            [1.0, 0.5, 0.0, 1.0, 0.0, 0.0],
            [f64::NAN; 6],
        ] {
            let [_, ix, iy, xx, xy, yy] = products;
            let Relief { slopes, precision, vector } = Relief::of(products);
            assert_eq!(
                format!("{slopes:?} {precision:?} {vector:?}"),
                format!("{:?} {:?} {:?}", [xx, xy, yy], [xx, xy, yy], [ix, iy])
            );
        }
    }
}
