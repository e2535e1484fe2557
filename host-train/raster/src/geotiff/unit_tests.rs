//! Units of heights, as GDAL writes and reads them.

use super::tests::scratch;
use crate::{heights, source};
use elunar_testing::rasterio as gdal;

#[test]
fn a_scale_that_is_no_number_is_refused() {
    let folder = scratch();
    let script = "
for name, scale, offset in (('scale.tif', float('nan'), 0), ('offset.tif', 1, float('inf'))):
    with rasterio.open(name, 'w', driver='GTiff', width=2, height=1, count=1, dtype='float32') as d:
        d.write(np.ones((1, 1, 2), 'f4'))
        d.scales, d.offsets = (scale,), (offset,)
";
    if gdal(script, folder.path()).is_none() {
        return;
    }
    for name in ["scale", "offset"] {
        let text = heights::open(&folder.path().join(name).with_extension("tif")).err().expect("refused").to_string();
        assert!(text.contains(&format!("band {name} is")) && text.ends_with("a finite number expected"), "{text}");
    }
}

#[test]
fn units_of_bands_and_of_vertical_systems_are_gdals() {
    let folder = scratch();
    let script = "
def put(name, unit=None, crs=None):
    with rasterio.open(name, 'w', driver='GTiff', width=2, height=1, count=1, dtype='float32', crs=crs, transform=Affine(2, 0, 0, 0, -2, 0)) as d:
        d.write(np.full((1, 1, 2), 1000, 'f4'))
        if unit: d.units = (unit,)
    print(name, *rasterio.open(name).units)
for i, unit in enumerate(('metre', 'foot', 'US survey foot', 'cm', 'km')):
    put(f'{i}.tif', unit)
for code in (5773, 8228, 6360, 5702, 8050, 8051, 6359):
    put(f'{code}.tif', crs=f'EPSG:32631+{code}')
# Without a code of its own, the system has the key of its unit.
import re
wkt = rasterio.crs.CRS.from_user_input('EPSG:32631+6360').to_wkt().replace('NAVD88 height (ftUS)', 'ours')
wkt = re.sub('.AUTHORITY.{2}EPSG...(6360|5103).{2}', '', wkt)
put('key.tif', crs=wkt)
put('both.tif', 'm', 'EPSG:32631+6360')
";
    let Some(out) = gdal(script, folder.path()) else { return };
    assert_eq!(out.lines().count(), 14, "{out}");
    for line in out.lines() {
        let (name, unit) = line.split_once(' ').unwrap();
        let metres = match unit {
            "metre" | "m" => 1000.0,
            "foot" => 304.8,
            "US survey foot" => 304.800_6,
            "cm" => 10.0,
            "km" => 1e6,
            _ => panic!("{line}"),
        };
        let path = folder.path().join(name);
        assert_eq!(heights::read(&path).unwrap().samples, [metres; 2], "{line}");
        let stated = source::open(&path).unwrap().info().unit_in_file.clone();
        assert!(
            stated.as_deref().is_none_or(|stated| stated == unit) && (stated.is_some() || unit == "metre"),
            "{line}: {stated:?}"
        );
    }
}
