//! Images described by labels.

use super::super::label_beside;
use super::{EQUIRECTANGULAR, POLAR, attached, opened, refused, shared, sldem_label};
use crate::source::{open, open_with, read_all};
use crate::{Crs, Projection, heights};
use elunar_core::sun::Body;
use elunar_core::tile::Window;

const I16: &str = "SAMPLE_TYPE = LSB_INTEGER SAMPLE_BITS = 16 CORE_NULL = -32768";

fn le(samples: &[f32]) -> Vec<u8> {
    samples.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn le16(samples: &[i16]) -> Vec<u8> {
    samples.iter().flat_map(|v| v.to_le_bytes()).collect()
}

#[test]
fn sldem_heights_are_metres_above_the_sphere() {
    let folder = tempfile::tempdir().unwrap();
    let samples = le(&[-1.5, 0.25, f32::from_bits(0xFF7F_FFFB), 10.5, 0.0, f32::NAN]);
    let label = sldem_label("SLDEM2015_512_00N_30N_000_045_FLOAT", 2, 3);
    let name = "SLDEM2015_512_00N_30N_000_045_FLOAT";
    let (lbl, img) = (format!("{name}.LBL"), format!("{}.img", name.to_lowercase()));
    let source = opened(folder.path(), &[(&lbl, label.as_bytes()), (&img, &samples)]).unwrap();
    let raster = read_all(&*source).unwrap();
    assert_eq!(raster.samples.iter().filter(|v| v.is_nan()).count(), 2);
    assert_eq!(
        [raster.samples[0], raster.samples[1], raster.samples[3], raster.samples[4]],
        [-1500.0, 250.0, 10_500.0, 0.0]
    );
    assert_eq!(source.info().unit.as_deref(), Some("m"));
    assert_eq!(source.info().format, "PDS3, f32 little-endian, detached label");
    let georef = raster.georef.unwrap();
    assert!(georef.crs.same_as(&Crs::equirectangular(Body::Moon.radius_m(), 0.0, 180.0)));
    // The upper left corner is 30 degrees north at longitude 0.
    let (lon_deg, lat_deg) = Projection::of(&georef.crs).unwrap().inverse(georef.transform[0], georef.transform[3]);
    assert!((lat_deg - 30.0).abs() < 1e-6 && lon_deg.abs() < 1e-6, "{lon_deg} {lat_deg}");
    // The image file leads to its label, in any case of either name.
    let same = open(&folder.path().join(&img)).unwrap();
    assert_eq!(same.info(), source.info());
}

#[test]
fn every_sample_type_in_both_orders() {
    let folder = tempfile::tempdir().unwrap();
    let types: [(&str, usize, &[u8], [f32; 2]); 18] = [
        ("MSB_INTEGER", 8, &[1, 255], [1.0, 255.0]),
        ("LSB_UNSIGNED_INTEGER", 8, &[1, 255], [1.0, 255.0]),
        ("MSB_INTEGER", 16, &[0, 1, 0xFF, 0xFE], [1.0, -2.0]),
        ("INTEGER", 16, &[0, 1, 0xFF, 0xFE], [1.0, -2.0]),
        ("SUN_INTEGER", 16, &[0, 1, 0xFF, 0xFE], [1.0, -2.0]),
        ("LSB_INTEGER", 16, &[1, 0, 0xFE, 0xFF], [1.0, -2.0]),
        ("PC_INTEGER", 16, &[1, 0, 0xFE, 0xFF], [1.0, -2.0]),
        ("VAX_INTEGER", 16, &[1, 0, 0xFE, 0xFF], [1.0, -2.0]),
        ("MSB_UNSIGNED_INTEGER", 16, &[0, 1, 0xFF, 0xFE], [1.0, 65534.0]),
        ("LSB_UNSIGNED_INTEGER", 16, &[1, 0, 0xFE, 0xFF], [1.0, 65534.0]),
        ("UNSIGNED_INTEGER", 32, &[0, 0, 0, 1, 0x80, 0, 0, 0], [1.0, 2_147_483_648.0]),
        ("LSB_UNSIGNED_INTEGER", 32, &[1, 0, 0, 0, 0, 0, 0, 0x80], [1.0, 2_147_483_648.0]),
        ("MSB_INTEGER", 32, &[0, 0, 0, 1, 0xFF, 0xFF, 0xFF, 0xFE], [1.0, -2.0]),
        ("LSB_INTEGER", 32, &[1, 0, 0, 0, 0xFE, 0xFF, 0xFF, 0xFF], [1.0, -2.0]),
        ("IEEE_REAL", 32, &[0x3F, 0x80, 0, 0, 0xC0, 0, 0, 0], [1.0, -2.0]),
        ("PC_REAL", 32, &[0, 0, 0x80, 0x3F, 0, 0, 0, 0xC0], [1.0, -2.0]),
        ("IEEE_REAL", 64, &[0x3F, 0xF0, 0, 0, 0, 0, 0, 0, 0xC0, 0, 0, 0, 0, 0, 0, 0], [1.0, -2.0]),
        ("\"PC_REAL\"", 64, &[0, 0, 0, 0, 0, 0, 0xF0, 0x3F, 0, 0, 0, 0, 0, 0, 0, 0xC0], [1.0, -2.0]),
    ];
    for (name, bits, bytes, expected) in types {
        let image = format!("SAMPLE_TYPE = {name} SAMPLE_BITS = {bits}");
        let file = [attached(1, 2, &image, "", bits / 8), bytes.to_vec()].concat();
        let source = opened(folder.path(), &[("a.img", &file)]).unwrap();
        assert_eq!(read_all(&*source).unwrap().samples, expected, "{name} {bits}");
    }
    for (name, bits) in [("VAX_REAL", 32), ("IEEE_REAL", 16), ("MSB_INTEGER", 64), ("CHARACTER", 8)] {
        let image = format!("SAMPLE_TYPE = {name} SAMPLE_BITS = {bits}");
        let text = refused(&[("a.img", &[attached(1, 2, &image, "", bits / 8), vec![0; 16]].concat())]);
        assert!(text.contains(&format!("samples {name} of {bits} bits")), "{text}");
    }
}

#[test]
fn windows_skip_prefixes_and_suffixes() {
    let folder = tempfile::tempdir().unwrap();
    let label = "PDS_VERSION_ID = PDS3\n^IMAGE = (\"A.DAT\", 6 <BYTES>)\nOBJECT = IMAGE\nLINES = 3\nLINE_SAMPLES = 4\nSAMPLE_TYPE = MSB_UNSIGNED_INTEGER\n\
                 SAMPLE_BITS = 8\nLINE_PREFIX_BYTES = 2\nLINE_SUFFIX_BYTES = 1\nSCALING_FACTOR = 0.5\nOFFSET = 10\nMISSING_CONSTANT = 21\nEND_OBJECT\nEND";
    let mut data = vec![99; 5];
    for row in 0..3u8 {
        data.extend([88, 88, 10 * row, 10 * row + 1, 10 * row + 2, 10 * row + 3, 77]);
    }
    let source = opened(folder.path(), &[("A.LBL", label.as_bytes()), ("A.DAT", &data)]).unwrap();
    let window = source.read(Window { row: 1, col: 1, rows: 2, cols: 3 }).unwrap();
    assert_eq!(window[..3], [15.5, 16.0, 16.5]);
    assert!(window[3].is_nan() && window[4..] == [21.0, 21.5]);
    assert!(source.read(Window { row: 1, col: 1, rows: 3, cols: 3 }).is_err());
    assert!(source.read(Window { row: 3, col: 0, rows: 0, cols: 4 }).unwrap().is_empty());
}

#[test]
fn pointers_of_every_form() {
    let folder = tempfile::tempdir().unwrap();
    let data: Vec<u8> = (0..12).collect();
    let label = |pointer: &str| {
        format!(
            "PDS_VERSION_ID = PDS3\nRECORD_BYTES = 4\n^IMAGE = {pointer}\n^OTHER_TABLE = (\"A.DAT\", 3)\nOBJECT = IMAGE\nLINES = 2\n\
                 LINE_SAMPLES = 2\nSAMPLE_TYPE = INTEGER\nSAMPLE_BITS = 8\nEND_OBJECT\nEND\n"
        )
    };
    for (pointer, first) in [
        ("\"A.DAT\"", 0.0),
        ("(\"A.DAT\", 2)", 4.0),
        ("(\"A.DAT\", 2 <records>)", 4.0),
        ("(\"a.dat\", 4 <BYTES>)", 3.0),
        ("(\"a.dat\", 5 <BYTE>)", 4.0),
        ("(\"A.DAT\")", 0.0),
    ] {
        let text = label(pointer);
        let source = opened(folder.path(), &[("A.LBL", text.as_bytes()), ("A.DAT", &data)]).unwrap();
        assert_eq!(read_all(&*source).unwrap().samples[0], first, "{pointer}");
    }
    // The name beside the pointer, and back from the image to the label.
    let inside = label("2")
        .replace("^IMAGE", "OBJECT = FILE\nFILE_NAME = \"A.DAT\"\n^IMAGE")
        .replace("END\n", "END_OBJECT = FILE\nEND\n");
    let source = opened(folder.path(), &[("A.LBL", inside.as_bytes()), ("A.DAT", &data)]).unwrap();
    assert_eq!(read_all(&*source).unwrap().samples[0], 4.0);
    assert_eq!(open(&folder.path().join("A.DAT")).unwrap().info(), source.info());
    // Attached, counted in bytes.
    let text = format!("{:300}", label("301 <BYTES>"));
    let file = [text.as_bytes(), &[7, 8, 9, 10]].concat();
    assert_eq!(read_all(&*opened(folder.path(), &[("B.IMG", &file)]).unwrap()).unwrap().samples, [7.0, 8.0, 9.0, 10.0]);
    let cases = [
        ("(\"A.DAT\", 0)", "from record or byte 1 on"),
        ("(\"A.DAT\", 2 <KM>)", "found <KM>"),
        ("(\"NONE.DAT\", 2)", "no such file beside the label"),
        ("\"../A.DAT\"", "a file beside the label expected"),
        ("(1, 2, 3)", "as \"FILE\", n or"),
        ("(1, 2)", "as \"FILE\", n or"),
        ("(\"A.DAT\", TWO)", "from record or byte 1 on expected, found Symbol(\"TWO\")"),
        ("1", "found the label itself"),
        ("(\"A.DAT\", 170141183460469231731687303715884105727)", "from record or byte 1 on"),
        ("(\"A.DAT\", 18446744073709551615)", "within 2^64"),
        ("(\"A.DAT\", 5)", "found 12 bytes where 20 are needed"),
    ];
    for (pointer, reason) in cases {
        let text = refused(&[("A.LBL", label(pointer).as_bytes()), ("A.DAT", &data)]);
        assert!(text.contains(reason), "{text}");
    }
}

#[test]
fn files_and_labels_that_disagree_are_refused() {
    let file = |rows: usize| [attached(4, 5, I16, "", 2), vec![1; rows * 10]].concat();
    assert!(opened(tempfile::tempdir().unwrap().path(), &[("a.img", &file(4))]).is_ok());
    assert!(refused(&[("a.img", &file(3))]).contains("4 lines of 5 i16 samples from byte"));
    assert!(refused(&[("a.img", &file(5))]).contains("10 bytes more than that, with no pointer to them"));
    let huge = attached(4_000_000_000, 5, I16, "", 2);
    assert!(refused(&[("a.img", &huge)]).contains("are needed"));
    let endless =
        attached(4, 5, "SAMPLE_TYPE = PC_REAL SAMPLE_BITS = 64 LINE_PREFIX_BYTES = 18446744073709551615", "", 2);
    assert!(refused(&[("a.img", &endless)]).contains("less than 2^64 bytes"));
    let beyond = attached(1 << 62, 5, I16, "", 2);
    assert!(refused(&[("a.img", &beyond)]).contains(&format!("found {} bytes", beyond.len())));
    let none = attached(0, 5, I16, "", 2);
    assert!(refused(&[("a.img", &none)]).contains("at least one sample"));
    let bands = [attached(4, 5, &format!("{I16} BANDS = 3"), "", 2), vec![0; 120]].concat();
    assert!(refused(&[("a.img", &bands)]).contains("BANDS"), "stated twice");
    let label =
        String::from_utf8(attached(4, 5, I16, "", 2)).unwrap().replace("BANDS                      = 1", "BANDS = 3");
    assert!(
        refused(&[("a.img", label.as_bytes())])
            .contains("3 bands found, one expected; take one out: gdal_translate -b 1")
    );
    let nothing = attached(4, 5, &format!("{I16} SCALING_FACTOR = 0"), "", 2);
    assert!(refused(&[("a.img", &nothing)]).contains("SCALING_FACTOR other than 0"));
    let packed = attached(4, 5, &format!("{I16} ENCODING_TYPE = HUFFMAN"), "", 2);
    assert!(refused(&[("a.img", &packed)]).contains("packed as HUFFMAN"));
    assert!(refused(&[("a.lbl", b"PDS_VERSION_ID = PDS3\n^TABLE = \"a.tab\"\nEND")]).contains("found ^TABLE"));
    let only = sldem_label("A", 1, 1)
        .replace("UNCOMPRESSED_FILE", "OTHER")
        .replace("^IMAGE                    = \"A.IMG\"", "");
    assert!(refused(&[("a.lbl", only.as_bytes())]).contains("gdal_translate -of GTiff FILE.JP2"));
    assert!(refused(&[("a.lbl", b"PDS_VERSION_ID = PDS3\nA = ;\nEND")]).contains("line 2: a value of A expected"));
}

#[test]
fn projections_become_places() {
    let folder = tempfile::tempdir().unwrap();
    let place = |projection: &str| {
        let file = [attached(4, 5, I16, projection, 2), vec![0; 40]].concat();
        opened(folder.path(), &[("a.img", &file)]).unwrap().info().georef.clone().unwrap()
    };
    let georef = place(EQUIRECTANGULAR);
    assert!(georef.crs.same_as(&Crs::equirectangular(Body::Moon.radius_m(), 20.0, 180.0)));
    let expected = [-4_276_880.0, 5.0, 0.0, 645_990.0, 0.0, -5.0];
    assert!(georef.transform.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{georef:?}");
    let georef = place(POLAR);
    assert_eq!(georef.transform, [500.0, 5.0, 0.0, 2000.0, 0.0, -5.0]);
    let projection = Projection::of(&georef.crs).unwrap();
    // The meridian of the centre points upwards around the south pole.
    let (x, y) = projection.forward(30.0, -89.9);
    assert!(x.abs() < 1e-6 && y > 3000.0, "{x} {y}");
    let mars = EQUIRECTANGULAR
        .replace("1737.4", "3396.19")
        .replace("6064.67008483", "11854.96")
        .replace("21.30330227", "10.8983");
    assert_eq!(place(&mars).crs.sphere_radius_m(), Some(3_396_190.0));
    let by_resolution = POLAR.replace("MAP_SCALE                      = 0.005 <KM/PIXEL>", "MAP_RESOLUTION = 512");
    assert!((place(&by_resolution).transform[1] - 59.225_293_8).abs() < 1e-6);
}

#[test]
fn places_that_are_not_understood_are_refused() {
    let cases = [
        ("MAP_PROJECTION_TYPE          = EQUIRECTANGULAR", "MAP_PROJECTION_TYPE = SINUSOIDAL", "projection SINUSOIDAL"),
        ("20.0 <DEG>", "90 <DEG>", "projection EQUIRECTANGULAR, centre latitude 90"),
        ("LONGITUDE_DIRECTION = EAST", "LONGITUDE_DIRECTION = WEST", "positive to the WEST"),
        ("ROTATION        = 0.0", "ROTATION = 90.0", "ROTATION 90"),
        ("<METERS/PIXEL>", "<DEGREES/PIXEL>", "found <DEGREES/PIXEL>"),
        ("<METERS/PIXEL>", "<KM/PIXEL>", "MAP_SCALE and MAP_RESOLUTION of one size"),
        ("129197.5", "-129197.5", "MAXIMUM_LATITUDE 21.30330227 and LINE_PROJECTION_OFFSET to agree"),
        ("C_AXIS_RADIUS                = 1737.4", "C_AXIS_RADIUS = 1735.0", "a sphere of 1737400 m expected"),
        ("A_AXIS_RADIUS                = 1737.4 <KM>", "", "A_AXIS_RADIUS of the map projection expected"),
        ("A_AXIS_RADIUS                = 1737.4", "A_AXIS_RADIUS = -1", "a radius above 0"),
        ("855375.5", "'N/A'", "SAMPLE_PROJECTION_OFFSET of the map projection expected, found none"),
        ("855375.5", "(1, 2)", "a number as SAMPLE_PROJECTION_OFFSET expected"),
    ];
    for (from, to, reason) in cases {
        assert!(EQUIRECTANGULAR.contains(from), "{from}");
        let file = [attached(4, 5, I16, &EQUIRECTANGULAR.replace(from, to), 2), vec![0; 40]].concat();
        let text = refused(&[("a.img", &file)]);
        assert!(text.contains(reason), "{text}");
    }
    // Labels of a scale alone, and of neither.
    for (to, reason) in [
        ("MAP_SCALE = 0 <KM/PIXEL>", "a MAP_SCALE above 0 expected, found 0 m per pixel"),
        ("MAP_SCALE = -1 <KM/PIXEL>", "a MAP_SCALE above 0 expected, found -1000 m per pixel"),
        ("MAP_RESOLUTION = 0", "a MAP_SCALE above 0 expected, found inf m per pixel"),
        ("", "MAP_SCALE or MAP_RESOLUTION expected, found neither"),
    ] {
        let polar = POLAR.replace("MAP_SCALE                      = 0.005 <KM/PIXEL>", to);
        let text = refused(&[("a.img", &[attached(4, 5, I16, &polar, 2), vec![0; 40]].concat())]);
        assert!(text.contains(reason), "{text}");
    }
}

#[test]
fn offsets_that_are_radii_are_never_added() {
    let folder = tempfile::tempdir().unwrap();
    let height = |image: &str, projection: &str| {
        let image = format!("SAMPLE_TYPE = LSB_INTEGER SAMPLE_BITS = 16 {image}");
        let file = [attached(1, 2, &image, projection, 2), vec![100, 0, 0, 0]].concat();
        let source = opened(folder.path(), &[("a.img", &file)]).unwrap();
        (source.read(Window { row: 0, col: 0, rows: 1, cols: 1 }).unwrap()[0], source.info().unit.clone())
    };
    let metres = || Some("m".to_owned());
    assert_eq!(height("UNIT = METER SCALING_FACTOR = 0.5 OFFSET = 1737400.", ""), (50.0, metres()));
    assert_eq!(height("SCALING_FACTOR = 0.001 OFFSET = 1737.4", ""), (100.0, metres()));
    assert_eq!(height("UNIT = KILOMETER OFFSET = 2", ""), (102_000.0, metres()));
    assert_eq!(height("UNIT = \"m\" OFFSET = 2", ""), (102.0, metres()));
    assert_eq!(height("UNIT = \"RAW_INSTRUMENT_COUNT\"", ""), (100.0, Some("RAW_INSTRUMENT_COUNT".into())));
    assert_eq!(height("UNIT = 'N/A' OFFSET = 2", ""), (102.0, None));
    // Units of the keywords themselves.
    assert_eq!(height("UNIT = METER OFFSET = 2 <KM>", ""), (2100.0, metres()));
    assert_eq!(height("UNIT = METER SCALING_FACTOR = 0.5 OFFSET = 1737.4 <KM>", ""), (50.0, metres()));
    assert_eq!(height("SCALING_FACTOR = 0.0005 <KM/DN>", ""), (50.0, metres()));
    assert_eq!(height("SCALING_FACTOR = 0.01 <KM> OFFSET = 5 <M>", ""), (1005.0, metres()));
    assert_eq!(height("OFFSET = 1737400 <m>", ""), (100.0, metres()));
    assert_eq!(height("SCALING_FACTOR = 2 <W/M**2/SR/DN>", ""), (200.0, None), "no length");
    assert_eq!(height("UNIT = WATT SCALING_FACTOR = 2 <KM>", ""), (200.0, Some("WATT".into())));
    let mars = POLAR.replace("1737.4", "3396.19");
    assert_eq!(height("UNIT = METER OFFSET = 3396190", &mars), (100.0, metres()));
    assert_eq!(height("UNIT = METER OFFSET = 1737400", &mars), (1_737_500.0, metres()));
}

#[test]
fn constants_that_mean_nothing_was_measured() {
    let folder = tempfile::tempdir().unwrap();
    let read = |image: &str, samples: &[u8], bytes: usize| {
        let file = [attached(1, samples.len() / bytes, image, "", bytes), samples.to_vec()].concat();
        read_all(&*opened(folder.path(), &[("a.img", &file)]).unwrap()).unwrap().samples
    };
    let gaps = |samples: Vec<f32>| samples.iter().map(|v| v.is_nan()).collect::<Vec<_>>();
    let reals = le(&[f32::from_bits(0xFF7F_FFFA), -1e32, 5.0, -9999.0]);
    let real = "SAMPLE_TYPE = PC_REAL SAMPLE_BITS = 32";
    assert_eq!(gaps(read(real, &reals, 4)), [true, true, false, false]);
    assert_eq!(gaps(read(&format!("{real} MISSING_CONSTANT = -9999"), &reals, 4)), [true, true, false, true]);
    assert_eq!(gaps(read(&format!("{real} CORE_NULL = 16#40A00000#"), &reals, 4)), [true, true, true, false]);
    assert_eq!(
        gaps(read(&format!("{real} MISSING_CONSTANT = (\"16#40A00000#\", -9999.0)"), &reals, 4)),
        [true, true, true, true]
    );
    let bytes = "SAMPLE_TYPE = LSB_INTEGER SAMPLE_BITS = 8 CORE_HIGH_REPR_SATURATION = 255 MISSING = 0";
    assert_eq!(gaps(read(bytes, &[0, 1, 254, 255], 1)), [true, false, false, true]);
    // Keywords that are no constants of that kind.
    let others = "SAMPLE_TYPE = LSB_INTEGER SAMPLE_BITS = 8 CORE_BASE = 1 BAND_SATURATION = 254";
    assert_eq!(gaps(read(others, &[0, 1, 254, 255], 1)), [false; 4]);
    let shorts: Vec<u8> = [-32768i16, -32764, -32763, 0].iter().flat_map(|v| v.to_le_bytes()).collect();
    assert_eq!(gaps(read("SAMPLE_TYPE = LSB_INTEGER SAMPLE_BITS = 16", &shorts, 2)), [true, true, false, false]);
    let text = refused(&[("a.img", &attached(1, 2, &format!("{real} MISSING_CONSTANT = \"x\""), "", 4))]);
    assert!(text.contains("a number as MISSING_CONSTANT"), "{text}");
}

#[test]
fn a_users_nodata_value_and_the_sun_of_a_label() {
    let folder = tempfile::tempdir().unwrap();
    let real =
        "SAMPLE_TYPE = PC_REAL SAMPLE_BITS = 32 SCALING_FACTOR = 2 SUB_SOLAR_AZIMUTH = 200 INCIDENCE_ANGLE = 60 <DEG>";
    for (projection, azimuth_deg) in [("", Some(290.0)), (EQUIRECTANGULAR, None)] {
        let file = [attached(1, 3, real, projection, 4), le(&[5.0, -9999.0, 0.1])].concat();
        let source = opened(folder.path(), &[("a.img", &file)]).unwrap();
        let sun = source.info().sun;
        assert_eq!((sun.azimuth_deg, sun.elevation_deg), (azimuth_deg, Some(30.0)), "{projection}");
        for (nodata, void) in [(-9999.0, 1), (0.1, 2)] {
            let samples = read_all(&*open_with(&folder.path().join("a.img"), Some(nodata)).unwrap()).unwrap().samples;
            let voids: Vec<usize> = (0..3).filter(|&i| samples[i].is_nan()).collect();
            assert!(voids == [void] && samples[0] == 10.0, "{samples:?}");
        }
    }
}

#[test]
fn samples_that_were_unpacked_and_lists_of_invalid_values() {
    let folder = tempfile::tempdir().unwrap();
    let samples = le16(&[-20000, -21000, 100, -22000]);
    let open = |image: &str| {
        let file = attached(1, 4, &format!("{I16} SCALING_FACTOR = 0.5 {image}"), "", 2);
        opened(folder.path(), &[("a.img", &[file, samples.clone()].concat())])
    };
    let valid = |image: &str| read_all(&*open(image).unwrap()).unwrap().samples.iter().filter(|v| !v.is_nan()).count();
    for packing in ["\"DCT_DECOMPRESSED\"", "'N/A'", "N/A"] {
        assert_eq!(valid(&format!("ENCODING_TYPE = {packing}")), 4, "{packing}");
    }
    assert!(open("ENCODING_TYPE = DCT").err().unwrap().to_string().contains("packed as DCT; plain samples"));
    assert_eq!(valid("INVALID_VALUE = (-20000, -21000, -22000, -23000)"), 1);
    assert_eq!(valid("INVALID_VALUE = {-20000, \"N/A\"}"), 3);
    assert_eq!(valid("INVALID_VALUE = -21000"), 3);
    assert_eq!(valid("INVALID_VALUE = \"N/A\""), 4);
    assert!(open("INVALID_VALUE = (A, 1)").err().unwrap().to_string().contains("a number as INVALID_VALUE expected"));
}

#[test]
fn keywords_without_a_value_are_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let file = attached(1, 2, &format!("{I16}\nUNIT =\nSCALING_FACTOR =\nOFFSET ="), "", 2);
    let line = String::from_utf8_lossy(&file).lines().position(|line| line.starts_with("UNIT")).unwrap() + 1;
    let source = opened(folder.path(), &[("a.img", &[file, le16(&[3, 4])].concat())]).unwrap();
    assert_eq!(read_all(&*source).unwrap().samples, [3.0, 4.0]);
    let names = format!("UNIT (line {line}), SCALING_FACTOR (line {}), OFFSET (line {})", line + 1, line + 2);
    assert_eq!(source.info().warnings, [format!("keywords without a value, read as empty: {names}")]);
    let file = attached(1, 2, &format!("{I16}\nA =\nB =\nC =\nD =\nE =\nF =\nG ="), "", 2);
    let source = opened(folder.path(), &[("b.img", &[file, le16(&[3, 4])].concat())]).unwrap();
    assert!(source.info().warnings[0].ends_with("), 2 more"), "{:?}", source.info().warnings);
    // What is needed is missed.
    let text = refused(&[("a.img", &attached(1, 2, "SAMPLE_BITS = 16\nSAMPLE_TYPE =", "", 2))]);
    assert!(text.contains("SAMPLE_TYPE of the IMAGE expected, found none"), "{text}");
}

#[test]
fn units_of_length_become_metres() {
    let folder = tempfile::tempdir().unwrap();
    let height = |unit: &str| {
        let file = [attached(1, 1, &format!("{I16} UNIT = {unit}"), "", 2), le16(&[1000])].concat();
        std::fs::write(folder.path().join("a.img"), file).unwrap();
        let source = heights::open(&folder.path().join("a.img")).map_err(|e| e.to_string())?;
        Ok::<_, String>((read_all(&*source).unwrap().samples[0], source.info().unit_in_file.clone().unwrap()))
    };
    let cases =
        [("FEET", 304.8), ("\"US_SURVEY_FOOT\"", 304.800_6), ("CENTIMETERS", 10.0), ("KM", 1e6), ("'meters'", 1000.0)];
    for (unit, metres) in cases {
        assert_eq!(height(unit), Ok((metres, unit.trim_matches(['"', '\'']).into())), "{unit}");
    }
    for unit in ["DEGREES", "\"W/m2/micron/sr\""] {
        assert!(height(unit).unwrap_err().contains("US survey foot expected, found"), "{unit}");
    }
}

#[test]
fn reported_labels_are_read() {
    let Some(folder) = elunar_testing::shared_folder() else { return };
    let [label, feet] =
        ["bugs/15_kaguya_labels/DECOMPRESSED.LBL", "user/LDEM_4_FEET.LBL"].map(|name| folder.join("files").join(name));
    if !label.exists() || !feet.exists() {
        return elunar_testing::skipped("reported_labels_are_read", "no files beside the reference data");
    }
    let raster = read_all(&*open(&label).unwrap()).unwrap();
    assert_eq!((raster.rows, raster.cols, raster.valid_count(), raster.range()), (50, 70, 3500, Some((6.5, 115.908))));
    let scratch = tempfile::tempdir().unwrap();
    std::fs::copy(&feet, scratch.path().join("a.lbl")).unwrap();
    std::fs::copy(folder.join("data/readers/LDEM_4.IMG"), scratch.path().join("LDEM_4.IMG")).unwrap();
    let lowest_ft = heights::read(&scratch.path().join("a.lbl")).unwrap().range().unwrap().0 / 0.3048;
    assert!((-9_500.0..-8_000.0).contains(&lowest_ft), "{lowest_ft}");
}

#[test]
fn real_image_files() {
    let Some(folder) = shared("readers") else { return };
    for (name, step) in [("pds3_1band.IMG", 1.0), ("pds3_1band_float.IMG", 1.5)] {
        let raster = read_all(&*open(&folder.join(name)).unwrap()).unwrap();
        assert_eq!((raster.rows, raster.cols), (10, 10));
        assert!(raster.samples.iter().enumerate().all(|(i, v)| *v == i as f32 * step), "{name}");
    }
    let labels = shared("pds3_labels").unwrap();
    let text = open(&labels.join("LDEM_4.LBL")).err().unwrap().to_string();
    assert!(text.contains("^IMAGE names LDEM_4.IMG, no such file beside the label"), "{text}");
    let text = open(&labels.join("NAC_DTM_A12LMAS_VALID.xml")).err().unwrap().to_string();
    assert!(text.contains("Array_3D in a File_Area_Observational expected, found none"), "{text}");
}

#[test]
fn an_image_of_a_few_bytes_is_no_tiff_and_a_folder_has_no_label() {
    let folder = tempfile::tempdir().unwrap();
    let label = "PDS_VERSION_ID = PDS3\n^IMAGE = \"A.DAT\"\nOBJECT = IMAGE\nLINES = 1\nLINE_SAMPLES = 2\n\
                 SAMPLE_TYPE = INTEGER\nSAMPLE_BITS = 8\nEND_OBJECT\nEND\n";
    let source = opened(folder.path(), &[("A.LBL", label.as_bytes()), ("A.DAT", b"II")]).unwrap();
    assert_eq!(read_all(&*source).unwrap().samples, [73.0, 73.0]);
    assert_eq!(label_beside(&folder.path().join("A.DAT")).unwrap(), Some(folder.path().join("A.LBL")));
    assert_eq!(label_beside(&folder.path().join("..")).unwrap(), None);
}
