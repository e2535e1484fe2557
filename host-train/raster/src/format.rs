//! File formats, recognised by the first bytes.

use super::{npy, pds3, pds4};
use crate::bytes::Bytes;
use elunar_base::{Error, Result};
use std::io::Read;
use std::path::Path;

/// Number of bytes to read. They contain the first keyword of a label, even behind a long comment.
const HEAD_BYTES: u64 = 4096;

/// A kind of raster file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Format {
    /// TIFF or BigTIFF.
    Tiff,
    /// PDS3 label, detached or in front of its image.
    Pds3,
    /// GDAL's virtual raster: an XML file that names others.
    Vrt,
    /// PDS4 label.
    Pds4,
    /// ISIS cube, or its label.
    Isis,
    /// NumPy array.
    Npy,
    /// Known, and readable by GDAL, but not by this program; its description.
    Convertible(&'static str),
    /// Any other format; the first bytes.
    Unknown(Vec<u8>),
}

impl Format {
    /// Reads the first bytes of the file and returns its format.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read, [`Error::Input`] if it is a folder, [`Error::Broken`] if it is empty.
    pub fn of(path: &Path) -> Result<Self> {
        Ok(Self::of_head(&head(path)?))
    }

    /// Returns the format for the first bytes of a file.
    #[must_use]
    pub fn of_head(head: &[u8]) -> Self {
        let text = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(head).trim_ascii_start();
        let starts = |magic: &[u8]| head.starts_with(magic);
        if [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].into_iter().any(|magic| starts(magic)) {
            Self::Tiff
        } else if starts(npy::MAGIC) {
            Self::Npy
        } else if starts(b"\0\0\0\x0CjP  \r\n\x87\n") || starts(b"\xFF\x4F\xFF\x51") {
            Self::Convertible("a JPEG 2000 image")
        } else if starts(b"\x89PNG") || starts(b"\xFF\xD8\xFF") {
            Self::Convertible("a PNG or JPEG picture")
        } else if text.starts_with(b"<VRTDataset") || is_xml(text) && contains(text, b"<VRTDataset") {
            Self::Vrt
        } else if is_xml(text) && contains(text, pds4::PRODUCT.as_bytes()) {
            Self::Pds4
        } else if is_xml(text) {
            Self::Convertible("an XML file, neither a PDS4 label of an observation nor a VRT")
        } else if is_cube(text) {
            Self::Isis
        } else if is_old_cube(text) {
            Self::Convertible("an ISIS cube of version 2")
        } else if pds3::is_label(head) {
            Self::Pds3
        } else {
            Self::Unknown(head[..head.len().min(16)].to_vec())
        }
    }
}

fn is_xml(text: &[u8]) -> bool {
    let after = |word: &[u8]| text.get(..word.len()).is_some_and(|start| start.eq_ignore_ascii_case(word));
    after(b"<?xml") || after(b"<Product_Observational")
}

fn contains(text: &[u8], word: &[u8]) -> bool {
    text.windows(word.len()).any(|part| part == word)
}

/// Returns whether the text begins with `Object = IsisCube`, in any case and spacing.
fn is_cube(text: &[u8]) -> bool {
    opens(text, b"OBJECT=ISISCUBE")
}

/// Returns whether the text begins as cubes of version 2 do.
fn is_old_cube(text: &[u8]) -> bool {
    opens(text, b"OBJECT=QUBE")
}

fn opens(text: &[u8], block: &[u8]) -> bool {
    let line = text.split(|&b| b == b'\n').next().unwrap_or(&[]);
    let line: Vec<u8> = line.iter().filter(|b| !b.is_ascii_whitespace()).map(u8::to_ascii_uppercase).collect();
    line.starts_with(block)
}

/// Reads the first bytes of a file, at least one.
///
/// # Errors
/// As [`Format::of`].
pub fn head(path: &Path) -> Result<Vec<u8>> {
    let mut head = Vec::new();
    Bytes::open(path)?.take(HEAD_BYTES).read_to_end(&mut head).map_err(Error::io(path))?;
    if head.is_empty() {
        return Err(Error::broken(path, "a raster expected, found an empty file"));
    }
    Ok(head)
}

/// Describes the first bytes for messages: as text if they are text, otherwise hexadecimal.
pub(super) fn describe(head: &[u8]) -> String {
    match std::str::from_utf8(head) {
        Ok(text) if text.chars().all(|c| !c.is_control() || c.is_ascii_whitespace()) => {
            format!("a file that begins with {text:?}")
        }
        _ => format!("a file that begins with bytes {head:02X?}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source;

    #[test]
    fn contents_decide() {
        let cases: [(&[u8], Format); 16] = [
            (b"II*\0rest", Format::Tiff),
            (b"MM\0+rest", Format::Tiff),
            (b"\x93NUMPY\x01\0", Format::Npy),
            (b"\0\0\0\x0CjP  \r\n\x87\n\0\0", Format::Convertible("a JPEG 2000 image")),
            (b"\xFF\x4F\xFF\x51\0\x2F", Format::Convertible("a JPEG 2000 image")),
            (b"\xFF\xD8\xFF\xE0\0\x10JFIF", Format::Convertible("a PNG or JPEG picture")),
            (b"NJPL1I00PDS100000000\r\nFILE_TYPE = IMAGE\r\n", Format::Pds3),
            (b"\r\n/* a comment */ PDS_VERSION_ID = PDS3\r\n", Format::Pds3),
            (b"CCSD3ZF0000100000001NJPL3IF0PDSX00000001\r\nPDS_VERSION_ID = PDS3", Format::Pds3),
            (b"Object = IsisCube\n  Object = Core", Format::Isis),
            (
                b"\xEF\xBB\xBF<?xml version",
                Format::Convertible("an XML file, neither a PDS4 label of an observation nor a VRT"),
            ),
            (b"<?xml version=\"1.0\"?>\n<Product_Observational xmlns", Format::Pds4),
            (b"<VRTDataset rasterXSize=\"5\"", Format::Vrt),
            (b"<?xml version=\"1.0\"?>\n<VRTDataset>", Format::Vrt),
            (b"\xFF\x4F\xFF\x51\0", Format::Convertible("a JPEG 2000 image")),
            (b"foo = bar", Format::Unknown(b"foo = bar".to_vec())),
        ];
        for (head, format) in cases {
            assert_eq!(Format::of_head(head), format);
        }
    }

    #[test]
    fn what_is_no_raster_is_said_in_one_line() {
        let folder = tempfile::tempdir().unwrap();
        let refused = |name: &str, content: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, content).unwrap();
            let text = source::open(&path).err().expect("refused").to_string();
            assert!(text.contains(name) && !text.contains('\n'), "{text}");
            text
        };
        assert!(refused("empty.tif", b"").contains("empty file"));
        assert!(refused("a.cub", b"OBJECT = QUBE\n").contains("gdal_translate -of GTiff"));
        assert!(refused("a.jp2", b"\xFF\x4F\xFF\x51").contains("JPEG 2000 image; convert it first: gdal_translate"));
        assert!(refused("a.xml", b"<?xml version=\"1.0\"?>").contains("gdal_translate"));
        assert!(refused("a.txt", b"1,2,3\n4").contains("begins with \"1,2,3\\n4\""));
        assert!(refused("a.img", b"\x01\x02").contains("bytes [01, 02] and no PDS3 label beside it"));
        let text = source::open(folder.path()).err().expect("refused").to_string();
        assert!(text.contains("a file expected, found a folder"), "{text}");
        assert!(source::open(&folder.path().join("none.tif")).err().expect("refused").to_string().contains("none.tif"));
    }
}
