//! Compares hand-made programs of a few operators with simple implementations.

mod attention;
mod conv;
pub(crate) mod draft;
mod kernels;
mod layer_norm;
mod limits;
mod model;
mod program;
mod random;
mod refusals;
mod rows;
mod schedule;
mod shadow;
mod slots;
mod suspend;
mod unit;
mod upsample;
mod whole;
mod witness;
mod work;

pub(crate) use kernels::kernels;
pub(crate) use random::Random;
