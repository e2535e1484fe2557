//! Resampling of one raster on another's grid, through map coordinates, never by index.

mod map;
mod reproject;
mod sample;
mod windowed;

#[cfg(test)]
mod gdal_tests;

pub use reproject::Reprojected;
pub use windowed::Onto;

use super::source::{Info, Source, check_window};
use super::{Projection, Raster};
use elunar_base::{Error, Result};
use elunar_core::tile::Window;
use map::Grid;
use windowed::{AlignPlan, lattice};

/// Interpolation between pixel centres.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[cfg_attr(feature = "clap", value(rename_all = "lower"))]
pub enum Interpolation {
    /// Interpolating bicubic, for a fine grid from a coarse one.
    Bicubic,
    /// Bilinear, invalid where any sample with weight is invalid. For comparisons of grids with about equal spacing.
    Bilinear,
    /// `cubicspline` of GDAL and the Ames Stereo Pipeline: a cubic B-spline that smooths and does not pass through the samples. For
    /// comparisons with their results. Meant for finer target grids; for coarser ones GDAL widens the kernel, this program does not.
    CubicSpline,
}

impl std::str::FromStr for Interpolation {
    type Err = String;

    /// Reads the name as on command lines: bicubic, bilinear or cubicspline.
    fn from_str(name: &str) -> std::result::Result<Self, String> {
        match name {
            "bicubic" => Ok(Self::Bicubic),
            "bilinear" => Ok(Self::Bilinear),
            "cubicspline" => Ok(Self::CubicSpline),
            _ => Err(format!("expected bicubic, bilinear or cubicspline, found {name}")),
        }
    }
}

/// Grids closer than this, in pixels, count as one, because writers differ in the last digits of a transform.
const SAME_GRID_PX: f64 = 1e-3;

/// A raster with its name in messages.
#[derive(Debug, Clone, Copy)]
pub struct Named<'a> {
    /// File name, or a description of the raster.
    pub name: &'a str,
    /// The raster.
    pub raster: &'a Raster,
}

impl<'a> Named<'a> {
    /// Combines name and raster.
    #[must_use]
    pub fn new(name: &'a str, raster: &'a Raster) -> Self {
        Self { name, raster }
    }
}

/// Returns the side of a pixel of `source` in pixels of `target`: about 30 for SLDEM2015 under an image of 2 m.
///
/// # Errors
/// [`Error::Input`] if the pixel size of either in metres is unknown.
pub fn spacing_ratio(source: Named, target: Named) -> Result<f32> {
    let side_m = |named: Named| info(named.raster).side_m(named.name);
    Ok((side_m(source)? / side_m(target)?) as f32)
}

/// Resamples `source` on the grid of `target`, as [`Onto`] does; NaN where `source` has no value.
///
/// # Errors
/// As [`Onto::new`]. [`Error::Input`] if no valid sample of `source` falls on `target`.
pub fn onto(source: Named, target: Named, interpolation: Interpolation) -> Result<Raster> {
    let (view, target_info) = (View::new(source.raster), info(target.raster));
    let (from, to) = ((source.name, &view.info), (target.name, &target_info));
    let (rows, cols) = (target.raster.rows, target.raster.cols);
    let samples = AlignPlan::new(from, to, interpolation)?.read(&view, Window { row: 0, col: 0, rows, cols })?;
    let placed = Raster { rows, cols, samples, georef: target.raster.georef.clone() };
    if placed.valid_count() > 0 {
        return Ok(placed);
    }
    if source.raster.valid_count() == 0 {
        let (source, target) = (source.name, target.name);
        let what =
            format!("{source}: valid samples overlapping {target} expected, none found: it holds no valid sample");
        return Err(Error::input(what));
    }
    Err(windowed::no_overlap(from, to))
}

fn info(raster: &Raster) -> Info {
    let (rows, cols, georef) = (raster.rows, raster.cols, raster.georef.clone());
    Info { rows, cols, georef, format: "memory".into(), ..Info::default() }
}

/// A borrowed raster as a source.
struct View<'a> {
    raster: &'a Raster,
    info: Info,
}

impl<'a> View<'a> {
    fn new(raster: &'a Raster) -> Self {
        Self { raster, info: info(raster) }
    }
}

impl Source for View<'_> {
    fn info(&self) -> &Info {
        &self.info
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        check_window(window, self.raster.rows, self.raster.cols)?;
        let line = |row: usize| &self.raster.samples[row * self.raster.cols + window.col..][..window.cols];
        Ok((window.row..window.row + window.rows).flat_map(|row| line(row).iter().copied()).collect())
    }
}

/// Describes the extent of a grid: map coordinates of its corners, or degrees of those of its pixels that have a longitude and latitude. A grid
/// without any has been refused ([`Info::place`]).
fn bounds((georef, (rows, cols)): Grid, as_degrees: bool) -> String {
    let Some(projection) = Projection::of(&georef.crs).filter(|_| as_degrees) else { return georef.extent(rows, cols) };
    let far = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    let points = lattice(rows, cols).map(|(row, col)| georef.centre(row, col)).map(|(x, y)| projection.inverse(x, y));
    let [x0, y0, x1, y1] = points
        .filter(|(lon_deg, _)| lon_deg.is_finite())
        .fold(far, |[x0, y0, x1, y1], (x, y)| [x0.min(x), y0.min(y), x1.max(x), y1.max(y)]);
    format!("longitudes {x0:.3} to {x1:.3}, latitudes {y0:.3} to {y1:.3}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Crs, GeoRef};
    use elunar_core::sun::Body;

    fn plane(rows: usize, cols: usize, transform: [f64; 6]) -> Raster {
        let georef = GeoRef { transform, crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0) };
        let height = |i: usize| {
            let (x, y) = georef.centre((i / cols) as f64, (i % cols) as f64);
            (0.01 * x - 0.02 * y) as f32
        };
        Raster { rows, cols, samples: (0..rows * cols).map(height).collect(), georef: Some(georef) }
    }

    fn largest_difference(a: &Raster, b: &Raster) -> f32 {
        a.samples.iter().zip(&b.samples).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    /// Without the rest of the source nothing changes.
    #[test]
    fn all_samples_in_use_lie_under_the_target() {
        use crate::source::InMemory;
        use std::sync::Arc;
        let source = plane(40, 50, [-600.0, 60.0, 0.0, 900.0, 0.0, -60.0]);
        for target in [[30.0, 2.0, 0.0, 40.0, 0.0, -2.0], [100.0, 1.5, 0.5, 0.0, 0.4, -1.8]] {
            let target = info(&plane(200, 260, target));
            let onto = |raster: &Raster| {
                let raster = Arc::new(InMemory::new(raster.clone(), None, "memory"));
                Onto::new(raster, "coarse", &target, "image", Interpolation::Bicubic).unwrap()
            };
            let under = onto(&source).under(200, 260).unwrap();
            assert!(under.rows * under.cols < 40 * 50 / 4, "{under:?}");
            let mut alone = source.clone();
            let within = |i: usize| {
                let (row, col) = (i / 50, i % 50);
                (under.row..under.row + under.rows).contains(&row) && (under.col..under.col + under.cols).contains(&col)
            };
            alone.samples.iter_mut().enumerate().filter(|(i, _)| !within(*i)).for_each(|(_, z)| *z = f32::NAN);
            let all = Window { row: 0, col: 0, rows: 200, cols: 260 };
            let (expected, found) = (onto(&source).read(all).unwrap(), onto(&alone).read(all).unwrap());
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn a_plane_is_the_same_on_every_grid() {
        let coarse = plane(12, 14, [-60.0, 60.0, 0.0, 90.0, 0.0, -60.0]);
        let fine = plane(200, 260, [30.0, 2.0, 0.0, 40.0, 0.0, -2.0]);
        for interpolation in [Interpolation::Bicubic, Interpolation::Bilinear] {
            let placed = onto(Named::new("coarse", &coarse), Named::new("image", &fine), interpolation).unwrap();
            assert_eq!(placed.valid_count(), 200 * 260);
            assert!(largest_difference(&placed, &fine) < 1e-4, "{interpolation:?}");
            assert_eq!(placed.georef, fine.georef);
        }
        // A rotated grid, too.
        let turned = plane(50, 50, [100.0, 1.5, 0.5, 0.0, 0.4, -1.8]);
        let placed =
            onto(Named::new("coarse", &coarse), Named::new("image", &turned), Interpolation::Bilinear).unwrap();
        assert!(largest_difference(&placed, &turned) < 1e-4);
    }

    #[test]
    fn the_same_grid_is_copied_and_whole_pixel_shifts_are_exact() {
        let mut a = plane(20, 30, [10.0, 2.0, 0.0, 50.0, 0.0, -2.0]);
        a.samples[33] = f32::NAN;
        let copy = onto(Named::new("a", &a), Named::new("b", &a.clone()), Interpolation::Bicubic).unwrap();
        assert_eq!(
            (copy.samples[32], copy.samples[33].is_nan(), copy.samples[34]),
            (a.samples[32], true, a.samples[34])
        );
        let shifted = plane(10, 10, [14.0, 2.0, 0.0, 44.0, 0.0, -2.0]);
        let placed = onto(Named::new("a", &a), Named::new("b", &shifted), Interpolation::Bilinear).unwrap();
        for (i, value) in placed.samples.iter().enumerate() {
            assert_eq!(*value, a.samples[(i / 10 + 3) * 30 + i % 10 + 2]);
        }
    }

    #[test]
    fn gaps_stay_gaps_under_bilinear() {
        let mut a = plane(8, 8, [0.0, 2.0, 0.0, 0.0, 0.0, -2.0]);
        a.samples[3 * 8 + 3] = f32::NAN;
        let half = plane(7, 7, [1.0, 2.0, 0.0, -1.0, 0.0, -2.0]);
        let placed = onto(Named::new("a", &a), Named::new("b", &half), Interpolation::Bilinear).unwrap();
        let gaps: Vec<usize> = (0..49).filter(|&i| placed.samples[i].is_nan()).collect();
        assert_eq!(gaps, [2 * 7 + 2, 2 * 7 + 3, 3 * 7 + 2, 3 * 7 + 3]);
    }

    #[test]
    fn misfits_are_named() {
        let a = plane(8, 8, [0.0, 2.0, 0.0, 0.0, 0.0, -2.0]);
        let mut b = a.clone();
        let refused = |b: &Raster| {
            onto(Named::new("c.tif", b), Named::new("i.tif", &a), Interpolation::Bicubic).unwrap_err().to_string()
        };
        b.georef.as_mut().unwrap().crs = Crs::equirectangular(Body::Moon.radius_m(), 0.0, 180.0);
        let text = refused(&b);
        assert!(text.contains("c.tif") && text.contains("i.tif") && text.contains("longitudes -180.000 to"), "{text}");
        let mars = Crs::parse("IAU_2015:49910").unwrap();
        b.georef.as_mut().unwrap().crs = mars;
        assert!(refused(&b).contains("(1737400 m) expected, 3396190 m found"), "{}", refused(&b));
        let mut unknown = Crs::equirectangular(Body::Moon.radius_m(), 0.0, 180.0);
        let at = unknown.directory.iter().position(|&key| key == 3075).unwrap();
        unknown.directory[at + 3] = 12;
        b.georef.as_mut().unwrap().crs = unknown;
        let text = refused(&b);
        assert!(text.contains("azimuthal equidistant") && !text.contains("method 12"), "{text}");
        assert!(
            text.contains("gdalwarp -t_srs '+proj=eqc +lat_ts=0 +lat_0=0 +lon_0=0 +R=1737400' c.tif c.tif.warped.tif"),
            "{text}"
        );
        let earth = Crs { directory: vec![1, 1, 0, 2, 1024, 0, 1, 2, 2048, 0, 1, 4326], ..Crs::default() };
        b.georef = Some(GeoRef { transform: [10.0, 0.01, 0.0, 5.0, 0.0, -0.01], crs: earth });
        let text = refused(&b);
        assert!(["EPSG:4326", "ellipsoid", "sphere", "IAU_2015:30100"].iter().all(|w| text.contains(w)), "{text}");
        let metres = [349_000.0, 2.0, 0.0, 600_000.0, 0.0, -2.0];
        b.georef = Some(GeoRef { transform: metres, crs: Crs::geographic(1_737_400.0) });
        assert!(refused(&b).contains("metres?") && !refused(&b).contains("inf"), "{}", refused(&b));
        b.georef =
            Some(GeoRef { transform: [10.0, 0.1, 0.0, 5.0, 0.0, -0.1], crs: Crs::polar(Body::Moon.radius_m(), false) });
        assert!(refused(&b).contains("are they degrees?"), "{}", refused(&b));
        b.georef = a.georef.clone();
        b.georef.as_mut().unwrap().crs = Crs::default();
        assert!(refused(&b).contains("reference system expected, none found"));
        b.georef = None;
        assert!(refused(&b).contains("geotransform expected, none found"));
        let far = plane(8, 8, [1000.0, 2.0, 0.0, 0.0, 0.0, -2.0]);
        assert!(refused(&far).contains("covers x 1000.0 to 1016.0, y -16.0 to 0.0"), "{}", refused(&far));
        let empty = Raster { samples: vec![f32::NAN; 64], ..a.clone() };
        assert!(refused(&empty).contains("no valid sample"));
    }

    #[test]
    fn turned_and_sheared_sources_and_polar_maps_lie_where_they_are() {
        let target = plane(9, 8, [10.0, 2.0, 0.0, 20.0, 0.0, -2.0]);
        let placed = |source: &Raster, target: &Raster| {
            onto(Named::new("coarse", source), Named::new("image", target), Interpolation::Bilinear).unwrap()
        };
        for transform in [[-60.0, 7.5, 2.5, 60.0, 2.0, -9.0], [-60.0, 7.5, 0.0, 60.0, 2.0, -9.0]] {
            let found = placed(&plane(30, 30, transform), &target);
            assert!(largest_difference(&found, &target) < 1e-4 && found.valid_count() == 72, "{transform:?}");
        }
        // The same size, other rows.
        let below = plane(9, 8, [10.0, 2.0, 0.0, 14.0, 0.0, -2.0]);
        assert_eq!(placed(&target, &below).samples[..48], target.samples[24..]);
        let polar = |mut raster: Raster| {
            raster.georef.as_mut().unwrap().crs = Crs::polar(Body::Moon.radius_m(), true);
            raster
        };
        let (coarse, target) = (polar(plane(12, 14, [-60.0, 60.0, 0.0, 90.0, 0.0, -60.0])), polar(target));
        assert!(largest_difference(&placed(&coarse, &target), &target) < 1e-4);
    }

    #[test]
    fn a_globe_begins_wherever_its_file_does() {
        use crate::source::InMemory;
        use std::sync::Arc;
        let globe = |west: f64, cols: usize, step: f64| {
            let georef =
                GeoRef { transform: [west, step, 0.0, 9.0, 0.0, -step], crs: Crs::geographic(Body::Moon.radius_m()) };
            let rows = (18.0 / step) as usize;
            let samples = (0..rows * cols).map(|i| (west + step * ((i % cols) as f64 + 0.5)) as f32).collect();
            Raster { rows, cols, samples, georef: Some(georef) }
        };
        let source = Arc::new(InMemory::new(globe(0.0, 180, 2.0), None, "globe"));
        // The first column of the target is not in the globe's file, but the one a turn later is.
        let target = info(&globe(-10.0, 40, 1.0));
        let onto = Onto::new(source.clone(), "globe", &target, "image", Interpolation::Bilinear).unwrap();
        let found = onto.read(Window { row: 9, col: 0, rows: 1, cols: 8 }).unwrap();
        let expected: Vec<f32> = (0..8).map(|col| 350.5 + col as f32).collect();
        assert_eq!(found, expected);
        assert!(onto.read(Window { row: 9, col: 3, rows: 0, cols: 8 }).unwrap().is_empty());
        let mut far = globe(-10.0, 40, 1.0);
        far.georef.as_mut().unwrap().transform[3] = 60.0;
        let refused = Onto::new(source, "globe", &info(&far), "image", Interpolation::Bilinear);
        let text = refused.err().unwrap().to_string();
        assert!(text.contains("globe: valid samples overlapping image expected, none found"), "{text}");
    }

    #[test]
    fn the_system_that_is_not_known_is_named() {
        let a = plane(8, 8, [0.0, 2.0, 0.0, 0.0, 0.0, -2.0]);
        let mut b = a.clone();
        let at = a.georef.as_ref().unwrap().crs.directory.iter().position(|&key| key == 3075).unwrap();
        b.georef.as_mut().unwrap().crs.directory[at + 3] = 12;
        let refused = |c: &Raster, i: &Raster| {
            onto(Named::new("c.tif", c), Named::new("i.tif", i), Interpolation::Bicubic).unwrap_err().to_string()
        };
        assert!(refused(&a, &b).ends_with(" i.tif i.tif.warped.tif"), "{}", refused(&a, &b));
        assert!(refused(&b, &a).ends_with(" c.tif c.tif.warped.tif"), "{}", refused(&b, &a));
        // Pixels of no height, and of a width beyond all numbers.
        for transform in [[0.0, 2.0, 0.0, 0.0, 0.0, 0.0], [0.0, 1e308, 0.0, 0.0, 0.0, -1e5]] {
            b.georef = Some(GeoRef { transform, crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 10.0) });
            let text = refused(&b, &a);
            assert!(text.contains(&format!("c.tif: transform {transform:?} has no inverse")), "{text}");
        }
    }
}
