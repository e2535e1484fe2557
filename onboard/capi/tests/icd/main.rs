//! Compares the tables of `onboard/docs/icd.md` with the code. A reader that uses only the numbers of the page reads the shipped model.

mod abi;
mod file;
#[path = "../pages/mod.rs"]
mod pages;
mod reader;

use pages::{read, section, table};

pub(crate) fn page() -> String {
    read("onboard/docs/icd.md")
}

pub(crate) fn number(text: &str) -> u64 {
    text.parse().unwrap_or_else(|_| panic!("expected a number, found '{text}'"))
}

/// Returns a table whose first column is a number and whose second is a name.
pub(crate) fn numbered(heading: &str) -> Vec<(u64, String)> {
    let rows = table(section(&page(), heading));
    rows.iter().map(|row| (number(&row[0]), row[1].clone())).collect()
}
