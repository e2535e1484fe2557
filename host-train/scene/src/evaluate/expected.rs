//! The errors that `predict --uncertainty` expects, on the grid of a comparison.

use elunar_core::photoclinometry::Origin;
use elunar_raster::align::{Interpolation, Named, onto};
use elunar_raster::geotiff::read_band;
use elunar_raster::{Error, Raster, Result};
use std::path::Path;

/// Origins of heights, in the order of their codes.
pub(super) const ORIGINS: [Origin; 5] = [Origin::Image, Origin::Blended, Origin::Coarse, Origin::Shadow, Origin::Void];

/// Expected errors of a DTM, on one grid.
#[derive(Debug, Clone)]
pub struct Expected {
    /// Name in messages and reports.
    pub name: String,
    /// Standard deviation of the height's error, metres; NaN where unknown.
    pub heights_m: Raster,
    /// Standard deviation of the slope's error along either axis, metres per metre; NaN where unknown.
    pub slopes: Raster,
    /// Code of the height's [`Origin`].
    pub origins: Raster,
}

impl Expected {
    /// Reads a file of `predict --uncertainty` for `dtm`.
    ///
    /// # Errors
    /// If the file cannot be read, has not three bands, or has another grid than `dtm`.
    pub fn read(path: &Path, dtm: Named) -> Result<Self> {
        let name = path.display().to_string();
        let band = |k: usize, what: &str| {
            read_band(path, k).map_err(|e| match e {
                Error::Unsupported { .. } => Error::input(format!("{name}: band {} expected, {what}: {e}", k + 1)),
                e => e,
            })
        };
        let heights_m = band(0, "errors of heights")?;
        if (heights_m.rows, heights_m.cols, &heights_m.georef) != (dtm.raster.rows, dtm.raster.cols, &dtm.raster.georef)
        {
            return Err(Error::input(format!(
                "{name}: the grid of {} expected, {} found; found {}",
                dtm.name,
                grid(dtm.raster),
                grid(&heights_m)
            )));
        }
        let (slopes, origins) = (band(1, "errors of slopes")?, band(2, "origins of heights")?);
        Ok(Self { name, heights_m, slopes, origins })
    }

    /// Brings the expected errors onto the grid of `target`: standard deviations bilinearly, and the origin that most of the four neighbours'
    /// weight has.
    ///
    /// # Errors
    /// As [`onto`].
    pub(super) fn onto(&self, target: Named) -> Result<Self> {
        let placed = |raster: &Raster| onto(Named::new(&self.name, raster), target, Interpolation::Bilinear);
        let (heights_m, slopes) = (placed(&self.heights_m)?, placed(&self.slopes)?);
        let mut origins = Raster { samples: vec![f32::NAN; heights_m.samples.len()], ..heights_m.clone() };
        let mut most = vec![0.0_f32; heights_m.samples.len()];
        for code in ORIGINS.map(|origin| f32::from(origin as u8)) {
            let is = |v: &f32| if *v == code { 1.0 } else { 0.0 };
            let share =
                placed(&Raster { samples: self.origins.samples.iter().map(is).collect(), ..self.origins.clone() })?;
            for (i, share) in share.samples.iter().enumerate().filter(|(_, share)| share.is_finite()) {
                if *share > most[i] {
                    (most[i], origins.samples[i]) = (*share, code);
                }
            }
        }
        Ok(Self { name: self.name.clone(), heights_m, slopes, origins })
    }
}

/// Returns the grid in words.
fn grid(raster: &Raster) -> String {
    let size = format!("{} x {} pixels", raster.rows, raster.cols);
    match &raster.georef {
        Some(georef) => format!("{size} with transform {:?}", georef.transform),
        None => format!("{size} without a place"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_raster::geotiff::{WriteOptions, Writer, write};
    use elunar_raster::{Crs, GeoRef};

    fn raster(rows: usize, cols: usize, pixel_m: f64, value: impl Fn(usize) -> f32) -> Raster {
        let transform = [0.0, pixel_m, 0.0, 0.0, 0.0, -pixel_m];
        let georef = GeoRef { transform, crs: Crs::moon_equirectangular(0.0, 0.0) };
        Raster { rows, cols, samples: (0..rows * cols).map(value).collect(), georef: Some(georef) }
    }

    #[test]
    fn a_file_is_read_and_another_grid_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("errors.tif");
        let dtm = raster(6, 8, 2.0, |i| i as f32);
        let options = WriteOptions::heights("errors").with_band("slopes", None).with_band("origins", None);
        let mut writer = Writer::create(&path, 6, 8, dtm.georef.as_ref(), &options).unwrap();
        for band in 0..3 {
            writer.write_band_rows(band, &[[0.5, 0.1, 2.0][band]; 48]).unwrap();
        }
        writer.finish().unwrap();
        let found = Expected::read(&path, Named::new("dtm.tif", &dtm)).unwrap();
        assert_eq!((found.heights_m.samples[7], found.slopes.samples[0], found.origins.samples[47]), (0.5, 0.1, 2.0));
        for other in [raster(6, 8, 4.0, |_| 0.0), raster(8, 6, 2.0, |_| 0.0)] {
            let refused = Expected::read(&path, Named::new("dtm.tif", &other)).unwrap_err().to_string();
            assert!(refused.contains("the grid of dtm.tif expected") && refused.contains("6 x 8 pixels"), "{refused}");
        }
        let single = folder.path().join("single.tif");
        write(&single, &dtm, &WriteOptions::heights("heights alone")).unwrap();
        let refused = Expected::read(&single, Named::new("dtm.tif", &dtm)).unwrap_err().to_string();
        assert!(refused.contains("single.tif") && refused.contains("band 2"), "{refused}");
    }

    #[test]
    fn on_a_finer_grid_origins_stay_codes() {
        let coarse = |value: fn(usize) -> f32| raster(10, 10, 2.0, value);
        let expected = Expected {
            name: "errors.tif".into(),
            heights_m: coarse(|i| (i % 10) as f32),
            slopes: coarse(|_| 0.25),
            origins: coarse(|i| if i % 10 < 5 { 0.0 } else { 2.0 }),
        };
        let target = raster(20, 20, 1.0, |_| 0.0);
        let placed = expected.onto(Named::new("truth.tif", &target)).unwrap();
        let known: Vec<f32> = placed.origins.samples.iter().copied().filter(|v| v.is_finite()).collect();
        assert!(known.len() >= 18 * 18 && known.iter().all(|code| [0.0, 2.0].contains(code)), "{known:?}");
        assert_eq!([8, 12].map(|col| placed.origins.samples[10 * 20 + col]), [0.0, 2.0]);
        assert!((placed.heights_m.samples[10 * 20 + 8] - 3.75).abs() < 1e-5);
    }
}
