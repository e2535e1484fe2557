//! Scores of the relief that the coarse DTM lacks: slope vectors, short waves, bright and shaded sides, shading.

use super::lowpass::{LowPass, high_pass};
use super::{Comparison, Scored};
use elunar_base::{Error, Result};
use elunar_core::grid::GridView;
use elunar_core::metrics::{Correlation, Facing, GradientErrors, HeightErrors};
use elunar_core::terrain::{PixelSize, Sun, gradient, hillshade};
use elunar_raster::Raster;
use serde::{Deserialize, Serialize};

/// Image and Sun of a scene.
#[derive(Debug, Clone, Copy)]
pub struct ImageLight<'a> {
    /// The image, on the truth's grid.
    pub image: &'a Raster,
    /// Azimuth of the Sun, degrees clockwise from the grid's up.
    pub azimuth_deg: f64,
    /// Elevation of the Sun, degrees.
    pub elevation_deg: f64,
}

/// Scores of the ground on one side, bright or shaded (Sec. VI-C).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Side {
    /// Pixels scored.
    pub pixels: u64,
    /// Root mean square height error, metres.
    pub rmse_m: f64,
    /// Mean length of the slope vector's error, metres per metre.
    pub slope_vector_error: f64,
}

/// Errors of the relief. A figure that cannot be computed is `None`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ReliefScores {
    /// Mean |∇z* − ∇z| over all pixels, metres per metre, with Horn's gradients.
    pub slope_vector_error: Option<f64>,
    /// Root mean square error of the waves longer than the high-pass wavelength, metres. The coarse DTM determines these waves.
    pub low_pass_rmse_m: Option<f64>,
    /// Root mean square error of the waves shorter than the high-pass wavelength, metres ([`high_pass`]).
    pub high_pass_rmse_m: Option<f64>,
    /// Correlation of the short waves with the truth's short waves, [-1, 1].
    pub high_pass_correlation: Option<f64>,
    /// Ground that falls towards the Sun by 3 degrees or more in the truth.
    pub bright: Option<Side>,
    /// Ground that falls away from the Sun by 3 degrees or more in the truth.
    pub shaded: Option<Side>,
    /// Correlation of the image with the DTM's hillshade under the image's Sun.
    pub shading_correlation: Option<f64>,
}

/// Scores the relief of one candidate of [`super::compare`]. Waves shorter than `wavelength_m` are
/// the short waves.
///
/// # Errors
/// [`Error::Input`] if rasters differ in size.
pub fn relief(
    comparison: &Comparison,
    scored: &Scored,
    wavelength_m: f64,
    light: Option<ImageLight>,
) -> Result<ReliefScores> {
    let misfit = |e: elunar_core::error::LengthError| Error::input(format!("{}: {e}", scored.name));
    let pixel = comparison.pixel;
    let placed = &scored.placed;
    // Truth and candidate have the same voids, so that a void of one map does not change only one low-pass.
    let common = &comparison.truth_m;
    let mut slopes = GradientErrors::default();
    let (truth_view, dtm_view) = (view(common)?, view(placed)?);
    slopes.extend(truth_view, dtm_view, pixel, |_| true).map_err(misfit)?;
    let pixel_m = (pixel.row_m, pixel.col_m);
    let [fine_truth, fine] = [common, placed].map(|map| high_pass(map, wavelength_m, pixel_m));
    let (mut heights, mut waves) = (HeightErrors::default(), Correlation::default());
    heights.extend(&fine_truth, &fine, None).map_err(misfit)?;
    waves.extend(&fine_truth, &fine, None).map_err(misfit)?;
    let side = |facing| light.map_or(Ok(None), |light| side(truth_view, dtm_view, pixel, light.azimuth_deg, facing));
    Ok(ReliefScores {
        slope_vector_error: slopes.mean(),
        low_pass_rmse_m: long_waves(&scored.error_m, wavelength_m, pixel_m),
        high_pass_rmse_m: heights.rmse_m(),
        high_pass_correlation: waves.coefficient(),
        bright: side(Facing::Bright)?,
        shaded: side(Facing::Shaded)?,
        shading_correlation: light.map_or(Ok(None), |light| shading(placed, pixel, light))?,
    })
}

/// Returns the root mean square of a map's long waves over its valid pixels.
fn long_waves(error_m: &Raster, wavelength_m: f64, pixel_m: (f64, f64)) -> Option<f64> {
    let (smooth, _) = LowPass::new(wavelength_m, pixel_m).apply(error_m);
    let squares = smooth.iter().filter(|v| v.is_finite()).map(|v| f64::from(*v).powi(2));
    let (sum, count) = squares.fold((0.0, 0_usize), |(sum, count), square| (sum + square, count + 1));
    (count > 0).then(|| (sum / count as f64).sqrt())
}

fn view(map: &Raster) -> Result<GridView<'_, f32>> {
    GridView::new(&map.samples, map.rows, map.cols).map_err(|e| Error::input(format!("evaluate: {e}")))
}

fn side(
    truth: GridView<'_, f32>,
    dtm: GridView<'_, f32>,
    pixel: PixelSize,
    azimuth_deg: f64,
    facing: Facing,
) -> Result<Option<Side>> {
    let misfit = |e: elunar_core::error::LengthError| Error::input(format!("evaluate: {e}"));
    let faces = |g| Facing::of(g, azimuth_deg) == facing;
    let (mut slopes, mut heights) = (GradientErrors::default(), HeightErrors::default());
    slopes.extend(truth, dtm, pixel, faces).map_err(misfit)?;
    for row in 0..truth.rows() {
        for (col, (z, predicted)) in truth.row(row).iter().zip(dtm.row(row)).enumerate() {
            let counts = predicted.is_finite() && gradient(truth, row, col, pixel).is_some_and(faces);
            if counts {
                heights.push(f64::from(*z), f64::from(*predicted));
            }
        }
    }
    let both = heights.rmse_m().zip(slopes.mean());
    Ok(both.map(|(rmse_m, slope_vector_error)| Side { pixels: heights.count(), rmse_m, slope_vector_error }))
}

fn shading(dtm: &Raster, pixel: PixelSize, light: ImageLight) -> Result<Option<f64>> {
    let misfit = |e: elunar_core::error::LengthError| Error::input(format!("image: {e}"));
    let mut shade = vec![0; dtm.samples.len()];
    let sun = Sun { azimuth_deg: light.azimuth_deg, elevation_deg: light.elevation_deg, exaggeration: 1.0 };
    hillshade(view(dtm)?, pixel, sun, &mut shade).map_err(misfit)?;
    let shade: Vec<f32> = shade.into_iter().map(|s| if s == 0 { f32::NAN } else { f32::from(s) }).collect();
    let mut found = Correlation::default();
    found.extend(&light.image.samples, &shade, None).map_err(misfit)?;
    Ok(found.coefficient())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Candidate, compare};
    use elunar_core::sun::Body;
    use elunar_raster::align::Named;
    use elunar_raster::{Crs, GeoRef};

    fn raster(rows: usize, cols: usize, height: impl Fn(f64, f64) -> f64) -> Raster {
        let georef = GeoRef {
            transform: [0.0, 2.0, 0.0, 0.0, 0.0, -2.0],
            crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0),
        };
        let samples = (0..rows * cols).map(|i| height((i / cols) as f64, (i % cols) as f64) as f32).collect();
        Raster { rows, cols, samples, georef: Some(georef) }
    }

    fn score(truth: &Raster, dtm: &Raster, light: Option<ImageLight>) -> ReliefScores {
        let found = compare(Named::new("truth", truth), &[Candidate::fine("dtm", dtm)], None).unwrap();
        relief(&found, &found.scored[0], 60.0, light).unwrap()
    }

    /// Returns ripples of 24 m on a slope that changes over 800 m.
    fn hills(r: f64, c: f64) -> f64 {
        6.0 * (r * 0.0157 + c * 0.01).sin() + 0.8 * (c * 0.52).sin() + 0.5 * (r * 0.6).cos()
    }

    #[test]
    fn an_error_of_long_waves_is_no_error_of_relief() {
        let truth = raster(100, 140, hills);
        let dtm = raster(100, 140, |r, c| hills(r, c) + 5.0 + 0.002 * r);
        let found = score(&truth, &dtm, None);
        assert!(found.high_pass_rmse_m.unwrap() < 0.01 && found.high_pass_correlation.unwrap() > 0.999, "{found:?}");
        assert!((found.slope_vector_error.unwrap() - 0.001).abs() < 1e-4);
        assert!((found.low_pass_rmse_m.unwrap() - 5.1).abs() < 0.02, "{found:?}");
        assert_eq!((found.bright, found.shading_correlation), (None, None));
    }

    #[test]
    fn a_dtm_without_ripples_lacks_all_of_the_short_waves() {
        let truth = raster(100, 140, hills);
        let smooth = raster(100, 140, |r, c| 6.0 * (r * 0.0157 + c * 0.01).sin());
        let found = score(&truth, &smooth, None);
        // RMS of the ripples. The filter passes almost all of their amplitude.
        let ripples = (0.5_f64 * (0.8 * 0.8 + 0.5 * 0.5)).sqrt();
        assert!((found.high_pass_rmse_m.unwrap() / ripples - 1.0).abs() < 0.05, "{found:?}");
        assert!(found.high_pass_correlation.unwrap().abs() < 0.2, "{found:?}");
        // At edges the means are one-sided, and ripples do not cancel exactly.
        assert!(found.low_pass_rmse_m.unwrap() < 0.1 * ripples, "{found:?}");
        let inverted = raster(100, 140, |r, c| 2.0 * 6.0 * (r * 0.0157 + c * 0.01).sin() - hills(r, c));
        assert!(score(&truth, &inverted, None).high_pass_correlation.unwrap() < -0.9);
    }

    /// The figures of `truth.tif`, `dtm.tif` and `image.tif` from their definitions.
    const NUMPY: &str = "
read = lambda name: rasterio.open(name).read(1, masked=True).astype('f8').filled(np.nan)
z, i = read('dtm.tif'), read('image.tif')
t = np.where(np.isfinite(z), read('truth.tif'), np.nan)
def gradient(h):
    p = [[h[i:h.shape[0] - 2 + i, j:h.shape[1] - 2 + j] for j in range(3)] for i in range(3)]
    hole = 0 * sum(sum(row) for row in p)
    dx = ((p[0][2] + 2 * p[1][2] + p[2][2]) - (p[0][0] + 2 * p[1][0] + p[2][0])) / 16
    dy = ((p[2][0] + 2 * p[2][1] + p[2][2]) - (p[0][0] + 2 * p[0][1] + p[0][2])) / 16
    return dx + hole, dy + hole
(tx, ty), (zx, zy) = gradient(t), gradient(z)
e = np.hypot(zx - tx, zy - ty)
sigma = 60 / 2 * np.sqrt(np.log(2) / 2) / np.pi
def low(h):
    k = lambda n: np.exp(-0.5 * ((np.arange(n)[:, None] - np.arange(n)) / sigma) ** 2) * (abs(np.arange(n)[:, None] - np.arange(n)) <= np.ceil(3 * sigma))
    a, b = k(h.shape[0]), k(h.shape[1])
    one = lambda n: np.exp(-0.5 * (np.arange(-n, n + 1) / sigma) ** 2).sum() ** 2
    valid = np.isfinite(h)
    sums, weights = (a @ np.where(valid, h, 0) @ b), (a @ valid @ b)
    return np.where(valid, sums / weights, np.nan), weights / one(int(np.ceil(3 * sigma)))
def high(h):
    smooth, weight = low(h)
    return np.where(weight >= 0.9, h - smooth, np.nan)
ht, hz = high(t), high(z)
both = np.isfinite(ht) & np.isfinite(hz)
rms = lambda v: np.sqrt(np.nanmean(v * v))
az, el = np.radians(250), np.radians(35)
falls = -(tx * np.sin(az) - ty * np.cos(az))
limit = np.tan(np.radians(3))
c = np.maximum(1, np.round(1 + 254 * np.clip((np.sin(el) - (zx * np.sin(az) - zy * np.cos(az)) * np.cos(el)) / np.sqrt(1 + zx**2 + zy**2), 0, None)))
lit = np.isfinite(c)
inner = (z - t)[1:-1, 1:-1]
print(np.nanmean(e), rms(low(z - t)[0]), rms(hz - ht), np.corrcoef(ht[both], hz[both])[0, 1],
      *[v for side in (falls >= limit, falls <= -limit) for m in [side & np.isfinite(e)] for v in (np.sum(m & np.isfinite(inner)), rms(inner[m]), np.mean(e[m]))],
      np.corrcoef(c[lit], i[1:-1, 1:-1][lit])[0, 1])
";

    /// All figures of a DTM with a void; numpy computes them from the definitions.
    #[test]
    fn figures_match_numpy() {
        use elunar_raster::geotiff::{WriteOptions, write};
        let folder = tempfile::tempdir().unwrap();
        let truth = raster(60, 70, hills);
        let mut dtm = raster(60, 70, |r, c| 1.03 * hills(r, c) + 0.3 * (r * 0.8 + c * 0.3).sin() + 0.4);
        dtm.samples[20 * 70 + 31] = f32::NAN;
        let image = raster(60, 70, |r, c| hills(r, c + 0.7) - hills(r, c - 0.7) + 0.1 * (r * c).sin());
        for (name, raster) in [("truth.tif", &truth), ("dtm.tif", &dtm), ("image.tif", &image)] {
            write(&folder.path().join(name), raster, &WriteOptions::heights("test")).unwrap();
        }
        let Some(out) = elunar_testing::rasterio(NUMPY, folder.path()) else { return };
        let expected: Vec<f64> = out.split_whitespace().map(|v| v.parse().unwrap()).collect();
        let light = ImageLight { image: &image, azimuth_deg: 250.0, elevation_deg: 35.0 };
        let found = score(&truth, &dtm, Some(light));
        let side = |side: Option<Side>| side.map(|s| [s.pixels as f64, s.rmse_m, s.slope_vector_error]).unwrap();
        let figures =
            [found.slope_vector_error, found.low_pass_rmse_m, found.high_pass_rmse_m, found.high_pass_correlation];
        let figures = [figures.map(Option::unwrap).to_vec(), side(found.bright).to_vec(), side(found.shaded).to_vec()];
        let figures = [figures.concat(), vec![found.shading_correlation.unwrap()]].concat();
        assert_eq!(figures.len(), expected.len());
        assert!(expected[4] > 300.0 && expected[7] > 300.0, "enough of either side: {expected:?}");
        for (k, (found, expected)) in figures.iter().zip(&expected).enumerate() {
            // Low-passes are stored in single precision.
            assert!(
                (found - expected).abs() < 2e-5 * expected.abs().max(1.0),
                "figure {k}: {found} instead of {expected}"
            );
        }
    }

    #[test]
    fn sides_are_scored_apart_and_shading_tells_the_right_relief() {
        let truth = raster(100, 140, hills);
        let image = raster(100, 140, |r, c| hills(r, c + 1.0) - hills(r, c - 1.0)); // bright where the ground faces west
        let light = ImageLight { image: &image, azimuth_deg: 270.0, elevation_deg: 45.0 };
        // The side that faces east is wrong by 2 m.
        let dtm = raster(100, 140, |r, c| hills(r, c) + if hills(r, c + 1.0) < hills(r, c - 1.0) { 2.0 } else { 0.0 });
        let found = score(&truth, &dtm, Some(light));
        let (bright, shaded) = (found.bright.unwrap(), found.shaded.unwrap());
        assert!(bright.pixels > 2000 && shaded.pixels > 2000);
        assert!(bright.rmse_m < 0.2 && shaded.rmse_m > 1.9, "{bright:?} {shaded:?}");
        assert!(score(&truth, &truth, Some(light)).shading_correlation.unwrap() > 0.9);
        let inverted = raster(100, 140, |r, c| -hills(r, c));
        assert!(score(&truth, &inverted, Some(light)).shading_correlation.unwrap() < -0.9);
    }
}
