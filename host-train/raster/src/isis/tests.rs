//! Cubes that GDAL writes, and cubes by hand, tiles, types and special pixels; broken ones are refused with the keyword's name.

use crate::gdal_tests::agrees;
use crate::source::{Source, open, read_all};
use elunar_core::tile::Window;
use elunar_testing::{mutate, oracle};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::path::Path;

const MAPPING: &str = "Group = Mapping
    TargetName = Moon
    EquatorialRadius = 1737400.0 <meters>
    PolarRadius = 1737400.0 <meters>
    LongitudeDirection = PositiveEast
    ProjectionName = PolarStereographic
    CenterLongitude = 30.0
    CenterLatitude = -90.0
    UpperLeftCornerX = -1000.0
    UpperLeftCornerY = 2.0 <kilometers>
    PixelResolution = 5.0 <meters/pixel>
  End_Group
  Group = Instrument
    SpacecraftName = \"Lunar Reconnaissance Orbiter\"
    StartTime = 2009-08-30T12:00:00.000
  End_Group
  Group = Kernels
    TargetPosition = (Table, $base/kernels/spk/de421.bsp)
  End_Group";

/// Returns a cube of 5 x 7 samples of a type, with the label's `Core` block so.
fn cube(core: &str, kind: &str, order: &str, samples: &[u8]) -> Vec<u8> {
    let label = format!(
        "Object = IsisCube
  Object = Core
    StartByte = 2049
    {core}
    Group = Dimensions
      Samples = 7
      Lines = 5
      Bands = 1
    End_Group
    Group = Pixels
      Type = {kind}
      ByteOrder = {order}
      Base = 0.0
      Multiplier = 1.0
    End_Group
  End_Object
  {MAPPING}
End_Object
Object = Label
  Bytes = 2048
End_Object
End
"
    );
    let mut bytes = label.into_bytes();
    assert!(bytes.len() <= 2048);
    bytes.resize(2048, 0);
    bytes.extend(samples);
    bytes
}

fn opened(bytes: &[u8]) -> elunar_base::Result<(tempfile::TempDir, Box<dyn Source>)> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.cub");
    std::fs::write(&path, bytes).unwrap();
    open(&path).map(|source| (folder, source))
}

#[test]
fn rows_and_tiles_hold_the_same_samples() {
    let number = |row: usize, col: usize| (10 * row + col + 3) as u16;
    let rows: Vec<u8> = (0..35).flat_map(|i| number(i / 7, i % 7).to_be_bytes()).collect();
    // Tiles of 2 x 3 cover 5 x 7 samples in three rows of three tiles.
    let place = |i: usize| (i / 18 * 2 + i % 6 / 3, i % 18 / 6 * 3 + i % 3);
    let tiles: Vec<u8> = (0..54).flat_map(|i| number(place(i).0, place(i).1).to_be_bytes()).collect();
    let (_a, plain) = opened(&cube("Format = BandSequential", "UnsignedWord", "Msb", &rows)).unwrap();
    let core = "Format = Tile TileSamples = 3 TileLines = 2";
    let (_b, tiled) = opened(&cube(core, "UnsignedWord", "Msb", &tiles)).unwrap();
    let whole = read_all(&*plain).unwrap();
    assert_eq!(whole.samples, (0..35).map(|i| f32::from(number(i / 7, i % 7))).collect::<Vec<_>>());
    assert_eq!(read_all(&*tiled).unwrap(), whole);
    for window in [(0, 0, 1, 1), (1, 2, 3, 4), (4, 6, 1, 1), (3, 0, 2, 7), (2, 5, 0, 2), (2, 5, 2, 0)] {
        let (row, col, rows, cols) = window;
        let window = Window { row, col, rows, cols };
        assert_eq!(plain.read(window).unwrap(), tiled.read(window).unwrap(), "{window:?}");
    }
    let info = tiled.info();
    assert_eq!(info.format, "ISIS cube, u16 big-endian, tiles of 2 x 3");
    assert!(info.is_unsigned() && info.sun.time == "2009-08-30T12:00:00".parse().ok());
    let georef = info.georef.as_ref().unwrap();
    assert_eq!(georef.transform, [-1000.0, 5.0, 0.0, 2000.0, 0.0, -5.0]);
    assert!(tiled.info().place("a.cub").is_ok());
    let short = &tiles[..tiles.len() - 1];
    let text = opened(&cube(core, "UnsignedWord", "Msb", short)).err().unwrap().to_string();
    assert!(
        text.contains("5 lines of 7 u16 samples from byte 2048 on, 2156 bytes in all, expected, found 2155"),
        "{text}"
    );
}

#[test]
fn special_pixels_are_void() {
    let voids = |kind: &str, numbers: &[u8]| {
        let mut samples = numbers.to_vec();
        samples.resize(35 * 8, 9);
        let (_folder, source) = opened(&cube("Format = BandSequential", kind, "Lsb", &samples)).unwrap();
        read_all(&*source).unwrap().samples[..6].iter().map(|v| v.is_nan()).collect::<Vec<_>>()
    };
    assert_eq!(voids("UnsignedByte", &[0, 255, 1, 254, 2, 9]), [true, true, false, false, false, false]);
    let words = [-32768_i16, -32764, -32752, 0, 1, 32767].map(i16::to_le_bytes).concat();
    assert_eq!(voids("SignedWord", &words), [true, true, false, false, false, false]);
    let words = [0_u16, 2, 3, 65533, 65534, 65535].map(u16::to_le_bytes).concat();
    assert_eq!(voids("UnsignedWord", &words), [true, true, false, false, true, true]);
    let words = [0_u32, 3, u32::MAX - 2, u32::MAX - 1, u32::MAX, 7].map(u32::to_le_bytes).concat();
    assert_eq!(voids("UnsignedInteger", &words), [true, false, false, true, true, false]);
    let reals = [0xFF7F_FFFB_u32, 0xFF7F_FFFF, 0x3F80_0000, 0, 0x7F80_0000, 0xC000_0000].map(u32::to_le_bytes).concat();
    assert_eq!(voids("Real", &reals), [true, true, false, false, true, false]);
}

#[test]
fn a_label_beside_its_cube_and_a_tiff_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let whole = cube("Format = BandSequential ^Core = A.cub", "UnsignedByte", "Lsb", &[]);
    let text = String::from_utf8(whole).unwrap().replace("StartByte = 2049", "StartByte = 1");
    std::fs::write(at("a.lbl"), &text).unwrap();
    std::fs::write(at("a.cub"), [7; 35]).unwrap();
    assert_eq!(read_all(&*open(&at("a.lbl")).unwrap()).unwrap().samples, [7.0; 35]);
    assert_eq!(crate::content::files_of_raster(&at("a.lbl")).unwrap(), [at("a.lbl"), at("a.cub")]);
    let refused = |from: &str, to: &str| {
        std::fs::write(at("b.lbl"), text.replace(from, to)).unwrap();
        open(&at("b.lbl")).err().expect("refused").to_string()
    };
    assert!(refused("A.cub", "\"../a.cub\"").contains("a file beside the label expected, ^Core names \"../a.cub\""));
    assert!(refused("A.cub", "c.cub").contains("^Core names c.cub, no such file beside the label"));
    assert!(refused("BandSequential", "GeoTIFF").contains("a TIFF as ^Core expected"));
    let raster = crate::Raster { rows: 5, cols: 7, samples: vec![2.0; 35], georef: None };
    crate::geotiff::write(&at("a.tif"), &raster, &crate::geotiff::WriteOptions::heights("t")).unwrap();
    std::fs::write(at("t.lbl"), text.replace("BandSequential", "GeoTIFF").replace("A.cub", "a.tif")).unwrap();
    let tiff = open(&at("t.lbl")).unwrap();
    assert!(tiff.info().format.ends_with(", ISIS label") && tiff.info().georef.is_some());
    assert_eq!(read_all(&*tiff).unwrap().samples, [2.0; 35]);
}

#[test]
fn broken_labels_are_refused_with_the_keyword() {
    let good = cube("Format = Tile TileSamples = 3 TileLines = 2", "Real", "Lsb", &[0; 216]);
    assert!(opened(&good).is_ok());
    let text = String::from_utf8_lossy(&good[..2048]).into_owned();
    for (from, to, what) in [
        ("Samples = 7", "Samples = 0", "at least 1 as Samples expected, found 0"),
        ("Samples = 7", "Samples = 9223372036854775807", "expected, found 2264 bytes"),
        ("Samples = 7", "Samples = -7", "a count as SAMPLES expected"),
        ("Lines = 5", "", "Lines in DIMENSIONS expected, found none"),
        ("Lines = 5", "Lines = 5\nLines = 6", "one value of LINES expected"),
        ("Bands = 1", "Bands = 3", "Bands = 3 found, 1 expected; take one out: gdal_translate -b 1"),
        ("TileSamples = 3", "TileSamples = 0", "at least 1 as TileSamples expected, found 0"),
        ("TileSamples = 3", "TileSamples = 9999999999999999999", "rows of less than 2^64 bytes expected"),
        ("TileLines = 2", "", "TileLines in CORE expected"),
        ("Format = Tile", "Format = Odd", "Tile, BandSequential or GeoTIFF as Format expected, found odd"),
        ("Format = Tile", "", "Format in CORE expected"),
        ("StartByte = 2049", "StartByte = 1", "StartByte from 2 on expected, found 1"),
        ("StartByte = 2049", "StartByte = 18446744073709551615", "more than 2^64 bytes in all, expected"),
        ("Type = Real", "Type = SignedInteger", "Real or Double as Type expected, found SignedInteger"),
        ("Type = Real", "", "Type in PIXELS expected"),
        ("ByteOrder = Lsb", "", "ByteOrder in PIXELS expected"),
        ("ByteOrder = Lsb", "ByteOrder = Vax", "Lsb or Msb as ByteOrder expected, found vax"),
        ("Multiplier = 1.0", "Multiplier = 0", "a Multiplier other than 0"),
        ("Base = 0.0", "Base = Odd", "a number as BASE expected"),
        ("Format = Tile", "Format = GeoTIFF", "^Core with the name of the TIFF expected, found none"),
        ("PixelResolution", "Rotation = 90\n    PixelResolution", "Rotation 90; 0 expected"),
        (
            "= 1737400.0 <meters>\n    PolarRadius = 1737400.0",
            "= -1.0 <meters>\n    PolarRadius = -1.0",
            "an EquatorialRadius above 0 expected, found -1 m",
        ),
        (
            "= 1737400.0 <meters>\n    PolarRadius = 1737400.0",
            "= 1e12 <meters>\n    PolarRadius = 1e12",
            "semi-axes of a body expected",
        ),
        ("Object = Core", "Object = Cure", "Object = Core expected, found none"),
        ("Group = Pixels", "Group = Pixel", "Group = Pixels expected"),
        ("PolarStereographic", "ObliqueCylindrical", "projection ObliqueCylindrical, centre latitude -90"),
        ("PolarRadius = 1737400.0", "PolarRadius = 1730000.0", "a sphere expected"),
        ("EquatorialRadius = 1737400.0 <meters>", "", "EquatorialRadius in MAPPING expected"),
        ("PixelResolution = 5.0 <meters/pixel>", "PixelResolution = 0 <meters/pixel>", "as PixelResolution expected"),
        ("PixelResolution = 5.0 <meters/pixel>", "PixelResolution = 5 <deg/pixel>", "found 5 <deg/pixel>"),
        ("UpperLeftCornerX = -1000.0", "UpperLeftCornerX = 1e999", "a number as UPPERLEFTCORNERX expected"),
        ("PositiveEast", "PositiveWest", "LongitudeDirection PositiveWest; PositiveEast expected"),
    ] {
        assert!(text.contains(from), "{from}");
        let mut bytes = text.replacen(from, to, 1).into_bytes();
        bytes.resize(2048, 0);
        bytes.extend(&good[2048..]);
        let found = opened(&bytes).err().unwrap_or_else(|| panic!("{to:?} is read")).to_string();
        assert!(found.contains("a.cub") && found.contains(what) && !found.contains('\n'), "{to}: {found}");
    }
}

#[test]
fn damaged_cubes_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.cub");
    let seeds = [
        cube("Format = Tile TileSamples = 3 TileLines = 2", "UnsignedWord", "Lsb", &[7; 108]),
        cube("Format = BandSequential", "Real", "Msb", &[63; 140]),
    ];
    let pieces = ["0", "9", "99999999999", "-1", "1e308", "\n", "End_Group\n", "Tile", "^Core = a.cub\n", "<km>", "\0"];
    let mut rng = ChaCha8Rng::seed_from_u64(48);
    let (mut read, mut refused) = (0, 0);
    for round in 0..2000 {
        let mut bytes = seeds[round % 2].clone();
        mutate(&mut bytes, &pieces, &mut rng);
        std::fs::write(&path, &bytes).unwrap();
        match open(&path).and_then(|source| read_all(&*source)) {
            Ok(raster) => {
                assert!(raster.samples.len() == raster.rows * raster.cols && raster.samples.len() <= bytes.len());
                read += 1;
            }
            Err(error) => {
                assert!(!error.to_string().contains('\n'), "{error}");
                refused += 1;
            }
        }
    }
    assert!(read > 200 && refused > 200, "{read} read, {refused} refused");
}

/// Writes `a.tif`, 40 x 30 pixels, on a map, with one void pixel.
fn source(folder: &Path, kind: &str, srs: &str) -> Option<String> {
    let script = format!(
        "
a = (np.arange(1200).reshape(30, 40) % 200 + 5).astype('{kind}')
nodata = -3.4028226550889045e38 if '{kind}' == 'float32' else 3
a[7, 9] = nodata
with rasterio.open('a.tif', 'w', driver='GTiff', width=40, height=30, count=1, dtype='{kind}', crs='{srs}',
                   transform=Affine(5, 0, -1000, 0, -5, 2000), nodata=nodata) as d: d.write(a, 1)
"
    );
    elunar_testing::rasterio(&script, folder)
}

#[test]
fn cubes_of_gdal_agree() {
    let equirectangular = "+proj=eqc +lat_ts=20 +lon_0=180 +R=1737400";
    let mut names = vec![];
    let folder = tempfile::tempdir().unwrap();
    for (name, kind, srs, options) in [
        ("rows", "float32", equirectangular, &[][..]),
        ("tiles", "float32", equirectangular, &["TILED=YES", "BLOCKXSIZE=16", "BLOCKYSIZE=8"]),
        ("bytes", "uint8", "+proj=stere +lat_0=-90 +lon_0=30 +R=1737400", &["TILED=YES"]),
        ("words", "int16", "+proj=sinu +lon_0=10 +R=1737400", &[]),
        ("unsigned", "uint16", "+proj=ortho +lat_0=20 +lon_0=10 +R=1737400", &["TILED=YES", "BLOCKXSIZE=32"]),
        ("mercator", "float32", "+proj=tmerc +lat_0=10 +lon_0=10 +R=1737400", &[]),
        ("lambert", "float32", "+proj=lcc +lat_1=20 +lat_2=60 +lat_0=40 +lon_0=10 +R=1737400", &[]),
        ("detached", "float32", equirectangular, &["DATA_LOCATION=EXTERNAL"]),
        ("tiff", "float32", equirectangular, &["DATA_LOCATION=GEOTIFF"]),
    ] {
        if source(folder.path(), kind, srs).is_none() {
            return;
        }
        let Some(mut command) = oracle::gdal("gdal_translate") else { return };
        let end = if ["detached", "tiff"].contains(&name) { "lbl" } else { "cub" };
        let name = format!("{name}.{end}");
        command.args(["-q", "-of", "ISIS3", "a.tif", &name]).current_dir(folder.path());
        command.args(options.iter().flat_map(|option| ["-co", option]));
        assert!(command.output().unwrap().status.success(), "{name}");
        names.push(name);
    }
    assert!(agrees(folder.path(), &names, |_| 1.0));
}

#[test]
fn a_real_cube_agrees() {
    let Some(shared) = elunar_testing::shared_folder() else { return };
    let source = open(&shared.join("data/readers/pattern.cub")).unwrap();
    let raster = read_all(&*source).unwrap();
    assert_eq!((raster.rows, raster.cols, raster.valid_count()), (90, 90, 8100));
    assert_eq!(source.info().format, "ISIS cube, f32 little-endian, tiles of 128 x 128");
    let script = format!(
        "rasterio.open({:?}).read(1).tofile('raw')",
        shared.join("data/readers/pattern.cub").canonicalize().unwrap()
    );
    let folder = tempfile::tempdir().unwrap();
    if elunar_testing::rasterio(&script, folder.path()).is_some() {
        let raw = std::fs::read(folder.path().join("raw")).unwrap();
        assert!(raster.samples.iter().zip(raw.as_chunks::<4>().0).all(|(a, b)| *a == f32::from_le_bytes(*b)));
    }
}
