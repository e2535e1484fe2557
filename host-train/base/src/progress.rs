//! Progress bars of long work.

use indicatif::{ProgressBar, ProgressStyle};

/// Returns a bar on stderr with rate, time left and a message. It is silent if stderr is not a terminal.
#[must_use]
pub fn bar(what: &str, len: u64, unit: &str) -> ProgressBar {
    let gap = if what.is_empty() { "" } else { " " };
    let style = format!("{what}{gap}{{bar:32}} {{pos}}/{{len}} {unit}, {{per_sec}}, {{eta}} left  {{msg}}");
    let style = ProgressStyle::with_template(&style).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(len).with_style(style)
}
