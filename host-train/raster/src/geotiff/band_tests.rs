//! Files of several bands: each is read back, and GDAL reads the same.

use super::tests::{heights, same_bits, scratch};
use super::*;
use crate::Raster;
use elunar_testing::oracle::rasterio_with;
use std::path::Path;
use tiff::encoder::{TiffEncoder, colortype::RGB8};

/// Writes three bands of a raster: itself, its double, and its negative, in turns of some rows.
fn three(path: &Path, raster: &Raster, rows_at_once: usize) {
    let options = WriteOptions::heights("one").with_band("two", Some("m")).with_band("three", None);
    let mut writer = Writer::create(path, raster.rows, raster.cols, raster.georef.as_ref(), &options).unwrap();
    for rows in raster.samples.chunks(rows_at_once * raster.cols) {
        for (band, factor) in [1.0, 2.0, -1.0].into_iter().enumerate() {
            writer.write_band_rows(band, &rows.iter().map(|v| factor * v).collect::<Vec<_>>()).unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn every_band_comes_back_bit_for_bit() {
    let folder = scratch();
    for (rows, cols) in [(1, 1), (40, 33), (1100, 700)] {
        let (path, raster) = (folder.path().join("a.tif"), heights(rows, cols));
        three(&path, &raster, 300);
        for (band, factor) in [1.0, 2.0, -1.0].into_iter().enumerate() {
            let back = crate::source::read_all(open_band(&path, band).unwrap().as_ref()).unwrap();
            let expected: Vec<f32> = raster.samples.iter().map(|v| factor * v).collect();
            assert!(same_bits(&back.samples, &expected), "{rows} x {cols}, band {band}");
            assert_eq!(back.georef, raster.georef);
        }
    }
    let path = folder.path().join("a.tif");
    let error = open_band(&path, 3).err().unwrap().to_string();
    assert!(error.contains("3 bands found, band 4 expected"), "{error}");
    let error = read(&path).unwrap_err().to_string();
    assert!(error.contains("3 bands found, one expected"), "{error}");
    // Bands pixel by pixel are not read one by one.
    let mixed = folder.path().join("c.tif");
    let mut tiff = TiffEncoder::new(std::fs::File::create(&mixed).unwrap()).unwrap();
    tiff.write_image::<RGB8>(2, 1, &[1, 2, 3, 4, 5, 6]).unwrap();
    let error = open_band(&mixed, 0).err().unwrap().to_string();
    assert!(error.contains("3 bands found, one expected"), "{error}");
    // A file of one band has a first band.
    let single = folder.path().join("b.tif");
    write(&single, &heights(20, 30), &WriteOptions::heights("h")).unwrap();
    let first = crate::source::read_all(open_band(&single, 0).unwrap().as_ref()).unwrap();
    assert!(same_bits(&first.samples, &heights(20, 30).samples));
    assert!(open_band(&single, 1).is_err());
}

#[test]
fn every_band_must_be_whole() {
    let folder = scratch();
    let path = folder.path().join("a.tif");
    let options = WriteOptions::heights("one").with_band("two", None);
    let mut writer = Writer::create(&path, 4, 2, None, &options).unwrap();
    writer.write_band_rows(0, &[0.0; 8]).unwrap();
    writer.write_band_rows(1, &[0.0; 6]).unwrap();
    let error = writer.write_band_rows(2, &[0.0; 2]).unwrap_err().to_string();
    assert!(error.contains("a band below 2 expected, band 2 found"), "{error}");
    assert!(writer.finish().unwrap_err().to_string().contains("4 rows expected, 3 given"));
    assert!(!path.exists());
}

#[test]
fn others_accept_files_of_several_bands() {
    let folder = scratch();
    three(&folder.path().join("a.tif"), &heights(1100, 700), 64);
    let script = r#"
from rio_cogeo.cogeo import cog_validate
with rasterio.open('a.tif') as f:
    assert f.count == 3 and f.descriptions == ('one', 'two', 'three') and f.units[1] == 'm', (f.descriptions, f.units)
    assert f.overviews(1) == f.overviews(3) == [2, 4], f.overviews(1)
    a = f.read()
    hole = a[0] == f.nodata
    assert hole.sum() == 1 and (a[:, hole] == f.nodata).all()
    assert (a[1][~hole] == 2 * a[0][~hole]).all() and (a[2][~hole] == -a[0][~hole]).all()
assert cog_validate('a.tif')[0], cog_validate('a.tif')
print('fine')
"#;
    let said = rasterio_with(&["rio_cogeo"], script, folder.path());
    assert!(said.is_none_or(|text| text.trim().ends_with("fine")));
}
