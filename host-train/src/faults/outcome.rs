//! The classes of outcomes.

use serde::{Deserialize, Serialize};

/// Heights further than this from those of the clean run are corrupt, metres.
pub const LIMIT_M: f32 = 0.1;

/// How a run with flipped bits ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// The runner said so; begun again, the tile came out right.
    Recovered,
    /// The runner said so, and says it again: what is hit has to be loaded anew.
    Reported,
    /// No height is further than [`LIMIT_M`] from the clean one.
    Masked,
    /// Heights are, and nobody said so.
    Silent,
    /// The run took more work than a tile has.
    Hang,
    /// The run panicked.
    Crash,
}

impl Outcome {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Recovered, Self::Reported, Self::Masked, Self::Silent, Self::Hang, Self::Crash];

    /// As the tables have it.
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

/// How often each outcome was seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts([u64; Outcome::ALL.len()]);

impl Counts {
    /// One more.
    pub fn add(&mut self, outcome: Outcome) {
        self.0[outcome as usize] += 1;
    }

    /// Those of another list, too.
    pub fn merge(&mut self, other: &Self) {
        self.0.iter_mut().zip(other.0).for_each(|(count, more)| *count += more);
    }

    /// Of one outcome.
    pub fn of(&self, outcome: Outcome) -> u64 {
        self.0[outcome as usize]
    }

    /// Of all.
    pub fn all(&self) -> u64 {
        self.0.iter().sum()
    }

    /// Share of all, 0 to 1; 0 of none.
    pub fn share(&self, outcome: Outcome) -> f64 {
        self.of(outcome) as f64 / self.all().max(1) as f64
    }
}
