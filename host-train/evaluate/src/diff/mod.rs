//! The difference of two DTMs, as in the Ames Stereo Pipeline's `geodiff`: on the grid of the first, with the second interpolated
//! bilinearly.

mod statistics;

pub use statistics::{PERCENTILES, Statistics};

use elunar_base::{Error, Result};
use elunar_raster::Raster;
use elunar_raster::align::{Interpolation, Named, onto};

/// Returns first minus second, or its absolute value, metres, on the grid of the first; NaN where either is invalid.
///
/// # Errors
/// [`Error::Input`] if a DTM has no georeference, they cannot be put on one grid, or they have no valid pixel in common.
pub fn difference(first: Named, second: Named, absolute: bool) -> Result<Raster> {
    let second_placed = onto(second, first, Interpolation::Bilinear)?;
    let subtract = |(&a, &b): (&f32, &f32)| {
        let difference = a - b;
        if absolute { difference.abs() } else { difference }
    };
    let samples: Vec<f32> = first.raster.samples.iter().zip(&second_placed.samples).map(subtract).collect();
    if !samples.iter().any(|d| d.is_finite()) {
        let what = format!("{}: pixels valid there and in {} expected, none found", first.name, second.name);
        return Err(Error::input(what));
    }
    Ok(Raster { samples, ..second_placed })
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_core::sun::Body;
    use elunar_raster::{Crs, GeoRef};

    fn plane(rows: usize, cols: usize, transform: [f64; 6], offset_m: f32) -> Raster {
        let georef = GeoRef { transform, crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0) };
        let height = |i: usize| {
            let (x, y) = georef.centre((i / cols) as f64, (i % cols) as f64);
            (0.01 * x - 0.02 * y) as f32 + offset_m
        };
        Raster { rows, cols, samples: (0..rows * cols).map(height).collect(), georef: Some(georef) }
    }

    #[test]
    fn the_grid_is_that_of_the_first() {
        let first = plane(20, 30, [10.0, 2.0, 0.0, -10.0, 0.0, -2.0], 0.0);
        let second = plane(40, 50, [0.0, 3.0, 0.0, 0.0, 0.0, -3.0], 5.0);
        let (a, b) = (Named::new("a", &first), Named::new("b", &second));
        for (absolute, expected) in [(false, -5.0), (true, 5.0)] {
            let made = difference(a, b, absolute).unwrap();
            assert_eq!((made.rows, made.cols, &made.georef), (20, 30, &first.georef));
            assert_eq!(made.valid_count(), 600);
            assert!(made.samples.iter().all(|d| (d - expected).abs() < 1e-4));
        }
    }

    #[test]
    fn gaps_of_either_are_gaps() {
        let transform = [0.0, 2.0, 0.0, 0.0, 0.0, -2.0];
        let (mut first, mut second) = (plane(3, 3, transform, 0.0), plane(3, 3, transform, 1.0));
        first.samples[0] = f32::NAN;
        second.samples[4] = f32::NAN;
        let made = difference(Named::new("a", &first), Named::new("b", &second), false).unwrap();
        let gaps: Vec<usize> = (0..9).filter(|&i| made.samples[i].is_nan()).collect();
        assert_eq!(gaps, [0, 4]);
        first.samples.iter_mut().enumerate().filter(|(i, _)| *i != 4).for_each(|(_, v)| *v = f32::NAN);
        let refused = difference(Named::new("a", &first), Named::new("b", &second), false);
        assert!(refused.unwrap_err().to_string().contains("a: pixels valid there and in b"));
    }
}
