//! The C interface of the flight runner, as ordinary Rust that host tests can call. The header for C is `include/elunar.h`.
//!
//! The caller lends one block of memory. A context is at its start, followed by all other memory for a tile. Nothing is allocated, and
//! there are no globals and no locks: there are as many contexts as blocks, and they are independent.
//!
//! ```text
//! eld_model_check -> eld_init -> eld_begin (or eld_begin_step ...) -> eld_step ... -> eld_output
//!                                                 eld_scrub between steps, eld_self_test_* now and then, eld_telemetry always
//! ```
//!
//! The modules, in the order of a call:
//!
//! 1. [`ffi`] validates pointers and lengths and turns them into slices. It has the only functions for C, and the only `unsafe`.
//! 2. `sealed` reads the context: plain numbers (`record`), kept twice, each copy under a checksum.
//! 3. `layout` gives the places of the parts in the lent memory.
//! 4. `check` validates a model in pieces. `begin` and `run` rebuild a runner for the duration of the call and suspend it again; `light` adds up what tiles show of their light.
//! 5. `terrain` keeps the lines of a grid for its terrain maps, without a model.
//! 6. [`slots`] keeps the core's work on model slots.
//! 7. [`status`] defines the status word of the call.
#![no_std]

mod begin;
mod check;
mod context;
pub mod ffi;
mod info;
mod layout;
mod light;
mod record;
mod run;
mod sealed;
pub mod slots;
pub mod status;
pub mod strip;
mod terrain;
mod tile;
pub mod types;

pub use elunar_core;
