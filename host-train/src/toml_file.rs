//! Settings in TOML files. An error is one line with file, line and reason.

use elunar_base::{Error, Result, read};
use serde::de::DeserializeOwned;
use std::path::Path;

/// Reads a file.
///
/// # Errors
/// As [`read::text`] and [`parse`].
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T> {
    parse(path, &read::text(path, read::MOST_SETTINGS_BYTES)?)
}

/// Parses `text`, the contents of `path`.
///
/// # Errors
/// [`Error::Broken`] with the line: not TOML, or a key that is unknown, missing or of another type.
pub fn parse<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T> {
    toml::from_str(text).map_err(|e| {
        let message = e.message().split_whitespace().collect::<Vec<_>>().join(" ");
        match e.span() {
            Some(span) => at_line(path, text, span.start, &message),
            None => Error::broken(path, message),
        }
    })
}

/// Returns the error about byte `offset` of `text`.
#[must_use]
pub fn at_line(path: &Path, text: &str, offset: usize, what: &str) -> Error {
    let line = text.bytes().take(offset).filter(|b| *b == b'\n').count() + 1;
    Error::broken(path, format!("line {line}: {what}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Settings {
        #[allow(dead_code)]
        steps: usize,
    }

    #[test]
    fn mistakes_are_named_with_their_line_on_one_line() {
        let refused = |text: &str| parse::<Settings>(Path::new("a.toml"), text).unwrap_err().to_string();
        assert!(parse::<Settings>(Path::new("a.toml"), "steps = 3").is_ok());
        for (text, line, word) in [
            ("# a\nsteps = 3\nstep = 4\n", "line 3", "step"),
            ("steps = \"x\"\n", "line 1", "invalid type"),
            ("steps = 3\n\nsteps = ", "line 3", ""),
            ("", "a.toml", "steps"),
        ] {
            let found = refused(text);
            assert!(found.contains(line) && found.contains(word) && found.lines().count() == 1, "{found}");
        }
        assert!(read::<Settings>(Path::new("/nowhere/a.toml")).unwrap_err().to_string().contains("nowhere"));
    }
}
