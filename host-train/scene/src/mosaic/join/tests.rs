//! Joining, compared with numpy and scipy, and by its properties.

use super::*;
use crate::mosaic::GridOptions;
use elunar_core::sun::Body;
use elunar_raster::source::InMemory;
use elunar_raster::{Crs, GeoRef, Raster};
use elunar_testing::oracle::rasterio_with;

fn raster(rows: usize, cols: usize, corner: (f64, f64), height: impl Fn(usize, usize) -> f32) -> Raster {
    let transform = [corner.0, 2.0, 0.0, corner.1, 0.0, -2.0];
    let georef = GeoRef { transform, crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0) };
    let samples = (0..rows * cols).map(|i| height(i / cols, i % cols)).collect();
    Raster { rows, cols, samples, georef: Some(georef) }
}

fn inputs(rasters: &[Raster]) -> Vec<MosaicInput> {
    let input = |(k, raster): (usize, &Raster)| MosaicInput {
        name: format!("{k}.tif"),
        source: Box::new(InMemory::new(raster.clone(), None, "memory")),
    };
    rasters.iter().enumerate().map(input).collect()
}

/// Returns three rough DTMs with gaps. The last one is shifted by half a pixel from the first.
fn rough() -> Vec<Raster> {
    let height = |k: usize| {
        move |r: usize, c: usize| {
            let gap = (r / 7 + c / 9 + k).is_multiple_of(11) && r > 12;
            let (x, y) = (c as f32 * 0.21 + k as f32, r as f32 * 0.17);
            if gap { f32::NAN } else { 20.0 * x.sin() * y.cos() + 3.0 * k as f32 - 1900.0 }
        }
    };
    vec![
        raster(50, 60, (100.0, 300.0), height(0)),
        raster(48, 70, (160.0, 270.0), height(1)),
        raster(60, 40, (131.0, 281.0), height(2)),
    ]
}

fn made(rasters: &[Raster], options: GridOptions, rules: &JoinRules) -> Raster {
    let inputs = inputs(rasters);
    let grid = Grid::around(&inputs, options).unwrap();
    let samples = join(&inputs, &grid, rules).unwrap();
    Raster { rows: grid.rows, cols: grid.cols, samples, georef: Some(grid.georef) }
}

/// One array per DTM over the whole grid, in numpy and scipy, without windows and frames.
const TWIN: &str = "
from scipy import ndimage, stats
def bilinear(z, w, rows, cols, r0, c0, sr, sc):
    r = r0 + sr * np.arange(rows); c = c0 + sc * np.arange(cols)
    out = np.full((rows, cols), np.nan); ow = np.zeros((rows, cols))
    for i, y in enumerate(r):
        for j, x in enumerate(c):
            if abs(y - round(y)) < 1e-3: y = round(y)
            if abs(x - round(x)) < 1e-3: x = round(x)
            if y < -0.55 or x < -0.55 or y > z.shape[0] - 0.45 or x > z.shape[1] - 0.45: continue
            y, x = min(max(y, 0), z.shape[0] - 1), min(max(x, 0), z.shape[1] - 1)
            y0, y1, x0, x1 = int(np.floor(y)), int(np.ceil(y)), int(np.floor(x)), int(np.ceil(x))
            n = [(y0, x0), (y0, x1), (y1, x0), (y1, x1)]
            if min(w[k] for k in n) <= 0: continue
            f = [(1 - y + y0) * (1 - x + x0), (1 - y + y0) * (x - x0), (y - y0) * (1 - x + x0), (y - y0) * (x - x0)]
            out[i, j] = sum(a * z[k] for a, k in zip(f, n)); ow[i, j] = sum(a * w[k] for a, k in zip(f, n))
    return out, ow
def fire(valid): return ndimage.distance_transform_cdt(np.pad(valid, 1), metric='taxicab')[1:-1, 1:-1].astype('f8')
def finish(d, far):
    d = np.minimum(d, far)
    if SIGMA > 0:
        n = int(7 * SIGMA) | 1; t = np.arange(-(n // 2), n // 2 + 1)
        k = stats.norm.cdf(t + 0.5, scale=SIGMA) - stats.norm.cdf(t - 0.5, scale=SIGMA); k /= k.sum()
        b = ndimage.convolve1d(ndimage.convolve1d(d, k, axis=0, mode='constant'), k, axis=1, mode='constant')
    else: b = d
    return np.where(d > 0, b ** POWER, 0.0)
FAR = ERODE + 200 + 2 * (int(7 * SIGMA) | 1) + 1
out = rasterio.open('out.tif'); T = out.transform; rows, cols = out.shape
wz, ws = np.zeros((rows, cols)), np.zeros((rows, cols)); room = np.full((rows, cols), np.inf)
for k in range(COUNT):
    d = rasterio.open(f'{k}.tif'); z = d.read(1, masked=True).astype('f8').filled(np.nan); t = d.transform
    dist = np.maximum(fire(np.isfinite(z)) - ERODE, 0)
    w = dist if LENGTH else finish(np.maximum(np.minimum(fire(np.isfinite(z)), FAR) - ERODE, 0), FAR)
    r0 = (T.f + 0.5 * T.e - t.f) / t.e - 0.5; c0 = (T.c + 0.5 * T.a - t.c) / t.a - 0.5
    z, w = bilinear(np.nan_to_num(z), w, rows, cols, r0, c0, T.e / t.e, T.a / t.a)
    if LENGTH:
        here = w > 0
        w = np.where(here, np.minimum(w, room), 0)
        room = np.where(here, np.minimum(room, np.maximum(0, LENGTH - w)), room)
        w = finish(fire(w > 0), FAR)
    wz += np.where(w > 0, w * np.nan_to_num(z), 0); ws += w
with np.errstate(invalid='ignore'): expected = (wz / ws).astype('f4')
found = out.read(1, masked=True).filled(np.nan)
assert (np.isnan(found) == np.isnan(expected)).all(), (np.isnan(found).sum(), np.isnan(expected).sum())
print(np.nanmax(abs(found - expected)), np.isfinite(found).sum(), np.isnan(found).sum())
";

#[test]
fn matches_numpy_and_scipy() {
    use elunar_raster::geotiff::{WriteOptions, write};
    let rules = |erode_px, blur_sigma_px, exponent, priority_px| JoinRules {
        weights: WeightRules { erode_px, blur_sigma_px, exponent },
        priority_px,
    };
    let folder = tempfile::tempdir().unwrap();
    let rasters = rough();
    for (k, raster) in rasters.iter().enumerate() {
        write(&folder.path().join(format!("{k}.tif")), raster, &WriteOptions::heights("test")).unwrap();
    }
    let coarser = GridOptions { spacing: Some(3.0), ..GridOptions::default() };
    let cases = [
        (GridOptions::default(), rules(0, 5.0, 2, 0)),
        (GridOptions::default(), rules(0, 5.0, 2, 6)),
        (GridOptions::default(), rules(2, 1.5, 1, 9)),
        (GridOptions::default(), rules(1, 0.0, 3, 0)),
        (coarser, rules(0, 2.0, 2, 4)),
    ];
    for (options, rules) in cases {
        let found = made(&rasters, options, &rules);
        write(&folder.path().join("out.tif"), &found, &WriteOptions::heights("test")).unwrap();
        let WeightRules { erode_px, blur_sigma_px, exponent } = rules.weights;
        let script = format!(
            "ERODE, SIGMA, POWER, LENGTH, COUNT = {erode_px}, {blur_sigma_px:?}, {exponent}, {}, 3\n{TWIN}",
            rules.priority_px
        );
        let Some(text) = rasterio_with(&["scipy"], &script, folder.path()) else { return };
        let numbers: Vec<f64> = text.split_whitespace().map(|v| v.parse().unwrap()).collect();
        // The order of the f64 sums differs. Rounding to f32 at about 1900 m gives one unit in the last place.
        assert!(numbers[0] <= 1.3e-4, "{rules:?}: {text}");
        assert!(numbers[1] > 2000.0 && numbers[2] > 100.0, "{rules:?}: {text}");
    }
}

#[test]
fn one_dtm_and_agreeing_dtms_come_out_as_they_went_in() {
    let height = |r: usize, c: usize| -1900.0 + r as f32 * 0.5 - c as f32 * 0.25;
    let one = raster(40, 50, (0.0, 0.0), height);
    for priority_px in [0, 10] {
        let rules = JoinRules { priority_px, ..JoinRules::default() };
        let alone = made(std::slice::from_ref(&one), GridOptions::default(), &rules);
        assert_eq!((alone.samples, alone.georef), (one.samples.clone(), one.georef.clone()));
        let two = raster(40, 50, (30.0, -20.0), |r, c| height(r + 10, c + 15));
        let both = made(&[one.clone(), two], GridOptions::default(), &rules);
        assert_eq!((both.rows, both.cols), (50, 65));
        for (i, z) in both.samples.iter().enumerate().filter(|(_, z)| z.is_finite()) {
            assert!((z - height(i / 65, i % 65)).abs() < 1e-3);
        }
        assert_eq!(both.valid_count(), 2 * 2000 - 30 * 35);
    }
}

#[test]
fn priority_keeps_the_first_but_for_its_edge() {
    let first = raster(80, 80, (0.0, 0.0), |_, _| 10.0);
    let second = raster(80, 160, (0.0, 0.0), |_, _| 20.0);
    let rules = JoinRules { priority_px: 12, ..JoinRules::default() };
    let found = made(&[first.clone(), second.clone()], GridOptions::default(), &rules);
    let at = |col: usize| found.samples[40 * 160 + col];
    assert_eq!((at(40), at(66)), (10.0, 10.0), "the first alone");
    assert!(at(74) > 10.0 && at(74) < 20.0, "{}", at(74));
    assert_eq!(at(90), 20.0, "the second alone");
    let blended = made(&[first, second], GridOptions::default(), &JoinRules::default());
    assert!(blended.samples[40 * 160 + 40] > 10.5, "without priority both count");
}

#[test]
fn a_window_is_a_part_of_the_whole() {
    let rasters = rough();
    for priority_px in [0, 6] {
        let rules = JoinRules { priority_px, ..JoinRules::default() };
        let whole = made(&rasters, GridOptions::default(), &rules);
        let window = Some([150.0, 210.0, 210.0, 260.0]);
        let part = made(&rasters, GridOptions { window, ..GridOptions::default() }, &rules);
        assert_eq!((part.rows, part.cols), (25, 30));
        for (i, z) in part.samples.iter().enumerate() {
            let other = whole.samples[(i / 30 + 20) * whole.cols + i % 30 + 25];
            assert!(z.to_bits() == other.to_bits() || (z.is_nan() && other.is_nan()), "{i}: {z} {other}");
        }
    }
}

/// The DTMs are taller than the reach of any weight, so that pixels around a band are really left out.
#[test]
fn bands_are_the_whole() {
    let height = |k: usize| {
        move |r: usize, c: usize| {
            let gap = (r / 5 + c / 4 + k).is_multiple_of(37);
            if gap { f32::NAN } else { ((r * 31 + c * 17 + k) % 97) as f32 + 40.0 * k as f32 }
        }
    };
    let rasters = [raster(2500, 30, (0.0, 0.0), height(0)), raster(2400, 24, (25.0, -101.0), height(1))];
    let inputs = inputs(&rasters);
    for priority_px in [0, 7] {
        let rules = JoinRules { priority_px, ..JoinRules::default() };
        let grid = Grid::around(&inputs, GridOptions::default()).unwrap();
        let whole = join(&inputs, &grid, &rules).unwrap();
        for rows in [0..40, 1200..1301, grid.rows - 3..grid.rows] {
            let part = join(&inputs, &grid.rows(rows.clone()), &rules).unwrap();
            let expected = &whole[rows.start * grid.cols..rows.end * grid.cols];
            assert_eq!(part.len(), expected.len());
            for (i, (a, b)) in part.iter().zip(expected).enumerate() {
                // The origin of a band is rounded separately: one unit in the last place.
                assert!((a.is_nan() && b.is_nan()) || (a - b).abs() <= 1e-5, "{priority_px} {rows:?} {i}: {a} {b}");
            }
        }
        assert!(whole.iter().filter(|z| z.is_finite()).count() > 60_000);
    }
}

#[test]
fn misfits_are_named() {
    let good = raster(9, 9, (0.0, 0.0), |_, _| 1.0);
    let mut other = good.clone();
    let refused = |other: &Raster, options| {
        Grid::around(&inputs(&[good.clone(), other.clone()]), options).unwrap_err().to_string()
    };
    other.georef.as_mut().unwrap().crs = Crs::polar(Body::Moon.radius_m(), true);
    assert!(refused(&other, GridOptions::default()).contains("1.tif: the reference system of 0.tif"));
    other.georef = good.georef.clone();
    other.georef.as_mut().unwrap().crs.doubles[..2].fill(3_396_190.0);
    assert!(refused(&other, GridOptions::default()).contains("sphere 3396190 m found"));
    other.georef.as_mut().unwrap().transform[2] = 0.1;
    assert!(refused(&other, GridOptions::default()).contains("north-up"));
    other.georef = None;
    assert!(refused(&other, GridOptions::default()).contains("1.tif: a raster with a geotransform expected"));
    let far = raster(9, 9, (2e6, 2e6), |_, _| 1.0);
    assert!(refused(&far, GridOptions::default()).contains("at most"));
    let window = |w| GridOptions { window: Some(w), ..GridOptions::default() };
    assert!(refused(&good, window([5.0, 0.0, 4.0, 1.0])).contains("xmin < xmax"));
    assert!(refused(&good, window([500.0, 0.0, 600.0, 1.0])).contains("a part of"));
    assert!(refused(&good, GridOptions { spacing: Some(-1.0), ..GridOptions::default() }).contains("--tr"));
}
