//! One page about the folders of suites, experiments, training runs and records: a relief of all scenes, tables, hillshades, error maps, curves, with all pictures inside.

pub(crate) use elunar::html;
mod record;
mod reliefs;
mod sections;

use crate::experiment::{COMPARISON, ExperimentResults};
use crate::suite::results::{RESULTS, SuiteResults};
use elunar_base::{Error, Result, atomic_write};
use elunar_learn::train::run::RECORD;
use html::escaped;
use std::path::{Path, PathBuf};

/// Writes the page of `folders`, in their order. Each holds a suite, a comparison of experiments, a training run, or a record: CSV tables
/// with an optional text (`about.txt`) and pictures (PNG).
///
/// # Errors
/// [`Error::Input`] with the name of a folder of another kind; if a file of a folder is missing or malformed, or the page cannot be written.
pub fn write(folders: &[PathBuf], page: &Path) -> Result<()> {
    let (mut sections, mut scenes) = (String::new(), vec![]);
    for folder in folders {
        sections += &section(folder)?;
        scenes.extend(grounds(folder)?);
    }
    let mut body = format!("<h1>How good the models are</h1>\n{}{sections}", html::relief(&scenes)?);
    body += &format!("<p class=\"faint\">host-train {}</p>\n", escaped(env!("CARGO_PKG_VERSION")));
    atomic_write(page, html::document("ELunarDTM: how good the models are", &body).as_bytes())
}

/// Returns the grounds that a folder has maps of.
fn grounds(folder: &Path) -> Result<Vec<html::ReliefScene>> {
    let is_suite = folder.join(RESULTS).exists() && !folder.join(COMPARISON).exists();
    if is_suite { reliefs::of_suite(folder, &SuiteResults::read(folder)?) } else { Ok(vec![]) }
}

fn section(folder: &Path) -> Result<String> {
    if folder.join(COMPARISON).exists() {
        sections::experiments(folder, &ExperimentResults::read(folder)?)
    } else if folder.join(RESULTS).exists() {
        sections::suite(folder, &SuiteResults::read(folder)?)
    } else if folder.join(RECORD).exists() {
        sections::training(folder)
    } else if let Some(page) = record::section(folder)? {
        Ok(page)
    } else {
        let what = format!(
            "expected a folder with {RESULTS} (suite), {COMPARISON} (experiment), {RECORD} (train) or CSV tables"
        );
        Err(Error::input(format!("{}: {what}, found none of them", folder.display())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::suite::summary::tests::results;
    use elunar_picture::write_png;
    use image::{GrayImage, Luma};

    #[test]
    fn a_suite_becomes_a_page_that_needs_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let mut made = results();
        made.scenes[0].pictures = vec![("one.png".into(), "view of <one>".into())];
        made.scenes[0].remarks = "low & behold".into();
        made.write(folder.path()).unwrap();
        let page = folder.path().join("page.html");
        let missing = write(&[folder.path().into()], &page).unwrap_err().to_string();
        assert!(missing.contains("one.png") && !page.exists(), "{missing}");
        write_png(&folder.path().join("one.png"), GrayImage::from_pixel(3, 2, Luma([7]))).unwrap();
        write(&[folder.path().into()], &page).unwrap();
        let text = std::fs::read_to_string(&page).unwrap();
        for expected in [
            "data:image/png;base64,",
            "view of &lt;one&gt;",
            "low &amp; behold",
            "<td class=\"best\">1.50</td>",
            "About &lt;it&gt;.",
        ] {
            assert!(text.contains(expected), "{expected} in {text}");
        }
        // The page loads no other file.
        assert!(!text.contains("http") && !text.contains("src=\"one"), "{text}");
        // The best cell is per group of scenes, not per column: the coarse DTM of one kind does not compete with another kind.
        assert!(!text.contains("<td class=\"best\">3.00</td>"));
    }

    #[test]
    fn a_folder_of_nothing_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let refused = write(&[folder.path().into()], &folder.path().join("p.html")).unwrap_err().to_string();
        assert!(refused.contains("results.json") && refused.contains("found none"), "{refused}");
    }
}
