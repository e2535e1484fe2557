//! The few pieces of HTML a page is made of.

use base64::Engine;
use elunar_raster::{Error, Result};
use std::path::PathBuf;

/// A picture of a page.
pub(crate) struct Picture {
    /// The PNG file.
    pub file: PathBuf,
    /// What it shows.
    pub caption: String,
}

/// A whole document, its style inside.
pub(crate) fn document(title: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en-GB\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{}</title>\n<style>\n{}</style>\n</head>\n<body>\n<main>\n{body}</main>\n</body>\n</html>\n",
        escaped(title),
        include_str!("style.css")
    )
}

/// Text that may stand in an element or a quoted attribute.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A picture with its caption, its bytes inside the page.
///
/// # Errors
/// [`Error::Io`] if the picture cannot be read.
pub(crate) fn figure(picture: &Picture) -> Result<String> {
    let bytes = std::fs::read(&picture.file).map_err(Error::io(&picture.file))?;
    let data = base64::engine::general_purpose::STANDARD.encode(bytes);
    let caption = escaped(&picture.caption);
    Ok(format!(
        "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>\n"
    ))
}

/// A table; the first cell of a row is its heading. `best` cells are marked. It scrolls where the page is narrower.
pub(crate) fn table(heading: &[&str], rows: &[Vec<Cell>]) -> String {
    let head: String = heading.iter().map(|text| format!("<th>{}</th>", escaped(text))).collect();
    let body: String = rows
        .iter()
        .map(|row| {
            let cells: String = row
                .iter()
                .map(|cell| {
                    let class = if cell.best { " class=\"best\"" } else { "" };
                    format!("<td{class}>{}</td>", escaped(&cell.text))
                })
                .collect();
            format!("<tr>{cells}</tr>\n")
        })
        .collect();
    format!("<div class=\"wide\"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table></div>\n")
}

/// One cell of a table.
pub(crate) struct Cell {
    /// What it says.
    pub text: String,
    /// Whether it is the best of its row.
    pub best: bool,
}

impl Cell {
    /// A cell that is nothing special.
    pub(crate) fn plain(text: impl Into<String>) -> Self {
        Self { text: text.into(), best: false }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_become_markup() {
        assert_eq!(escaped("a<b>&\"c\""), "a&lt;b&gt;&amp;&quot;c&quot;");
        let cell = Cell { text: "<1".into(), best: true };
        let made = table(&["x & y"], &[vec![cell]]);
        assert!(made.contains("<td class=\"best\">&lt;1</td>") && made.contains("<th>x &amp; y</th>"));
    }
}
