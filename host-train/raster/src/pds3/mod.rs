//! PDS3 images: a text label that describes raw samples, in the same file or beside it.
//!
//! [`LabelBlock`] is the label as a tree. [`open`] finds the image that a label points at. The image is read in windows, as metres above the
//! sphere, with its georeference.

mod image;
mod label;
mod lexer;
mod place;
mod pointer;
pub(super) mod sun;
pub(super) mod units;
mod value;

#[cfg(test)]
mod tests;

pub use image::open;
pub(super) use image::{image_of, open_with};
pub use label::{LabelBlock, LabelItem};
pub use pointer::label_beside;
pub(super) use pointer::resolve;
pub use value::{Value, ValueKind};

use elunar_base::{Error, Result, read};
use std::fmt;
use std::io::Read;
use std::path::Path;

/// Greatest length of a label, bytes. Labels of the archive's lunar products are below 100 kB.
pub const MOST_LABEL_BYTES: u64 = 1 << 20;

/// A defect of a label, with its line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Defect {
    /// Line of the label, counted from 1; 0 if something is missing.
    pub line: usize,
    /// What was expected and what was found.
    pub what: String,
}

impl Defect {
    pub(super) fn at(line: usize, what: impl Into<String>) -> Self {
        Self { line, what: what.into() }
    }

    pub(super) fn missing(what: impl Into<String>) -> Self {
        Self::at(0, what)
    }

    /// Makes an error about the label's file.
    fn of(self, path: &Path) -> Error {
        Error::broken(path, one_line(&self.to_string()))
    }
}

impl fmt::Display for Defect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => f.write_str(&self.what),
            line => write!(f, "line {line}: {}", self.what),
        }
    }
}

impl std::error::Error for Defect {}

/// Reason for refusing a label: it contradicts itself, or it describes something unsupported.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Refusal {
    Broken(Defect),
    Unsupported(String),
}

impl From<Defect> for Refusal {
    fn from(defect: Defect) -> Self {
        Self::Broken(defect)
    }
}

impl Refusal {
    /// Makes an error about the label's file.
    pub(super) fn of(self, path: &Path) -> Error {
        match self {
            Self::Broken(defect) => defect.of(path),
            Self::Unsupported(what) => Error::unsupported(path, one_line(&what)),
        }
    }
}

/// Replaces control characters by blanks, so that messages are one line.
pub(super) fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

/// Reads the label of a file: all of a detached label, or the beginning of an image with an attached label.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read, [`Error::Broken`] with the line and the reason if it holds no label.
pub fn read_label(path: &Path) -> Result<LabelBlock> {
    let mut bytes = Vec::new();
    read::file(path)?.take(MOST_LABEL_BYTES).read_to_end(&mut bytes).map_err(Error::io(path))?;
    LabelBlock::parse(&bytes).map_err(|defect| defect.of(path))
}

/// Returns whether a file that begins with `head` has a PDS3 label. Its first keyword is the version of the standard, or it begins with
/// transfer labels, as in older volumes.
#[must_use]
pub fn is_label(head: &[u8]) -> bool {
    if head.starts_with(b"CCSD3ZF") || head.starts_with(b"NJPL1I00PDS") {
        return true;
    }
    let mut lexer = lexer::Lexer::new(head);
    let first = ["PDS_VERSION_ID", "ODL_VERSION_ID", "LABEL_REVISION_NOTE"];
    matches!(lexer.next(), Ok(lexer::Token::Word(word)) if first.contains(&word.to_ascii_uppercase().as_str()))
        && matches!(lexer.next(), Ok(lexer::Token::Mark(b'=')))
}
