//! What programs say besides their results, on stderr: warnings, notes, details and progress. The user chooses how much, and whether as text or
//! as JSON lines. A [`Caller`](crate::caller::Caller) hears it instead.

use crate::caller::{Said, current};
use std::io::Write;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

/// How much is said.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Amount {
    /// Errors alone.
    Quiet,
    /// Warnings, notes and progress, too.
    Usual,
    /// Details, too.
    Verbose,
}

static AMOUNT: AtomicU8 = AtomicU8::new(Amount::Usual as u8);
static JSON: AtomicBool = AtomicBool::new(false);

/// Chooses how much this program says, and whether each line is one JSON object.
pub fn choose(amount: Amount, as_json: bool) {
    AMOUNT.store(amount as u8, Ordering::Relaxed);
    JSON.store(as_json, Ordering::Relaxed);
}

/// Says that the result is probably not what the user meant.
pub fn warning(text: &str) {
    say(Said::Warning(text));
}

/// Says what else the user should know.
pub fn note(text: &str) {
    say(Said::Note(text));
}

/// Says what was chosen, and how long it took.
pub fn detail(text: &str) {
    say(Said::Detail(text));
}

/// Returns whether progress is shown as a bar.
pub(crate) fn draws_bars() -> bool {
    !is_json() && wanted(Amount::Usual) && current().is_none()
}

/// Returns whether lines are JSON objects.
pub(crate) fn is_json() -> bool {
    JSON.load(Ordering::Relaxed)
}

pub(crate) fn say(said: Said<'_>) {
    if let Some(caller) = current() {
        return caller.hear(said);
    }
    let least = if matches!(said, Said::Detail(_)) { Amount::Verbose } else { Amount::Usual };
    if wanted(least)
        && let Some(line) = line(said, is_json())
    {
        // A closed stderr is no reason to fail.
        let _ = writeln!(std::io::stderr(), "{line}");
    }
}

fn wanted(least: Amount) -> bool {
    AMOUNT.load(Ordering::Relaxed) >= least as u8
}

/// Returns the line for stderr; `None` for progress that is a bar.
fn line(said: Said<'_>, as_json: bool) -> Option<String> {
    let object = |key: &str, text: &str| Some(format!("{{\"{key}\":{}}}", quoted(text)));
    match (said, as_json) {
        (Said::Warning(text), false) => Some(format!("WARNING: {text}")),
        (Said::Note(text) | Said::Detail(text), false) => Some(text.into()),
        (Said::Progress { .. }, false) => None,
        (Said::Warning(text), true) => object("warning", text),
        (Said::Note(text), true) => object("note", text),
        (Said::Detail(text), true) => object("detail", text),
        (Said::Progress { what, done, all, unit }, true) => {
            let (what, unit) = (quoted(what), quoted(unit));
            Some(format!("{{\"progress\":{{\"what\":{what},\"done\":{done},\"all\":{all},\"unit\":{unit}}}}}"))
        }
    }
}

/// Returns a text as a string of JSON.
fn quoted(text: &str) -> String {
    let escaped: String = text
        .chars()
        .map(|c| match c {
            '"' | '\\' => format!("\\{c}"),
            c if u32::from(c) < 0x20 => format!("\\u{:04x}", u32::from(c)),
            c => c.into(),
        })
        .collect();
    format!("\"{escaped}\"")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_text_or_objects() {
        let progress = Said::Progress { what: "survey", done: 1, all: 2, unit: "blocks" };
        assert_eq!(line(Said::Warning("a \"b\""), false).unwrap(), "WARNING: a \"b\"");
        assert_eq!(line(progress, false), None);
        assert_eq!(line(Said::Warning("a \"b\\\n"), true).unwrap(), r#"{"warning":"a \"b\\\u000a"}"#);
        let expected = r#"{"progress":{"what":"survey","done":1,"all":2,"unit":"blocks"}}"#;
        assert_eq!(line(progress, true).unwrap(), expected);
    }
}
