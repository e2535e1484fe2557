//! The head of a TIFF: its header and directories with all their values. In a cloud-optimised file, they come before the samples.

use std::collections::BTreeMap;
use tiff::tags::{Tag, Type};

/// The values of one tag.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Field {
    Short(Vec<u16>),
    Long(Vec<u32>),
    /// File offsets: 32 bits in classic files, 64 in BigTIFF.
    Offset(Vec<u64>),
    Double(Vec<f64>),
    /// ASCII without its final NUL.
    Text(String),
}

/// One image's tags by number, the order in files.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Directory(BTreeMap<u16, Field>);

impl Directory {
    /// Sets a tag and replaces its former value.
    pub(super) fn insert(&mut self, tag: Tag, field: Field) {
        self.0.insert(tag.to_u16(), field);
    }
}

impl<const N: usize> From<[(Tag, Field); N]> for Directory {
    fn from(tags: [(Tag, Field); N]) -> Self {
        Self(tags.into_iter().map(|(tag, field)| (tag.to_u16(), field)).collect())
    }
}

impl Field {
    /// Returns the type, the count, and the bytes, little-endian.
    fn encode(&self, big: bool) -> (Type, usize, Vec<u8>) {
        match self {
            Self::Short(v) => (Type::SHORT, v.len(), v.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Self::Long(v) => (Type::LONG, v.len(), v.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Self::Offset(v) if big => (Type::LONG8, v.len(), v.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Self::Offset(v) => (Type::LONG, v.len(), v.iter().flat_map(|&v| (v as u32).to_le_bytes()).collect()),
            Self::Double(v) => (Type::DOUBLE, v.len(), v.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Self::Text(text) => (Type::ASCII, text.len() + 1, [text.as_bytes(), &[0]].concat()),
        }
    }
}

/// Returns header and directories. The length depends only on the counts in `images`, not on the values. A first call gives the length, so
/// that offsets can be filled in for a second call.
pub(super) fn head(images: &[Directory], big: bool) -> Vec<u8> {
    let word = |value: u64| if big { value.to_le_bytes().to_vec() } else { (value as u32).to_le_bytes().to_vec() };
    let mut out = if big { b"II\x2b\0\x08\0\0\0".to_vec() } else { b"II\x2a\0".to_vec() };
    let first = out.len() + word(0).len();
    out.extend(word(first as u64));
    for (index, tags) in images.iter().enumerate() {
        let (count_bytes, entry_bytes) = if big { (8, 20) } else { (2, 12) };
        let values_at = out.len() + count_bytes + entry_bytes * tags.0.len() + word(0).len();
        let mut values = Vec::new();
        out.extend(&(tags.0.len() as u64).to_le_bytes()[..count_bytes]);
        for (tag, field) in &tags.0 {
            let (kind, count, mut bytes) = field.encode(big);
            out.extend(tag.to_le_bytes());
            out.extend(kind.to_u16().to_le_bytes());
            out.extend(word(count as u64));
            if bytes.len() <= word(0).len() {
                bytes.resize(word(0).len(), 0);
                out.extend(bytes);
            } else {
                values.resize((values_at + values.len()).next_multiple_of(8) - values_at, 0);
                out.extend(word((values_at + values.len()) as u64));
                values.extend(bytes);
            }
        }
        values.resize((values_at + values.len()).next_multiple_of(8) - values_at, 0);
        let next = if index + 1 < images.len() { (values_at + values.len()) as u64 } else { 0 };
        out.extend(word(next));
        out.extend(values);
    }
    out
}
