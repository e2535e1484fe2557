//! Errors of the slope as a vector, in metres per metre: the direction of the slope counts, not only its steepness (our choice).

use super::{each_gradient, mean};
use crate::error::LengthError;
use crate::grid::GridView;
use crate::terrain::PixelSize;

/// Smallest slope towards or away from the Sun that counts as bright or shaded (Sec. VI-C): 3 degrees.
const LEAST_SLOPE_TOWARDS: f64 = 0.052407779283041196; // tan 3°

/// The direction in which ground slopes, relative to the Sun (Sec. VI-C).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Facing {
    /// The ground falls towards the Sun: it appears bright.
    Bright,
    /// The ground falls away from the Sun: it is shaded, or in shadow.
    Shaded,
    /// The slope along the Sun's azimuth is below 3 degrees.
    Neither,
}

impl Facing {
    /// Returns how ground with this gradient (towards east and south, metres per metre) faces a Sun at this azimuth, degrees clockwise from
    /// north.
    ///
    /// ```
    /// use elunar_core::metrics::Facing;
    /// // Rises eastwards, so it falls westwards, towards a Sun in the west.
    /// assert_eq!(Facing::of((0.2, 0.0), 270.0), Facing::Bright);
    /// assert_eq!(Facing::of((0.2, 0.0), 90.0), Facing::Shaded);
    /// assert_eq!(Facing::of((0.2, 0.0), 0.0), Facing::Neither);
    /// ```
    #[must_use]
    pub fn of((east, south): (f64, f64), azimuth_deg: f64) -> Self {
        let azimuth = azimuth_deg.to_radians();
        // Rise per metre towards the Sun, whose direction is (sin, -cos) in (east, south). Ground that falls in this direction faces the
        // Sun.
        let falls = -(east * libm::sin(azimuth) - south * libm::cos(azimuth));
        if falls >= LEAST_SLOPE_TOWARDS {
            Self::Bright
        } else if falls <= -LEAST_SLOPE_TOWARDS {
            Self::Shaded
        } else {
            Self::Neither
        }
    }
}

/// Accumulates |∇z* − ∇z|, the length of the difference between the predicted and the true gradient.
///
/// ```
/// use elunar_core::metrics::GradientErrors;
/// let mut errors = GradientErrors::default();
/// errors.push((0.3, 0.4), (0.0, 0.0));
/// assert_eq!(errors.mean(), Some(0.5));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GradientErrors {
    count: u64,
    sum: f64,
}

impl GradientErrors {
    /// Adds one pixel; gradients towards east and south, metres per metre.
    pub fn push(&mut self, truth: (f64, f64), predicted: (f64, f64)) {
        let (east, south) = (predicted.0 - truth.0, predicted.1 - truth.1);
        self.count += 1;
        self.sum += libm::sqrt(east * east + south * south);
    }

    /// Adds every pixel whose 3 x 3 neighbourhood is real in both grids and for whose true gradient `counts` returns `true`. Heights are in
    /// metres, gradients after Horn ([`crate::terrain::gradient`]).
    ///
    /// # Errors
    /// [`LengthError`] with the two sample counts if the shapes differ.
    pub fn extend(
        &mut self,
        truth_m: GridView<'_, f32>,
        predicted_m: GridView<'_, f32>,
        pixel: PixelSize,
        counts: impl Fn((f64, f64)) -> bool,
    ) -> Result<(), LengthError> {
        each_gradient(truth_m, predicted_m, pixel, |truth, predicted| {
            if counts(truth) {
                self.push(truth, predicted);
            }
        })
    }

    /// Adds the pixels of another accumulator.
    pub fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
    }

    /// Number of pixels.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the mean length, metres per metre; `None` without pixels.
    pub fn mean(&self) -> Option<f64> {
        mean(self.sum, self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(heights: &[f32]) -> GridView<'_, f32> {
        GridView::new(heights, 5, 5).unwrap()
    }

    #[test]
    fn a_ramp_turned_by_a_right_angle_errs_by_its_diagonal() {
        let east: Vec<f32> = (0..25).map(|i| (i % 5) as f32 * 0.6).collect();
        let mut south: Vec<f32> = (0..25).map(|i| (i / 5) as f32 * 0.6).collect();
        let pixel = PixelSize::square(2.0);
        let mut errors = GradientErrors::default();
        errors.extend(view(&east), view(&south), pixel, |_| true).unwrap();
        assert_eq!(errors.count(), 9);
        // Both slopes are equally steep, so SlopeErrors would be 0.
        assert!((errors.mean().unwrap() - 0.3 * 2.0f64.sqrt()).abs() < 1e-6);
        south[12] = f32::NAN;
        let mut holed = GradientErrors::default();
        holed.extend(view(&east), view(&south), pixel, |_| true).unwrap();
        assert_eq!((holed.count(), holed.mean()), (0, None));
        assert!(holed.extend(view(&east), GridView::new(&south[..20], 4, 5).unwrap(), pixel, |_| true).is_err());
    }

    #[test]
    fn only_wanted_pixels_count_and_merging_is_counting() {
        // A roof: the western half faces west.
        let roof: Vec<f32> = (0..25).map(|i| 2.0 - (i as f32 % 5.0 - 2.0).abs()).collect();
        let flat = [0.0; 25];
        let sunlit = |azimuth_deg: f64, facing: Facing| {
            let mut errors = GradientErrors::default();
            let wanted = |g| Facing::of(g, azimuth_deg) == facing;
            errors.extend(view(&roof), view(&flat), PixelSize::square(1.0), wanted).unwrap();
            errors
        };
        let [bright, shaded, ridge] = [Facing::Bright, Facing::Shaded, Facing::Neither].map(|f| sunlit(270.0, f));
        assert_eq!([bright.count(), shaded.count(), ridge.count()], [3, 3, 3]);
        assert_eq!((bright.mean(), ridge.mean()), (Some(1.0), Some(0.0)));
        let mut all = bright;
        all.merge(&shaded);
        all.merge(&ridge);
        assert_eq!((all.count(), all.mean()), (9, Some(2.0 / 3.0)));
        assert_eq!(sunlit(0.0, Facing::Neither).count(), 9);
    }

    #[test]
    fn facing_turns_with_the_sun() {
        // Rises northwards: falls southwards.
        for (azimuth_deg, expected) in [(180.0, Facing::Bright), (0.0, Facing::Shaded), (90.0, Facing::Neither)] {
            assert_eq!(Facing::of((0.0, -0.2), azimuth_deg), expected, "{azimuth_deg}");
        }
        assert_eq!(Facing::of((0.04, 0.0), 270.0), Facing::Neither, "flatter than 3 degrees");
    }
}
