//! Outputs: what may be replaced, files that appear whole, files that grow, the rows of an unfinished job, the one owner of an output, and its
//! files in a folder.
//!
//! Every command writes through this module. No link is followed, and nothing but a regular file is ever replaced.

mod growing;
mod listing;
mod owner;
mod part;
mod record;
mod renewal;
#[cfg(all(test, unix))]
mod simulated;
mod step;
mod target;
mod whole;

pub use growing::open_growing;
pub use listing::{check_names, remove_folder};
pub use owner::Owner;
pub use part::{PartFile, part_path};
pub use record::host_name;
pub use target::check_target;
pub(crate) use target::kind_of;
pub use whole::{Staged, atomic_write, settle};
