//! Labels that GDAL writes, and labels by hand; broken ones are refused with the element's name and line.

use crate::gdal_tests::agrees;
use crate::source::{Source, open, read_all};
use elunar_testing::{mutate, oracle};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::path::Path;

const LABEL: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Product_Observational xmlns="http://pds.nasa.gov/pds4/pds/v1" xmlns:cart="http://pds.nasa.gov/pds4/cart/v1">
<Observation_Area><Time_Coordinates><start_date_time>2009-08-30T12:00:00.000Z</start_date_time></Time_Coordinates>
<Discipline_Area><vertical_display_direction>Top to Bottom</vertical_display_direction>
<cart:Cartography>
<cart:north_bounding_coordinate unit="deg">0.066</cart:north_bounding_coordinate>
<cart:Planar><cart:Map_Projection>
<cart:map_projection_name>Equirectangular</cart:map_projection_name><cart:Equirectangular>
<cart:standard_parallel_1 unit="deg">20</cart:standard_parallel_1>
<cart:longitude_of_central_meridian unit="deg">180</cart:longitude_of_central_meridian>
</cart:Equirectangular></cart:Map_Projection>
<cart:Planar_Coordinate_Information><cart:Coordinate_Representation>
<cart:pixel_resolution_x unit="m/pixel">5</cart:pixel_resolution_x>
<cart:pixel_resolution_y unit="km/pixel">0.005</cart:pixel_resolution_y>
</cart:Coordinate_Representation></cart:Planar_Coordinate_Information>
<cart:Geo_Transformation><cart:upperleft_corner_x unit="m">-1000</cart:upperleft_corner_x>
<cart:upperleft_corner_y unit="m">2000</cart:upperleft_corner_y></cart:Geo_Transformation></cart:Planar>
<cart:Geodetic_Model><cart:a_axis_radius unit="km">1737.4</cart:a_axis_radius>
<cart:c_axis_radius unit="m">1737400</cart:c_axis_radius>
<cart:longitude_direction>Positive East</cart:longitude_direction></cart:Geodetic_Model>
</cart:Cartography></Discipline_Area></Observation_Area>
<File_Area_Observational><File><file_name>A.DAT</file_name></File>
<Array_2D_Image><offset unit="byte">2</offset><axes>2</axes><axis_index_order>Last Index Fastest</axis_index_order>
<Element_Array><data_type>SignedMSB2</data_type><unit>km</unit><scaling_factor>0.5</scaling_factor></Element_Array>
<Axis_Array><axis_name>Line</axis_name><elements>5</elements><sequence_number>1</sequence_number></Axis_Array>
<Axis_Array><axis_name>Sample</axis_name><elements>7</elements><sequence_number>2</sequence_number></Axis_Array>
<Special_Constants><missing_constant>5</missing_constant><invalid_constant>0x0007</invalid_constant>
<valid_maximum>30</valid_maximum></Special_Constants>
</Array_2D_Image></File_Area_Observational></Product_Observational>
"#;

fn written(folder: &Path, label: &str) -> std::path::PathBuf {
    let samples: Vec<u8> = [0, 0].into_iter().chain((0..35).flat_map(i16::to_be_bytes)).collect();
    std::fs::write(folder.join("a.dat"), samples).unwrap();
    std::fs::write(folder.join("a.xml"), label).unwrap();
    folder.join("a.xml")
}

fn opened(label: &str) -> elunar_base::Result<(tempfile::TempDir, Box<dyn Source>)> {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), label);
    open(&path).map(|source| (folder, source))
}

#[test]
fn a_label_describes_samples_place_unit_and_time() {
    let (folder, source) = opened(LABEL).unwrap();
    let raster = read_all(&*source).unwrap();
    for (i, &found) in raster.samples.iter().enumerate() {
        let void = [5, 7].contains(&i);
        assert!(found == i as f32 * 500.0 && !void || found.is_nan() && void, "{i}: {found}");
    }
    let info = source.info();
    assert_eq!(info.format, "PDS4, i16 big-endian");
    assert_eq!((info.unit.as_deref(), info.unit_in_file.as_deref()), (Some("m"), Some("km")));
    assert_eq!(info.georef.as_ref().unwrap().transform, [-1000.0, 5.0, 0.0, 2000.0, 0.0, -5.0]);
    assert!(info.place("a").is_ok() && info.warnings.is_empty());
    assert_eq!(info.sun.time, "2009-08-30T12:00:00".parse().ok());
    let files = [folder.path().join("a.xml"), folder.path().join("a.dat")];
    assert_eq!(crate::content::files_of_raster(&files[0]).unwrap(), files);
    // One band is no axis, wherever it stands; without a map there is no place; a second array is named.
    let band = "<Axis_Array><axis_name>Band</axis_name><elements>1</elements><sequence_number>3</sequence_number></Axis_Array>";
    let from = LABEL.find("<cart:Cartography>").unwrap();
    let to = LABEL.find("</Discipline_Area>").unwrap();
    let bare = format!("{}{}", &LABEL[..from], &LABEL[to..]);
    let more = bare.replace("<Special", &format!("{band}<Special")).replace("2D_Image", "3D_Image");
    let more = more.replace("</File_Area", "<Array_2D><offset>0</offset></Array_2D></File_Area");
    let (_folder, source) = opened(&more).unwrap();
    assert_eq!(source.info().georef, None);
    assert_eq!(source.info().warnings, ["1 more arrays in the label; the first, Array_3D_Image, is read"]);
}

#[test]
fn broken_labels_are_refused_with_the_element() {
    let mut wrong = vec![];
    for (from, to, what) in [
        ("<elements>7", "<elements>0", "line 26: at least 1 as elements expected, found 0"),
        ("<elements>7", "<elements>many", "a number as elements expected, found \"many\""),
        ("<elements>7", "<elements>9223372036854775807", "more than 2^64 bytes in all, expected, found 72"),
        ("<elements>7", "<elements>8", "5 lines of 8 i16 samples from byte 2 on, 82 bytes in all, expected, found 72"),
        (
            "<elements>7",
            "<elements>18446744073709551615",
            "rows of less than 2^64 bytes expected, found 18446744073709551615",
        ),
        ("<elements>5", "<elements>9999999999999999", "found 72 bytes"),
        ("<sequence_number>2", "<sequence_number>1", "axes of sequence_number 1, 2, ... expected"),
        ("<axis_name>Sample", "<axis_name>Band", "7 bands found, one expected; take one out: gdal_translate -b 1"),
        ("<axis_name>Sample", "<axis_name>Time", "axes Line, Sample expected, found \"Line, Time\""),
        ("<axis_name>Line</axis_name>", "", "line 25: axis_name in Axis_Array expected, found none"),
        ("Last Index", "First Index", "axis_index_order First Index Fastest; Last Index Fastest expected"),
        ("SignedMSB2", "ComplexMSB8", "data_type \"ComplexMSB8\"; integers of 1, 2 and 4 bytes"),
        ("<data_type>SignedMSB2</data_type>", "", "data_type in Element_Array expected, found none"),
        ("<scaling_factor>0.5", "<scaling_factor>0", "a scaling_factor other than 0 expected"),
        ("<scaling_factor>0.5", "<scaling_factor>nan", "a finite number as scaling_factor expected, found NaN"),
        ("unit=\"byte\"", "unit=\"record\"", "offset in byte expected, found record"),
        ("<offset unit=\"byte\">2</offset>", "", "offset in Array_2D_Image expected"),
        (">2</offset>", ">18446744073709551615</offset>", "more than 2^64 bytes in all, expected"),
        ("<File><file_name>A.DAT</file_name></File>", "", "File in File_Area_Observational expected, found none"),
        ("A.DAT", "../a.dat", "a file beside the label expected, file_name names \"../a.dat\""),
        ("A.DAT", "b.dat", "file_name names b.dat, no such file beside the label"),
        ("Array_2D_Image", "Array_1D", "Array_2D_Image, Array_2D_Map, Array_2D, Array_3D_Image, Array_3D in a"),
        ("missing_constant>5", "missing_constant>none", "a number as missing_constant expected, found \"none\""),
        ("Top to Bottom", "Bottom to Top", "vertical_display_direction Bottom to Top; Top to Bottom expected; convert"),
        (">Equirectangular<", ">Gnomonic<", "line 7: projection Gnomonic, centre latitude 0"),
        ("cart:Planar>", "cart:Geographic>", "expected, found Geographic"),
        (">1737400<", ">1730000<", "c_axis_radius 1730000 m; a sphere of 1737400 m expected"),
        ("cart:Geodetic_Model>", "cart:Model>", "Geodetic_Model in Cartography expected, found none"),
        (">5</cart:pixel", ">0</cart:pixel", "pixel_resolution_x above 0 expected, found 0 m"),
        ("\"km/pixel\"", "\"deg/pixel\"", "pixel_resolution_y in metres or kilometres expected, found deg"),
        (">2000</cart", ">-2000</cart", "north_bounding_coordinate 0.066 and upperleft_corner_y to agree expected"),
        ("Positive East", "Positive West", "longitude_direction Positive West; Positive East expected"),
        ("Product_Observational", "Product_Observational_Odd", "Product_Observational as outermost element expected"),
        ("</Element_Array>", "", "XML expected, found: "),
        (
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>",
            "<?xml version=\"1.0\"?><!DOCTYPE a [<!ENTITY b \"c\">]>",
            "found: ",
        ),
    ] {
        assert!(LABEL.contains(from), "{from}");
        let found = opened(&LABEL.replace(from, to)).err().map_or_else(|| "it is read".into(), |e| e.to_string());
        if !(found.contains("a.xml") && found.contains(what) && !found.contains('\n')) {
            wrong.push(format!("{to}: {found}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    let deep = LABEL.replace("<Observation_Area>", &format!("<Observation_Area>{}", "<a>".repeat(100_000)));
    assert!(opened(&deep).err().unwrap().to_string().contains("XML expected"));
}

#[test]
fn radii_names_and_bits_have_their_range() {
    let radius = |metres: &str| {
        let label = LABEL.replace("unit=\"km\">1737.4<", &format!("unit=\"m\">{metres}<"));
        opened(&label.replace(">1737400<", &format!(">{metres}<"))).err().unwrap().to_string()
    };
    assert!(radius("0").contains("line 18: a radius above 0 expected, found 0 m"), "{}", radius("0"));
    assert!(radius("1e12").contains("line 7: semi-axes of a body expected"), "{}", radius("1e12"));
    // Misspelt in an edition of the dictionary; the map has no latitude to compare with.
    let (_folder, source) = opened(&LABEL.replace(">Equirectangular<", ">Orothographic<")).unwrap();
    let crs = source.info().georef.clone().unwrap().crs;
    assert!(crs.same_as(&crate::Crs::parse("+proj=ortho +lon_0=180 +R=1737400").unwrap()), "{}", crs.summary());
    // Without a bound and without special constants.
    let north = "<cart:north_bounding_coordinate unit=\"deg\">0.066</cart:north_bounding_coordinate>\n";
    let from = LABEL.find("<Special_Constants>").unwrap();
    let to = LABEL.find("</Array_2D_Image>").unwrap();
    let bare = format!("{}{}", &LABEL[..from], &LABEL[to..]).replace(north, "").replace(">2000<", ">-2000<");
    assert!(!bare.contains("north"));
    let (_folder, source) = opened(&bare).unwrap();
    assert_eq!(read_all(&*source).unwrap().valid_count(), 35);
    // The radii's names in older dictionaries.
    let old = LABEL.replace("a_axis", "semi_major").replace("c_axis", "polar");
    assert!(opened(&old).unwrap().1.info().place("a").is_ok());
    // Constants as bits, in every type.
    for (kind, samples, bits, void) in [
        ("IEEE754MSBSingle", 35.0_f32.to_be_bytes().to_vec(), "0x420C0000", true),
        ("IEEE754LSBDouble", 35.0_f64.to_le_bytes().to_vec(), "16#4041800000000000#", true),
        ("SignedByte", vec![0xFE], "0XFE", true),
        ("SignedByte", vec![0xFE], "0x1FE", false),
        ("SignedLSB4", (-2_i32).to_le_bytes().to_vec(), "0xFFFFFFFE", true),
        ("UnsignedLSB4", 7_u32.to_le_bytes().to_vec(), "0x7", true),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let label = LABEL
            .replace("SignedMSB2", kind)
            .replace("<elements>5", "<elements>1")
            .replace("<elements>7", "<elements>1");
        let path = written(
            folder.path(),
            &label.replace("0x0007", bits).replace("<missing_constant>5", "<missing_constant>6"),
        );
        std::fs::write(folder.path().join("a.dat"), [vec![0, 0], samples].concat()).unwrap();
        match open(&path).and_then(|source| read_all(&*source)) {
            Ok(raster) => assert!(void && raster.samples[0].is_nan(), "{kind}: {:?}", raster.samples),
            Err(error) => {
                assert!(!void && error.to_string().contains("a number as invalid_constant"), "{kind}: {error}")
            }
        }
    }
}

#[test]
fn damaged_labels_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let pieces =
        ["0", "-1", "99999999999", "<", ">", "</a>", "<a>", "&amp;", "&#0;", "1e308", "\"", "Band", "<!--", "\u{e9}"];
    let mut rng = ChaCha8Rng::seed_from_u64(48);
    let (mut read, mut refused) = (0, 0);
    for _ in 0..3000 {
        let mut bytes = LABEL.as_bytes().to_vec();
        mutate(&mut bytes, &pieces, &mut rng);
        let path = written(folder.path(), "");
        std::fs::write(&path, &bytes).unwrap();
        match open(&path).and_then(|source| read_all(&*source)) {
            Ok(raster) => {
                assert!(raster.samples.len() == raster.rows * raster.cols && raster.samples.len() <= 36);
                read += 1;
            }
            Err(error) => {
                assert!(!error.to_string().contains('\n'), "{error}");
                refused += 1;
            }
        }
    }
    assert!(read > 40 && refused > 200, "{read} read, {refused} refused");
}

#[test]
fn labels_of_gdal_agree() {
    let folder = tempfile::tempdir().unwrap();
    let equirectangular = "+proj=eqc +lat_ts=20 +lon_0=180 +R=1737400";
    let mut names = vec![];
    for (name, kind, srs, options) in [
        ("plain", "float32", equirectangular, &[][..]),
        ("bytes", "uint8", "+proj=stere +lat_0=-90 +lon_0=30 +R=1737400", &[]),
        ("words", "int16", "+proj=sinu +lon_0=10 +R=1737400", &["ARRAY_TYPE=Array_2D_Image"]),
        ("unsigned", "uint16", "+proj=merc +lon_0=10 +R=1737400", &[]),
        ("doubles", "float64", "+proj=tmerc +lat_0=10 +lon_0=10 +R=1737400", &[]),
        ("integers", "int32", "+proj=lcc +lat_1=20 +lat_2=60 +lat_0=40 +lon_0=10 +R=1737400", &[]),
        ("tiff", "float32", equirectangular, &["IMAGE_FORMAT=GEOTIFF"]),
    ] {
        let script = format!(
            "
a = (np.arange(1200).reshape(30, 40) % 200 + 5).astype('{kind}')
a[7, 9] = 3
with rasterio.open('a.tif', 'w', driver='GTiff', width=40, height=30, count=1, dtype='{kind}', crs='{srs}',
                   transform=Affine(5, 0, -1000, 0, -5, 2000), nodata=3) as d: d.write(a, 1)
"
        );
        if elunar_testing::rasterio(&script, folder.path()).is_none() {
            return;
        }
        let Some(mut command) = oracle::gdal("gdal_translate") else { return };
        let name = format!("{name}.xml");
        command.args(["-q", "-of", "PDS4", "a.tif", &name]).current_dir(folder.path());
        command.args(options.iter().flat_map(|option| ["-co", option]));
        let out = command.output().unwrap();
        assert!(out.status.success(), "{name}: {}", String::from_utf8_lossy(&out.stderr));
        names.push(name);
    }
    assert!(agrees(folder.path(), &names, |_| 1.0));
}
