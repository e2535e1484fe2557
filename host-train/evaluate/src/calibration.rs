//! Whether errors are as large as expected: coverage of expected standard deviations, and reliability.

use super::View;
use super::expected::{ExpectedErrorMaps, ORIGINS};
use elunar_base::{Error, Result};
use elunar_core::grid::GridView;
use elunar_core::photoclinometry::Origin;
use elunar_core::terrain::{PixelSize, gradient};
use elunar_core::tile::Window;
use elunar_picture::{Chart, Series, plot};
use image::RgbImage;
use serde_json::{Value, json};

/// Multiples of the standard deviation whose coverage is reported. A Gaussian's is 68.3 and 95.0 %.
const LEVELS_SD: [f64; 2] = [1.0, 1.96];
/// Nominal probabilities of the reliability curve: 5, 10, ... 95 %.
const NOMINAL: usize = 19;

/// Coverage of errors by multiples of their expected standard deviation.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Coverage {
    /// Errors counted. A slope has two, one along each axis.
    pub errors: u64,
    within: [u64; LEVELS_SD.len()],
    nominal: [u64; NOMINAL],
}

impl Coverage {
    /// Adds an error with its expected standard deviation, of the same unit.
    fn push(&mut self, error: f64, sd: f64, limits: &[f64; NOMINAL]) {
        self.errors += 1;
        let count = |counts: &mut [u64], limits: &[f64]| {
            counts.iter_mut().zip(limits).for_each(|(n, limit)| *n += u64::from(error.abs() <= limit * sd));
        };
        count(&mut self.within, &LEVELS_SD);
        count(&mut self.nominal, limits);
    }

    fn merge(mut self, other: &Self) -> Self {
        self.errors += other.errors;
        self.within.iter_mut().zip(other.within).for_each(|(n, m)| *n += m);
        self.nominal.iter_mut().zip(other.nominal).for_each(|(n, m)| *n += m);
        self
    }

    /// Returns the shares, in [0, 1], of errors within 1 and 1.96 standard deviations; `None` without errors.
    #[must_use]
    pub fn within(&self) -> Option<[f64; 2]> {
        (self.errors > 0).then(|| self.within.map(|n| n as f64 / self.errors as f64))
    }

    /// Returns the reliability curve: nominal probability of a Gaussian and observed frequency. Empty without errors.
    #[must_use]
    pub fn reliability(&self) -> Vec<(f64, f64)> {
        let point = |(k, n): (usize, &u64)| (nominal(k), *n as f64 / self.errors as f64);
        if self.errors == 0 { vec![] } else { self.nominal.iter().enumerate().map(point).collect() }
    }

    fn json(&self) -> Value {
        let within = self.within();
        json!({ "errors": self.errors, "within_1_sd": within.map(|w| w[0]), "within_1_96_sd": within.map(|w| w[1]) })
    }
}

/// Coverage of a DTM's expected errors, of heights and slopes.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// File of the expected errors.
    pub name: String,
    /// Coverage of height errors by the code of their [`Origin`]. No mean is removed.
    pub heights: [Coverage; 5],
    /// Coverage of slope errors along both axes (Horn's gradients), by the code of the [`Origin`] of the middle pixel.
    pub slopes: [Coverage; 5],
}

/// Compares the errors of the first candidate with the expected ones. Pixels without an expected error do not count.
///
/// Expected errors are those of the DTM's own grid. If the view has a resolution, the errors compared are those of smoothed heights.
///
/// # Errors
/// If the expected errors cannot be brought onto the truth's grid, or a file cannot be read.
pub fn calibration(view: &View<'_>, expected: &ExpectedErrorMaps) -> Result<Calibration> {
    let maps = view.maps;
    let placed = expected.onto(maps.truth().info(), maps.truth_name())?;
    let (pixel, limits) = (maps.pixel(), std::array::from_fn(|k| two_sided(nominal(k))));
    let empty = [Coverage::default(); 5];
    let mut found = Calibration { name: expected.name.clone(), heights: empty, slopes: empty };
    view.each_band(&mut |band| {
        let [Some(truth), Some(dtm)] = [band.maps.first(), band.maps.get(1)] else {
            return Err(Error::input("evaluate: a DTM expected, none found"));
        };
        let error_m: Vec<f32> = dtm.iter().zip(truth).map(|(z, t)| z - t).collect();
        let (first, rows) = (band.inner.start * band.cols, band.inner.len());
        let window = Window { row: band.row + band.inner.start, col: 0, rows, cols: band.cols };
        let expected = placed.read(window)?;
        found.add(&error_m, (band.cols, first), &expected, pixel, &limits)
    })?;
    Ok(found)
}

impl Calibration {
    /// Adds errors of a map of `cols` columns from sample `first` on, with what was expected there.
    fn add(
        &mut self,
        error_m: &[f32],
        (cols, first): (usize, usize),
        [heights_m, slopes, origins]: &[Vec<f32>; 3],
        pixel: PixelSize,
        limits: &[f64; NOMINAL],
    ) -> Result<()> {
        let misfit = |e: elunar_core::error::LengthError| Error::input(format!("evaluate: {e}"));
        let error = GridView::new(error_m, error_m.len() / cols.max(1), cols).map_err(misfit)?;
        for (k, code) in origins.iter().enumerate() {
            let i = first + k;
            if !code.is_finite() || !error_m[i].is_finite() {
                continue;
            }
            let origin = *code as usize;
            let (sd_m, sd) = (f64::from(heights_m[k]), f64::from(slopes[k]));
            if sd_m.is_finite() {
                self.heights[origin].push(f64::from(error_m[i]), sd_m, limits);
            }
            // The gradient is linear: that of the error is the error of the gradient.
            if let Some((east, south)) = gradient(error, i / cols, i % cols, pixel).filter(|_| sd.is_finite()) {
                [east, south].iter().for_each(|e| self.slopes[origin].push(*e, sd, limits));
            }
        }
        Ok(())
    }

    /// Returns the coverage of all heights and of all slopes.
    #[must_use]
    pub fn all(&self) -> [Coverage; 2] {
        [&self.heights, &self.slopes].map(|by| by.iter().fold(Coverage::default(), |sum, one| sum.merge(one)))
    }

    /// Returns the coverage as a table. The text ends with a newline.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = format!(
            "expected errors of {}: share of |error| within 1 sd (68.3 % of a Gaussian) and 1.96 sd (95.0 %)\n{:22}{:>12}{:>8}{:>9}{:>14}{:>8}{:>9}\n",
            self.name, "origin", "heights", "1 sd", "1.96 sd", "slopes", "1 sd", "1.96 sd"
        );
        let cells = |one: &Coverage| match one.within() {
            Some([one_sd, two_sd]) => format!("{:>8.1}{:>9.1}", 100.0 * one_sd, 100.0 * two_sd),
            None => format!("{:>8}{:>9}", "-", "-"),
        };
        let mut line = |name: &str, [heights, slopes]: [&Coverage; 2]| {
            let (of_heights, of_slopes) = (cells(heights), cells(slopes));
            text += &format!("{name:22}{:>12}{of_heights}{:>14}{of_slopes}\n", heights.errors, slopes.errors);
        };
        let all = self.all();
        line("all", [&all[0], &all[1]]);
        for origin in ORIGINS {
            let both = [&self.heights, &self.slopes].map(|by| &by[origin as usize]);
            if both.iter().any(|one| one.errors > 0) {
                line(name(origin), both);
            }
        }
        text
    }

    /// Returns the coverage as JSON: shares in [0, 1], all pixels and by origin, and the reliability curve.
    #[must_use]
    pub fn json(&self) -> Value {
        let [heights, slopes] = self.all();
        let by = |all: &Coverage, by: &[Coverage; 5]| {
            let mut object = json!({ "all": all.json() });
            for origin in ORIGINS {
                object[name(origin).replace(' ', "_").to_lowercase()] = by[origin as usize].json();
            }
            object
        };
        let curve = |of: &Coverage| of.reliability().iter().map(|p| p.1).collect::<Vec<f64>>();
        json!({
            "file": self.name,
            "heights": by(&heights, &self.heights),
            "slopes": by(&slopes, &self.slopes),
            "reliability": {
                "nominal": (0..NOMINAL).map(nominal).collect::<Vec<f64>>(),
                "heights": curve(&heights),
                "slopes": curve(&slopes),
            },
        })
    }

    /// Draws the reliability curves of heights and slopes. Below the diagonal the expected errors are too small.
    ///
    /// # Errors
    /// [`Error::Input`] if there is neither a height nor a slope with an expected error.
    pub fn picture(&self) -> Result<RgbImage> {
        let percent = |points: Vec<(f64, f64)>| points.iter().map(|(x, y)| (100.0 * x, 100.0 * y)).collect();
        let [heights, slopes] = self.all().map(|all| all.reliability());
        if heights.is_empty() && slopes.is_empty() {
            return Err(Error::input(format!("{}: a pixel with an expected error expected, none found", self.name)));
        }
        let diagonal = (0..NOMINAL).map(|k| (nominal(k), nominal(k))).collect();
        let series = [("as expected", diagonal), ("heights", heights), ("slopes", slopes)]
            .map(|(name, points)| Series { name: name.into(), points: percent(points) });
        let chart = Chart {
            title: "Reliability of the expected errors",
            x: "probability of a Gaussian, %",
            y: "errors within, %",
            log_y: false,
        };
        plot(&chart, &series)
    }
}

fn name(origin: Origin) -> &'static str {
    match origin {
        Origin::Image => "image",
        Origin::Blended => "image and coarse DTM",
        Origin::Coarse => "coarse DTM",
        Origin::Shadow => "shadow",
        Origin::Void => "no height",
    }
}

fn nominal(k: usize) -> f64 {
    (k + 1) as f64 / (NOMINAL + 1) as f64
}

/// Returns the multiple of the standard deviation within which a Gaussian lies with `probability` (0 to 0.99), by bisection of the series
/// P = √(2/π) Σ (-1)^k z^(2k+1) / (2^k k! (2k+1)).
fn two_sided(probability: f64) -> f64 {
    let within = |z: f64| {
        let (mut term, mut sum) = (z, z);
        for k in 1..60 {
            term *= -z * z / (2.0 * f64::from(k));
            sum += term / f64::from(2 * k + 1);
        }
        sum * (2.0 / std::f64::consts::PI).sqrt()
    };
    let (mut low, mut high) = (0.0, 3.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if within(middle) < probability { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::EvaluatedMaps;
    use elunar_core::sun::Body;
    use elunar_raster::align::Interpolation;
    use elunar_raster::source::{InMemory, Source};
    use elunar_raster::{Crs, GeoRef, Raster};
    use rand::{Rng, SeedableRng};
    use std::sync::Arc;

    const ROWS: usize = 300;
    const COLS: usize = 400;

    fn raster(value: impl FnMut(usize) -> f32) -> Raster {
        let georef = GeoRef {
            transform: [0.0, 2.0, 0.0, 0.0, 0.0, -2.0],
            crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0),
        };
        Raster { rows: ROWS, cols: COLS, samples: (0..ROWS * COLS).map(value).collect(), georef: Some(georef) }
    }

    fn sd_m(i: usize) -> f32 {
        if i % COLS < COLS / 2 { 0.5 } else { 4.0 }
    }

    /// Independent Gaussian errors (Box and Muller) of 0.5 m in the left half, 4 m in the right one, and `factor` times the standard deviations.
    fn case(factor: f32) -> Calibration {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let mut gaussian = || {
            let (a, b): (f64, f64) = (random.random(), random.random());
            (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
        };
        let truth = raster(|i| -1900.0 + (i % COLS) as f32 * 0.1);
        let dtm = raster(|i| truth.samples[i] + (gaussian() * f64::from(sd_m(i))) as f32);
        // Horn's gradient of independent errors: sd √(2 (1 + 4 + 1)) / 8 pixels of 2 m.
        let slope = 12.0_f32.sqrt() / 16.0;
        let mut heights_m = raster(|i| factor * sd_m(i));
        heights_m.samples[..COLS].fill(f32::NAN);
        let source = |raster: Raster| -> Arc<dyn Source> { Arc::new(InMemory::new(raster, None, "memory")) };
        let expected = ExpectedErrorMaps {
            name: "errors.tif".into(),
            heights_m: source(heights_m),
            slopes: source(raster(|i| factor * slope * sd_m(i))),
            origins: source(raster(|i| if i % COLS < COLS / 2 { 0.0 } else { 2.0 })),
        };
        let dtm = (("d".into(), source(dtm)), Interpolation::Bilinear);
        let maps = EvaluatedMaps::new(("t".into(), source(truth)), vec![dtm], None).unwrap();
        calibration(&maps.as_they_are().unwrap(), &expected).unwrap()
    }

    #[test]
    fn gaussian_errors_of_known_size_are_covered_as_a_gaussian() {
        let found = case(1.0);
        let all = found.all();
        assert_eq!(all.map(|all| all.errors), [((ROWS - 1) * COLS) as u64, 2 * ((ROWS - 2) * (COLS - 2)) as u64]);
        let half = |by: &[Coverage; 5]| [by[0], by[2]];
        for one in [all.to_vec(), half(&found.heights).to_vec(), half(&found.slopes)[..1].to_vec()].concat() {
            let [one_sd, two_sd] = one.within().unwrap();
            assert!((one_sd - 0.6827).abs() < 0.01 && (two_sd - 0.95).abs() < 0.01, "{one_sd} {two_sd}");
            for (nominal, observed) in one.reliability() {
                assert!((nominal - observed).abs() < 0.01, "{nominal} {observed}");
            }
        }
        assert_eq!(found.heights[1], Coverage::default());
        let text = found.table();
        assert!(text.contains("coarse DTM") && !text.contains("shadow") && text.contains("68."), "{text}");
        let value = found.json();
        assert_eq!(value["heights"]["image"]["errors"], ((ROWS - 1) * COLS / 2) as u64);
        assert_eq!(value["heights"]["shadow"]["within_1_sd"], Value::Null);
        assert_eq!(value["reliability"]["heights"].as_array().unwrap().len(), 19);
        assert!(found.picture().unwrap().pixels().filter(|p| p.0 == [40, 140, 70]).count() > 300);
    }

    #[test]
    fn expected_errors_of_half_the_size_cover_less() {
        for all in case(0.5).all() {
            let [one_sd, two_sd] = all.within().unwrap();
            // P(|Z| < 0.5) and P(|Z| < 0.98) of a Gaussian.
            assert!((one_sd - 0.3829).abs() < 0.01 && (two_sd - 0.6729).abs() < 0.01, "{one_sd} {two_sd}");
        }
    }

    #[test]
    fn limits_are_those_of_the_normal_table() {
        for (probability, limit) in [(0.5, 0.674_490), (0.682_689, 1.0), (0.9, 1.644_854), (0.95, 1.959_964)] {
            assert!((two_sided(probability) - limit).abs() < 2e-6, "{probability}");
        }
    }
}
