//! The C interface of the flight runner, as ordinary Rust that host tests can call. C sees `include/elunar.h`.
//!
//! The caller lends one block of memory; a context lives at its start, and everything else a tile needs lies behind it. Nothing is
//! allocated, nothing is global, nothing locks: contexts are as many as there are blocks, and do not know of each other.
//!
//! ```text
//! eld_model_check -> eld_init -> eld_begin -> eld_step ... eld_step -> eld_output
//!                                                 eld_scrub between steps, eld_self_test_* now and then, eld_telemetry always
//! ```
//!
//! In the order a call meets them:
//!
//! 1. [`ffi`] validates pointers and lengths and turns them into slices: the only functions C sees, the only `unsafe`.
//! 2. [`sealed`](mod@sealed) reads the context: plain numbers ([`record`](mod@record)), kept twice, each copy under a checksum.
//! 3. [`layout`](mod@layout) says where things lie in the lent memory.
//! 4. [`begin`](mod@begin) and [`run`](mod@run) rebuild a runner for the length of the call and put it aside again.
//! 5. [`status`] says how it went, in one word.
#![no_std]

mod begin;
mod context;
pub mod ffi;
mod info;
mod layout;
mod record;
mod run;
mod sealed;
pub mod status;
pub mod types;
mod validity;

pub use elunar_core;
