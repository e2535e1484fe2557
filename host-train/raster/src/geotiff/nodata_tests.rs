//! Voids are GDAL's: nodata texts of other programs, and values that were rounded on their way.

use super::tests::{heights, scratch};
use super::*;
use elunar_testing::rasterio as gdal;
use std::path::Path;
use tiff::encoder::{TiffEncoder, colortype::Gray8};
use tiff::tags::Tag;

/// Defines `put(name, samples, kind, text, ...)`, which writes a file of one row with a nodata text as it stands.
const PUT: &str = "
def put(name, samples, kind, text, **more):
    mark = 'NODATA-IS-HERE' + 26 * ' '
    with rasterio.open(name, 'w', driver='GTiff', width=len(samples), height=1, count=1, dtype=kind, **more) as d:
        d.write(np.array([[samples]], kind))
        d.update_tags(mark=mark)
    b = open(name, 'rb').read()
    little, big = b[:2] == b'II', b[2:4] in (b'+\\0', b'\\0+')
    e = '<' if little else '>'
    # The metadata tag becomes that of nodata.
    width, count, at = (20, 'Q', struct.unpack(e + 'Q', b[8:16])[0]) if big else (12, 'H', struct.unpack(e + 'I', b[4:8])[0])
    for i in range(struct.unpack_from(e + count, b, at)[0]):
        entry = at + (8 if big else 2) + i * width
        if struct.unpack_from(e + 'H', b, entry)[0] == 42112:
            length, start = struct.unpack_from(e + ('QQ' if big else 'II'), b, entry + 4)
            text = text.encode().ljust(length, b'\\0')
            b = b[:entry] + struct.pack(e + 'H', 42113) + b[entry + 2:]
            b = b[:start] + text + b[start + length:]
    open(name, 'wb').write(b)
";

fn voids(path: &Path) -> Vec<usize> {
    let samples = read(path).unwrap_or_else(|e| panic!("{e}")).samples;
    (0..samples.len()).filter(|&i| samples[i].is_nan()).collect()
}

/// Runs a script that puts files, and compares their voids with GDAL's. Returns their number.
fn compare(script: &str) -> usize {
    let folder = scratch();
    let ask = "
import glob
for name in sorted(glob.glob('*.tif')):
    print(name, *np.nonzero(rasterio.open(name).read_masks(1)[0] == 0)[0])
";
    let Some(out) = gdal(&format!("{PUT}\n{script}\n{ask}"), folder.path()) else { return 0 };
    for line in out.lines() {
        let (name, places) = line.split_once(' ').unwrap_or((line, ""));
        let expected: Vec<usize> = places.split_whitespace().map(|i| i.parse().unwrap()).collect();
        assert_eq!(voids(&folder.path().join(name)), expected, "{name}");
    }
    out.lines().count()
}

#[test]
fn texts_of_other_programs_are_read_as_gdal_reads_them() {
    let found = compare(
        "
samples = [-9999, 0, -9999.5, np.nan, 5, 16, 1, 1.234, -9, -10000]
texts = ['nan', 'NaN', '+nan', ' nan', '1.#QNAN', '-1.#QNAN', '1.#SNAN', '-1.#IND', '-9999', '-9999,000000', '-9999,5', '-9999 -8888',
         '-9999\\n', '\\t-9999', '  -9999 ', '-9999;', '-9999m', '-1e4', '-9,999e3', '+5', '-9999,-8888', '1,234.5', '-9999\\r\\n', '5.', '-9999.0E+00']
for i, text in enumerate(texts):
    for j, (kind, more) in enumerate([('float32', {}), ('float64', {'BIGTIFF': 'YES'}), ('float32', {'ENDIANNESS': 'BIG'})]):
        # GDAL does not count NaN as void without a nodata value of NaN.
        a = samples if 'n' in text.lower() else [5 if v != v else v for v in samples]
        put(f'{i}_{j}.tif', a, kind, text, **more)
",
    );
    assert!(found == 0 || found == 75, "{found} files");
}

#[test]
fn integers_have_their_range() {
    let found = compare(
        "
for kind, samples, texts in (
    ('uint8', [0, 1, 7, 255], ['-1', '256', '7.5', '7', '-0', 'nan', '255.4', '6.9999', '1e300', '7,0']),
    ('int16', [-32763, -9999, 0, 7], ['-32769', '-9999.5', '40000', '-9999.0', '-3.4e38', 'nan']),
    ('uint16', [0, 7, 65535], ['65535', '-1', '65536', '-9999', '-32768']),
    ('int32', [-2147483648, -9999, 0, 7, 2147483647], ['-2147483648', '-3.4e38', '7.9', '-9999', '2147483647']),
    ('uint32', [0, 7, 4294967295], ['4294967295', '-1', '4294967296'])):
    for i, text in enumerate(texts):
        put(f'{kind}_{i}.tif', samples, kind, text)
",
    );
    assert!(found == 0 || found == 29, "{found} files");
}

#[test]
fn values_that_were_rounded_on_their_way_are_void() {
    let found = compare(
        "
rng = np.random.default_rng(3)
for i, value in enumerate([-9999.9, 0.1, -32767.7, 1e20, -1e-20, 1e5 / 3, -99999, 0]):
    near = value * (1 + np.concatenate([[0], rng.normal(0, 1, 20) * 10.0 ** rng.uniform(-8, -4, 20)]))
    for j, text in enumerate([repr(float(value)), repr(float(np.float32(value))), '%.8g' % value]):
        put(f'f64_{i}_{j}.tif', list(near) + [float(np.float32(value)), 0, 7], 'float64', text)
        put(f'f32_{i}_{j}.tif', list(near) + [0, 7], 'float32', text)
",
    );
    assert!(found == 0 || found == 48, "{found} files");
}

#[test]
fn lows_of_f32_are_void_however_they_were_rounded() {
    let folder = scratch();
    let script = "
low = [-3.4028234663852886e38, -3.4028226550889045e38, -3.4e38, float(np.float32(-3.4e38)), -3.39999999999999996e38]
texts = ['-3.4e38', '-3.4028235e+38', '-3.40282265508890445e+38', '-3.39999999999999996e+38', '-3.4028234663852886e+38', '-3.39999995e38']
for i, text in enumerate(texts):
    for kind in ('float32', 'float64'):
        put(f'{kind}_{i}.tif', low + [-2000.5, 7], kind, text)
";
    if gdal(&format!("{PUT}\n{script}"), folder.path()).is_none() {
        return;
    }
    for (kind, text) in ["float32", "float64"].into_iter().flat_map(|kind| (0..6).map(move |text| (kind, text))) {
        assert_eq!(voids(&folder.path().join(format!("{kind}_{text}.tif"))), [0, 1, 2, 3, 4], "{kind} {text}");
    }
}

#[test]
fn reported_files_have_their_voids() {
    let Some(shared) = elunar_testing::shared_folder() else { return };
    let files = [
        ("04_nodata_text/qnan.tif", 48),
        ("12_nodata_rounded/f64_from_f32.tif", 60),
        ("12_nodata_rounded/f32_3.4_tag_3.4.tif", 60),
        ("12_nodata_rounded/f32_lowest_tag_3.4.tif", 60),
    ];
    for (name, count) in files {
        let path = shared.join("files/bugs").join(name);
        match path.exists() {
            true => assert_eq!(voids(&path).len(), count, "{name}"),
            false => elunar_testing::skipped("reported_files_have_their_voids", &format!("no {}", path.display())),
        }
    }
}

#[test]
fn what_no_height_can_be_is_void_without_a_nodata_value() {
    let folder = scratch();
    let path = folder.path().join("a.tif");
    let mut raster = heights(4, 5);
    for (at, value) in [(0, -3.4e38), (1, -1e32), (2, 1.701_41e38), (3, 1e30), (4, -9e29), (5, f32::INFINITY)] {
        raster.samples[at] = value;
    }
    write(&path, &raster, &WriteOptions::heights("t")).unwrap();
    assert_eq!(voids(&path), [0, 1, 2, 3, 5, 10]);
    // Kilometres.
    let mut options = WriteOptions::heights("t");
    options.unit = Some("km".into());
    write(&path, &raster, &options).unwrap();
    assert_eq!(voids(&path), [0, 1, 2, 3, 4, 5, 10]);
}

#[test]
fn a_text_without_a_number_is_refused() {
    let folder = scratch();
    let script = format!("{PUT}\nput('a.tif', [1, 2], 'float32', 'none')");
    if gdal(&script, folder.path()).is_some() {
        let error = read(folder.path().join("a.tif")).unwrap_err().to_string();
        assert!(error.ends_with("nodata tag 42113 is \"none\", a number expected"), "{error}");
    }
}

#[test]
fn a_blank_text_names_no_value() {
    let folder = scratch();
    let path = folder.path().join("a.tif");
    for (text, void) in [("", vec![]), ("  ", vec![]), (" 7", vec![1])] {
        let mut tiff = TiffEncoder::new(std::fs::File::create(&path).unwrap()).unwrap();
        let mut image = tiff.new_image::<Gray8>(3, 1).unwrap();
        image.encoder().write_tag(Tag::GdalNodata, text).unwrap();
        image.write_data(&[0, 7, 255]).unwrap();
        assert_eq!(voids(&path), void, "{text:?}");
    }
}
