//! VRTs that GDAL writes, and VRTs by hand; what would be computed, and what is broken, is refused.

use crate::content::{files_of_raster, sha256_of_raster};
use crate::gdal_tests::agrees;
use crate::geotiff::{SampleType, WriteOptions, write};
use crate::source::{Source, open, read_all};
use crate::{Raster, heights};
use elunar_core::tile::Window;
use elunar_testing::{mutate, oracle};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::path::Path;

const SIMPLE: &str = r#"<VRTDataset rasterXSize="4" rasterYSize="3">
<SRS>+proj=eqc +lat_ts=20 +lon_0=180 +R=1737400</SRS><GeoTransform>-1000, 5, 0, 2000, 0, -5</GeoTransform>
<Metadata><MDI key="IMAGE_TIME">2009-08-30T12:00:00</MDI></Metadata>
<VRTRasterBand dataType="Float32" band="1"><NoDataValue>3</NoDataValue>
<SimpleSource><SourceFilename relativeToVRT="1">a.tif</SourceFilename><SourceBand>1</SourceBand>
<SrcRect xOff="0" yOff="0" xSize="3" ySize="2"/><DstRect xOff="1" yOff="1" xSize="3" ySize="2"/></SimpleSource>
</VRTRasterBand></VRTDataset>
"#;

/// Writes `a.tif`: 2 x 3 pixels from 1 to 6.
fn written(folder: &Path, vrt: &str) -> std::path::PathBuf {
    let raster = Raster { rows: 2, cols: 3, samples: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], georef: None };
    write(&folder.join("a.tif"), &raster, &WriteOptions::image(SampleType::F32, "t")).unwrap();
    std::fs::write(folder.join("a.vrt"), vrt).unwrap();
    folder.join("a.vrt")
}

fn opened(vrt: &str) -> elunar_base::Result<(tempfile::TempDir, Box<dyn Source>)> {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), vrt);
    open(&path).map(|source| (folder, source))
}

/// Returns samples, voids as -1.
fn samples(vrt: &str) -> Vec<f32> {
    let (_folder, source) = opened(vrt).unwrap();
    read_all(&*source).unwrap().samples.into_iter().map(|v| if v.is_nan() { -1.0 } else { v }).collect()
}

#[test]
fn pieces_lie_where_they_are_put() {
    let placed = [-1.0, -1.0, -1.0, -1.0, -1.0, 1.0, 2.0, -1.0, -1.0, 4.0, 5.0, 6.0];
    assert_eq!(samples(SIMPLE), placed);
    let (folder, source) = opened(SIMPLE).unwrap();
    let info = source.info();
    assert_eq!(info.format, "VRT, f32, of 1 file");
    assert!(info.place("a").is_ok() && info.sun.time == "2009-08-30T12:00:00".parse().ok());
    let part = source.read(Window { row: 2, col: 2, rows: 1, cols: 2 }).unwrap();
    assert_eq!(part, [5.0, 6.0]);
    let files = [folder.path().join("a.vrt"), folder.path().join("a.tif")];
    assert_eq!(files_of_raster(&files[0]).unwrap(), files);
    assert!(sha256_of_raster(&files[0]).unwrap().contains('+'));
    // Without NoDataValue, 0 is where no file lies; a scale, an offset and a unit apply.
    let scaled = SIMPLE.replace("<NoDataValue>3</NoDataValue>", "<Scale>2</Scale><Offset>1</Offset>");
    assert_eq!(samples(&scaled), [1.0, 1.0, 1.0, 1.0, 1.0, 3.0, 5.0, 7.0, 1.0, 9.0, 11.0, 13.0]);
    let unit = SIMPLE.replace("<NoDataValue>", "<UnitType>km</UnitType><NoDataValue>");
    assert_eq!(samples(&unit)[9..], [4000.0, 5000.0, 6000.0]);
    // Later pieces lie above earlier ones, unless they are clear; pieces may lie partly outside.
    let one = SIMPLE.split("<SimpleSource>").nth(1).unwrap().split("</SimpleSource>").next().unwrap();
    let over = one.replace("<DstRect xOff=\"1\" yOff=\"1\"", "<DstRect xOff=\"-1\" yOff=\"0\"");
    let two = SIMPLE.replace("</VRTRasterBand>", &format!("<SimpleSource>{over}</SimpleSource></VRTRasterBand>"));
    assert_eq!(samples(&two), [2.0, -1.0, -1.0, -1.0, 5.0, 6.0, 2.0, -1.0, -1.0, 4.0, 5.0, 6.0]);
    let clear = format!("<ComplexSource>{over}<NODATA>6</NODATA></ComplexSource></VRTRasterBand>");
    let clear = SIMPLE.replace("</VRTRasterBand>", &clear);
    assert_eq!(samples(&clear), [2.0, -1.0, -1.0, -1.0, 5.0, 1.0, 2.0, -1.0, -1.0, 4.0, 5.0, 6.0]);
}

#[test]
fn what_is_computed_or_broken_is_refused() {
    let mut wrong = vec![];
    for (from, to, what) in [
        (
            "<VRTDataset ",
            "<VRTDataset subClass=\"VRTWarpedDataset\" ",
            "line 1: VRTWarpedDataset is not read; convert it",
        ),
        ("dataType=\"Float32\"", "subClass=\"VRTDerivedRasterBand\"", "line 4: VRTDerivedRasterBand is not read"),
        (
            "<NoDataValue>3",
            "<MaskBand/><NoDataValue>3",
            "line 4: MaskBand in VRTRasterBand is not read; convert it first",
        ),
        ("<SourceBand>1", "<LUT>1:2</LUT><SourceBand>1", "LUT in SimpleSource is not read"),
        ("<SourceBand>1", "<SourceBand>2", "SourceBand 2; 1 expected"),
        ("Float32", "CFloat32", "dataType CFloat32; Byte, Int8, UInt16"),
        ("Float32", "Byte", "a.tif of u8 samples expected, found GeoTIFF, f32"),
        ("<NoDataValue>3", "<NoDataValue>none", "a number as NoDataValue expected, found \"none\""),
        ("<NoDataValue>3<", "<Scale>0</Scale><NoDataValue>3<", "a Scale other than 0"),
        ("rasterXSize=\"4\"", "", "rasterXSize in VRTDataset expected, found none"),
        ("rasterXSize=\"4\"", "rasterXSize=\"-4\"", "a number as rasterXSize expected, found \"-4\""),
        ("rasterXSize=\"4\"", "rasterXSize=\"0\"", "rasterXSize from 1 to 2^63 expected, found 0"),
        (
            "<DstRect xOff=\"1\" yOff=\"1\" xSize=\"3\"",
            "<DstRect xOff=\"1\" yOff=\"1\" xSize=\"6\"",
            "SrcRect of 2 x 6 as DstRect",
        ),
        ("xSize=\"3\"", "xSize=\"3.5\"", "whole pixels as xSize expected, found 3.5; convert"),
        ("xSize=\"3\"", "xSize=\"0\"", "at least 1 as xSize expected, found 0"),
        (
            "xSize=\"3\"",
            "xSize=\"9007199254740991\"",
            "a.tif of 2 x 9007199254740991 pixels at least (SrcRect) expected",
        ),
        ("<SrcRect xOff=\"0\"", "<SrcRect xOff=\"-1\"", "SrcRect within its file expected"),
        (
            "<SrcRect xOff=\"0\"",
            "<SrcRect xOff=\"1\"",
            "a.tif of 2 x 4 pixels at least (SrcRect) expected, found 2 x 3",
        ),
        ("a.tif", "b.tif", "b.tif"),
        ("a.tif", "a.vrt", "VRTs at most 3 deep expected, found more"),
        ("a.tif", "http://127.0.0.1/a.tif", "found an address"),
        ("-1000, 5", "-1000, 0", "a GeoTransform with an inverse expected"),
        ("-1000, 5", "5", "six numbers as GeoTransform expected"),
        ("xSize=\"3\"", "xSize=\"1e300\"", "whole pixels as xSize expected, found 1"),
        ("+proj=eqc", "+proj=odd", "line 2: SRS: "),
        ("</VRTRasterBand>", "</VRTRasterBand><VRTRasterBand/>", "2 bands found, one expected"),
        ("</VRTDataset>", "", "XML expected, found"),
    ] {
        assert!(SIMPLE.contains(from), "{from}");
        let found = opened(&SIMPLE.replace(from, to)).err().map_or_else(|| "it is read".into(), |e| e.to_string());
        if !found.contains(what) || found.contains('\n') {
            wrong.push(format!("{to}: {found}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    // A huge one opens, and takes no memory before it is read.
    let (_folder, huge) = opened(&SIMPLE.replace("rasterXSize=\"4\"", "rasterXSize=\"9007199254740991\"")).unwrap();
    let far = huge.read(Window { row: 1, col: 1 << 40, rows: 2, cols: 2 }).unwrap();
    assert!(far.iter().all(|v| v.is_nan()));
}

#[test]
fn files_must_have_the_conversion_of_the_vrt() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), SIMPLE);
    let raster = Raster { rows: 2, cols: 3, samples: vec![1.0; 6], georef: None };
    let mut options = WriteOptions::heights("t");
    options.unit = Some("km".into());
    write(&folder.path().join("a.tif"), &raster, &options).unwrap();
    // GDAL's builder drops the unit; the file's counts.
    assert_eq!(heights::read(&path).unwrap().samples[5], 1000.0);
    std::fs::write(&path, SIMPLE.replace("<NoDataValue>", "<Scale>2</Scale><NoDataValue>")).unwrap();
    let text = open(&path).err().expect("refused").to_string();
    assert!(text.contains("scale 2000 and offset 0 of the VRT expected, found 1000 and 0; convert it first"), "{text}");
}

#[test]
fn damaged_vrts_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), SIMPLE);
    let pieces =
        ["0", "-1", "9999999999", "<", "/>", "\"", "<NODATA>1</NODATA>", "Byte", "a.vrt", "1e308", "nan", "&lt;"];
    let mut rng = ChaCha8Rng::seed_from_u64(48);
    let (mut read, mut refused) = (0, 0);
    for _ in 0..2000 {
        let mut bytes = SIMPLE.as_bytes().to_vec();
        mutate(&mut bytes, &pieces, &mut rng);
        std::fs::write(&path, &bytes).unwrap();
        let small = |source: &dyn Source| source.info().rows.saturating_mul(source.info().cols) < 10_000;
        match open(&path) {
            Ok(source) if small(&*source) => {
                read_all(&*source).unwrap();
                read += 1;
            }
            Ok(_) => {}
            Err(error) => {
                assert!(!error.to_string().contains('\n'), "{error}");
                refused += 1;
            }
        }
    }
    assert!(read > 40 && refused > 200, "{read} read, {refused} refused");
}

#[test]
fn vrts_of_gdal_agree() {
    let folder = tempfile::tempdir().unwrap();
    let script = "
rng = np.random.default_rng(48)
for name, col, row, kind in (('a', 0, 0, 'float32'), ('b', 25, 5, 'float32'), ('c', 70, 60, 'float32'),
                             ('i', 0, 0, 'int16'), ('j', 40, 0, 'int16')):
    a = rng.integers(0, 200, (30, 40)).astype(kind); a[rng.random((30, 40)) < 0.2] = 3
    with rasterio.open(name + '.tif', 'w', driver='GTiff', width=40, height=30, count=1, dtype=kind, nodata=3,
                       crs='+proj=eqc +lat_ts=20 +lon_0=180 +R=1737400', transform=Affine(5, 0, col * 5, 0, -5, 2000 - row * 5)) as d:
        d.write(a, 1)
        if kind == 'int16': d.scales = (0.5,)
";
    if elunar_testing::rasterio(script, folder.path()).is_none() {
        return;
    }
    let mut names = vec![];
    for (name, program, arguments) in [
        ("mosaic", "gdalbuildvrt", &["mosaic.vrt", "a.tif", "b.tif", "c.tif"][..]),
        ("scaled", "gdalbuildvrt", &["scaled.vrt", "i.tif", "j.tif"]),
        ("nested", "gdalbuildvrt", &["nested.vrt", "mosaic.vrt", "a.tif"]),
        ("part", "gdal_translate", &["-of", "VRT", "-srcwin", "5", "3", "20", "11", "b.tif", "part.vrt"]),
        ("outside", "gdal_translate", &["-of", "VRT", "-srcwin", "-5", "-3", "60", "50", "b.tif", "outside.vrt"]),
        ("void", "gdal_translate", &["-of", "VRT", "-a_nodata", "7", "a.tif", "void.vrt"]),
        ("plain", "gdal_translate", &["-of", "VRT", "-a_nodata", "none", "a.tif", "plain.vrt"]),
    ] {
        let Some(mut command) = oracle::gdal(program) else { return };
        let out = command.arg("-q").args(arguments).current_dir(folder.path()).output().unwrap();
        assert!(out.status.success(), "{name}: {}", String::from_utf8_lossy(&out.stderr));
        names.push(format!("{name}.vrt"));
    }
    // GDAL shows 3 where the file's nodata value is not the VRT's; here it stays void.
    names.retain(|name| name != "plain.vrt" && name != "void.vrt");
    assert!(agrees(folder.path(), &names, |name| if name == "scaled.vrt" { 0.5 } else { 1.0 }));
    for (name, void) in [("void.vrt", 7.0), ("plain.vrt", 3.0)] {
        let read = |name: &str| read_all(&*open(&folder.path().join(name)).unwrap()).unwrap().samples;
        let (ours, file) = (read(name), read("a.tif"));
        assert!(ours.iter().zip(file).all(|(a, b)| *a == b || a.is_nan() && (b.is_nan() || b == void)), "{name}");
    }
    assert_eq!(files_of_raster(&folder.path().join("nested.vrt")).unwrap().len(), 5);
}

#[test]
fn what_is_no_vrt_or_has_no_place_or_no_files() {
    let text = opened("<?xml version=\"1.0\"?><a><VRTDataset/></a>").err().unwrap().to_string();
    assert!(text.contains("VRTDataset as outermost element expected, found a"), "{text}");
    let text = opened(&SIMPLE.replace("-1000, 5", "inf, 5")).err().unwrap().to_string();
    assert!(text.contains("a GeoTransform with an inverse expected, found [inf"), "{text}");
    let from = SIMPLE.find("<GeoTransform>").unwrap();
    let to = SIMPLE.find("<Metadata>").unwrap();
    let (_folder, source) = opened(&format!("{}{}", &SIMPLE[..from], &SIMPLE[to..])).unwrap();
    assert_eq!(source.info().georef, None);
    let bare = |band: &str| {
        format!(
            "<VRTDataset rasterXSize=\"1\" rasterYSize=\"1\"><VRTRasterBand dataType=\"Byte\">{band}</VRTRasterBand></VRTDataset>"
        )
    };
    assert_eq!(samples(&bare("<UnitType>km</UnitType><Offset>2</Offset>")), [2000.0], "a VRT of no file");
    let piece = "<SimpleSource><SourceFilename>a</SourceFilename><SrcRect xOff=\"0\" yOff=\"0\" xSize=\"1\" ySize=\"1\"/>\
                 <DstRect xOff=\"0\" yOff=\"0\" xSize=\"1\" ySize=\"1\"/></SimpleSource>";
    let text = opened(&bare(&piece.repeat(100_001))).err().unwrap().to_string();
    assert!(text.contains("at most 100000 sources expected, found more"), "{text}");
}

#[test]
fn all_files_must_have_one_unit() {
    let folder = tempfile::tempdir().unwrap();
    let one = SIMPLE.split("<SimpleSource>").nth(1).unwrap().split("</SimpleSource>").next().unwrap();
    let two = one.replace("a.tif", "b.tif");
    let two = SIMPLE.replace("</VRTRasterBand>", &format!("<SimpleSource>{two}</SimpleSource></VRTRasterBand>"));
    let path = written(folder.path(), &two);
    let raster = Raster { rows: 2, cols: 3, samples: vec![1.0; 6], georef: None };
    write(&folder.path().join("b.tif"), &raster, &WriteOptions::heights("t")).unwrap();
    let text = open(&path).err().unwrap().to_string();
    assert!(text.contains("b.tif: unit, scale and offset of the first file expected, found others"), "{text}");
}
