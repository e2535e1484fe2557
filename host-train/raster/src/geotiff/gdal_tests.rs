//! GDAL reads our files, and we read GDAL's files. Needs `python3` with `rasterio`; says so if it is absent.

use super::tests::{heights, same_bits, scratch};
use super::*;
use crate::source::Source;
use crate::{Crs, GeoRef, Raster};
use elunar_core::sun::Body;
use elunar_core::tile::Window;
use elunar_testing::{rasterio as gdal, shared_folder};
use rand::{Rng, SeedableRng};
use std::path::Path;

fn raw(path: impl AsRef<Path>) -> Vec<f32> {
    let bytes = std::fs::read(path).expect("what the script left");
    bytes.as_chunks::<4>().0.iter().map(|&b| f32::from_ne_bytes(b)).collect()
}

#[test]
fn gdal_reads_our_heights_bit_for_bit() {
    let folder = scratch();
    let raster = heights(300, 270);
    let options = WriteOptions::heights("metres above the 1737400 m sphere").with_item("MODEL", "nano <é>");
    write(&folder.path().join("a.tif"), &raster, &options).unwrap();
    let script = "
d = rasterio.open('a.tif')
a = d.read(1); a.tofile('a.raw')
assert struct.pack('<f', a[150, 0]) == bytes.fromhex('fbff7fff'), a[150, 0]
assert d.nodata == -3.4028226550889045e+38, d.nodata
assert d.transform[:6] == (2.0, 0.0, 349000.25, 0.0, -2.5, 600000.5), d.transform
assert d.tags()['AREA_OR_POINT'] == 'Area' and d.tags()['MODEL'] == 'nano <é>', d.tags()
assert d.units == ('m',) and d.descriptions[0].startswith('metres above'), (d.units, d.descriptions)
assert d.block_shapes == [(304, 272)] and d.compression.value == 'DEFLATE', d.profile
p = d.crs.to_dict()
assert (p['proj'], p['lat_ts'], p['lon_0'], p['R'], p['units']) == ('eqc', 12, 180, 1737400, 'm'), p
";
    if gdal(script, folder.path()).is_some() {
        let mut expected = raster.samples;
        expected.iter_mut().filter(|v| v.is_nan()).for_each(|v| *v = NODATA);
        assert!(same_bits(&raw(folder.path().join("a.raw")), &expected));
    }
}

#[test]
fn gdal_understands_our_systems_and_images() {
    let folder = scratch();
    let mut raster = heights(40, 50);
    raster.samples.iter_mut().for_each(|v| *v = (*v + 3200.0) / 10.0 - 6.0);
    for (name, south) in [("n.tif", false), ("s.tif", true)] {
        raster.georef = Some(GeoRef {
            transform: [5.0, 1.5, 0.25, -7.0, 0.5, -2.0],
            crs: Crs::polar(Body::Moon.radius_m(), south),
        });
        write(&folder.path().join(name), &raster, &WriteOptions::image(SampleType::U16, "image")).unwrap();
    }
    raster.samples.iter_mut().for_each(|v| *v = if v.is_nan() { 0.0 } else { (*v).clamp(0.0, 255.0) });
    write(&folder.path().join("b.tif"), &raster, &WriteOptions::image(SampleType::U8, "image")).unwrap();
    let script = "
for name, lat in (('n.tif', 90), ('s.tif', -90)):
    d = rasterio.open(name)
    p = d.crs.to_dict()
    assert (p['proj'], p['lat_0'], p['lon_0'], p['R']) == ('stere', lat, 0, 1737400), p
    assert d.dtypes == ('uint16',) and d.nodata == 0 and d.transform[:6] == (1.5, 0.25, 5.0, 0.5, -2.0, -7.0), d.profile
    assert (d.read(1) == 0).sum() == 1
d = rasterio.open('b.tif')
assert d.dtypes == ('uint8',) and d.nodata is None, d.profile
d.read(1).astype('f4').tofile('b.raw')
";
    if gdal(script, folder.path()).is_some() {
        let rounded: Vec<f32> = raster.samples.iter().map(|v| v.round()).collect();
        assert_eq!(raw(folder.path().join("b.raw")), rounded);
    }
}

#[test]
fn we_read_every_layout_gdal_writes() {
    let folder = scratch();
    let script = "
rng = np.random.default_rng(5)
crs = rasterio.crs.CRS.from_proj4('+proj=eqc +lat_ts=12 +lon_0=180 +R=1737400 +units=m +no_defs')
n = 0
for dtype in ('uint8', 'uint16', 'int16', 'int32', 'uint32', 'float32', 'float64'):
    a = (rng.random((150, 170)) * 200 - (0 if dtype.startswith('u') else 100)).astype(dtype)
    a[3, 5] = 7
    for compress in ('none', 'lzw', 'deflate', 'zstd', 'packbits'):
        for predictor in (1, 2, 3):
            if predictor > 1 and compress not in ('lzw', 'deflate', 'zstd') or predictor == 3 and not dtype.startswith('f'):
                continue
            if predictor == 2 and dtype == 'float64':
                continue
            for extra in ({}, {'tiled': True, 'blockxsize': 64, 'blockysize': 32}, {'BIGTIFF': 'YES'}, {'ENDIANNESS': 'BIG', 'blockysize': 1}, {'blockysize': 150}):
                name = f'v{n}'
                with rasterio.open(name + '.tif', 'w', driver='GTiff', width=170, height=150, count=1, dtype=dtype, crs=crs, nodata=7,
                                   transform=Affine(2, 0, 100, 0, -3, 500), compress=compress, predictor=predictor, **extra) as d:
                    d.write(a, 1)
                b = a.astype('f4'); b[a == 7] = np.nan
                b.tofile(name + '.raw')
                n += 1
print(n)
";
    let Some(out) = gdal(script, folder.path()) else { return };
    let count: usize = out.split_whitespace().last().unwrap().parse().unwrap();
    assert!(count > 100, "{count} variants");
    for n in 0..count {
        let raster = read(folder.path().join(format!("v{n}.tif"))).unwrap();
        assert_eq!((raster.rows, raster.cols), (150, 170));
        assert!(same_bits(&raster.samples, &raw(folder.path().join(format!("v{n}.raw")))), "variant {n}");
        assert_windows_agree(&folder.path().join(format!("v{n}.tif")), &raster, n as u64);
        let georef = raster.georef.unwrap();
        assert_eq!(georef.transform, [100.0, 2.0, 0.0, 500.0, 0.0, -3.0]);
        assert!(georef.crs.same_as(&Crs::equirectangular(Body::Moon.radius_m(), 12.0, 180.0)), "{georef:?}");
    }
}

/// Windows at any position, with little, some and much memory, hold the same samples as the whole.
fn assert_windows_agree(path: &Path, whole: &Raster, seed: u64) {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    for cache_bytes in [0, 40_000, 1 << 26] {
        let source = super::read::GeoTiff::open(path, cache_bytes, None).unwrap();
        for _ in 0..5 {
            let (row, col) = (rng.random_range(0..whole.rows), rng.random_range(0..whole.cols));
            let (rows, cols) = (rng.random_range(0..=whole.rows - row), rng.random_range(0..=whole.cols - col));
            let found = source.read(Window { row, col, rows, cols }).unwrap();
            let line = |r: usize| &whole.samples[r * whole.cols + col..][..cols];
            let expected: Vec<f32> = (row..row + rows).flat_map(|r| line(r).iter().copied()).collect();
            assert!(same_bits(&found, &expected), "{}: {row} {col} {rows} {cols}", path.display());
        }
        assert!(source.read(Window { row: whole.rows, col: 0, rows: 1, cols: 1 }).is_err());
    }
}

#[test]
fn jpeg_sparse_files_and_what_a_file_says_of_itself() {
    let folder = scratch();
    let script = "
y, x = np.mgrid[:90, :70]
a = (120 + 60 * np.sin(x / 9) + 40 * np.cos(y / 13)).astype('u1')
def make(name, dtype='uint8', **more):
    with rasterio.open(name, 'w', driver='GTiff', width=70, height=90, count=1, dtype=dtype, **more) as d:
        d.write(a.astype(dtype), 1)
make('jpeg.tif', compress='jpeg', JPEG_QUALITY=90, tiled=True, blockxsize=32, blockysize=32)
make('rows.tif', 'int16', blockysize=1)
rasterio.open('jpeg.tif').read(1).astype('f4').tofile('jpeg.raw')
for name, nodata in (('sparse.tif', None), ('gaps.tif', -7)):
    with rasterio.open(name, 'w', driver='GTiff', width=70, height=90, count=1, dtype='float32', SPARSE_OK=True, nodata=nodata,
                       tiled=True, blockxsize=32, blockysize=32, compress='zstd') as d:
        d.write(np.ones((32, 32), 'f4'), 1, window=rasterio.windows.Window(32, 32, 32, 32))
";
    if gdal(script, folder.path()).is_none() {
        return;
    }
    let at = |name: &str| folder.path().join(name);
    // Two decoders may round one JPEG differently.
    let (ours, theirs) = (read(at("jpeg.tif")).unwrap(), raw(at("jpeg.raw")));
    let worst = ours.samples.iter().zip(&theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst <= 2.0 && ours.samples.len() == theirs.len(), "{worst}");
    let format = |name: &str| open(&at(name)).unwrap().info().format.clone();
    assert_eq!(format("jpeg.tif"), "GeoTIFF, u8, tiles of 32 x 32, JPEG");
    assert_eq!(format("rows.tif"), "GeoTIFF, i16, strips of 1 row, uncompressed");
    for (name, outside) in [("sparse.tif", 0.0), ("gaps.tif", f32::NAN)] {
        let raster = read(at(name)).unwrap();
        let expected =
            |i: usize| if (32..64).contains(&(i / 70)) && (32..64).contains(&(i % 70)) { 1.0 } else { outside };
        assert!(same_bits(&raster.samples, &(0..90 * 70).map(expected).collect::<Vec<f32>>()), "{name}");
        assert_windows_agree(&at(name), &raster, 1);
    }
}

#[test]
fn scale_unit_point_and_rotation_are_gdals() {
    let folder = scratch();
    let script = "
crs = rasterio.crs.CRS.from_proj4('+proj=eqc +lat_ts=0 +lon_0=180 +R=1737400 +units=m +no_defs')
polar = rasterio.crs.CRS.from_proj4('+proj=stere +lat_0=-90 +lon_0=0 +k=1 +R=1737400 +units=m +no_defs')
a = np.arange(-3, 3, dtype='i2').reshape(2, 3)
def make(name, dtype='int16', transform=Affine(2, 0, 100, 0, -3, 500), scale=1, offset=0, unit=None, point=False, crs=crs, nodata=None):
    with rasterio.open(name, 'w', driver='GTiff', width=3, height=2, count=1, dtype=dtype, crs=crs, transform=transform, nodata=nodata) as d:
        if point: d.update_tags(AREA_OR_POINT='Point')
        d.write(a.astype(dtype), 1)
        d.scales, d.offsets = (scale,), (offset,)
        if unit: d.units = (unit,)
make('plain.tif', scale=0.5, offset=10)
make('lola.tif', scale=0.5, offset=1737400, unit='m')
make('sldem.tif', 'float32', offset=1737.4)
make('km.tif', 'float32', unit='km')
make('point.tif', point=True)
make('rotated.tif', transform=Affine(1.5, 0.25, 5, 0.5, -2, -7))
make('polar.tif', crs=polar)
make('nan.tif', 'float32', nodata=float('nan'))
a = np.array([[-32768, -32767, -32764], [-32763, 0, 7]], dtype='i2')
make('special.tif')
for name in ('point.tif', 'rotated.tif'):
    print(*rasterio.open(name).transform.to_gdal())
";
    let Some(out) = gdal(script, folder.path()) else { return };
    let read = |name: &str| read(folder.path().join(name)).unwrap();
    assert_eq!(read("plain.tif").samples, [8.5, 9.0, 9.5, 10.0, 10.5, 11.0]);
    assert_eq!(read("lola.tif").samples, [-1.5, -1.0, -0.5, 0.0, 0.5, 1.0], "a radius is not a height");
    assert_eq!(read("sldem.tif").samples, [-3000.0, -2000.0, -1000.0, 0.0, 1000.0, 2000.0], "kilometres and a radius");
    assert_eq!(read("km.tif").samples[5], 2000.0);
    assert_eq!(read("nan.tif").valid_count(), 6);
    assert_eq!(read("special.tif").samples[3..], [-32763.0, 0.0, 7.0]);
    assert_eq!(read("special.tif").valid_count(), 3, "NULL, LRS and HRS of PDS3");
    assert!(read("polar.tif").georef.unwrap().crs.same_as(&Crs::polar(Body::Moon.radius_m(), true)));
    for (line, name) in out.lines().zip(["point.tif", "rotated.tif"]) {
        let expected: Vec<f64> = line.split_whitespace().map(|v| v.parse().unwrap()).collect();
        assert_eq!(read(name).georef.unwrap().transform.to_vec(), expected, "{name}");
    }
}

#[test]
fn what_we_cannot_read_we_refuse() {
    let folder = scratch();
    let script = "
def make(name, count=1, dtype='uint8', gcps=None, **more):
    with rasterio.open(name, 'w', driver='GTiff', width=64, height=64, count=count, dtype=dtype, **more) as d:
        d.write(np.ones((count, 64, 64), dtype))
        if gcps: d.gcps = (gcps, rasterio.crs.CRS.from_epsg(4326))
make('bands.tif', 3)
make('planes.tif', 2, interleave='band')
make('complex.tif', dtype='complex64')
made = ['bands', 'planes', 'complex', 'bits', 'gcps', 'mask']
for codec in ('lerc', 'lerc_deflate', 'lzma', 'webp', 'ccittfax4', 'jxl'):
    try:
        bands = 3 if codec == 'webp' else 1
        make(codec + '.tif', bands, compress=codec, **({'NBITS': 1} if codec == 'ccittfax4' else {}))
        made.append(codec)
    except rasterio.errors.RasterioError as e:
        pass
make('bits.tif', NBITS=4)
make('gcps.tif', gcps=[rasterio.control.GroundControlPoint(i * 9 % 60, i * 17 % 60, i, 2 * i * i) for i in range(5)])
with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True):
    with rasterio.open('mask.tif', 'w', driver='GTiff', width=64, height=64, count=1, dtype='uint8') as d:
        d.write(np.ones((1, 64, 64), 'uint8')); d.write_mask(np.eye(64, dtype=bool))
print(*made)
";
    let Some(out) = gdal(script, folder.path()) else { return };
    let names: Vec<&str> = out.split_whitespace().collect();
    assert!(names.len() >= 6, "{names:?}");
    for name in names {
        let error = read(folder.path().join(name).with_extension("tif")).expect_err(name);
        assert!(matches!(error, elunar_base::Error::Unsupported { .. }), "{name}: {error}");
        assert!(!name.starts_with("lerc") || error.to_string().contains("gdal_translate"), "{error}");
        println!("{error}");
    }
}

#[test]
fn real_files_are_read_as_gdal_reads_them() {
    let Some(shared) = shared_folder() else { return };
    let folder = scratch();
    let files = [
        "nac_m139939938le/image.tif",
        "nac_m139939938le/stereo_dem.tif",
        "independent_synthetic/mixed_coarse.tif",
        "independent_synthetic/mixed_image.tif",
        "lola_kepler/kepler.tif",
        "stereolunar/g00540_height_50m_f32.tif",
        "readers/Lunar_LRO_LOLA_Shade_MAP2_90.0N20.0_LAMB.tif",
    ];
    for name in files {
        let path = shared.join("data").join(name);
        let script = format!(
            "d = rasterio.open({path:?}); a = d.read(1, masked=True).astype('f8').filled(np.nan)
a[~np.isfinite(a) | (a <= -3.4e38)] = np.nan
a.astype('f4').tofile('a.raw'); print(*d.transform.to_gdal())"
        );
        let Some(out) = gdal(&script, folder.path()) else { return };
        let raster = read(&path).unwrap();
        assert!(same_bits(&raster.samples, &raw(folder.path().join("a.raw"))), "{name}");
        let transform: Vec<f64> = out.split_whitespace().map(|v| v.parse().unwrap()).collect();
        let georef = raster.georef.clone().unwrap();
        assert_eq!(georef.transform.to_vec(), transform, "{name}");
        if georef.crs.is_empty() {
            continue;
        }
        assert_eq!(georef.crs.sphere_radius_m(), Some(1_737_400.0), "{name}");
        assert!(!name.starts_with("nac") || georef.crs.same_as(&Crs::polar(Body::Moon.radius_m(), true)), "{georef:?}");
        assert!(
            !name.starts_with("indep") || georef.crs.same_as(&Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0)),
            "{georef:?}"
        );
        // Written again: GDAL finds the same system in our copy.
        write(&folder.path().join("copy.tif"), &raster, &WriteOptions::heights("copy")).unwrap();
        let script = format!("assert rasterio.open({path:?}).crs == rasterio.open('copy.tif').crs, {name:?}");
        gdal(&script, folder.path());
    }
}
