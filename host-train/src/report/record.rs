//! A record: a folder with tables as CSV, a text about them (`about.txt`) and pictures (PNG).

use super::html::{Picture, escaped, figure};
use super::sections::html;
use crate::suite::tables::TextTable;
use elunar_base::{Error, Result, read};
use std::path::{Path, PathBuf};

/// The text of a record. Its first line is the title.
const ABOUT: &str = "about.txt";

/// Returns the section about a folder with CSV tables; `None` for a folder without.
///
/// # Errors
/// If a file cannot be read, or is no table.
pub(super) fn section(folder: &Path) -> Result<Option<String>> {
    let tables = files(folder, "csv")?;
    if tables.is_empty() {
        return Ok(None);
    }
    let about = folder.join(ABOUT);
    let about = if about.exists() { read::text(&about, read::MOST_SETTINGS_BYTES)? } else { String::new() };
    let mut lines = about.lines();
    let title = lines.next().map_or_else(|| folder.display().to_string(), Into::into);
    let mut body = format!("<h2>{}</h2>\n", escaped(&title));
    lines.for_each(|line| body += &format!("<p>{}</p>\n", escaped(line)));
    for path in &tables {
        body += &format!("<h3>{}</h3>\n{}", escaped(&stem(path)), html(&read(path)?));
    }
    for file in files(folder, "png")? {
        let caption = stem(&file);
        body += &figure(&Picture { file, caption })?;
    }
    Ok(Some(body))
}

/// Returns the files of a folder with this extension, in the order of their names.
fn files(folder: &Path, extension: &str) -> Result<Vec<PathBuf>> {
    let mut found = vec![];
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let path = entry.map_err(Error::io(folder))?.path();
        if path.extension().is_some_and(|end| end == extension) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Reads a table with a head line and rows of the same length.
fn read(path: &Path) -> Result<TextTable> {
    let text = read::bytes(path, read::MOST_BYTES)?;
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(text.as_slice());
    let mut rows = vec![];
    for row in reader.records() {
        let row = row.map_err(|e| Error::broken(path, e.to_string()))?;
        rows.push(row.iter().map(String::from).collect::<Vec<_>>());
    }
    if rows.is_empty() {
        return Err(Error::broken(path, "expected a head line, found nothing"));
    }
    Ok(TextTable { heading: rows.remove(0), rows })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_with_their_text_become_a_section() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        assert!(section(folder.path()).unwrap().is_none());
        file("b.csv", "kernel,ms\n\"a, b\",1.5\n");
        file("a.csv", "scenes,RMSE\nmare,2\nmare,1\n");
        file(ABOUT, "What <it> is\nCommand: x & y\n");
        let page = section(folder.path()).unwrap().unwrap();
        for expected in
            ["<h2>What &lt;it&gt; is</h2>", "<p>Command: x &amp; y</p>", "<td>a, b</td>", "<td class=\"best\">1</td>"]
        {
            assert!(page.contains(expected), "{expected} in {page}");
        }
        assert!(page.find("<h3>a</h3>") < page.find("<h3>b</h3>"));
    }

    #[test]
    fn what_is_no_table_is_named() {
        let folder = tempfile::tempdir().unwrap();
        for text in ["", "a,b\n1\n", "a,b\n1,2,3\n"] {
            std::fs::write(folder.path().join("t.csv"), text).unwrap();
            let refused = section(folder.path()).map(|_| ()).unwrap_err().to_string();
            assert!(refused.contains("t.csv: broken file"), "{refused}");
        }
    }
}
