//! Reads the pages of `onboard/docs`, for the tests that compare them with the code.
#![allow(dead_code)] // each test file uses only some functions

pub(crate) mod items;

use std::path::{Path, PathBuf};

pub(crate) fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Reads a file of the repository.
pub(crate) fn read(path: &str) -> String {
    std::fs::read_to_string(repository().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Returns the text below a heading, up to the next heading of any level. `heading` is the start of the heading's text, after the hashes.
pub(crate) fn section<'p>(page: &'p str, heading: &str) -> &'p str {
    let is_heading = |line: &str| line.starts_with('#') && line.trim_start_matches('#').starts_with(' ');
    let mut at = 0;
    let mut start = None;
    for line in page.split_inclusive('\n') {
        if is_heading(line) {
            if let Some(start) = start {
                return &page[start..at];
            }
            if line.trim_start_matches('#').trim_start().starts_with(heading) {
                start = Some(at + line.len());
            }
        }
        at += line.len();
    }
    &page[start.unwrap_or_else(|| panic!("no heading '{heading}'"))..]
}

/// Returns the cells of the first table of a section: a block of text whose columns are two or more blanks apart, without its head.
pub(crate) fn table(section: &str) -> Vec<Vec<String>> {
    let lines = section.lines().skip_while(|line| *line != "```text").skip(2).take_while(|line| *line != "```");
    lines
        .map(|line| line.split("  ").map(str::trim).filter(|cell| !cell.is_empty()).map(String::from).collect())
        .collect()
}

/// Returns the rows of a table of comma-separated values, without its head. A cell in quotation marks may contain commas.
pub(crate) fn csv(table: &str) -> Vec<Vec<String>> {
    let cells = |line: &str| {
        let (mut cells, mut quoted) = (vec![String::new()], false);
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                ',' if !quoted => cells.push(String::new()),
                c => cells.last_mut().unwrap().push(c),
            }
        }
        cells
    };
    table.lines().skip(1).map(cells).collect()
}
