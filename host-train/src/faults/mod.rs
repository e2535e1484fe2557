//! What a flipped bit does: bits are flipped in a model, in the memory of a tile at work and in what a caller keeps of the run, and every
//! outcome is put into a class.
//!
//! ```text
//! once      a tile is run; the memory is put aside at some moments, in every kind of operator           moments.rs
//! often     one of these moments is taken up again, bits are flipped, the run goes on to its end      injection.rs, run.rs
//!           outcome: what the runner says, and how far the heights are from those of the clean run     outcome.rs
//! ```
//! Injection number i of a seed is the same whatever the number of threads, so a campaign can be made in parts (journal.rs). Bits stay
//! flipped in a model, as they would in a memory without correction; the arena is overwritten as the run goes on.

mod injection;
mod journal;
mod moments;
mod outcome;
mod run;
mod table;

pub use injection::{Injection, Target};
pub use journal::{Journal, Tried};
pub use moments::Moments;
pub use outcome::{Counts, LIMIT_M, Outcome};
pub use run::{Campaign, run};
pub use table::{Results, markdown, picture};
