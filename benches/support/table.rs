//! Tables: printed as Markdown, kept as CSV.

use elunar_base::table::to_csv;
use std::path::{Path, PathBuf};

/// Names the folder that tables are written to; else they lie in the target directory.
pub const FOLDER_VARIABLE: &str = "ELUNAR_BENCH_TABLES";

/// A table: a head and rows of as many cells.
#[derive(Debug, Clone)]
pub struct Table {
    name: String,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// With its name, which becomes that of a file, and the names of its columns.
    #[must_use]
    pub fn new(name: &str, head: &[&str]) -> Self {
        Self { name: name.into(), rows: vec![head.iter().map(ToString::to_string).collect()] }
    }

    /// Adds a row.
    pub fn row(&mut self, cells: Vec<String>) {
        self.rows.push(cells);
    }

    /// As Markdown, under its name.
    fn markdown(&self) -> String {
        let mut lines: Vec<String> = self.rows.iter().map(|cells| format!("| {} |", cells.join(" | "))).collect();
        let rule = vec!["---"; self.rows.first().map_or(0, Vec::len)];
        lines.insert(1, format!("| {} |", rule.join(" | ")));
        format!("{}\n\n{}\n", self.name, lines.join("\n"))
    }
}

/// A number with `digits` decimals; nothing where there is none.
#[must_use]
pub fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(String::new, |v| format!("{v:.digits$}"))
}

/// Prints `tables` and writes each to `<folder>/<name>.csv`. The folder is that of [`FOLDER_VARIABLE`], or `target`, the caller's
/// `CARGO_TARGET_TMPDIR`.
///
/// # Panics
/// If a file cannot be written, or rows differ in length.
pub fn publish(target: &str, tables: &[Table]) {
    let folder = std::env::var_os(FOLDER_VARIABLE).map_or_else(|| Path::new(target).join("tables"), PathBuf::from);
    std::fs::create_dir_all(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    for table in tables {
        println!("{}", table.markdown());
        let path = folder.join(format!("{}.csv", table.name));
        let text = to_csv(&table.rows).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        std::fs::write(&path, text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        println!("table: {}", path.display());
    }
}
