//! The effect of bit flips. Bits are flipped in a model, in the memory of a running tile, and in the state that a caller keeps of the run.
//! Every outcome is put into a class.
//!
//! ```text
//! once      a tile is run; the memory is put aside at some moments, in every kind of operator           moments.rs
//! often     one of these moments is taken up again, bits are flipped, the run goes on to its end      injection.rs, run.rs
//!           outcome: what the runner says, and how far the heights are from those of the clean run     outcome.rs
//! ```
//! A strip has moments of its own, between any two of its calls (strip.rs).
//!
//! Injection number i of a seed does not depend on the number of threads, so a campaign can be made in parts (journal.rs). Bits stay
//! flipped in a model, as in a memory without correction. The arena is overwritten during the run.

mod injection;
mod journal;
mod moments;
mod outcome;
mod run;
mod strip;
mod table;

pub use injection::{Injection, InjectionTarget};
pub use journal::CampaignJournal;
pub use moments::Moments;
pub use outcome::{FaultOutcome, LIMIT_M, OutcomeCounts, Tried};
pub use run::{Campaign, run};
pub use strip::{StripCampaign, run_strip};
pub use table::{CampaignResults, markdown, picture};
