//! The errors that `predict --uncertainty` expects, on the grid of a comparison.

use elunar_base::{Error, Result};
use elunar_core::photoclinometry::Origin;
use elunar_core::tile::Window;
use elunar_raster::align::{Interpolation, Onto};
use elunar_raster::geotiff::open_band;
use elunar_raster::source::{Info, Source};
use std::path::Path;
use std::sync::Arc;

/// Origins of heights, in the order of their codes.
pub(super) const ORIGINS: [Origin; 5] = [Origin::Image, Origin::Blended, Origin::Coarse, Origin::Shadow, Origin::Void];

/// Expected errors of a DTM, on one grid, read by windows.
#[derive(Clone)]
pub struct ExpectedErrorMaps {
    /// Name in messages and reports.
    pub name: String,
    /// Standard deviation of the height's error, metres; NaN where unknown.
    pub heights_m: Arc<dyn Source>,
    /// Standard deviation of the slope's error along either axis, metres per metre; NaN where unknown.
    pub slopes: Arc<dyn Source>,
    /// Code of the height's [`Origin`].
    pub origins: Arc<dyn Source>,
}

impl ExpectedErrorMaps {
    /// Opens a file of `predict --uncertainty` for a DTM.
    ///
    /// # Errors
    /// If the file cannot be read, has not three bands, or has another grid than the DTM.
    pub fn open(path: &Path, (dtm_name, dtm): (&str, &Info)) -> Result<Self> {
        let name = path.display().to_string();
        let band = |k: usize, what: &str| -> Result<Arc<dyn Source>> {
            let source = open_band(path, k).map_err(|e| match e {
                Error::Unsupported { .. } => Error::input(format!("{name}: band {} expected, {what}: {e}", k + 1)),
                e => e,
            })?;
            Ok(source.into())
        };
        let heights_m = band(0, "errors of heights")?;
        let info = heights_m.info();
        if (info.rows, info.cols, &info.georef) != (dtm.rows, dtm.cols, &dtm.georef) {
            let (expected, found) = (grid(dtm), grid(info));
            return Err(Error::input(format!(
                "{name}: the grid of {dtm_name} expected, {expected} found; found {found}"
            )));
        }
        let (slopes, origins) = (band(1, "errors of slopes")?, band(2, "origins of heights")?);
        Ok(Self { name, heights_m, slopes, origins })
    }

    /// Puts the expected errors on another grid: standard deviations bilinearly, and the origin that most of the four neighbours' weight has.
    ///
    /// # Errors
    /// As [`Onto::new`].
    pub(super) fn onto(&self, target: &Info, target_name: &str) -> Result<Placed> {
        let placed =
            |source: Arc<dyn Source>| Onto::new(source, &self.name, target, target_name, Interpolation::Bilinear);
        let share = |origin: Origin| {
            let code = f32::from(origin as u8);
            Ok((code, placed(Arc::new(IsCode { source: Arc::clone(&self.origins), code }))?))
        };
        let origins = ORIGINS.into_iter().map(share).collect::<Result<_>>()?;
        Ok(Placed {
            heights_m: placed(Arc::clone(&self.heights_m))?,
            slopes: placed(Arc::clone(&self.slopes))?,
            origins,
        })
    }
}

/// Expected errors on another grid.
pub(super) struct Placed {
    heights_m: Onto,
    slopes: Onto,
    /// For every code the share of the neighbours' weight that has it.
    origins: Vec<(f32, Onto)>,
}

impl Placed {
    /// Reads heights' and slopes' standard deviations and the codes of origins in a window.
    pub(super) fn read(&self, window: Window) -> Result<[Vec<f32>; 3]> {
        let (heights_m, slopes) = (self.heights_m.read(window)?, self.slopes.read(window)?);
        let mut origins = vec![f32::NAN; heights_m.len()];
        let mut most = vec![0.0_f32; heights_m.len()];
        for (code, onto) in &self.origins {
            for (i, share) in onto.read(window)?.into_iter().enumerate().filter(|(_, share)| share.is_finite()) {
                if share > most[i] {
                    (most[i], origins[i]) = (share, *code);
                }
            }
        }
        Ok([heights_m, slopes, origins])
    }
}

/// 1 where a source has a code, 0 elsewhere.
struct IsCode {
    source: Arc<dyn Source>,
    code: f32,
}

impl Source for IsCode {
    fn info(&self) -> &Info {
        self.source.info()
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        let is = |v: f32| if v == self.code { 1.0 } else { 0.0 };
        Ok(self.source.read(window)?.into_iter().map(is).collect())
    }
}

/// Returns the grid in words.
fn grid(info: &Info) -> String {
    let size = format!("{} x {} pixels", info.rows, info.cols);
    match &info.georef {
        Some(georef) => format!("{size} with transform {:?}", georef.transform),
        None => format!("{size} without a place"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_core::sun::Body;
    use elunar_raster::geotiff::{WriteOptions, Writer, write};
    use elunar_raster::source::InMemory;
    use elunar_raster::{Crs, GeoRef, Raster};

    fn source(raster: Raster) -> Arc<dyn Source> {
        Arc::new(InMemory::new(raster, None, "memory"))
    }

    fn raster(rows: usize, cols: usize, pixel_m: f64, value: impl Fn(usize) -> f32) -> Raster {
        let transform = [0.0, pixel_m, 0.0, 0.0, 0.0, -pixel_m];
        let georef = GeoRef { transform, crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0) };
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
        let of = |path: &Path, dtm: Raster| ExpectedErrorMaps::open(path, ("dtm.tif", source(dtm).info()));
        let found = of(&path, dtm.clone()).unwrap();
        let at = |band: &Arc<dyn Source>, col| band.read(Window { row: 0, col, rows: 1, cols: 1 }).unwrap()[0];
        assert_eq!((at(&found.heights_m, 7), at(&found.slopes, 0), at(&found.origins, 5)), (0.5, 0.1, 2.0));
        for other in [raster(6, 8, 4.0, |_| 0.0), raster(8, 6, 2.0, |_| 0.0)] {
            let refused = of(&path, other).err().unwrap().to_string();
            assert!(refused.contains("the grid of dtm.tif expected") && refused.contains("6 x 8 pixels"), "{refused}");
        }
        let single = folder.path().join("single.tif");
        write(&single, &dtm, &WriteOptions::heights("heights alone")).unwrap();
        let refused = of(&single, dtm).err().unwrap().to_string();
        assert!(refused.contains("single.tif") && refused.contains("band 2"), "{refused}");
    }

    #[test]
    fn on_a_finer_grid_origins_stay_codes() {
        let coarse = |value: fn(usize) -> f32| source(raster(10, 10, 2.0, value));
        let expected = ExpectedErrorMaps {
            name: "errors.tif".into(),
            heights_m: coarse(|i| (i % 10) as f32),
            slopes: coarse(|_| 0.25),
            origins: coarse(|i| if i % 10 < 5 { 0.0 } else { 2.0 }),
        };
        let target = raster(20, 20, 1.0, |_| 0.0);
        let placed = expected.onto(source(target).info(), "truth.tif").unwrap();
        let [heights_m, _, origins] = placed.read(Window { row: 0, col: 0, rows: 20, cols: 20 }).unwrap();
        let known: Vec<f32> = origins.iter().copied().filter(|v| v.is_finite()).collect();
        assert!(known.len() >= 18 * 18 && known.iter().all(|code| [0.0, 2.0].contains(code)), "{known:?}");
        assert_eq!([8, 12].map(|col| origins[10 * 20 + col]), [0.0, 2.0]);
        assert!((heights_m[10 * 20 + 8] - 3.75).abs() < 1e-5);
    }
}
