//! Progress of long work: bars on stderr, or for another program or a caller how far the work is.

use crate::caller::{Caller, Said, current};
use crate::say;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::ops::Deref;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Least time between two lines for another program.
const PAUSE: Duration = Duration::from_millis(100);

/// A bar, with all that [`ProgressBar`] does.
pub struct Bar {
    bar: ProgressBar,
    what: String,
    unit: String,
    caller: Option<Arc<Caller>>,
    /// When another program was told last.
    told: Mutex<Option<Instant>>,
}

/// Returns a bar on stderr with rate, time left and a message. It is silent if stderr is not a terminal.
#[must_use]
pub fn bar(what: &str, len: u64, unit: &str) -> Bar {
    let gap = if what.is_empty() { "" } else { " " };
    let style = format!("{what}{gap}{{bar:32}} {{pos}}/{{len}} {unit}, {{per_sec}}, {{eta}} left  {{msg}}");
    let style = ProgressStyle::with_template(&style).unwrap_or_else(|_| ProgressStyle::default_bar());
    let target = if say::draws_bars() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let bar = ProgressBar::with_draw_target(Some(len), target).with_style(style);
    Bar { bar, what: what.into(), unit: unit.into(), caller: current(), told: Mutex::new(None) }
}

impl Bar {
    /// Returns a bar that nobody sees.
    #[must_use]
    pub fn hidden() -> Self {
        Self { bar: ProgressBar::hidden(), caller: None, ..bar("", 0, "") }
    }

    /// Starts from a position.
    #[must_use]
    pub fn with_position(self, done: u64) -> Self {
        Self { bar: self.bar.with_position(done), ..self }
    }

    /// Counts more pieces as done.
    pub fn inc(&self, more: u64) {
        self.bar.inc(more);
        self.tell();
    }

    /// Sets how many pieces are done.
    pub fn set_position(&self, done: u64) {
        self.bar.set_position(done);
        self.tell();
    }

    fn tell(&self) {
        let (done, all) = (self.bar.position(), self.bar.length().unwrap_or(0));
        let said = Said::Progress { what: &self.what, done, all, unit: &self.unit };
        if let Some(caller) = &self.caller {
            caller.hear(said);
        } else if say::is_json() {
            let mut told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
            if done == all || told.is_none_or(|at| at.elapsed() >= PAUSE) {
                *told = Some(Instant::now());
                say::say(said);
            }
        }
    }
}

impl Deref for Bar {
    type Target = ProgressBar;

    fn deref(&self) -> &ProgressBar {
        &self.bar
    }
}
