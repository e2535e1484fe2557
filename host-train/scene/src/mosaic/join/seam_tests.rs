//! Tiles of one map whose corners are rounded, and tiles on both sides of the seam of a map around the body.

use super::*;
use crate::mosaic::GridOptions;
use elunar_core::sun::Body;
use elunar_raster::source::InMemory;
use elunar_raster::{Crs, GeoRef, Projection, Raster, source};

/// Returns a height, metres, at a place in degrees. It varies by 30 m within 0.01 degrees.
fn height(lon_deg: f64, lat_deg: f64) -> f32 {
    let (lon, lat) = ((lon_deg.rem_euclid(360.0) * 100.0), lat_deg * 100.0);
    (-1900.0 + 15.0 * (lon * 1.3).sin() * (lat * 0.9).cos()) as f32
}

/// Returns a tile of `rows` x `cols` pixels of `step`, its upper left corner at `corner` and stated as `said`.
fn tile(crs: &Crs, (rows, cols): (usize, usize), step: f64, corner: (f64, f64), said: (f64, f64)) -> Raster {
    let projection = Projection::of(crs).unwrap();
    let true_place = GeoRef { transform: [corner.0, step, 0.0, corner.1, 0.0, -step], crs: crs.clone() };
    let sample = |i: usize| {
        let (x, y) = true_place.centre((i / cols) as f64, (i % cols) as f64);
        let (lon_deg, lat_deg) = projection.inverse(x, y);
        height(lon_deg, lat_deg)
    };
    let samples = (0..rows * cols).map(sample).collect();
    let georef = GeoRef { transform: [said.0, step, 0.0, said.1, 0.0, -step], crs: crs.clone() };
    Raster { rows, cols, samples, georef: Some(georef) }
}

fn made(rasters: Vec<Raster>, options: GridOptions, rules: &JoinRules) -> Raster {
    let input = |(k, raster): (usize, Raster)| MosaicInput {
        name: format!("{k}.tif"),
        source: Box::new(InMemory::new(raster, None, "memory")),
    };
    let inputs: Vec<MosaicInput> = rasters.into_iter().enumerate().map(input).collect();
    let grid = Grid::around(&inputs, options).unwrap();
    let samples = join(&inputs, &grid, rules).unwrap();
    Raster { rows: grid.rows, cols: grid.cols, samples, georef: Some(grid.georef) }
}

fn degrees() -> Crs {
    Crs::parse("IAU_2015:30100").unwrap()
}

/// Four tiles of 30 x 40 pixels, their corners stated to `decimals` of a degree.
fn four(step: f64, decimals: i32) -> Vec<Raster> {
    let round = |v: f64| (v * 10_f64.powi(decimals)).round() / 10_f64.powi(decimals);
    let corners = [(0.0, 0.0), (40.0, 0.0), (0.0, 30.0), (40.0, 30.0)];
    let one = |(col, row): (f64, f64)| {
        let corner = (23.456_789 + col * step, 12.345_678_9 - row * step);
        tile(&degrees(), (30, 40), step, corner, (round(corner.0), round(corner.1)))
    };
    corners.map(one).to_vec()
}

#[test]
fn tiles_with_rounded_corners_join_without_a_seam() {
    // Pixels of 1 / 512 degree to 2 m: rounded to five decimals, tiles are up to 0.005 to 0.15 pixels apart; to four, more than half a pixel.
    for (step, decimals) in
        [(1.0 / 512.0, 9), (1.0 / 512.0, 5), (1.0 / 4096.0, 5), (2.0 / 30_323.0, 5), (1.0 / 4096.0, 4)]
    {
        let tiles = four(step, decimals);
        let heights_m = |tile: usize, row: usize, col: usize| tiles[tile].samples[row * 40 + col];
        for priority_px in [0, 6] {
            let rules = JoinRules { priority_px, ..JoinRules::default() };
            let found = made(tiles.clone(), GridOptions::default(), &rules);
            assert_eq!((found.rows, found.cols), (60, 80), "{step} {decimals}");
            assert_eq!(found.valid_count(), 60 * 80, "{step} {decimals} {priority_px}");
            let whole = |row: usize, col: usize| heights_m(row / 30 * 2 + col / 40, row % 30, col % 40);
            // Half a pixel at most, on slopes of less than 0.2 m in a hundredth of a pixel of 1 / 512 degree.
            let limit = if decimals == 9 { 1e-4 } else { 2.0 };
            for (i, z) in found.samples.iter().enumerate() {
                assert!((z - whole(i / 80, i % 80)).abs() <= limit, "{step} {decimals}: {i}: {z}");
            }
        }
    }
}

/// A void beside the seam stays as large as it is.
#[test]
fn a_void_beside_a_rounded_seam_does_not_grow() {
    let mut tiles = four(1.0 / 4096.0, 5);
    tiles[1].samples[10 * 40..12 * 40].fill(f32::NAN);
    let found = made(tiles, GridOptions::default(), &JoinRules::default());
    assert_eq!(found.valid_count(), 60 * 80 - 80);
}

#[test]
fn tiles_on_both_sides_of_180_degrees_are_one_mosaic() {
    let step = 1.0 / 32.0;
    let tiles = |west_first: bool| {
        let west = tile(&degrees(), (64, 64), step, (178.0, 1.0), (178.0, 1.0));
        let east = tile(&degrees(), (64, 64), step, (-180.0, 1.0), (-180.0, 1.0));
        if west_first { vec![west, east] } else { vec![east, west] }
    };
    let whole = tile(&degrees(), (64, 128), step, (178.0, 1.0), (178.0, 1.0));
    for west_first in [true, false] {
        let found = made(tiles(west_first), GridOptions::default(), &JoinRules::default());
        assert_eq!((found.rows, found.cols, &found.georef), (64, 128, &whole.georef));
        assert!(found.samples.iter().zip(&whole.samples).all(|(a, b)| (a - b).abs() < 1e-3));
        let window = GridOptions { window: Some([-181.0, -0.5, -179.0, 0.5]), ..GridOptions::default() };
        let part = made(tiles(west_first), window, &JoinRules::default());
        assert_eq!((part.rows, part.cols, part.valid_count()), (32, 64, 32 * 64));
        assert!((part.samples[0] - whole.samples[16 * 128 + 32]).abs() < 1e-3);
    }
}

/// In metres a turn is no whole number of pixels, so that one of the tiles is interpolated.
#[test]
fn equirectangular_tiles_join_across_180_degrees() {
    let crs = Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0);
    let (half, step) = (Projection::of(&crs).unwrap().period().unwrap() / 2.0, 10.0);
    for apart in [0.0, 3.3] {
        let west = tile(&crs, (40, 50), step, (half - 500.0, 200.0), (half - 500.0, 200.0));
        let east = tile(&crs, (40, 50), step, (-half + apart, 200.0), (-half + apart, 200.0));
        let found = made(vec![west, east], GridOptions::default(), &JoinRules::default());
        assert_eq!((found.rows, found.cols), (40, 100));
        assert_eq!(found.valid_count(), 40 * 100, "{apart}");
        let whole = tile(&crs, (40, 100), step, (half - 500.0, 200.0), (0.0, 0.0));
        assert!(found.samples.iter().zip(&whole.samples).all(|(a, b)| (a - b).abs() < 0.2), "{apart}");
    }
}

#[test]
fn longitudes_to_360_join_longitudes_to_180() {
    let step = 2.0;
    let east = |height_m: f32| {
        let mut map = tile(&degrees(), (20, 180), step, (0.0, 20.0), (0.0, 20.0));
        map.samples.fill(height_m);
        map
    };
    let mut west = east(10.0);
    west.georef.as_mut().unwrap().transform[0] = -180.0;
    for maps in [[east(10.0), west.clone()], [west.clone(), east(10.0)]] {
        let first = maps[0].georef.as_ref().unwrap().transform[0];
        let found = made(maps.to_vec(), GridOptions::default(), &JoinRules::default());
        assert_eq!((found.cols, found.valid_count()), (180, 20 * 180));
        assert_eq!(found.georef.unwrap().transform[0], first);
        assert!(found.samples.iter().all(|z| (z - 10.0).abs() < 1e-5));
    }
    // A region of the other numbering beside a whole map lies where it belongs.
    let mut patch = tile(&degrees(), (10, 10), step, (-170.0, 10.0), (-170.0, 10.0));
    patch.samples.fill(50.0);
    let rules = JoinRules { priority_px: 1, ..JoinRules::default() };
    let found = made(
        vec![patch, east(10.0)],
        GridOptions { window: Some([0.0, -20.0, 360.0, 20.0]), ..GridOptions::default() },
        &rules,
    );
    assert_eq!((found.cols, found.samples[10 * 180 + 100], found.samples[10 * 180 + 10]), (180, 50.0, 10.0));
}

/// The shared folder's tiles.
#[test]
fn shared_tiles_join() {
    let Some(folder) = elunar_testing::shared_folder().map(|folder| folder.join("files/bugs")) else { return };
    if !folder.is_dir() {
        return elunar_testing::skipped("shared_tiles_join", "no files/bugs in the reference data");
    }
    let read = |name: &str| source::read(&folder.join(name)).unwrap();
    let made = |names: &[&str]| {
        made(names.iter().map(|name| read(name)).collect(), GridOptions::default(), &JoinRules::default())
    };
    for (kind, limit) in [("five_digits", 0.4), ("tile", 0.0)] {
        let names = ["00", "01", "10", "11"].map(|k| format!("10_adjacent_tiles_rounded_origins/{kind}_{k}.tif"));
        let found = made(&names.each_ref().map(String::as_str));
        let whole = read(&format!(
            "10_adjacent_tiles_rounded_origins/{}whole.tif",
            if kind == "tile" { "" } else { "five_digits_" }
        ));
        assert_eq!((found.rows, found.cols, found.valid_count()), (120, 128, 120 * 128));
        assert!(found.samples.iter().zip(&whole.samples).all(|(a, b)| (a - b).abs() <= limit));
    }
    let across = "09_mosaic_across_180/";
    let whole = read(&format!("{across}whole_178_182.tif"));
    for [west, east] in [["west_178_180.tif", "east_m180_m178.tif"], ["east_m180_m178.tif", "west_178_180.tif"]] {
        let found = made(&[&format!("{across}{west}"), &format!("{across}{east}")]);
        assert_eq!((found.rows, found.cols, found.valid_count()), (64, 128, 64 * 128));
        assert!(found.samples.iter().zip(&whole.samples).all(|(a, b)| (a - b).abs() < 1e-3));
    }
}
