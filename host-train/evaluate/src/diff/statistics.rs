//! Statistics of a difference.

use elunar_base::quantile::quantile;
use elunar_core::metrics::HeightErrors;
use elunar_core::metrics::height::LIMITS_M;
use serde::Serialize;

/// Percentages of [`Statistics::percentiles_m`].
pub const PERCENTILES: [f64; 8] = [1.0, 5.0, 16.0, 25.0, 75.0, 84.0, 95.0, 99.0];

/// Turns the median of absolute deviations into the standard deviation of a normal distribution.
const NMAD_FACTOR: f64 = 1.4826;

/// Statistics of differences, metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Statistics {
    /// Number of pixels with a difference.
    pub pixels: u64,
    /// Mean.
    pub mean_m: f64,
    /// Median.
    pub median_m: f64,
    /// Standard deviation about the mean, over all pixels (divided by their number).
    pub std_m: f64,
    /// Root mean square.
    pub rmse_m: f64,
    /// Mean of the absolute values.
    pub mae_m: f64,
    /// Normalised median absolute deviation, 1.4826 · median |d − median d|: a standard deviation that outliers hardly change.
    pub nmad_m: f64,
    /// Smallest value.
    pub min_m: f64,
    /// Largest value.
    pub max_m: f64,
    /// The percentiles [`PERCENTILES`].
    #[serde(skip)]
    pub percentiles_m: [f64; 8],
    /// Shares, in [0, 1], of |d| below 2, 4 and 10 m (the paper's RE, Sec. V).
    #[serde(skip)]
    pub share_within: [f64; 3],
}

impl Statistics {
    /// Computes the statistics of the finite values among `differences_m`; `None` if there is none.
    #[must_use]
    pub fn of(differences_m: &[f32]) -> Option<Self> {
        let mut values: Vec<f64> = differences_m.iter().filter(|d| d.is_finite()).map(|&d| f64::from(d)).collect();
        let mut errors = HeightErrors::default();
        values.iter().for_each(|&d| errors.push(0.0, d));
        let (mean_m, rmse_m) = (errors.bias_m()?, errors.rmse_m()?);
        let variance = values.iter().map(|d| (d - mean_m).powi(2)).sum::<f64>() / values.len() as f64;
        let percentiles_m = PERCENTILES.map(|p| quantile(&mut values, p / 100.0).unwrap_or(f64::NAN));
        let (min_m, max_m) = (quantile(&mut values, 0.0)?, quantile(&mut values, 1.0)?);
        let median_m = quantile(&mut values, 0.5)?;
        values.iter_mut().for_each(|d| *d = (*d - median_m).abs());
        Some(Self {
            pixels: errors.count(),
            mean_m,
            median_m,
            std_m: variance.sqrt(),
            rmse_m,
            mae_m: errors.mae_m()?,
            nmad_m: NMAD_FACTOR * quantile(&mut values, 0.5)?,
            min_m,
            max_m,
            percentiles_m,
            share_within: errors.share_within()?,
        })
    }

    /// Returns the table: one line per figure. The text ends with a newline.
    #[must_use]
    pub fn table(&self) -> String {
        let mut lines = vec![
            ("mean".into(), self.mean_m),
            ("median".into(), self.median_m),
            ("standard deviation".into(), self.std_m),
            ("RMSE".into(), self.rmse_m),
            ("MAE".into(), self.mae_m),
            ("NMAD".into(), self.nmad_m),
            ("minimum".into(), self.min_m),
            ("maximum".into(), self.max_m),
        ];
        lines.extend(PERCENTILES.iter().zip(self.percentiles_m).map(|(p, v)| (format!("percentile {p}"), v)));
        let mut text = format!("{:24}{:>12}\n", "pixels", self.pixels);
        lines.iter().for_each(|(name, value)| text += &format!("{:24}{value:>12.3}\n", format!("{name} [m]")));
        for (limit_m, share) in LIMITS_M.iter().zip(self.share_within) {
            text += &format!("{:24}{:>12.3}\n", format!("|d| < {limit_m} m [%]"), 100.0 * share);
        }
        text
    }

    /// Returns the statistics as JSON: one object, units in the names, shares in [0, 1].
    #[must_use]
    pub fn json(&self) -> serde_json::Value {
        let mut object = serde_json::to_value(self).unwrap_or_default();
        for (percent, value) in PERCENTILES.iter().zip(self.percentiles_m) {
            object[format!("p{percent:02}_m")] = value.into();
        }
        for (limit_m, share) in LIMITS_M.iter().zip(self.share_within) {
            object[format!("share_within_{limit_m}_m")] = share.into();
        }
        object
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matches_numpy() {
        assert_eq!(Statistics::of(&[f32::NAN]), None);
        let folder = tempfile::tempdir().unwrap();
        let values: Vec<f32> = (0..997_u32).map(|i| (f64::from(i * 7919 % 997).sin() * 12.0 + 1.5) as f32).collect();
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        std::fs::write(folder.path().join("d.f32"), bytes).unwrap();
        let script = "
d = np.fromfile('d.f32', '<f4').astype('f8')
m = np.median(d)
print(d.size, d.mean(), m, d.std(), np.sqrt((d * d).mean()), abs(d).mean(), 1.4826 * np.median(abs(d - m)), d.min(), d.max(),
      *np.percentile(d, [1, 5, 16, 25, 75, 84, 95, 99]), *[(abs(d) < l).mean() for l in (2, 4, 10)])
";
        let Some(out) = elunar_testing::rasterio(script, folder.path()) else { return };
        let expected: Vec<f64> = out.split_whitespace().map(|v| v.parse().unwrap()).collect();
        let s = Statistics::of(&values).unwrap();
        let first = [s.pixels as f64, s.mean_m, s.median_m, s.std_m, s.rmse_m, s.mae_m, s.nmad_m, s.min_m, s.max_m];
        let found = [first.as_slice(), &s.percentiles_m, &s.share_within].concat();
        assert_eq!(found.len(), expected.len());
        for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
            assert!((found - expected).abs() < 1e-10 * expected.abs().max(1.0), "{i}: {found} instead of {expected}");
        }
        assert!(s.table().contains("NMAD") && s.json()["p05_m"].is_f64() && s.json()["share_within_4_m"].is_f64());
    }
}
