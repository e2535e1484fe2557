//! Hashes of the contents of rasters' files.

use crate::format::Format;
use crate::{bytes, isis, mask, pds3, pds4, vrt};
use elunar_base::Result;
use elunar_base::digest::{sha256_hex, sha256_while};
use std::path::{Path, PathBuf};

/// Most hashes that are joined (our choice).
pub const MOST_HASHES: usize = 8;

/// Returns the SHA-256 of a raster's files, hexadecimal. A PDS3 product of a label and an image has two, joined by `+`, as the user names
/// the one or the other. A mask has one more, and so has every file that a VRT names. Of more than [`MOST_HASHES`] files the result is the hash
/// of these hashes.
///
/// # Errors
/// [`elunar_base::Error::Io`] if a file cannot be read; as [`crate::source::open`] if it is no raster.
pub fn sha256_of_raster(path: &Path) -> Result<String> {
    sha256_of_raster_while(path, &|| true)
}

/// Returns what stands for the content of a raster: [`sha256_of_raster_while`], or of a file on the net its address, length and entity tag (or time of
/// the last change), in words that say that no bytes were hashed.
///
/// # Errors
/// As [`sha256_of_raster_while`]; [`elunar_base::Error::Io`] if the server does not answer.
pub fn identity_of_raster_while(path: &Path, goes_on: &dyn Fn() -> bool) -> Result<String> {
    bytes::identity(path)?.map_or_else(|| sha256_of_raster_while(path, goes_on), Ok)
}

/// Returns the SHA-256 of a raster's files as [`sha256_of_raster`] does, while `goes_on` says yes.
///
/// # Errors
/// As [`sha256_while`] and [`sha256_of_raster`].
pub fn sha256_of_raster_while(path: &Path, goes_on: &dyn Fn() -> bool) -> Result<String> {
    let hashes: Vec<String> =
        files_of_raster(path)?.iter().map(|file| sha256_while(file, goes_on)).collect::<Result<_>>()?;
    Ok(if hashes.len() > MOST_HASHES { sha256_hex(hashes.join("+")) } else { hashes.join("+") })
}

/// Returns the files of a raster: one, a label and the image that it describes, or a VRT and the files that it names; and their masks.
///
/// # Errors
/// [`elunar_base::Error::Io`] if a file cannot be read; as [`crate::source::open`] if it is no raster.
pub fn files_of_raster(path: &Path) -> Result<Vec<PathBuf>> {
    let label = match Format::of(path)? {
        Format::Isis => return Ok(described(path, path, isis::image_of(path)?)),
        Format::Vrt => return vrt::files(path, 0),
        Format::Pds4 => return Ok(described(path, path, pds4::image_of(path)?)),
        Format::Pds3 => Some(path.to_path_buf()),
        Format::Unknown(_) => pds3::label_beside(path)?,
        _ => None,
    };
    Ok(match label {
        Some(label) => described(path, &label, pds3::image_of(&label)?),
        None => [Some(path.into()), mask::beside(path)].into_iter().flatten().collect(),
    })
}

/// Returns a label, the image that it describes unless it is in the label's file, and the mask beside the file that the user names.
fn described(path: &Path, label: &Path, image: PathBuf) -> Vec<PathBuf> {
    let mut files = vec![label.to_path_buf(), image];
    files.dedup();
    files.extend(mask::beside(path));
    files
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_base::digest::sha256;

    #[test]
    fn a_label_counts_with_its_image() {
        let folder = tempfile::tempdir().unwrap();
        let [label, image] = ["A.LBL", "A.IMG"].map(|name| folder.path().join(name));
        let text = "PDS_VERSION_ID = PDS3\r\n^IMAGE = \"A.IMG\"\r\nOBJECT = IMAGE\r\nLINES = 2\r\nLINE_SAMPLES = 2\r\n\
            SAMPLE_TYPE = UNSIGNED_INTEGER\r\nSAMPLE_BITS = 8\r\nEND_OBJECT = IMAGE\r\nEND\r\n";
        std::fs::write(&label, text).unwrap();
        std::fs::write(&image, [1, 2, 3, 4]).unwrap();
        let first = sha256_of_raster(&label).unwrap();
        assert_eq!(first, format!("{}+{}", sha256(&label).unwrap(), sha256(&image).unwrap()));
        assert_eq!(sha256_of_raster(&image).unwrap(), first);
        std::fs::write(&image, [1, 2, 3, 5]).unwrap();
        assert_ne!(sha256_of_raster(&label).unwrap(), first);
    }

    #[test]
    fn of_many_files_the_hash_of_the_hashes_counts() {
        use crate::geotiff::{WriteOptions, write};
        let folder = tempfile::tempdir().unwrap();
        let vrt = |count: usize| {
            let mut pieces = String::new();
            for number in 0..count {
                let raster = crate::Raster { rows: 1, cols: 1, samples: vec![number as f32], georef: None };
                write(&folder.path().join(format!("{number}.tif")), &raster, &WriteOptions::heights("t")).unwrap();
                pieces += &format!(
                    "<SimpleSource><SourceFilename relativeToVRT=\"1\">{number}.tif</SourceFilename>\
                     <SrcRect xOff=\"0\" yOff=\"0\" xSize=\"1\" ySize=\"1\"/>\
                     <DstRect xOff=\"{number}\" yOff=\"0\" xSize=\"1\" ySize=\"1\"/></SimpleSource>"
                );
            }
            let path = folder.path().join("a.vrt");
            let text = format!(
                "<VRTDataset rasterXSize=\"{count}\" rasterYSize=\"1\"><VRTRasterBand dataType=\"Float32\">{pieces}\
                 </VRTRasterBand></VRTDataset>"
            );
            std::fs::write(&path, text).unwrap();
            path
        };
        let joined = |path: &Path| {
            let files = files_of_raster(path).unwrap();
            files.iter().map(|file| sha256(file).unwrap()).collect::<Vec<_>>().join("+")
        };
        let most = vrt(MOST_HASHES - 1);
        assert_eq!(sha256_of_raster(&most).unwrap(), joined(&most));
        let more = vrt(MOST_HASHES);
        assert_eq!(identity_of_raster_while(&more, &|| true).unwrap(), sha256_hex(joined(&more)));
    }
}
