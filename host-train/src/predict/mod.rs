//! A scene through the network, tile by tile.

pub mod network;
