//! What became of an item: the line that `batch` prints and `status` reads.

use crate::program::{BAD_INPUT, TRY_AGAIN, USAGE};
use serde::{Deserialize, Serialize};
use std::time::{SystemTime, UNIX_EPOCH};

/// What became of an item.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ItemOutcome {
    /// The DTM is made.
    Done,
    /// The DTM was there, by the same job, and has its SHA-256.
    DoneBefore,
    /// It may succeed later.
    TryAgain,
    /// It never succeeds as it is.
    Failed,
}

impl ItemOutcome {
    /// Judges an exit code; `None` is an end by a signal that was not caught.
    #[must_use]
    pub fn of(code: Option<i32>, is_before: bool) -> Self {
        let is_never = |code: i32| [USAGE, BAD_INPUT, crate::program::DEFECT].contains(&(code as u8));
        match code {
            Some(0) if is_before => Self::DoneBefore,
            Some(0) => Self::Done,
            // A kill, memory, a full disk, an unknown code of a killed container.
            Some(code) if is_never(code) => Self::Failed,
            _ => Self::TryAgain,
        }
    }

    /// Returns whether the DTM exists.
    #[must_use]
    pub fn is_done(self) -> bool {
        matches!(self, Self::Done | Self::DoneBefore)
    }
}

/// The line about an attempt at an item.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AttemptRecord {
    /// Name of the item.
    pub id: String,
    /// Its line in the manifest.
    pub line: usize,
    /// What became of it.
    pub verdict: ItemOutcome,
    /// Exit code; 128 plus the signal for a process that a signal ended.
    pub code: i32,
    /// The error, if there was one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// The DTM.
    pub output: String,
    /// Start, seconds of the Unix epoch.
    pub start_s: f64,
    /// Duration, seconds.
    pub seconds: f64,
    /// Machine.
    pub host: String,
    /// Which of the parallel jobs of the batch.
    pub slot: usize,
    /// The chunk of the batch.
    pub chunk: String,
    /// Pixels of the DTM, if it was made now.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixels: Option<u64>,
}

impl AttemptRecord {
    /// Returns the kind of a failure for counts: by its exit code.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self.code {
            0 => "done",
            64 => "command line",
            65 => "bad input",
            70 => "defect of the program",
            71 => "memory or threads",
            code if code == i32::from(TRY_AGAIN) => "stopped, locked, full disk or system",
            code if code > 128 => "ended by a signal",
            _ => "another code",
        }
    }
}

/// Returns the time, seconds of the Unix epoch.
pub(super) fn now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |time| time.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exit_code_decides() {
        let cases = [
            (Some(0), ItemOutcome::Done),
            (Some(64), ItemOutcome::Failed),
            (Some(65), ItemOutcome::Failed),
            (Some(70), ItemOutcome::Failed),
            (Some(71), ItemOutcome::TryAgain),
            (Some(75), ItemOutcome::TryAgain),
            (Some(143), ItemOutcome::TryAgain),
            (None, ItemOutcome::TryAgain),
        ];
        for (code, verdict) in cases {
            assert_eq!(ItemOutcome::of(code, false), verdict, "{code:?}");
        }
        assert_eq!(ItemOutcome::of(Some(0), true), ItemOutcome::DoneBefore);
    }
}
