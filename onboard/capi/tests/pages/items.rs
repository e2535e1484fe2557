//! Whether the code and the tests that a table names exist.

use super::{read, repository};

/// What may stand before a name that Rust declares.
const KINDS: [&str; 7] = ["fn", "struct", "enum", "trait", "const", "static", "macro_rules!"];

/// Whether a line of a file declares an item: any of Rust, a function of C, Python or a script, a table of TOML.
pub(crate) fn declares(path: &str, line: &str, name: &str) -> bool {
    let goes_on = |rest: &str| rest.starts_with(|c: char| c.is_ascii_alphanumeric() || c == '_');
    match path.rsplit_once('.').unwrap_or_default().1 {
        "rs" => KINDS.iter().any(|kind| {
            let declared = line.split_once(&format!("{kind} {name}"));
            declared.is_some_and(|(before, rest)| !before.contains("//") && !goes_on(rest))
        }),
        "c" => line.contains(&format!(" {name}(")) && !line.starts_with(' ') && !line.ends_with(';'),
        "py" => line.starts_with(&format!("def {name}(")),
        "sh" => line.starts_with(&format!("{name}() {{")),
        "toml" => line == format!("[{name}]"),
        _ => false,
    }
}

/// Returns an error unless the code of a requirement exists: `path::item`, or a file. Tests are no code of a requirement.
pub(crate) fn implements(item: &str) -> Result<(), String> {
    let (path, name) = item.split_once("::").map_or((item, None), |(path, name)| (path, Some(name)));
    if !repository().join(path).is_file() {
        return Err(format!("{item}: no such file"));
    }
    if format!("/{path}").contains("/tests") {
        return Err(format!("{item}: a test implements nothing"));
    }
    match name {
        Some(name) if !read(path).lines().any(|line| declares(path, line, name)) => {
            Err(format!("{item}: no such item"))
        }
        _ => Ok(()),
    }
}

/// Returns an error unless a verification, `path::name`, exists: a test in Rust, or a function of a script.
pub(crate) fn exists(verification: &str) -> Result<(), String> {
    let (path, name) = verification.split_once("::").ok_or(format!("{verification}: expected path::name"))?;
    if !repository().join(path).is_file() {
        return Err(format!("{verification}: no such file"));
    }
    let text = read(path);
    let lines: Vec<&str> = text.lines().collect();
    let script = path.ends_with(".sh");
    let at = lines.iter().position(|line| declares(path, line, name));
    let at = at.ok_or(format!("{verification}: no such function"))?;
    // Attributes are before the function, one per line.
    let attributes = lines[..at].iter().rev().take_while(|line| line.trim_start().starts_with("#["));
    match script || attributes.into_iter().any(|line| line.trim() == "#[test]") {
        true => Ok(()),
        false => Err(format!("{verification}: no test")),
    }
}

/// Returns the functions that a header declares.
pub(crate) fn functions(header: &str) -> Vec<String> {
    let declared = header.lines().filter(|line| !line.starts_with([' ', '/', '#', '}']) && line.contains('('));
    let name = |line: &str| {
        Some(format!("eld_{}", line.split_once(" eld_").or(line.split_once("*eld_"))?.1.split_once('(')?.0))
    };
    declared.filter_map(name).collect()
}
