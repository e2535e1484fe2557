//! Tests' comparison of any raster with GDAL: samples by bits, places to a millimetre. Needs `python3` with `rasterio`.

use crate::source::{open, read_all};
use elunar_testing::rasterio;
use std::path::Path;

/// Stores GDAL's samples, with nodata as NaN. Prints its transform; longitude and latitude of the map coordinates of a point; the radius.
const SCRIPT: &str = "
import json
from rasterio.warp import transform
out = {}
for name in NAMES:
    d = rasterio.open(name)
    a = d.read(1).astype('f8')
    if d.nodata is not None: a[d.read(1) == np.array(d.nodata, d.dtypes[0])] = np.nan
    a.astype('f4').tofile(name + '.raw')
    x, y = d.transform * (1.0, 2.0)
    p = d.crs.to_dict()
    lonlat = rasterio.crs.CRS.from_proj4('+proj=longlat +R=%s +no_defs' % p['R'])
    lon, lat = transform(d.crs, lonlat, [x], [y])
    out[name] = [list(d.transform.to_gdal()), lon[0], lat[0], p['R']]
print(json.dumps(out))
";

/// Asserts that GDAL reads the same from files of a folder. GDAL's samples times `factor` of a name are ours. Returns whether GDAL is here.
pub(crate) fn agrees(folder: &Path, names: &[String], factor: impl Fn(&str) -> f32) -> bool {
    let Some(text) = rasterio(&SCRIPT.replace("NAMES", &format!("{names:?}")), folder) else { return false };
    let truth: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(truth.as_object().unwrap().len(), names.len());
    for (name, expected) in truth.as_object().unwrap() {
        compare(&folder.join(name), expected, factor(name));
    }
    true
}

/// Compares bits, and positions to a millimetre.
fn compare(path: &Path, expected: &serde_json::Value, factor: f32) {
    let raster = read_all(&*open(path).unwrap()).unwrap();
    let raw = std::fs::read(format!("{}.raw", path.display())).unwrap();
    let theirs: Vec<f32> = raw.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b) * factor).collect();
    assert_eq!(raster.samples.len(), theirs.len());
    for (a, b) in raster.samples.iter().zip(&theirs) {
        assert!(a == b || a.is_nan() && b.is_nan(), "{}: {a} {b}", path.display());
    }
    let georef = raster.georef.unwrap();
    for (i, ours) in georef.transform.iter().enumerate() {
        assert!((ours - expected[0][i].as_f64().unwrap()).abs() < 1e-3, "{}: {georef:?} {expected}", path.display());
    }
    let projection = crate::Projection::of(&georef.crs).unwrap();
    let (x, y) = georef.centre(1.5, 0.5);
    let (lon_deg, lat_deg) = projection.inverse(x, y);
    let degree_m = 30_323.0;
    let (lon, lat) = (expected[1].as_f64().unwrap(), expected[2].as_f64().unwrap());
    let near = ((lon_deg - lon + 180.0).rem_euclid(360.0) - 180.0).abs() * degree_m < 1e-2
        && (lat_deg - lat).abs() * degree_m < 1e-2;
    assert!(near, "{}: {lon_deg} {lat_deg}, GDAL {lon} {lat}", path.display());
    assert_eq!(projection.radius_m(), expected[3].as_f64().unwrap());
}
