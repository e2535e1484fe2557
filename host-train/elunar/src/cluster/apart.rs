//! No item may write what another item, or it itself, reads or writes.

use super::manifest::BatchManifest;
use crate::outputs::OutputTarget;
use crate::outputs::uses::{Clash, Uses};
use elunar_base::{Error, Result};
use elunar_net::shipped;
use std::fmt;
use std::path::Path;

/// Who reads or writes a file: a field of a line, or something else of the command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct User {
    /// Line of the manifest; 0 for what is no item's.
    line: usize,
    field: &'static str,
}

impl User {
    /// Names what is no item's, such as an option.
    #[must_use]
    pub fn other(field: &'static str) -> Self {
        Self { line: 0, field }
    }
}

impl fmt::Display for User {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { line, field } = self;
        if *line == 0 { write!(f, "{field}") } else { write!(f, "line {line}, field {field}") }
    }
}

/// Returns all files that the items of a manifest read and write.
#[must_use]
pub fn uses(manifest: &BatchManifest) -> Uses<User> {
    let (mut uses, at) = (Uses::default(), |path: &Path| manifest.folder.join(path));
    for (line, item) in &manifest.items {
        let user = |field| User { line: *line, field };
        uses.write(&OutputTarget::Dtm(&at(&item.output)).files(), user("output"));
        if let Some(path) = item.uncertainty() {
            uses.write(&OutputTarget::Errors(&at(path)).files(), user("options.uncertainty"));
        }
        for (path, field) in [(&item.image, "image"), (&item.coarse, "coarse")] {
            uses.read(&at(path), user(field));
        }
        // A shipped model is no file.
        if shipped::find(&item.model).is_none() {
            uses.read(&item.model_at(&manifest.folder), user("model"));
        }
    }
    uses
}

/// Refuses uses of which one writes what another reads or writes. `manifest` is its path.
///
/// # Errors
/// [`Error::Broken`] with both lines; [`Error::Usage`] if the writer is no item.
pub fn check(manifest: &Path, uses: Uses<User>) -> Result<()> {
    let Some(Clash { path, written_by, other, is_read }) = uses.clash() else { return Ok(()) };
    let does = if is_read { "is read" } else { "is also written" };
    let what = format!(
        "{written_by}: {} would be written, which {does} by {other}; an output must not overwrite an input or another output",
        path.display()
    );
    Err(if written_by.line == 0 { Error::usage(what) } else { Error::broken(manifest, what) })
}

#[cfg(test)]
mod tests {
    use super::super::item::BatchItem;
    use super::*;
    use std::path::PathBuf;

    fn item(image: &str, output: &str) -> BatchItem {
        let [image, coarse, model, output] = [image, "c.tif", "m.eld", output].map(PathBuf::from);
        BatchItem { id: "a".into(), image, coarse, model, output, ..BatchItem::default() }
    }

    fn refused(folder: &Path, items: &[BatchItem]) -> Option<String> {
        let manifest = BatchManifest { folder: folder.into(), items: (1..).zip(items.iter().cloned()).collect() };
        check(Path::new("m.jsonl"), uses(&manifest)).err().map(|error| error.to_string())
    }

    #[test]
    fn every_file_of_an_output_is_kept_from_every_item() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        assert_eq!(refused(at, &[item("a.tif", "d/a.tif"), item("b.tif", "d/b.tif")]), None);
        let ends =
            [".tif", ".tif.lock", ".tif.part", ".tif.sha256", ".tif.survey", ".tif.survey.lock", "_hillshade.png"];
        for end in ends {
            let image = format!("d/b{end}");
            let text = refused(at, &[item(&image, "d/a.tif"), item("b.tif", "d/b.tif")]).unwrap();
            let expected = format!(
                "line 2, field output: {}/d/b{end} would be written, which is read by line 1, field image",
                at.display()
            );
            assert!(text.contains(&expected), "{text}");
        }
        for coarse_or_model in ["c.tif", "m.eld"] {
            let mut wrong = [item("a.tif", "d/a.tif"), item("b.tif", "c.tif")];
            wrong[1].model = coarse_or_model.into();
            assert!(refused(at, &wrong).unwrap().contains("line 2, field output"), "{coarse_or_model}");
        }
        let errors = |path: &str| [("uncertainty".to_string(), path.into())].into();
        let wrong = [item("a.tif", "d/a.tif"), BatchItem { options: errors("a.tif"), ..item("b.tif", "d/b.tif") }];
        assert!(refused(at, &wrong).unwrap().contains("line 2, field options.uncertainty"));
        let wrong = [item("a.tif", "d/a.tif"), BatchItem { options: errors("d/a.tif"), ..item("b.tif", "d/b.tif") }];
        let text = refused(at, &wrong).unwrap();
        assert!(text.contains("which is also written by line 1, field output"), "{text}");
    }

    #[test]
    fn a_hundred_thousand_items_take_seconds() {
        let folder = tempfile::tempdir().unwrap();
        let mut items: Vec<BatchItem> =
            (0..100_000).map(|i| item(&format!("images/{i}.tif"), &format!("dtms/{i}.tif"))).collect();
        std::fs::create_dir(folder.path().join("images")).unwrap();
        let start = std::time::Instant::now();
        assert_eq!(refused(folder.path(), &items), None);
        items[7].image = "dtms/99999_hillshade.png".into();
        let text = refused(folder.path(), &items).unwrap();
        assert!(text.contains("line 100000, field output") && text.contains("line 8, field image"), "{text}");
        // Pairs would take hours.
        assert!(start.elapsed() < std::time::Duration::from_secs(60), "{:?}", start.elapsed());
    }
}
