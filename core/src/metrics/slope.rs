//! Slope errors in degrees. A smooth DTM has such errors even where its heights are right (our choice).

use super::{each_gradient, mean};
use crate::error::LengthError;
use crate::grid::GridView;
use crate::terrain::PixelSize;
use crate::terrain::slope::from_gradient_deg;

/// Accumulates differences of Horn slope, predicted minus true.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SlopeErrors {
    count: u64,
    sum: f64,
    absolute: f64,
    square: f64,
}

impl SlopeErrors {
    /// Adds one pixel; slopes in degrees.
    pub fn push(&mut self, truth_deg: f64, predicted_deg: f64) {
        let error = predicted_deg - truth_deg;
        self.count += 1;
        self.sum += error;
        self.absolute += error.abs();
        self.square += error * error;
    }

    /// Adds every pixel whose 3 x 3 neighbourhood is real in both grids; heights in metres.
    ///
    /// # Errors
    /// [`LengthError`] with the two sample counts if the shapes differ.
    pub fn extend(
        &mut self,
        truth_m: GridView<'_, f32>,
        predicted_m: GridView<'_, f32>,
        pixel: PixelSize,
    ) -> Result<(), LengthError> {
        each_gradient(truth_m, predicted_m, pixel, |truth, predicted| {
            self.push(from_gradient_deg(truth), from_gradient_deg(predicted));
        })
    }

    /// Adds the pixels of another accumulator.
    pub fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        self.absolute += other.absolute;
        self.square += other.square;
    }

    /// Number of pixels.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the mean difference in degrees, negative if the prediction is too smooth. Here and below, `None` without pixels.
    pub fn bias_deg(&self) -> Option<f64> {
        mean(self.sum, self.count)
    }

    /// Returns the mean absolute difference, degrees.
    pub fn mae_deg(&self) -> Option<f64> {
        mean(self.absolute, self.count)
    }

    /// Returns the root mean square difference, degrees.
    pub fn rmse_deg(&self) -> Option<f64> {
        mean(self.square, self.count).map(libm::sqrt)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flattened_ramp_is_too_smooth_by_its_slope() {
        let ramp: Vec<f32> = (0..25).map(|i| (i % 5) as f32 * 2.0).collect();
        let mut flat = vec![0.0f32; 25];
        flat[0] = f32::NAN; // excludes the one window that contains the corner
        let mut errors = SlopeErrors::default();
        let (truth, predicted) = (GridView::new(&ramp, 5, 5).unwrap(), GridView::new(&flat, 5, 5).unwrap());
        errors.extend(truth, predicted, PixelSize::square(2.0)).unwrap();
        assert_eq!(errors.count(), 8);
        assert_eq!(errors.bias_deg(), Some(-45.0));
        let mut twice = errors;
        twice.push(0.0, 45.0);
        twice.merge(&errors);
        assert_eq!(twice.count(), 17);
        assert_eq!((twice.mae_deg(), twice.rmse_deg()), (Some(45.0), Some(45.0)));
        assert!(errors.extend(truth, GridView::new(&flat[..20], 4, 5).unwrap(), PixelSize::square(2.0)).is_err());
    }
}
