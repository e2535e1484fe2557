//! Tests of labels and images: comparison with GDAL, and mutations.

mod gdal;
mod grammar;
mod images;
mod mutations;

use crate::source::{Source, open};
use elunar_base::Result;
use std::path::{Path, PathBuf};

/// Writes files into a folder and opens the first.
fn opened(folder: &Path, files: &[(&str, &[u8])]) -> Result<Box<dyn Source>> {
    for (name, bytes) in files {
        std::fs::write(folder.join(name), bytes).unwrap();
    }
    open(&folder.join(files[0].0))
}

/// Returns the reason for refusing the first of the files: one line that names it.
fn refused(files: &[(&str, &[u8])]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let text = opened(folder.path(), files).err().expect("refused").to_string();
    assert!(text.contains(files[0].0) && !text.contains('\n'), "{text}");
    text
}

/// Returns a label as of SLDEM2015: two files are described, the plain one with nested image object and pointer, heights in kilometres, the
/// sphere's radius as OFFSET.
fn sldem_label(name: &str, rows: usize, cols: usize) -> String {
    format!(
        "PDS_VERSION_ID            = \"PDS3\"\r
/*** GENERAL DATA DESCRIPTION PARAMETERS ***/\r
DESCRIPTION               = \"Heights on\r
   several lines = none, /* of */ them END\r
\"\r
OBJECT                    = COMPRESSED_FILE\r
FILE_NAME                 = \"{name}.JP2\"\r
ENCODING_TYPE             = \"JPEG 2000\"\r
^IMAGE                    = \"{name}.JP2\"\r
END_OBJECT                = COMPRESSED_FILE\r
OBJECT                    = UNCOMPRESSED_FILE\r
FILE_NAME                 = \"{name}.IMG\"\r
RECORD_TYPE               = FIXED_LENGTH\r
FILE_RECORDS              = {rows}\r
RECORD_BYTES              = {record}\r
^IMAGE                    = \"{name}.IMG\"\r
  OBJECT                  = IMAGE\r
    NAME                  = HEIGHT\r
    LINES                 = {rows}\r
    LINE_SAMPLES          = {cols}\r
    MAXIMUM               = 10.783\r
    SAMPLE_TYPE           = PC_REAL\r
    SAMPLE_BITS           = 32\r
    UNIT                  = KILOMETER\r
    SCALING_FACTOR        = 1.0\r
    OFFSET                = 1737.4\r
  END_OBJECT              = IMAGE\r
END_OBJECT                = UNCOMPRESSED_FILE\r
OBJECT                    = IMAGE_MAP_PROJECTION\r
 ^DATA_SET_MAP_PROJECTION     = \"DSMAP.CAT\"\r
 MAP_PROJECTION_TYPE          = \"SIMPLE CYLINDRICAL\"\r
 MAP_RESOLUTION               = 512 <pix/deg>\r
 A_AXIS_RADIUS                = 1737.4 <km>\r
 B_AXIS_RADIUS                = 1737.4 <km>\r
 C_AXIS_RADIUS                = 1737.4 <km>\r
 FIRST_STANDARD_PARALLEL      = 'N/A'\r
 POSITIVE_LONGITUDE_DIRECTION = \"EAST\"\r
 CENTER_LATITUDE              = 0. <deg>\r
 CENTER_LONGITUDE             = 180. <deg>\r
 MAP_PROJECTION_ROTATION      = 0.0\r
 MAP_SCALE                    = 0.0592252938 <km/pix>\r
 MAXIMUM_LATITUDE             = 30 <deg>\r
 LINE_PROJECTION_OFFSET       = 15359.5 <pix>\r
 SAMPLE_PROJECTION_OFFSET     = 92159.5 <pix>\r
END_OBJECT                    = IMAGE_MAP_PROJECTION\r
END\r
",
        record = cols * 4
    )
}

/// Returns a label and its image as in NAC orthoimages, padded to whole records, polar or equirectangular.
fn attached(rows: usize, cols: usize, image: &str, projection: &str, sample_bytes: usize) -> Vec<u8> {
    let record = cols * sample_bytes;
    let text = |records: usize| {
        format!(
            "PDS_VERSION_ID            = PDS3\r
/* The source image data definition. */\r
RECORD_TYPE   = FIXED_LENGTH\r
RECORD_BYTES  = {record}\r
FILE_RECORDS  = {}\r
LABEL_RECORDS = {records}\r
^IMAGE        = {}\r
{projection}\r
OBJECT = IMAGE\r
    LINES                      = {rows}\r
    LINE_SAMPLES               = {cols}\r
    {image}\r
    BANDS                      = 1\r
END_OBJECT = IMAGE\r
END\r
",
            rows + records,
            records + 1
        )
    };
    let records = (text(99).len() + 8).div_ceil(record);
    let mut label = text(records).into_bytes();
    label.resize(records * record, b' ');
    label
}

const EQUIRECTANGULAR: &str = "OBJECT = IMAGE_MAP_PROJECTION
    MAP_PROJECTION_TYPE          = EQUIRECTANGULAR
    A_AXIS_RADIUS                = 1737.4 <KM>
    B_AXIS_RADIUS                = 1737.4 <KM>
    C_AXIS_RADIUS                = 1737.4 <KM>
    POSITIVE_LONGITUDE_DIRECTION = EAST
    CENTER_LATITUDE               = 20.0 <DEG>
    CENTER_LONGITUDE              = 180.0 <DEG>
    MAP_PROJECTION_ROTATION        = 0.0 <DEG>
    MAP_RESOLUTION                 = 6064.67008483 <PIX/DEG>
    MAP_SCALE                      = 4.9999999999999005 <METERS/PIXEL>
    MAXIMUM_LATITUDE                = 21.30330227 <DEG>
    LINE_PROJECTION_OFFSET          = 129197.5 <PIXEL>
    SAMPLE_PROJECTION_OFFSET        = 855375.5 <PIXEL>
END_OBJECT = IMAGE_MAP_PROJECTION";

const POLAR: &str = "OBJECT = IMAGE_MAP_PROJECTION
    MAP_PROJECTION_TYPE          = \"POLAR STEREOGRAPHIC\"
    A_AXIS_RADIUS                = 1737.4 <KM>
    B_AXIS_RADIUS                = 1737.4 <KM>
    C_AXIS_RADIUS                = 1737.4 <KM>
    CENTER_LATITUDE               = -90.0 <DEG>
    CENTER_LONGITUDE              = 30.0 <DEG>
    MAP_SCALE                      = 0.005 <KM/PIXEL>
    LINE_PROJECTION_OFFSET          = 399.5 <PIXEL>
    SAMPLE_PROJECTION_OFFSET        = -100.5 <PIXEL>
END_OBJECT = IMAGE_MAP_PROJECTION";

fn shared(path: &str) -> Option<PathBuf> {
    Some(elunar_testing::shared_folder()?.join("data").join(path))
}
