//! Uncompressed samples without gaps, row after row. Any rows can be read separately.
//!
//! Many programs write a whole image as a single strip; others write each row as a strip. Read strip by strip, the former would fill the
//! memory, and the latter would take thousands of small steps.

use super::handle::Handle;
use elunar_base::{Error, Result};
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use tiff::decoder::DecodingResult;
use tiff::tags::ByteOrder;

/// The type of a sample: `u`, `i` or `f`, and its bits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SampleKind {
    pub(super) letter: char,
    pub(super) bits: u16,
}

/// Reads `count` samples from byte `at` on; `None` for types without a Rust equivalent.
pub(super) fn read(file: &mut Handle, kind: SampleKind, at: u64, count: usize) -> Result<Option<DecodingResult>> {
    let little = file.tiff.byte_order() == ByteOrder::LittleEndian;
    let mut bytes = vec![0; count * usize::from(kind.bits / 8)];
    let reader = file.tiff.inner();
    reader.seek(SeekFrom::Start(at)).and_then(|_| reader.read_exact(&mut bytes)).map_err(|e| match e.kind() {
        ErrorKind::UnexpectedEof => Error::broken(&file.path, "the file ends too early"),
        _ => Error::Io { path: file.path.clone(), source: e },
    })?;
    macro_rules! numbers {
        ($variant:ident, $type:ty) => {{
            let each = |&b| if little { <$type>::from_le_bytes(b) } else { <$type>::from_be_bytes(b) };
            DecodingResult::$variant(bytes.as_chunks().0.iter().map(each).collect())
        }};
    }
    Ok(Some(match (kind.letter, kind.bits) {
        ('u', 8) => DecodingResult::U8(bytes),
        ('i', 8) => numbers!(I8, i8),
        ('u', 16) => numbers!(U16, u16),
        ('i', 16) => numbers!(I16, i16),
        ('u', 32) => numbers!(U32, u32),
        ('i', 32) => numbers!(I32, i32),
        ('f', 32) => numbers!(F32, f32),
        ('f', 64) => numbers!(F64, f64),
        _ => return Ok(None),
    }))
}
