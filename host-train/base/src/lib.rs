//! What every crate on the ground needs. [`Error`] is the error type of all of them. [`mod@read`] opens inputs, and [`output`] writes outputs.
//! [`table`] reads and writes tables. [`digest`] identifies files and jobs, and [`quantile`] has medians and percentiles. [`interrupt`] says
//! whether the user has asked to stop, [`mod@say`] is what programs say besides their results, [`progress`] shows how far a run is, and a
//! [`caller`] in this process hears both. [`memory`] marks allocations that may fail. [`rounds`] works on several items at a time.

pub mod caller;
pub mod digest;
mod error;
mod folder;
pub mod interrupt;
pub mod memory;
pub mod output;
pub mod progress;
pub mod quantile;
pub mod read;
pub mod rounds;
pub mod say;
pub mod table;

pub use error::{Error, Result};
pub use folder::folder_of;
pub use output::atomic_write;

/// Whether the program can start threads. WebAssembly has one, and no other process beside it.
pub const HAS_THREADS: bool = !cfg!(target_family = "wasm");

/// What files name as their maker: both programs write the same ones.
pub const SOFTWARE: &str = concat!("ELunarDTM ", env!("CARGO_PKG_VERSION"));
