//! Tables in Markdown, printed and stored in a file.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Name of the variable with the folder for tables; the default is in the target directory.
pub const FOLDER_VARIABLE: &str = "ELUNAR_BENCH_TABLES";

/// A table: a head and rows, all with the same number of cells.
#[derive(Debug, Clone, Default)]
pub struct Table {
    text: String,
}

impl Table {
    /// Makes a table with these column names.
    #[must_use]
    pub fn new(head: &[&str]) -> Self {
        let mut table = Self::default();
        table.row(&head.iter().map(ToString::to_string).collect::<Vec<_>>());
        table.row(&vec!["---".to_string(); head.len()]);
        table
    }

    /// Adds a row.
    pub fn row(&mut self, cells: &[String]) {
        let _ = writeln!(self.text, "| {} |", cells.join(" | ")); // writing to a String cannot fail
    }

    /// Returns the table as Markdown, followed by an empty line.
    #[must_use]
    pub fn text(&self) -> String {
        format!("{}\n", self.text)
    }
}

/// Formats a number with `digits` decimals, or a dash for `None`.
#[must_use]
pub fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "–".into(), |v| format!("{v:.digits$}"))
}

/// Prints `text` and writes it to `<folder>/<name>.md`. The folder is that of [`FOLDER_VARIABLE`], or a subfolder of `target`, the caller's
/// `CARGO_TARGET_TMPDIR`.
///
/// # Panics
/// If the file cannot be written.
pub fn publish(target: &str, name: &str, text: &str) {
    println!("{text}");
    let folder = std::env::var_os(FOLDER_VARIABLE).map_or_else(|| Path::new(target).join("tables"), PathBuf::from);
    std::fs::create_dir_all(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let path = folder.join(format!("{name}.md"));
    std::fs::write(&path, text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    println!("tables: {}", path.display());
}
