//! The classes of outcomes, and an injection with its outcome.

use super::injection::InjectionTarget;
use serde::{Deserialize, Serialize};

/// Heights that differ from the clean run by more than this are corrupt, metres.
pub const LIMIT_M: f32 = 0.1;

/// Outcome of a run with flipped bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FaultOutcome {
    /// The runner reported an error, and a second run has undamaged memory. One second run in 16 is made, and must give the right result.
    Recovered,
    /// The runner reported an error, and would report it again. The damaged memory must be loaded again.
    Reported,
    /// No height differs from the clean run by more than [`LIMIT_M`].
    Masked,
    /// Heights differ by more, and no error was reported.
    Silent,
    /// The run needed more steps than a tile has.
    Hang,
    /// The run panicked.
    Crash,
}

/// An injection and its outcome: a line of the journal.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tried {
    /// Number of the injection.
    pub index: u64,
    /// Target of the flips.
    pub target: InjectionTarget,
    /// Number of bits that flipped.
    pub bits: usize,
    /// Kind of the current operator.
    pub operator: String,
    /// Outcome of the run.
    pub outcome: FaultOutcome,
}

impl FaultOutcome {
    /// All outcomes.
    pub const ALL: [Self; 6] = [Self::Recovered, Self::Reported, Self::Masked, Self::Silent, Self::Hang, Self::Crash];

    /// Returns the name in the tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Recovered => "detected, recovered",
            Self::Reported => "detected, reported",
            Self::Masked => "masked",
            Self::Silent => "silent, above 0.1 m",
            Self::Hang => "hang",
            Self::Crash => "crash",
        }
    }
}

/// Number of runs with each outcome.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OutcomeCounts([u64; FaultOutcome::ALL.len()]);

impl OutcomeCounts {
    /// Adds one run.
    pub fn add(&mut self, outcome: FaultOutcome) {
        self.0[outcome as usize] += 1;
    }

    /// Adds the counts of another list.
    pub fn merge(&mut self, other: &Self) {
        self.0.iter_mut().zip(other.0).for_each(|(count, more)| *count += more);
    }

    /// Returns the number of runs with one outcome.
    pub fn of(&self, outcome: FaultOutcome) -> u64 {
        self.0[outcome as usize]
    }

    /// Returns the number of all runs.
    pub fn all(&self) -> u64 {
        self.0.iter().sum()
    }

    /// Returns the share of an outcome in all runs, 0 to 1; 0 without runs.
    pub fn share(&self, outcome: FaultOutcome) -> f64 {
        self.of(outcome) as f64 / self.all().max(1) as f64
    }
}
