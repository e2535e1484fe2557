//! `^IMAGE`: the file, and the offset in it.

use super::label::{LabelBlock, LabelItem};
use super::value::{Value, ValueKind};
use super::{Defect, one_line, read_label};
use elunar_base::{Error, Result, folder_of};
use std::path::{Path, PathBuf};

/// Target of an `^IMAGE`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Pointer {
    /// Name of the file; `None` for the label's own file.
    pub(super) file: Option<String>,
    /// First byte of the image, counted from 0.
    pub(super) start: u64,
}

impl Pointer {
    /// Reads the five forms: `n`, `n <BYTES>`, `"F"`, `("F", n)`, `("F", n <BYTES>)`. Records and bytes are counted from 1. A record has
    /// `record_bytes` bytes.
    pub(super) fn parse(item: &LabelItem, record_bytes: Option<u64>) -> std::result::Result<Self, Defect> {
        let members = item.value.members();
        let (file, place) = match members {
            [file] if file.text().is_some() => (file.text(), None),
            [place] => (None, Some(place)),
            [file, place] if file.text().is_some() => (file.text(), Some(place)),
            _ => return Err(Defect::at(item.line, format!("{} as \"FILE\", n or (\"FILE\", n) expected", item.key))),
        };
        let start = place.map_or(Ok(0), |place| Self::start(item, place, record_bytes))?;
        Ok(Self { file: file.map(str::to_owned), start })
    }

    /// Returns whether both point into one file. In copied archives, names may differ in case.
    pub(super) fn same_file(&self, other: &Self) -> bool {
        match (&self.file, &other.file) {
            (Some(a), Some(b)) => a.eq_ignore_ascii_case(b),
            (a, b) => a == b,
        }
    }

    fn start(item: &LabelItem, place: &Value, record_bytes: Option<u64>) -> std::result::Result<u64, Defect> {
        let refuse = |what: String| Defect::at(item.line, what);
        let count = match place.kind {
            ValueKind::Integer(n) | ValueKind::Based { value: n, .. } => {
                u64::try_from(n).ok().and_then(|n| n.checked_sub(1))
            }
            _ => None,
        };
        let Some(count) = count else {
            return Err(refuse(format!("{} from record or byte 1 on expected, found {:?}", item.key, place.kind)));
        };
        let size = match &place.unit {
            Some(unit) if unit.eq_ignore_ascii_case("BYTES") || unit.eq_ignore_ascii_case("BYTE") => 1,
            Some(unit) if !unit.eq_ignore_ascii_case("RECORDS") => {
                return Err(refuse(format!("{} in <BYTES> or records expected, found <{unit}>", item.key)));
            }
            _ if count == 0 => 0,
            _ => record_bytes
                .ok_or_else(|| refuse(format!("RECORD_BYTES for {} in records expected, found none", item.key)))?,
        };
        count.checked_mul(size).ok_or_else(|| refuse(format!("{} within 2^64 bytes expected", item.key)))
    }
}

/// An image's pointer and the blocks around it, innermost first. Sizes and names are stated near their pointer.
pub(super) struct Found<'a> {
    pub(super) item: &'a LabelItem,
    pub(super) around: Vec<&'a LabelBlock>,
}

impl<'a> Found<'a> {
    /// Finds the first `^IMAGE` that points at plain samples. A COMPRESSED_FILE object describes the same image in compressed form.
    pub(super) fn in_label(label: &'a LabelBlock) -> std::result::Result<Option<Self>, Defect> {
        if label.name == "COMPRESSED_FILE" {
            return Ok(None);
        }
        if let Some(item) = label.find("^IMAGE")? {
            return Ok(Some(Self { item, around: vec![label] }));
        }
        for block in &label.blocks {
            if let Some(mut found) = Self::in_label(block)? {
                found.around.push(label);
                return Ok(Some(found));
            }
        }
        Ok(None)
    }

    /// Returns the item of `key` in the nearest block around the pointer that states it.
    pub(super) fn nearest(&self, key: &str) -> std::result::Result<Option<&'a LabelItem>, Defect> {
        for block in &self.around {
            if let Some(item) = block.find(key)? {
                return Ok(Some(item));
            }
        }
        Ok(None)
    }

    /// Returns the nearest `OBJECT` of that name.
    pub(super) fn object(&self, name: &str) -> Option<&'a LabelBlock> {
        self.around
            .iter()
            .find_map(|block| block.blocks.iter().find(|inner| inner.name == name).or_else(|| block.block(name)))
    }
}

/// Finds the file `name`, as `key` of the label states it, in the folder of the label, in any case. Archives were copied from systems without
/// case.
pub(crate) fn resolve(label: &Path, key: &str, name: &str) -> Result<PathBuf> {
    if name.contains(['/', '\\']) {
        return Err(Error::unsupported(label, format!("a file beside the label expected, {key} names {name:?}")));
    }
    let folder = folder_of(label);
    let exact = folder.join(name);
    if exact.exists() {
        return Ok(exact);
    }
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder))?;
    let mut others =
        entries.flatten().filter(|e| e.file_name().to_string_lossy().eq_ignore_ascii_case(name)).map(|e| e.path());
    let missing =
        || Error::input(format!("{}: {key} names {}, no such file beside the label", label.display(), one_line(name)));
    others.next().ok_or_else(missing)
}

/// Finds the label of an image file without an attached label: `NAME.LBL` in the same folder, in any case, whose ^IMAGE names the file.
///
/// # Errors
/// From reading the folder or the label.
pub fn label_beside(image: &Path) -> Result<Option<PathBuf>> {
    let Some((name, stem)) = image.file_name().zip(image.file_stem()) else { return Ok(None) };
    let (name, wanted) = (name.to_string_lossy(), format!("{}.lbl", stem.to_string_lossy()));
    let folder = folder_of(image);
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder))?;
    let beside = entries.flatten().filter(|e| e.file_name().to_string_lossy().eq_ignore_ascii_case(&wanted));
    let Some(label) = beside.map(|e| e.path()).find(|path| path != image) else { return Ok(None) };
    let tree = read_label(&label)?;
    let names_image = |found: Found| {
        let stated = found.around.iter().flat_map(|block| &block.items).filter(|item| item.key == "FILE_NAME");
        let mut names = found.item.value.members().iter().chain(stated.map(|item| &item.value));
        names.any(|value| value.text().is_some_and(|text| text.eq_ignore_ascii_case(&name)))
    };
    let found = Found::in_label(&tree).map_err(|defect| defect.of(&label))?;
    Ok(found.is_some_and(names_image).then_some(label))
}
