//! Pictures of models: their memory, and what the precision of their layers costs.

mod arena;
mod costs;

pub use arena::arena;
pub use costs::picture as costs;
