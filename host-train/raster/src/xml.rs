//! Elements of an XML file, by their names without prefixes, with their lines.

use super::pds3::{Defect, one_line};
use elunar_base::{Error, Result, read};
use roxmltree::{Document, Node};
use std::path::Path;
use std::str::FromStr;

/// Greatest length of an XML file, bytes (our choice). Labels have up to a few hundred kilobytes, a VRT of a thousand files half a megabyte.
const MOST_XML_BYTES: u64 = 1 << 24;

/// Most elements, attributes and texts of an XML file (our choice).
const MOST_NODES: u32 = 1 << 20;

/// Reads the text of an XML file.
///
/// # Errors
/// As [`read::bytes`]; [`Error::Broken`] if it is not UTF-8.
pub(crate) fn text(path: &Path) -> Result<String> {
    let bytes = read::bytes(path, MOST_XML_BYTES)?;
    String::from_utf8(bytes).map_err(|_| Error::broken(path, "XML in UTF-8 expected, found other bytes"))
}

/// Reads a text as a tree. Declarations of types (DTD) are refused.
///
/// # Errors
/// [`Error::Broken`] with the line.
pub(crate) fn tree<'a>(path: &Path, text: &'a str) -> Result<Document<'a>> {
    let options = roxmltree::ParsingOptions { nodes_limit: MOST_NODES, ..Default::default() };
    let broken = |error: roxmltree::Error| Error::broken(path, one_line(&format!("XML expected, found: {error}")));
    Document::parse_with_options(text, options).map_err(broken)
}

/// An element of a file.
#[derive(Clone, Copy)]
pub(crate) struct Element<'a>(pub(crate) Node<'a, 'a>);

impl<'a> Element<'a> {
    pub(crate) fn name(self) -> &'a str {
        self.0.tag_name().name()
    }

    pub(crate) fn line(self) -> usize {
        self.0.document().text_pos_at(self.0.range().start).row as usize
    }

    /// Returns the elements directly in this one.
    pub(crate) fn children(self) -> impl Iterator<Item = Self> {
        self.0.children().filter(Node::is_element).map(Self)
    }

    /// Returns the first element of that name directly in this one.
    pub(crate) fn child(self, name: &str) -> Option<Self> {
        self.children().find(|child| child.name() == name)
    }

    /// Returns all elements of that name in this one, at any depth.
    pub(crate) fn all(self, name: &str) -> impl Iterator<Item = Self> {
        self.0.descendants().filter(move |node| node.is_element() && node.tag_name().name() == name).map(Self)
    }

    /// Returns the first element of that name in this one, at any depth.
    pub(crate) fn inside(self, name: &str) -> Option<Self> {
        self.all(name).next()
    }

    pub(crate) fn text(self) -> &'a str {
        self.0.text().unwrap_or("").trim()
    }

    pub(crate) fn attribute(self, name: &str) -> Option<&'a str> {
        self.0.attribute(name).map(str::trim)
    }

    /// Returns the first element of that name directly in this one, which must be there.
    pub(crate) fn required(self, name: &str) -> std::result::Result<Self, Defect> {
        self.child(name).ok_or_else(|| self.lacks(name))
    }

    /// Makes a defect: nothing of that name is in this element.
    pub(crate) fn lacks(self, name: &str) -> Defect {
        Defect::at(self.line(), format!("{name} in {} expected, found none", self.name()))
    }

    /// Returns the text as a finite number.
    pub(crate) fn number(self) -> std::result::Result<f64, Defect> {
        parsed(self, self.name(), self.text()).and_then(|number: f64| match number.is_finite() {
            true => Ok(number),
            false => {
                Err(Defect::at(self.line(), format!("a finite number as {} expected, found {number}", self.name())))
            }
        })
    }

    /// Returns the text as a count.
    pub(crate) fn count(self) -> std::result::Result<u64, Defect> {
        parsed(self, self.name(), self.text())
    }

    /// Returns an attribute as a number, which must be there.
    pub(crate) fn number_of<T: FromStr>(self, attribute: &str) -> std::result::Result<T, Defect> {
        let text = self.attribute(attribute).ok_or_else(|| self.lacks(attribute))?;
        parsed(self, attribute, text)
    }
}

fn parsed<T: FromStr>(element: Element, what: &str, text: &str) -> std::result::Result<T, Defect> {
    let short: String = text.chars().take(40).collect();
    text.parse().map_err(|_| Defect::at(element.line(), format!("a number as {what} expected, found {short:?}")))
}
