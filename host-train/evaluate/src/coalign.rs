//! Co-alignment of a finished DTM to the coarse DTM, in the two usual forms.
//!
//! Networks that normalise by their own range return relief of an arbitrary scale. DLunarDTMNet and related networks then align the result
//! to the coarse DTM. The papers do not give the details. The forms here are the two of LISTER: a linear fit, and an exchange of the low
//! frequencies.

use super::lowpass::LowPass;
use elunar_base::{Error, Result};
use elunar_raster::Raster;
use serde::{Deserialize, Serialize};

/// How a DTM is aligned to the coarse DTM.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum CoAlignment {
    /// No change.
    #[default]
    None,
    /// Apply the factor and offset that bring the DTM's low frequencies nearest to the coarse DTM's, by least squares.
    Fit,
    /// Apply the fit, then replace the low frequencies by the coarse DTM's.
    LowPass,
}

/// A coarse DTM resolves waves longer than this many of its pixels.
const RESOLVED_COARSE_PX: f64 = 4.0;

impl CoAlignment {
    /// Returns `dtm` aligned to `coarse`. Both are in metres on one grid with pixels of `pixel_m` (row, column). `coarse_m` is the side of
    /// the coarse DTM's own pixels, metres. Pixels without a coarse height become NaN.
    ///
    /// # Errors
    /// [`Error::Input`] if the sizes differ or no pixel is valid in both.
    pub fn apply(self, dtm: &Raster, coarse: &Raster, pixel_m: (f64, f64), coarse_m: f64) -> Result<Raster> {
        if self == Self::None {
            return Ok(dtm.clone());
        }
        if (dtm.rows, dtm.cols) != (coarse.rows, coarse.cols) {
            let what = format!("expected the coarse DTM on the DTM's grid, {} x {}", dtm.rows, dtm.cols);
            return Err(Error::input(format!("co-alignment: {what}, found {} x {}", coarse.rows, coarse.cols)));
        }
        let filter = LowPass::new(RESOLVED_COARSE_PX * coarse_m, pixel_m);
        let both = |map: &Raster| {
            let pairs = map.samples.iter().zip(dtm.samples.iter().zip(&coarse.samples));
            let kept = pairs.map(|(v, (z, c))| if z.is_finite() && c.is_finite() { *v } else { f32::NAN });
            Raster { samples: kept.collect(), ..dtm.clone() }
        };
        let (dtm, coarse) = (both(dtm), both(coarse));
        let (low, low_coarse) = (filter.apply(&dtm).0, filter.apply(&coarse).0);
        let (factor, offset) = line(&low, &low_coarse)?;
        let fitted = |z: f32| (factor * f64::from(z) + offset) as f32;
        let pixel = |i: usize| match self {
            // The low-pass is linear: the low-pass of the fitted DTM is the fitted low-pass of the DTM.
            Self::LowPass => fitted(dtm.samples[i]) - fitted(low[i]) + low_coarse[i],
            _ => fitted(dtm.samples[i]),
        };
        Ok(Raster { samples: (0..dtm.samples.len()).map(pixel).collect(), ..dtm })
    }
}

/// Returns factor and offset of the least-squares line from `x` to `y`. If `x` is constant, the factor is 1.
fn line(x: &[f32], y: &[f32]) -> Result<(f64, f64)> {
    let pairs =
        || x.iter().zip(y).filter(|(x, y)| x.is_finite() && y.is_finite()).map(|(x, y)| (f64::from(*x), f64::from(*y)));
    let n = pairs().count() as f64;
    if n == 0.0 {
        return Err(Error::input("co-alignment: a pixel valid in DTM and coarse DTM expected, none found"));
    }
    let (mean_x, mean_y) = (pairs().map(|p| p.0).sum::<f64>() / n, pairs().map(|p| p.1).sum::<f64>() / n);
    let square: f64 = pairs().map(|p| (p.0 - mean_x).powi(2)).sum();
    let product: f64 = pairs().map(|p| (p.0 - mean_x) * (p.1 - mean_y)).sum();
    let factor = if square > 0.0 { product / square } else { 1.0 };
    Ok((factor, mean_y - factor * mean_x))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(value: impl Fn(f64, f64) -> f64) -> Raster {
        let samples = (0..80 * 100).map(|i| value((i / 100) as f64, (i % 100) as f64) as f32).collect();
        Raster { rows: 80, cols: 100, samples, georef: None }
    }

    fn hill(r: f64, c: f64) -> f64 {
        20.0 * (r * 0.03).sin() + 15.0 * (c * 0.04).cos() - 1500.0
    }

    fn ripple(r: f64, c: f64) -> f64 {
        (r * 1.1).sin() + (c * 1.3).sin()
    }

    fn rms(a: &Raster, b: &Raster) -> f64 {
        let squares =
            a.samples.iter().zip(&b.samples).filter(|(a, _)| a.is_finite()).map(|(a, b)| f64::from(a - b).powi(2));
        (squares.sum::<f64>() / a.valid_count() as f64).sqrt()
    }

    #[test]
    fn a_fit_restores_a_scale_and_an_offset() {
        let (coarse, truth) = (map(hill), map(|r, c| hill(r, c) + ripple(r, c)));
        let shrunk = map(|r, c| 0.8 * (hill(r, c) + ripple(r, c)) + 40.0);
        assert_eq!(CoAlignment::None.apply(&shrunk, &coarse, (2.0, 2.0), 20.0).unwrap().samples, shrunk.samples);
        let fitted = CoAlignment::Fit.apply(&shrunk, &coarse, (2.0, 2.0), 20.0).unwrap();
        assert!(rms(&fitted, &truth) < 0.05 && rms(&shrunk, &truth) > 100.0, "{}", rms(&fitted, &truth));
    }

    #[test]
    fn low_frequencies_are_exchanged_and_ripples_kept() {
        let (coarse, truth) = (map(hill), map(|r, c| hill(r, c) + ripple(r, c)));
        let warped = map(|r, c| hill(r, c) + ripple(r, c) + 6.0 * (c * 0.031 + r * 0.02).sin());
        let [fitted, exchanged] =
            [CoAlignment::Fit, CoAlignment::LowPass].map(|how| how.apply(&warped, &coarse, (2.0, 2.0), 20.0).unwrap());
        assert!(
            rms(&exchanged, &truth) < 0.3 * rms(&fitted, &truth),
            "{} {}",
            rms(&exchanged, &truth),
            rms(&fitted, &truth)
        );
    }

    #[test]
    fn voids_stay_voids_and_misfits_are_refused() {
        let (mut coarse, dtm) = (map(hill), map(hill));
        coarse.samples[123] = f32::NAN;
        let made = CoAlignment::LowPass.apply(&dtm, &coarse, (2.0, 2.0), 20.0).unwrap();
        assert_eq!((made.valid_count(), made.samples[123].is_nan()), (80 * 100 - 1, true));
        let small = Raster { rows: 1, cols: 2, samples: vec![0.0; 2], georef: None };
        assert!(CoAlignment::Fit.apply(&dtm, &small, (2.0, 2.0), 20.0).unwrap_err().to_string().contains("1 x 2"));
        let empty = map(|_, _| f64::NAN);
        assert!(CoAlignment::Fit.apply(&dtm, &empty, (2.0, 2.0), 20.0).is_err());
    }
}
