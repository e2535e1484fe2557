//! A raster in another reference system, on a new grid.

use super::windowed::lattice;
use super::{Interpolation, Onto};
use crate::source::{Info, Source};
use crate::{Crs, GeoRef, Projection};
use elunar_base::{Error, Result};
use elunar_core::tile::Window;
use std::sync::Arc;

/// A source in another projection. Its corner lies on whole multiples of the spacing, so that such grids fit each other (`--tap`).
pub struct Reprojected {
    info: Info,
    onto: Onto,
}

impl Reprojected {
    /// Puts `source` into the system `crs`, with pixels of `spacing` map units; `None` takes the ground size of the source's pixels.
    /// Messages call the source `name`. Of the values of x of a meridian, those near `near_x` are taken, if it is stated. Bilinear
    /// interpolation reaches up to the source's edges.
    ///
    /// # Errors
    /// [`Error::Input`] if a system is not supported, the spheres differ, the source has no georeference, or the spacing is not positive.
    pub fn new(
        source: Arc<dyn Source>,
        name: &str,
        crs: &Crs,
        (spacing, near_x): (Option<f64>, Option<f64>),
        interpolation: Interpolation,
    ) -> Result<Self> {
        let Info { rows, cols, georef, .. } = source.info();
        let georef =
            georef.as_ref().ok_or_else(|| Error::input(format!("{name}: a geotransform expected, none found")))?;
        let known = |crs: &Crs| {
            Projection::of(crs).ok_or_else(|| {
                let what =
                    format!("{name}: a reference system with a known projection expected, {} found", crs.summary());
                Error::input(format!("{what}; {}", crs.remedy(name, None)))
            })
        };
        let (from, to) = (known(&georef.crs)?, known(crs)?);
        let step = match spacing {
            Some(step) => step,
            None => own_spacing(georef, (*rows, *cols), crs, &to).unwrap_or(f64::NAN),
        };
        if !(step.is_finite() && step > 0.0) {
            return Err(Error::input(format!("{name}: a positive pixel size expected, {step} found")));
        }
        // Outer edges, not centres. Of the values of x of a meridian, the one nearest to the middle's is taken.
        let place = |row: f64, col: f64| {
            let (x, y) = georef.centre(row - 0.5, col - 0.5);
            let (lon_deg, lat_deg) = from.inverse(x, y);
            to.forward(lon_deg, lat_deg)
        };
        let nearest = |x: f64, to_x: f64| to.period().map_or(x, |period| x - period * ((x - to_x) / period).round());
        let middle = place(*rows as f64 / 2.0, *cols as f64 / 2.0).0;
        let middle = near_x.map_or(middle, |near_x| nearest(middle, near_x));
        let near = |x: f64| nearest(x, middle);
        let all = lattice(rows + 1, cols + 1).map(|(row, col)| place(row, col));
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for (x, y) in all.map(|(x, y)| (near(x), y)).filter(|(x, y)| x.is_finite() && y.is_finite()) {
            (low, high) = ([low[0].min(x), low[1].min(y)], [high[0].max(x), high[1].max(y)]);
        }
        if low[0] > high[0] {
            let what = format!("{name}: a raster with a place in {} expected, none found", crs.summary());
            return Err(Error::input(what));
        }
        let (west, north) = ((low[0] / step).floor() * step, (high[1] / step).ceil() * step);
        let count = |span: f64| (span / step - 1e-6).ceil().max(1.0) as usize;
        let georef = GeoRef { transform: [west, step, 0.0, north, 0.0, -step], crs: crs.clone() };
        let (rows, cols) = (count(north - low[1]), count(high[0] - west));
        let info = Info { rows, cols, georef: Some(georef), ..source.info().clone() };
        let onto = Onto::new(source, name, &info, &crs.summary(), interpolation)?.to_edges();
        Ok(Self { info, onto })
    }
}

impl Source for Reprojected {
    fn info(&self) -> &Info {
        &self.info
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        crate::source::check_window(window, self.info.rows, self.info.cols)?;
        self.onto.read(window)
    }
}

/// Returns the ground size of the source's pixels in map units of `crs`.
fn own_spacing(georef: &GeoRef, (rows, cols): (usize, usize), crs: &Crs, to: &Projection) -> Option<f64> {
    let (row_m, col_m) = georef.pixel_m(rows, cols)?;
    let side_m = (row_m * col_m).sqrt();
    match crs.metres_per_unit() {
        Some(metres) => Some(side_m / metres),
        None => Some((side_m / to.radius_m()).to_degrees()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Raster;
    use crate::source::{InMemory, read_all};
    use elunar_core::sun::Body;

    /// Returns a height that is linear in longitude and latitude, so that it is known in every projection.
    fn height(lon_deg: f64, lat_deg: f64) -> f64 {
        -1800.0 + 400.0 * lon_deg + 700.0 * lat_deg
    }

    fn plane(crs: Crs, rows: usize, cols: usize, transform: [f64; 6]) -> Arc<dyn Source> {
        let (georef, projection) = (GeoRef { transform, crs: crs.clone() }, Projection::of(&crs).unwrap());
        let sample = |i: usize| {
            let (x, y) = georef.centre((i / cols) as f64, (i % cols) as f64);
            let (lon_deg, lat_deg) = projection.inverse(x, y);
            height(lon_deg, lat_deg) as f32
        };
        let samples = (0..rows * cols).map(sample).collect();
        Arc::new(InMemory::new(Raster { rows, cols, samples, georef: Some(georef) }, None, "memory"))
    }

    #[test]
    fn heights_stay_where_they_are_on_the_ground() {
        let crs = Crs::equirectangular(Body::Moon.radius_m(), 20.0, 30.0);
        let of_source = Projection::of(&crs).unwrap();
        let source = plane(crs, 150, 120, [5000.0, 60.0, 0.0, 600_000.0, 0.0, -60.0]);
        for (text, spacing) in [("IAU_2015:30100", None), ("IAU_2015:30115", Some(50.0)), ("IAU_2015:30110", None)] {
            let crs = Crs::parse(text).unwrap();
            let seen = Reprojected::new(source.clone(), "dem", &crs, (spacing, None), Interpolation::Bilinear).unwrap();
            let (found, projection) = (read_all(&seen).unwrap(), Projection::of(&crs).unwrap());
            let georef = found.georef.as_ref().unwrap();
            assert!(found.valid_count() * 10 > found.rows * found.cols * 8, "{text}: {}", found.valid_count());
            let (row_m, col_m) = found.pixel_m().unwrap();
            assert!(spacing.is_some() || ((row_m * col_m).sqrt() / 60.0 - 1.0).abs() < 0.1, "{row_m} {col_m}");
            for (i, z) in found.samples.iter().enumerate().filter(|(_, z)| z.is_finite()) {
                let (x, y) = georef.centre((i / found.cols) as f64, (i % found.cols) as f64);
                let (lon_deg, lat_deg) = projection.inverse(x, y);
                // With a central meridian of 180, 30 degrees appears as -330.
                let expected = height((lon_deg + 180.0).rem_euclid(360.0) - 180.0, lat_deg);
                let (x, y) = of_source.forward(lon_deg, lat_deg);
                let (col, row) = ((x - 5000.0) / 60.0 - 0.5, (600_000.0 - y) / 60.0 - 0.5);
                let between = (0.0..=119.0).contains(&col) && (0.0..=149.0).contains(&row);
                // Heights of thousands of metres as f32, interpolated on a plane in degrees; half a pixel up to the edges.
                let limit = if between { 2e-3 } else { 1.0 };
                assert!((f64::from(*z) - expected).abs() < limit, "{text}: {z} {expected}");
            }
        }
    }

    /// Neighbours on both sides of 180 degrees, in another system: every pixel of the whole is one of theirs.
    #[test]
    fn neighbours_leave_no_gap() {
        let crs = || Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0);
        let half = Projection::of(&crs()).unwrap().period().unwrap() / 2.0;
        let source = |cols: usize, x: f64| plane(crs(), 30, cols, [x, 60.0, 0.0, 700.0, 0.0, -60.0]);
        let (whole, west, east) = (source(80, half - 2400.0), source(40, half - 2400.0), source(40, -half));
        for (text, spacing) in [("IAU_2015:30100", 0.0017), ("+proj=eqc +lat_ts=40 +lon_0=170 +R=1737400", 47.0)] {
            let crs = Crs::parse(text).unwrap();
            let seen = |source: &Arc<dyn Source>, near_x| {
                Reprojected::new(source.clone(), "dem", &crs, (Some(spacing), near_x), Interpolation::Bilinear).unwrap()
            };
            let whole = read_all(&seen(&whole, None)).unwrap();
            let t = whole.georef.as_ref().unwrap().transform;
            let mut found = vec![false; whole.samples.len()];
            for part in [&west, &east].map(|source| read_all(&seen(source, Some(t[0]))).unwrap()) {
                let place = part.georef.unwrap().transform;
                let [row, col] = [(t[3] - place[3]) / spacing, (place[0] - t[0]) / spacing].map(f64::round);
                for (i, _) in part.samples.iter().enumerate().filter(|(_, z)| z.is_finite()) {
                    let (row, col) = (row + (i / part.cols) as f64, col + (i % part.cols) as f64);
                    found[row as usize * whole.cols + col as usize] = true;
                }
            }
            let missing = whole.samples.iter().zip(&found).filter(|(z, found)| z.is_finite() && !**found).count();
            assert!(missing == 0 && whole.valid_count() > 2000, "{text}: {missing} of {}", whole.valid_count());
        }
    }

    #[test]
    fn what_cannot_be_is_named() {
        let source = plane(Crs::polar(Body::Moon.radius_m(), true), 20, 20, [0.0, 60.0, 0.0, 0.0, 0.0, -60.0]);
        let refused = |crs: &str, spacing| {
            let crs = Crs::parse(crs).unwrap();
            Reprojected::new(source.clone(), "dem", &crs, (spacing, None), Interpolation::Bilinear)
                .err()
                .unwrap()
                .to_string()
        };
        assert!(refused("IAU_2015:30100", Some(0.0)).contains("dem: a positive pixel size expected, 0 found"));
        assert!(refused("IAU_2015:49910", None).contains("dem"), "another sphere");
    }

    #[test]
    fn what_is_off_the_sphere_is_left_out() {
        let disc = |x: f64| {
            let crs = Crs::parse("+proj=ortho +lat_0=20 +lon_0=10 +R=1737400").unwrap();
            let georef = GeoRef { transform: [x, 4e4, 0.0, 2e6, 0.0, -4e4], crs };
            Arc::new(InMemory::new(
                Raster { rows: 100, cols: 100, samples: vec![7.0; 10_000], georef: Some(georef) },
                None,
                "memory",
            ))
        };
        let crs = Crs::parse("IAU_2015:30100").unwrap();
        let seen = |x: f64, spacing| {
            Reprojected::new(disc(x), "dem", &crs, (Some(spacing), None), Interpolation::Bilinear)
                .map_err(|error| error.to_string())
        };
        let found = read_all(&seen(-2e6, 2.0).unwrap()).unwrap();
        assert!(
            (150..=180).contains(&found.cols) && (70..=90).contains(&found.rows),
            "{} x {}",
            found.rows,
            found.cols
        );
        assert!(found.samples.iter().all(|z| z.is_nan() || *z == 7.0) && found.valid_count() > 3000);
        assert_eq!(
            seen(1e7, 2.0).err().unwrap(),
            "dem: a raster with a place in longitude/latitude, sphere 1737400 m expected, none found"
        );
        assert!(seen(-2e6, f64::INFINITY).err().unwrap().contains("a positive pixel size expected, inf found"));
    }
}
