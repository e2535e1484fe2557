//! Writes the files that fuzzing begins with: `seeds FOLDER` writes a folder for each target that has some.

use elunar_core::sun::Body;
use elunar_provoke::Random;
use elunar_provoke::model::sound_models;
use elunar_provoke::programs::{Sizes, program};
use std::io::Result;
use std::path::{Path, PathBuf};

/// Small tables, headers and labels, with what targets they are for.
const TEXTS: [(&str, &str); 10] = [
    (
        "lola_csv",
        "Coordinated_Universal_Time,Pt_Longitude,Pt_Latitude,Pt_Radius,Pt_Flg\r\n2009-07-17T00:46:24.1,30.5,20.25,1737.6,0\r\n",
    ),
    ("lola_csv", "\u{feff}\"lon (deg)\"; lat; height_m\n1;2;3\n# c\n4;5;-6\n"),
    ("npy_header", "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }        \n"),
    ("npy_header", "{'descr': '>u2', 'fortran_order': True, 'shape': (30000, 4), }\n"),
    ("pds3_label", "A = (1, {2.5 <m>, \"t\"}, 16#FF#); GROUP = G B = 1990-158T01:02:03Z END_GROUP = G END"),
    (
        "pds3_label",
        "PDS_VERSION_ID = PDS3\r\nRECORD_BYTES = 16\r\n^IMAGE = \"A.IMG\"\r\nOBJECT = IMAGE\r\nLINES = 3\r\nLINE_SAMPLES = 4\r\n\
         SAMPLE_TYPE = PC_REAL\r\nSAMPLE_BITS = 32\r\nEND_OBJECT = IMAGE\r\nEND\r\n",
    ),
    (
        "labels",
        "Object = IsisCube Object = Core StartByte = 9 Format = Tile TileSamples = 2 TileLines = 2 Group = Dimensions Samples = 3 Lines = 2 \
         Bands = 1 End_Group Group = Pixels Type = UnsignedWord ByteOrder = Lsb Base = 0.0 Multiplier = 1.0 End_Group End_Object End_Object End",
    ),
    (
        "labels",
        "<Product_Observational><File_Area_Observational><File><file_name>a.dat</file_name></File><Array_2D_Image><offset>0</offset>\
         <Element_Array><data_type>SignedLSB2</data_type></Element_Array><Axis_Array><axis_name>Line</axis_name><elements>2</elements>\
         <sequence_number>1</sequence_number></Axis_Array><Axis_Array><axis_name>Sample</axis_name><elements>3</elements>\
         <sequence_number>2</sequence_number></Axis_Array></Array_2D_Image></File_Area_Observational></Product_Observational>",
    ),
    (
        "labels",
        "<VRTDataset rasterXSize=\"4\" rasterYSize=\"3\"><VRTRasterBand dataType=\"Float32\"><SimpleSource><SourceFilename relativeToVRT=\"1\">\
         a.dat</SourceFilename><SrcRect xOff=\"0\" yOff=\"0\" xSize=\"3\" ySize=\"2\"/><DstRect xOff=\"1\" yOff=\"1\" xSize=\"3\" ySize=\"2\"/>\
         </SimpleSource></VRTRasterBand></VRTDataset>",
    ),
    ("pds3_label", "OBJECT = IMAGE_MAP_PROJECTION /* c */ A_AXIS_RADIUS = 1737.4 <KM> END_OBJECT END"),
];

fn main() -> Result<()> {
    let folder = PathBuf::from(std::env::args().nth(1).expect("expected a folder"));
    for (number, (target, text)) in TEXTS.into_iter().enumerate() {
        write(&folder.join(target), number, text.as_bytes())?;
    }
    let programs = (0..).filter_map(|seed| program(&mut Random::of_seed(seed), &Sizes::SMALL));
    let models = sound_models().map(<[u8]>::to_vec).into_iter().chain(programs.map(|program| program.file()));
    for (number, model) in models.take(100).enumerate() {
        write(&folder.join("model"), number, &model)?;
    }
    for target in ["kernels", "c_abi", "c_lines"] {
        for seed in 0..50 {
            let mut random = Random::of_seed(seed);
            let len = 20 + random.number() as usize % 400;
            write(&folder.join(target), seed as usize, &random.bytes(len))?;
        }
    }
    #[cfg(feature = "readers")]
    rasters(&folder.join("tiff"))?;
    Ok(())
}

fn write(folder: &Path, number: usize, bytes: &[u8]) -> Result<()> {
    std::fs::create_dir_all(folder)?;
    std::fs::write(folder.join(format!("seed-{number}")), bytes)
}

/// Writes small TIFF files of every kind that the writer has.
#[cfg(feature = "readers")]
fn rasters(folder: &Path) -> Result<()> {
    use elunar_raster::geotiff::{Compression, SampleType, WriteOptions, write};
    use elunar_raster::{Crs, GeoRef, Raster};

    std::fs::create_dir_all(folder)?;
    let (rows, cols) = (9, 7);
    let samples = (0..rows * cols).map(|i| if i == 30 { f32::NAN } else { (i * 4) as f32 }).collect();
    let transform = [349_000.25, 2.0, 0.0, 600_000.5, 0.0, -2.5];
    let georef = Some(GeoRef { transform, crs: Crs::equirectangular(Body::Moon.radius_m(), 12.0, 180.0) });
    let raster = Raster { rows, cols, samples, georef };
    for compression in [Compression::None, Compression::Lzw, Compression::Deflate, Compression::Zstd] {
        let heights = || WriteOptions::heights("seed").with_compression(compression).with_item("A", "b");
        let image = |sample| WriteOptions::image(sample, "seed").with_compression(compression);
        let kinds = [("f32", heights()), ("u8", image(SampleType::U8)), ("u16", image(SampleType::U16))];
        for (kind, options) in kinds {
            let path = folder.join(format!("seed-{kind}-{compression:?}"));
            write(&path, &raster, &options).map_err(std::io::Error::other)?;
        }
    }
    Ok(())
}
