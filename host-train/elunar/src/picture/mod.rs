//! Pictures of models: their memory, and the effect of their layers' precision.

mod arena;
mod costs;

pub use arena::arena;
pub use costs::picture as costs;
