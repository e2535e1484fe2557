//! Strips of a tiny model, against the whole scene at once.

mod faults;
mod lengths;
mod plan;
mod posts;
mod refusals;
mod rig;
