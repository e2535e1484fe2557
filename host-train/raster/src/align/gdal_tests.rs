//! Comparison with GDAL's warper. Needs `python3` with `rasterio`; says so if it is absent.

use super::*;
use crate::source::InMemory;
use crate::{Crs, GeoRef, geotiff};
use elunar_testing::rasterio as gdal;
use rand::{Rng, SeedableRng};
use std::path::Path;
use std::sync::Arc;

/// Rows, columns, geotransform and reference system.
type Grid = (usize, usize, [f64; 6], &'static str);

/// Metres of a degree on the Moon's sphere.
const DEGREE: f64 = 1_737_400.0 * std::f64::consts::PI / 180.0;

/// Pairs of a rough source and a finer target in very different systems: simple cylindrical under a polar image, the source across the 180
/// degree seam of the target's longitudes, a pole in the middle, geographic from -180 under 0 to 360.
const PAIRS: [(&str, Grid, Grid); 9] = [
    (
        "polar on simple cylindrical",
        (60, 300, [-0.5 * DEGREE, 0.25 * DEGREE, 0.0, -70.0 * DEGREE, 0.0, -0.25 * DEGREE], "IAU_2015:30115"),
        (120, 150, [-150_000.0, 2_000.0, 0.0, -300_000.0, 0.0, -2_000.0], "IAU_2015:30135"),
    ),
    (
        "equirectangular with another parallel and meridian",
        (90, 90, [170.0, 0.25, 0.0, 30.0, 0.0, -0.25], "IAU_2015:30100"),
        (130, 140, [-60_000.0, 900.0, 20.0, 25.0 * DEGREE, 15.0, -950.0], "+proj=eqc +lat_ts=25 +lon_0=180 +R=1737400"),
    ),
    (
        "the pole in the middle",
        (40, 720, [0.0, 0.5, 0.0, 90.0, 0.0, -0.5], "IAU_2015:30100"),
        (110, 100, [-100_000.0, 2_000.0, 0.0, 100_000.0, 0.0, -2_000.0], "IAU_2015:30130"),
    ),
    (
        "two polar maps",
        (70, 80, [-80_000.0, 2_000.0, 0.0, 70_000.0, 0.0, -2_000.0], "IAU_2015:30135"),
        (
            100,
            90,
            [1_980_000.0, 250.0, 0.0, 2_010_000.0, 0.0, -250.0],
            "+proj=stere +lat_0=-90 +lon_0=30 +k=0.994 +x_0=2000000 +y_0=2000000 +R=1737400",
        ),
    ),
    (
        "orthographic on a transverse Mercator zone",
        (
            90,
            90,
            [107_500.0, 2_500.0, 0.0, 415_500.0, 0.0, -2_500.0],
            "+proj=tmerc +lon_0=21 +k=0.999 +x_0=250000 +R=1737400",
        ),
        (110, 130, [-60_000.0, 900.0, 0.0, 50_000.0, 0.0, -900.0], "+proj=ortho +lat_0=10 +lon_0=20 +R=1737400"),
    ),
    (
        "Mercator on sinusoidal",
        (80, 90, [-254_970.0, 2_500.0, 0.0, 706_466.0, 0.0, -2_500.0], "IAU_2015:30125"),
        (100, 120, [-196_455.0, 1_000.0, 0.0, 607_260.0, 0.0, -1_000.0], "+proj=merc +lon_0=180 +k=0.9 +R=1737400"),
    ),
    (
        "oblique stereographic on Lambert conformal",
        (
            100,
            100,
            [-43_000.0, 3_000.0, 0.0, 301_600.0, 0.0, -3_000.0],
            "+proj=lcc +lat_1=30 +lat_2=50 +lat_0=40 +lon_0=15 +R=1737400",
        ),
        (
            90,
            90,
            [-67_500.0, 1_500.0, 10.0, 67_500.0, 20.0, -1_500.0],
            "+proj=stere +lat_0=45 +lon_0=20 +k=0.99 +R=1737400",
        ),
    ),
    (
        "a disc with what is off it",
        (360, 720, [0.0, 0.5, 0.0, 90.0, 0.0, -0.5], "IAU_2015:30100"),
        (
            100,
            100,
            [-2_000_000.0, 40_000.0, 0.0, 2_000_000.0, 0.0, -40_000.0],
            "+proj=ortho +lat_0=20 +lon_0=170 +R=1737400",
        ),
    ),
    (
        "equirectangular on a Mercator globe, across its seam",
        (60, 720, [-180.0 * DEGREE, 0.5 * DEGREE, 0.0, 15.0 * DEGREE, 0.0, -0.5 * DEGREE], "+proj=merc +R=1737400"),
        (100, 120, [-2.0 * DEGREE, 0.033 * DEGREE, 0.0, 3.0 * DEGREE, 0.0, -0.033 * DEGREE], "IAU_2015:30115"),
    ),
];

fn raster((rows, cols, transform, system): Grid, height: impl Fn(usize, usize) -> f32) -> Raster {
    let samples = (0..rows * cols).map(|i| height(i / cols, i % cols)).collect();
    Raster { rows, cols, samples, georef: Some(GeoRef { transform, crs: Crs::parse(system).unwrap() }) }
}

/// Returns the pairs as rasters.
fn pairs() -> impl Iterator<Item = (&'static str, Raster, Raster)> {
    let rough = |r: usize, c: usize| ((r * 31 + c * 17) % 23) as f32 * 10.0 + (r as f32 * 0.3).sin() * 50.0;
    let flat = |r: usize, c: usize| (r + c) as f32;
    PAIRS.into_iter().map(move |(name, source, target)| (name, raster(source, rough), raster(target, flat)))
}

fn raw(path: &Path) -> Vec<f32> {
    let bytes = std::fs::read(path).expect("what the script left");
    bytes.as_chunks::<4>().0.iter().map(|&b| f32::from_ne_bytes(b)).collect()
}

#[test]
fn gdals_warper_agrees() {
    let folder = tempfile::tempdir().unwrap();
    let methods = [Interpolation::Bicubic, Interpolation::Bilinear, Interpolation::CubicSpline];
    let with_gap = |(name, mut source, target): (&'static str, Raster, Raster)| {
        // A gap, two pixels wide, in the middle.
        let middle = source.samples.len() / 2 + source.cols / 2;
        source.samples[middle..middle + 2].fill(f32::NAN);
        (name, source, target)
    };
    let pairs: Vec<_> = pairs().map(with_gap).collect();
    for (i, (_, source, target)) in pairs.iter().enumerate() {
        for (kind, raster) in [("s", source), ("t", target)] {
            let file = folder.path().join(format!("{kind}{i}.tif"));
            geotiff::write(&file, raster, &geotiff::WriteOptions::heights("x")).unwrap();
        }
    }
    // By default, GDAL approximates positions to an eighth of a pixel.
    let script = format!(
        "
from rasterio.vrt import WarpedVRT
from rasterio.enums import Resampling
for i in range({}):
    s, t = rasterio.open(f's{{i}}.tif'), rasterio.open(f't{{i}}.tif')
    for method in ('cubic', 'bilinear', 'cubic_spline'):
        with WarpedVRT(s, crs=t.crs, transform=t.transform, width=t.width, height=t.height, resampling=Resampling[method],
                       tolerance=1e-9, XSCALE=1, YSCALE=1) as v:
            v.read(1, masked=True).astype('f4').filled(np.nan).tofile(f'{{method}}{{i}}.raw')
",
        pairs.len()
    );
    if gdal(&script, folder.path()).is_none() {
        return;
    }
    for (pair, (name, source, target)) in pairs.iter().enumerate() {
        let edge = Edge::of(source, target);
        for (interpolation, file) in methods.into_iter().zip(["cubic", "bilinear", "cubic_spline"]) {
            let ours = onto(Named::new("s", source), Named::new("t", target), interpolation).unwrap();
            let theirs = raw(&folder.path().join(format!("{file}{pair}.raw")));
            let (mut compared, mut worst) = (0, 0.0_f32);
            for (i, (a, b)) in ours.samples.iter().zip(&theirs).enumerate() {
                let (row, col) = (i / target.cols, i % target.cols);
                // GDAL loses pixels beyond its own seam of longitudes. Beside gaps and edges the two programs follow different rules. Only
                // the spline follows GDAL's rule, where the source has edges.
                let own_rule = !(interpolation == Interpolation::CubicSpline && source.cols < 720);
                if b.is_nan() || own_rule && (a.is_nan() || edge.is_near(row, col)) {
                    continue;
                }
                let off = (a - b).abs();
                (compared, worst) = (compared + 1, if off <= worst { worst } else { off });
            }
            println!("{name}, {interpolation:?}: {compared} of {} pixels, worst {worst} m", theirs.len());
            assert!(
                worst < 1e-3 && compared > theirs.len() / 3,
                "{name}, {interpolation:?}: {worst}, {compared} pixels"
            );
        }
    }
}

/// The edge of a source, as a target's pixels see it.
struct Edge<'a> {
    source: &'a Raster,
    map: map::Map,
}

impl<'a> Edge<'a> {
    fn of(source: &'a Raster, target: &Raster) -> Self {
        let [of_target, of_source] =
            [target, source].map(|raster| (raster.georef.as_ref().unwrap(), (raster.rows, raster.cols)));
        Self { source, map: map::Map::between(of_target, of_source).unwrap() }
    }

    /// Returns whether the target's pixel is within three pixels of the source's edge or gap.
    fn is_near(&self, row: usize, col: usize) -> bool {
        let (r, c) = self.map.apply(row as f64, col as f64);
        let Raster { rows, cols, samples, .. } = self.source;
        let inside = r > 2.0 && c > 2.0 && r < *rows as f64 - 3.0 && c < *cols as f64 - 3.0;
        let around = |v: f64| v as usize - 2..v as usize + 4;
        !inside || around(r).any(|row| around(c).any(|col| samples[row * cols + col].is_nan()))
    }
}

#[test]
fn windows_hold_what_the_whole_holds() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    for (name, source, target) in pairs() {
        for interpolation in [Interpolation::Bicubic, Interpolation::Bilinear, Interpolation::CubicSpline] {
            let whole = onto(Named::new("s", &source), Named::new("t", &target), interpolation).unwrap();
            assert!(whole.valid_count() > whole.samples.len() / 3, "{name}: {}", whole.valid_count());
            let memory = Arc::new(InMemory::new(source.clone(), None, "memory"));
            let onto = Onto::new(memory, "s", &info(&target), "t", interpolation).unwrap();
            for _ in 0..10 {
                let (row, col) = (rng.random_range(0..target.rows), rng.random_range(0..target.cols));
                let (rows, cols) = (rng.random_range(1..=target.rows - row), rng.random_range(1..=target.cols - col));
                let found = onto.read(Window { row, col, rows, cols }).unwrap();
                for (i, value) in found.iter().enumerate() {
                    let expected = whole.samples[(row + i / cols) * target.cols + col + i % cols];
                    assert!(value.to_bits() == expected.to_bits() || value.is_nan() && expected.is_nan(), "{name}");
                }
            }
        }
    }
}

#[test]
fn a_global_grid_has_no_seam() {
    // Around the sphere in steps of 2 degrees. The value is a smooth function of the position.
    let at = |lon: f64, lat: f64| (1000.0 * (lon.to_radians() * 2.0).sin() + 10.0 * lat) as f32;
    let mut globe = raster((40, 180, [0.0, 2.0, 0.0, 40.0, 0.0, -2.0], "IAU_2015:30100"), |_, _| 0.0);
    (0..40 * 180).for_each(|i| globe.samples[i] = at((i % 180) as f64 * 2.0 + 1.0, 39.0 - (i / 180) as f64 * 2.0));
    let radius_m = 1_737_400.0;
    let step = radius_m * 0.1_f64.to_radians();
    // Across longitude 0, where the globe's grid begins and ends, in its own system and in another.
    for (system, transform) in [
        ("IAU_2015:30110", [-100.0 * step, step, 0.0, 50.0 * step, 0.0, -step]),
        ("IAU_2015:30100", [-10.0, 0.1, 0.0, 5.0, 0.0, -0.1]),
    ] {
        let target = raster((100, 200, transform, system), |_, _| 0.0);
        for interpolation in [Interpolation::Bicubic, Interpolation::Bilinear, Interpolation::CubicSpline] {
            let placed = onto(Named::new("globe", &globe), Named::new("t", &target), interpolation).unwrap();
            let off = |i: usize| {
                let (lon, lat) = ((i % 200) as f64 * 0.1 - 9.95, 4.95 - (i / 200) as f64 * 0.1);
                (placed.samples[i] - at(lon, lat)).abs()
            };
            let worst = (0..100 * 200).map(off).fold(0.0_f32, |a, b| if b.is_nan() { f32::INFINITY } else { a.max(b) });
            assert!(worst < 3.0, "{system} {interpolation:?}: {worst}");
        }
    }
}
