//! A manifest: JSON lines, one an image. All lines are checked before anything starts.

use super::item::BatchItem;
use elunar_base::{Error, Result, folder_of, read};
use elunar_scene::predict::span::PartOf;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// A manifest that was read and checked.
#[derive(Debug, Clone, PartialEq)]
pub struct BatchManifest {
    /// The folder that paths of the manifest start from, if they are not absolute.
    pub folder: PathBuf,
    /// The items with the numbers of their lines.
    pub items: Vec<(usize, BatchItem)>,
}

impl BatchManifest {
    /// Reads a manifest. Empty lines are left out.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read; [`Error::Broken`] with line and field if a line is wrong, or has the name of another.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(path, &read::text(path, read::MOST_BYTES)?)
    }

    /// Reads the text of the manifest at `path`, which need not be there.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(path: &Path, text: &str) -> Result<Self> {
        let (mut items, mut ids) = (vec![], HashMap::new());
        for (line, text) in (1..).zip(text.lines()).filter(|(_, text)| !text.trim().is_empty()) {
            let wrong = |(field, what)| Error::broken(path, format!("line {line}, field {field}: {what}"));
            let item = BatchItem::parse(text).map_err(wrong)?;
            if let Some(other) = ids.insert(item.id.clone(), line) {
                return Err(wrong(("id".into(), format!("another than that of line {other} expected"))));
            }
            items.push((line, item));
        }
        if items.is_empty() {
            return Err(Error::broken(path, "a line at least expected, none found"));
        }
        Ok(Self { folder: folder_of(path).to_path_buf(), items })
    }

    /// Returns the items of a chunk: every n-th line, so that neighbours of one size spread over all chunks.
    #[must_use]
    pub fn chunk(&self, chunk: PartOf) -> Vec<&(usize, BatchItem)> {
        self.items.iter().skip(chunk.k - 1).step_by(chunk.n).collect()
    }
}

/// Returns items as the text of a manifest.
///
/// # Errors
/// [`Error::Usage`] if JSON cannot represent a number.
pub fn text<'a>(items: impl IntoIterator<Item = &'a BatchItem>) -> Result<String> {
    let line = |item: &BatchItem| serde_json::to_string(item).map(|line| line + "\n");
    items
        .into_iter()
        .map(line)
        .collect::<std::result::Result<_, _>>()
        .map_err(|e| Error::usage(format!("manifest: {e}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn item(id: &str) -> BatchItem {
        let [image, coarse, model] = ["i.tif", "c.tif", "m.eld"].map(PathBuf::from);
        BatchItem { id: id.into(), image, coarse, model, output: format!("{id}.tif").into(), ..BatchItem::default() }
    }

    #[test]
    fn lines_are_read_and_chunks_cover_them_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.jsonl");
        let items: Vec<BatchItem> = (0..7).map(|i| item(&format!("i{i}"))).collect();
        std::fs::write(&path, text(&items).unwrap().replace("\n{\"id\":\"i3\"", "\n\n{\"id\":\"i3\"")).unwrap();
        let manifest = BatchManifest::read(&path).unwrap();
        assert_eq!(manifest.items.iter().map(|(_, item)| item.clone()).collect::<Vec<_>>(), items);
        assert_eq!(manifest.items[3].0, 5, "empty lines count as lines");
        for n in [1, 2, 3, 9] {
            let mut all: Vec<&str> =
                (1..=n).flat_map(|k| manifest.chunk(PartOf { k, n })).map(|(_, item)| item.id.as_str()).collect();
            all.sort_unstable();
            assert_eq!(all, ["i0", "i1", "i2", "i3", "i4", "i5", "i6"], "{n}");
        }
    }

    #[test]
    fn a_wrong_line_is_named_by_line_and_field() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.jsonl");
        let refused = |content: String| {
            std::fs::write(&path, content).unwrap();
            BatchManifest::read(&path).unwrap_err().to_string()
        };
        let good = text(&[item("a"), item("b")]).unwrap();
        let error =
            refused(good.replace(
                "\"image\":\"i.tif\",\"coarse\":\"c.tif\",\"model\":\"m.eld\",\"output\":\"b",
                "\"output\":\"b",
            ));
        assert!(error.contains("m.jsonl: broken file: line 2, field image: a text expected, none found"), "{error}");
        let error = refused(good.replace("\"id\":\"b\"", "\"id\":\"a\""));
        assert!(error.contains("line 2, field id: another than that of line 1"), "{error}");
        assert!(refused("\n".into()).contains("a line at least"));
    }
}
