//! HTML elements of a page, and the style that all pages share.

mod packed;
mod relief;

use base64::Engine;
use elunar_base::{Result, read};
pub use relief::{LONGEST_PX, LayerRole, ReliefLayer, ReliefScene, relief};
use std::path::PathBuf;

/// A picture in a page.
pub struct Picture {
    /// The PNG file.
    pub file: PathBuf,
    /// Caption of the picture.
    pub caption: String,
}

/// Returns a whole document, with its style inside.
#[must_use]
pub fn document(title: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en-GB\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{}</title>\n<style>\n{}</style>\n</head>\n<body>\n<main>\n{body}</main>\n</body>\n</html>\n",
        escaped(title),
        include_str!("style.css")
    )
}

/// Escapes text for an element or a quoted attribute.
#[must_use]
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Returns a picture with its caption. The page contains its bytes.
///
/// # Errors
/// [`Error::Io`] if the picture cannot be read.
pub fn figure(picture: &Picture) -> Result<String> {
    let bytes = read::bytes(&picture.file, read::MOST_BYTES)?;
    let data = base64::engine::general_purpose::STANDARD.encode(bytes);
    let caption = escaped(&picture.caption);
    Ok(format!(
        "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>\n"
    ))
}

/// Returns a table. The first cell of a row is its heading. `best` cells are marked. The table scrolls if the page is narrower.
#[must_use]
pub fn table(heading: &[&str], rows: &[Vec<Cell>]) -> String {
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
pub struct Cell {
    /// Text of the cell.
    pub text: String,
    /// Whether it is the best of its row.
    pub best: bool,
}

impl Cell {
    /// Makes a cell that is not the best of its row.
    #[must_use]
    pub fn plain(text: impl Into<String>) -> Self {
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
