//! Shared helpers of the benchmarks: networks to run, shapes of their products, the processor's peak, samples and tables.

pub mod models;
pub mod peak;
pub mod samples;
pub mod shapes;
pub mod table;
