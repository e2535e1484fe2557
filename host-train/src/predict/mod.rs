//! A scene through the network, tile by tile.

pub mod float;
pub mod network;
