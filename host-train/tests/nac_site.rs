//! The recipe for a NAC site (docs/nac-site.md), on small imitations of the archives' products: an orthoimage with an attached PDS3 label,
//! an SLDEM2015 tile (kilometres, another central meridian, OFFSET = radius), a stereo DTM as TIFF with a detached label, and a table of
//! laser points. The result is the same as with plain GeoTIFFs.

use elunar_core::sun::Body;
use elunar_raster::geotiff::{SampleType, WriteOptions, read, write};
use elunar_raster::{Crs, Raster};
use std::path::Path;
use support::Shell;

mod support;

const PIXEL_M: f64 = 2.0;
/// Pixel of SLDEM2015 at 512 pixels per degree, metres.
const COARSE_M: f64 = 59.225_293_8;
/// Upper left corner of the image and of the coarse DTM, metres east and north of (0, 0).
const IMAGE_AT: (f64, f64) = (12_000.0, 40_000.0);
const COARSE_AT: (f64, f64) = (11_700.0, 40_300.0);

fn hills(x: f64, y: f64) -> f64 {
    -2600.0 + 25.0 * (x / 180.0).sin() * (y / 140.0).cos() + 2.0 * (x / 31.0 + y / 23.0).sin()
}

/// Returns Lambert brightness with the Sun in the north-west, as integers.
fn brightness(x: f64, y: f64) -> f64 {
    let (dx, dy) = ((hills(x + 1.0, y) - hills(x - 1.0, y)) / 2.0, (hills(x, y + 1.0) - hills(x, y - 1.0)) / 2.0);
    (8000.0 * (0.57 + 0.58 * dx - 0.58 * dy).max(0.0) / (1.0 + dx * dx + dy * dy).sqrt()).round() + 50.0
}

fn raster(rows: usize, cols: usize, at: (f64, f64), pixel_m: f64, value: impl Fn(f64, f64) -> f64) -> Raster {
    support::raster((rows, cols), at, pixel_m, Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0), value)
}

/// Returns the IMAGE_MAP_PROJECTION of a grid with its corner at `at`, for a central meridian of `lon0_deg`.
fn projection(name: &str, rows: usize, cols: usize, at: (f64, f64), pixel_m: f64, lon0_deg: f64) -> String {
    let east = at.0 - lon0_deg.to_radians() * Body::Moon.radius_m();
    let (sample, line) = (-east / pixel_m - 0.5, at.1 / pixel_m - 0.5);
    let north_deg = |y: f64| (y / Body::Moon.radius_m()).to_degrees();
    format!(
        "OBJECT = IMAGE_MAP_PROJECTION\r\n  MAP_PROJECTION_TYPE = \"{name}\"\r\n  A_AXIS_RADIUS = 1737.4 <KM>\r\n  \
         B_AXIS_RADIUS = 1737.4 <KM>\r\n  C_AXIS_RADIUS = 1737.4 <KM>\r\n  POSITIVE_LONGITUDE_DIRECTION = EAST\r\n  \
         CENTER_LATITUDE = 0.0 <DEG>\r\n  CENTER_LONGITUDE = {lon0_deg} <DEG>\r\n  LINE_FIRST_PIXEL = 1\r\n  LINE_LAST_PIXEL = {rows}\r\n  \
         SAMPLE_FIRST_PIXEL = 1\r\n  SAMPLE_LAST_PIXEL = {cols}\r\n  MAP_PROJECTION_ROTATION = 0.0\r\n  \
         MAP_SCALE = {} <KM/PIXEL>\r\n  MAXIMUM_LATITUDE = {} <DEG>\r\n  MINIMUM_LATITUDE = {} <DEG>\r\n  \
         LINE_PROJECTION_OFFSET = {line} <PIXEL>\r\n  SAMPLE_PROJECTION_OFFSET = {sample} <PIXEL>\r\nEND_OBJECT = IMAGE_MAP_PROJECTION\r\n",
        pixel_m / 1000.0,
        north_deg(at.1),
        north_deg(at.1 - rows as f64 * pixel_m),
    )
}

/// A folder with the archives' products.
struct Site(Shell);

impl Site {
    /// Writes an orthoimage: 16-bit integers behind a label of one record.
    fn orthoimage(&self, name: &str, image: &Raster) {
        let (rows, cols) = (image.rows, image.cols);
        let record = 2 * cols;
        let records = 3000_usize.div_ceil(record);
        let label = format!(
            "PDS_VERSION_ID = PDS3\r\nRECORD_TYPE = FIXED_LENGTH\r\nRECORD_BYTES = {record}\r\nFILE_RECORDS = {}\r\n\
             LABEL_RECORDS = {records}\r\n^IMAGE = {}\r\n\
             OBJECT = IMAGE\r\n  LINES = {rows}\r\n  LINE_SAMPLES = {cols}\r\n  SAMPLE_TYPE = LSB_INTEGER\r\n  SAMPLE_BITS = 16\r\n  \
             CORE_NULL = -32768\r\nEND_OBJECT = IMAGE\r\n{}END\r\n",
            rows + records,
            records + 1,
            projection("EQUIRECTANGULAR", rows, cols, IMAGE_AT, PIXEL_M, 0.0),
        );
        let mut bytes = label.into_bytes();
        assert!(bytes.len() <= records * record, "label of {} bytes", bytes.len());
        bytes.resize(records * record, b' ');
        bytes.extend(image.samples.iter().flat_map(|v| (*v as i16).to_le_bytes()));
        std::fs::write(self.0.path(name), bytes).unwrap();
    }

    /// Writes a coarse DTM in kilometres, with label and image in separate files.
    fn sldem(&self, name: &str, coarse: &Raster) {
        let (rows, cols) = (coarse.rows, coarse.cols);
        let label = format!(
            "PDS_VERSION_ID = PDS3\r\nOBJECT = UNCOMPRESSED_FILE\r\n  FILE_NAME = \"{name}.IMG\"\r\n  RECORD_TYPE = FIXED_LENGTH\r\n  \
             RECORD_BYTES = {}\r\n  FILE_RECORDS = {rows}\r\n  ^IMAGE = \"{name}.IMG\"\r\n  OBJECT = IMAGE\r\n    LINES = {rows}\r\n    \
             LINE_SAMPLES = {cols}\r\n    SAMPLE_TYPE = PC_REAL\r\n    SAMPLE_BITS = 32\r\n    UNIT = KILOMETER\r\n    \
             SCALING_FACTOR = 1.\r\n    OFFSET = 1737.4\r\n  END_OBJECT = IMAGE\r\nEND_OBJECT = UNCOMPRESSED_FILE\r\n{}END\r\n",
            4 * cols,
            projection("SIMPLE CYLINDRICAL", rows, cols, COARSE_AT, COARSE_M, 180.0),
        );
        std::fs::write(self.0.path(&format!("{name}.LBL")), label).unwrap();
        let bytes: Vec<u8> = coarse.samples.iter().flat_map(|v| (v / 1000.0).to_le_bytes()).collect();
        std::fs::write(self.0.path(&format!("{name}.IMG")), bytes).unwrap();
    }

    /// Writes a pass from south to north over the middle of the image, with a point every 20 m.
    fn track(&self, name: &str) {
        let mut text = String::from("Coordinated_Universal_Time,Pt_Longitude,Pt_Latitude,Pt_Radius,Pt_Flg\n");
        for i in 0..25 {
            let (x, y) = (IMAGE_AT.0 + 350.0, IMAGE_AT.1 - 560.0 + 20.0 * f64::from(i));
            let degrees = |metres: f64| (metres / Body::Moon.radius_m()).to_degrees();
            let radius_km = (Body::Moon.radius_m() + hills(x, y)) / 1000.0;
            text += &format!("2009-09-01T00:00:{i:02}.000,{:.9},{:.9},{radius_km:.6},0\n", degrees(x), degrees(y));
        }
        std::fs::write(self.0.path(name), text).unwrap();
    }
}

fn largest_difference(a: &Path, b: &Path) -> f32 {
    let (a, b) = (read(a).unwrap(), read(b).unwrap());
    assert_eq!(a.valid_count(), b.valid_count());
    let difference = |(a, b): (&f32, &f32)| if a.is_nan() && b.is_nan() { 0.0 } else { (a - b).abs() };
    a.samples.iter().zip(&b.samples).map(difference).fold(0.0, f32::max)
}

#[test]
fn the_archives_products_go_in_and_a_hillshade_comes_out() {
    let site = Site(Shell::new());
    let (image, truth) = (raster(300, 350, IMAGE_AT, PIXEL_M, brightness), raster(300, 350, IMAGE_AT, PIXEL_M, hills));
    let coarse = raster(20, 22, COARSE_AT, COARSE_M, hills);
    write(&site.0.path("image.tif"), &image, &WriteOptions::image(SampleType::U16, "image")).unwrap();
    write(&site.0.path("coarse.tif"), &coarse, &WriteOptions::heights("coarse")).unwrap();
    write(&site.0.path("TRUTH.TIF"), &truth, &WriteOptions::heights("truth")).unwrap();
    site.orthoimage("ORTHO_2M.IMG", &image);
    site.sldem("SLDEM2015_FLOAT", &coarse);
    site.track("RDR_PointPerRow_csv_table.csv");

    assert!(site.0.made(&["inspect", "ORTHO_2M.IMG"]).contains("300"));
    assert!(site.0.made(&["inspect", "SLDEM2015_FLOAT.LBL"]).contains("m"));
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/ground.eld");
    let model = model.to_str().unwrap();
    let predict = |image, coarse, output| {
        let sun = ["--sun-azimuth", "315"];
        let files = ["predict", "--image", image, "--coarse", coarse, "--model", model, "-o", output];
        site.0.made(&[&files[..], &sun].concat())
    };
    predict("image.tif", "coarse.tif", "plain.tif");
    predict("ORTHO_2M.IMG", "SLDEM2015_FLOAT.LBL", "dtm.tif");
    // Heights in kilometres as f32 are exact to 0.1 mm here, and positions to rounding. In int8 this may rarely become a step.
    let apart = largest_difference(&site.0.path("plain.tif"), &site.0.path("dtm.tif"));
    assert!(apart < 0.1, "{apart} m apart");

    let scored = ["--truth", "TRUTH.TIF", "--coarse", "SLDEM2015_FLOAT.LBL", "--error-map", "error.png", "--json"];
    let scores = site.0.made(&[&["evaluate", "--dtm", "dtm.tif"][..], &scored].concat());
    let scores: serde_json::Value = serde_json::from_str(&scores).unwrap();
    assert_eq!(scores["common_pixels"], 300 * 350);
    let difference = site.0.made(&["diff", "dtm.tif", "TRUTH.TIF", "-o", "difference.tif"]);
    assert!(difference.contains("RMSE"), "{difference}");
    let tracks = site.0.made(&["lola", "--dtm", "TRUTH.TIF", "--tracks", "RDR_PointPerRow_csv_table.csv", "--json"]);
    let tracks: serde_json::Value = serde_json::from_str(&tracks).unwrap();
    let std_m = tracks["tracks"][0]["std_m"].as_f64().unwrap_or_else(|| panic!("{tracks:#}"));
    assert!(std_m < 0.05, "{tracks:#}");
    site.0.made(&["hillshade", "dtm.tif", "-o", "shade.tif", "--sun-azimuth", "315", "--sun-elevation", "30"]);
    for made in ["dtm_hillshade.png", "error.png", "difference.tif", "shade.tif"] {
        assert!(site.0.path(made).exists(), "{made}");
    }
}
