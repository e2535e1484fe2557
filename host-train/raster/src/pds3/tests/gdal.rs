//! GDAL reads the same samples with the same georeference. Needs `python3` with `rasterio`; says so if it is absent.

use super::{EQUIRECTANGULAR, POLAR, attached, sldem_label};
use crate::gdal_tests::agrees;
use crate::source::{open, read_all};
use elunar_testing::rasterio;

/// Returns a detached label that points into a TIFF, as in NAC_DTM products.
fn nac_dtm_label(start: usize, rows: usize, cols: usize) -> String {
    format!(
        "PDS_VERSION_ID = PDS3\r\nRECORD_TYPE = UNDEFINED\r\n^IMAGE = (\"NAC_DTM_SITE.TIF\",{start} <BYTES>)\r\n{EQUIRECTANGULAR}\r
OBJECT = IMAGE\r\n DESCRIPTION = \"NoDATA value is -3.40282266e+038\"\r\n LINES = {rows}\r\n LINE_SAMPLES = {cols}\r
 SAMPLE_TYPE = PC_REAL\r\n SAMPLE_BITS = 32\r\n BANDS = 1\r\nEND_OBJECT = IMAGE\r\nEND\r\n"
    )
}

#[test]
fn samples_and_places_agree() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let heights: Vec<f32> =
        (0..35).map(|i| if i == 3 { f32::from_bits(0xFF7F_FFFB) } else { i as f32 * 0.125 - 2.0 }).collect();
    let (little, big): (Vec<u8>, Vec<u8>) = (
        heights.iter().flat_map(|v| v.to_le_bytes()).collect(),
        heights.iter().flat_map(|v| v.to_be_bytes()).collect(),
    );
    // GDAL prefers the compressed copy of the image, which is absent here.
    let label = sldem_label("SLDEM", 5, 7).replace("^IMAGE                    = \"SLDEM.JP2\"", "");
    std::fs::write(
        path("SLDEM.LBL"),
        label
            .replace(
                "COMPRESSED_FILE\r\nFILE_NAME                 = \"SLDEM.JP2",
                "OTHER_FILE\r\nFILE_NAME                 = \"SLDEM.JP2",
            )
            .replacen("END_OBJECT                = COMPRESSED_FILE", "END_OBJECT                = OTHER_FILE", 1),
    )
    .unwrap();
    std::fs::write(path("SLDEM.IMG"), &little).unwrap();
    let ortho: Vec<u8> = (0..35).flat_map(|i: i16| if i == 9 { i16::MIN } else { i * 20 }.to_le_bytes()).collect();
    let write = |name: &str, image: &str, projection: &str, bytes: usize, samples: &[u8]| {
        std::fs::write(path(name), [attached(5, 7, image, projection, bytes), samples.to_vec()].concat()).unwrap();
    };
    write("ORTHO.IMG", "SAMPLE_TYPE = LSB_INTEGER\r\n SAMPLE_BITS = 16", EQUIRECTANGULAR, 2, &ortho);
    write("POLAR.IMG", "SAMPLE_TYPE = IEEE_REAL\r\n SAMPLE_BITS = 32", POLAR, 4, &big);
    let north = POLAR.replace("-90.0", "90.0");
    write("NORTH.IMG", "SAMPLE_TYPE = PC_REAL\r\n SAMPLE_BITS = 32", &north, 4, &little);
    for (name, lat_deg) in
        [("SINUSOIDAL", "0.0"), ("ORTHOGRAPHIC", "20.0"), ("TRANSVERSE MERCATOR", "5.0"), ("MERCATOR", "0.0")]
    {
        let map = POLAR.replace("POLAR STEREOGRAPHIC", name).replace("-90.0", lat_deg);
        write(&format!("{name}.IMG"), "SAMPLE_TYPE = PC_REAL\r\n SAMPLE_BITS = 32", &map, 4, &little);
    }
    let mut names: Vec<String> =
        ["ORTHO", "POLAR", "NORTH", "SINUSOIDAL", "ORTHOGRAPHIC", "TRANSVERSE MERCATOR", "MERCATOR"]
            .map(|name| format!("{name}.IMG"))
            .into();
    names.push("SLDEM.LBL".into());
    agrees(folder.path(), &names, |name| if name.starts_with("SLDEM") { 1000.0 } else { 1.0 });
}

#[test]
fn a_label_beside_a_tiff_adds_what_the_tiff_does_not_say() {
    let folder = tempfile::tempdir().unwrap();
    let script = "
a = np.arange(35, dtype='f4').reshape(5, 7); a[1, 1] = np.frombuffer(bytes.fromhex('fbff7fff'), 'f4')[0]
with rasterio.open('NAC_DTM_SITE.TIF', 'w', driver='GTiff', width=7, height=5, count=1, dtype='float32', blockysize=1) as d:
    d.write(a, 1)
b = open('NAC_DTM_SITE.TIF', 'rb').read()
print(b.index(a.tobytes()) + 1)
";
    let Some(start) = rasterio(script, folder.path()) else { return };
    let label = folder.path().join("NAC_DTM_SITE.LBL");
    std::fs::write(&label, nac_dtm_label(start.trim().parse().unwrap(), 5, 7)).unwrap();
    let script = "
d = rasterio.open('NAC_DTM_SITE.LBL'); assert d.driver == 'PDS', d.driver
d.read(1).tofile('gdal.raw'); print(list(d.transform.to_gdal()))";
    let transform = rasterio(script, folder.path()).unwrap();
    let source = open(&label).unwrap();
    let raster = read_all(&*source).unwrap();
    let raw = std::fs::read(folder.path().join("gdal.raw")).unwrap();
    for (i, (ours, theirs)) in raster.samples.iter().zip(raw.as_chunks::<4>().0).enumerate() {
        assert!(*ours == f32::from_le_bytes(*theirs) || i == 8 && ours.is_nan(), "{i}: {ours}");
    }
    let expected: [f64; 6] = serde_json::from_str(&transform).unwrap();
    let georef = raster.georef.unwrap();
    assert!(georef.transform.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3), "{georef:?} {expected:?}");
    assert!(source.info().format.ends_with("PDS3 label"), "{:?}", source.info());
    std::fs::write(&label, nac_dtm_label(9, 5, 8)).unwrap();
    let text = open(&label).err().unwrap().to_string();
    assert!(text.contains("5 x 8 samples expected, found 5 x 7"), "{text}");
}
