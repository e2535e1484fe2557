//! NumPy's `.npy` arrays (format versions 1 to 3, NEP 1): rows x columns without a georeference.

use super::binary::{Binary, Layout, Meaning, Sample};
use super::source::{Info, Source};
use elunar_base::{Error, Result, read};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// First bytes of every `.npy` file.
pub const MAGIC: &[u8] = b"\x93NUMPY";

/// Headers have a few hundred bytes. In versions 2 and 3 they could claim four gigabytes.
const MOST_HEADER_BYTES: u32 = 1 << 16;

/// Contents of the header.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Header {
    /// NumPy's name of the samples: `<f4`.
    pub descr: String,
    /// True if columns are stored one after the other.
    pub fortran_order: bool,
    /// Size along each axis.
    pub shape: Vec<u64>,
}

impl Header {
    /// Reads the text of a header: a Python dictionary with exactly three entries.
    ///
    /// # Errors
    /// A text with what was expected and what was found.
    pub fn parse(text: &str) -> std::result::Result<Self, String> {
        let refuse = || format!("a header with descr, fortran_order and shape expected, found {:?}", head(text));
        let value = |key: &str| {
            let at = [format!("'{key}'"), format!("\"{key}\"")]
                .into_iter()
                .find_map(|key| Some(text.find(&key)? + key.len()))?;
            text[at..].trim_start().strip_prefix(':').map(str::trim_start)
        };
        let descr = value("descr").ok_or_else(refuse)?;
        let quote = descr
            .chars()
            .next()
            .filter(|c| ['\'', '"'].contains(c))
            .ok_or_else(|| format!("plain samples expected, found structured ones: {:?}", head(descr)))?;
        let descr = descr[1..].split(quote).next().ok_or_else(refuse)?.to_owned();
        let order = value("fortran_order").ok_or_else(refuse)?;
        let fortran_order = match (order.starts_with("True"), order.starts_with("False")) {
            (true, _) => true,
            (_, true) => false,
            _ => return Err(refuse()),
        };
        let shape = value("shape").and_then(|shape| shape.strip_prefix('(')?.split_once(')')).ok_or_else(refuse)?.0;
        let sizes = shape.split(',').map(str::trim).filter(|size| !size.is_empty());
        let shape = sizes.map(|size| size.trim_end_matches('L').parse::<u64>()).collect::<std::result::Result<_, _>>();
        Ok(Self { descr, fortran_order, shape: shape.map_err(|_| refuse())? })
    }

    /// Returns the layout behind a header of `start` bytes. There are two axes, or three of which the first has one entry.
    fn layout(&self, start: u64) -> std::result::Result<Layout, String> {
        let (rows, cols) = match self.shape[..] {
            [rows, cols] | [1, rows, cols] => (rows, cols),
            _ => return Err(format!("an array of rows x columns expected, found shape {:?}", self.shape)),
        };
        if self.fortran_order {
            return Err(
                "Fortran order; rows after rows expected: numpy.save(file, numpy.ascontiguousarray(array))".into()
            );
        }
        let (order, kind) = self.descr.split_at_checked(1).unwrap_or(("", ""));
        let sample = match kind {
            "u1" => Sample::U8,
            "i1" => Sample::I8,
            "u2" => Sample::U16,
            "i2" => Sample::I16,
            "u4" => Sample::U32,
            "i4" => Sample::I32,
            "f4" => Sample::F32,
            "f8" => Sample::F64,
            _ => return Err(format!("samples u1, i1, u2, i2, u4, i4, f4 or f8 expected, found {:?}", self.descr)),
        };
        let big_endian = match order {
            "<" => false,
            ">" => true,
            "|" if sample.bytes() == 1 => false,
            _ => return Err(format!("byte order < or > expected, found {:?}", self.descr)),
        };
        let size = |n: u64| usize::try_from(n).ok().filter(|&n| n > 0);
        match (size(rows), size(cols), cols.checked_mul(sample.bytes() as u64)) {
            (Some(rows), Some(cols), Some(row_bytes)) => {
                Ok(Layout { sample, big_endian, rows, cols, start, row_bytes, tile: None })
            }
            _ => Err(format!("an array with samples expected, found shape {:?}", self.shape)),
        }
    }
}

/// Opens a `.npy` file. Samples are returned unchanged; special pixels become NaN as in every other format.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read, [`Error::Broken`] if header and file size disagree, [`Error::Unsupported`] for Fortran order,
/// other axes, and samples other than real numbers and integers up to 32 bits.
pub fn open(path: &Path) -> Result<Box<dyn Source>> {
    open_with(path, None)
}

/// Opens a file as [`open`] does, with samples stored as `nodata` invalid.
pub(super) fn open_with(path: &Path, nodata: Option<f64>) -> Result<Box<dyn Source>> {
    let mut file = read::file(path)?;
    let file_bytes = file.metadata().map_err(Error::io(path))?.len();
    let (text, start) = header(path, &mut file)?;
    let header = Header::parse(&text).map_err(|what| Error::broken(path, what))?;
    let layout = header.layout(start).map_err(|what| Error::unsupported(path, what))?;
    let Layout { rows, cols, sample, .. } = layout;
    if layout.end() != Some(file_bytes) {
        let what = format!(
            "{rows} x {cols} {} samples behind {start} bytes expected, found {file_bytes} bytes in all",
            sample.name()
        );
        return Err(Error::broken(path, what));
    }
    let format = format!("NumPy array, {}", header.descr);
    let info = Info { rows, cols, format, ..Info::default() };
    let meaning = Meaning::new(sample, nodata, 1.0, 0.0);
    Ok(Box::new(Binary::new(path.into(), file, layout, meaning, info)))
}

/// Returns the header's text, and the offset of the samples.
fn header(path: &Path, file: &mut File) -> Result<(String, u64)> {
    let short = |_| Error::broken(path, "a NumPy header expected, found the end of the file");
    let mut fixed = [0; 8];
    file.read_exact(&mut fixed).map_err(short)?;
    let (bytes, fixed_bytes) = match fixed {
        [magic @ .., 1, _] if magic == MAGIC => {
            let mut length = [0; 2];
            file.read_exact(&mut length).map_err(short)?;
            (u32::from(u16::from_le_bytes(length)), 10)
        }
        [magic @ .., 2 | 3, _] if magic == MAGIC => {
            let mut length = [0; 4];
            file.read_exact(&mut length).map_err(short)?;
            (u32::from_le_bytes(length), 12)
        }
        _ => return Err(Error::unsupported(path, format!("NumPy format 1 to 3 expected, found bytes {fixed:02X?}"))),
    };
    if bytes > MOST_HEADER_BYTES {
        return Err(Error::broken(path, format!("a header up to {MOST_HEADER_BYTES} bytes expected, found {bytes}")));
    }
    let mut text = vec![0; bytes as usize];
    file.read_exact(&mut text).map_err(short)?;
    Ok((String::from_utf8_lossy(&text).into_owned(), fixed_bytes + u64::from(bytes)))
}

fn head(text: &str) -> String {
    text.chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::super::source::read_all;
    use super::*;
    use crate::source;
    use elunar_core::tile::Window;
    use elunar_testing::{mutate, rasterio};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn file(version: u8, header: &str, samples: &[u8]) -> Vec<u8> {
        let mut bytes = [MAGIC, &[version, 0]].concat();
        match version {
            1 => bytes.extend((header.len() as u16).to_le_bytes()),
            _ => bytes.extend((header.len() as u32).to_le_bytes()),
        }
        [&bytes, header.as_bytes(), samples].concat()
    }

    fn opened(bytes: &[u8]) -> Result<Vec<f32>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        std::fs::write(&path, bytes).unwrap();
        Ok(read_all(&*source::open(&path)?)?.samples)
    }

    #[test]
    fn versions_and_orders_are_read() {
        let header = |descr: &str| format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (1, 2), }}     \n");
        for version in 1..=3 {
            assert_eq!(opened(&file(version, &header(">i2"), &[0, 5, 0xFF, 0xFE])).unwrap(), [5.0, -2.0]);
            assert_eq!(opened(&file(version, &header("<u2"), &[5, 0, 0xFE, 0xFF])).unwrap(), [5.0, 65534.0]);
        }
        assert_eq!(opened(&file(1, &header("|i1"), &[5, 0xFE])).unwrap(), [5.0, -2.0]);
        let special = opened(&file(1, &header("<f4"), &[0xFB, 0xFF, 0x7F, 0xFF, 0, 0, 0x80, 0x3F])).unwrap();
        assert!(special[0].is_nan() && special[1] == 1.0);
    }

    #[test]
    fn what_is_not_read_is_named() {
        let header = |descr: &str, order: &str, shape: &str| {
            format!("{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}}}")
        };
        let cases = [
            (file(1, &header("'<f4'", "True", "(1, 1)"), &[0; 4]), "ascontiguousarray"),
            (file(1, &header("'<c8'", "False", "(1, 1)"), &[0; 8]), "<c8"),
            (file(1, &header("[('a', '<f4')]", "False", "(1, 1)"), &[0; 4]), "structured"),
            (file(1, &header("'<f4'", "False", "(1, 1, 1, 1)"), &[0; 4]), "[1, 1, 1, 1]"),
            (file(1, &header("'<f4'", "False", "(0, 7)"), &[]), "[0, 7]"),
            (file(1, &header("'<f4'", "False", "(2, 1)"), &[0; 4]), "2 x 1"),
            (file(1, &header("'<f4'", "False", "(18446744073709551615, 9)"), &[0; 4]), "x 9"),
            (file(1, "{}", &[0; 4]), "descr, fortran_order and shape"),
            (file(1, &header("'|i2'", "False", "(1, 2)"), &[0; 4]), "byte order < or > expected, found \"|i2\""),
            (file(9, "{}", &[]), "format 1 to 3"),
            (file(2, "{}", &[])[..9].to_vec(), "end of the file"),
            ([MAGIC, &[2, 0, 0xFF, 0xFF, 0xFF, 0xFF]].concat(), "up to 65536"),
        ];
        for (bytes, reason) in cases {
            let text = opened(&bytes).unwrap_err().to_string();
            assert!(text.contains(reason) && text.contains("a.npy"), "{text}");
        }
    }

    #[test]
    fn what_numpy_writes_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let script = "
a = (np.arange(6 * 7).reshape(6, 7) * 3)
for kind in ('<f4', '>f4', '<f8', '>f8', '|u1', '<u2', '>u2', '<i2', '>i2', '<i4', '>i4'):
    np.save(kind[1:] + ('b' if kind[0] == '>' else 'l') + '.npy', a.astype(kind))
";
        if rasterio(script, folder.path()).is_none() {
            return;
        }
        let files: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().path()).collect();
        assert_eq!(files.len(), 11);
        for path in files {
            let source = source::open(&path).unwrap();
            let window = source.read(Window { row: 2, col: 3, rows: 3, cols: 2 }).unwrap();
            assert_eq!(window, [51.0, 54.0, 72.0, 75.0, 93.0, 96.0], "{}", path.display());
        }
    }

    #[test]
    fn damaged_arrays_never_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }        \n";
        let seeds = [file(1, header, &[0x3F; 48]), file(2, &header.replace("<f4", ">u2"), &[1; 24])];
        let pieces = ["(", ")", ",", "'", "18446744073709551615", "0", "True", "<f8", "|u1", "shape", "\u{e9}", ":"];
        let mut rng = ChaCha8Rng::seed_from_u64(33);
        let (mut read, mut refused) = (0, 0);
        for round in 0..3000 {
            let mut bytes = seeds[round % 2].clone();
            mutate(&mut bytes, &pieces, &mut rng);
            std::fs::write(&path, &bytes).unwrap();
            match open(&path).and_then(|source| read_all(&*source)) {
                Ok(raster) => {
                    assert!(raster.samples.len() <= bytes.len());
                    read += 1;
                }
                Err(error) => {
                    assert!(!error.to_string().contains('\n'), "{error}");
                    refused += 1;
                }
            }
        }
        assert!(read > 100 && refused > 1000, "{read} read, {refused} refused");
    }
}
