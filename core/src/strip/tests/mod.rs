//! Compares strips of a tiny model with the computation of the whole scene at once.

mod faults;
mod guards;
mod lengths;
mod plan;
mod posts;
mod refusals;
mod rig;
