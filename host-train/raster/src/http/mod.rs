//! Files on the net: `http://` and `https://`, read by byte ranges (feature `http`). Only the blocks that are asked for are fetched, and every answer
//! is of one version of the file.

#[cfg(not(all(feature = "http", not(target_family = "wasm"))))]
mod absent;
#[cfg(all(feature = "http", not(target_family = "wasm")))]
mod ask;
#[cfg(all(feature = "http", not(target_family = "wasm")))]
mod remote;
#[cfg(all(test, feature = "http"))]
mod tests;

#[cfg(not(all(feature = "http", not(target_family = "wasm"))))]
pub(crate) use absent::{Remote, open};
#[cfg(all(feature = "http", not(target_family = "wasm")))]
pub(crate) use remote::{Remote, open};
