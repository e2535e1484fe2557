//! The float network: the Burn modules, named as in the paper's figures.

pub mod backend;
pub mod cast;
pub mod conv;
pub mod critic;
pub mod decoder;
pub mod detail;
pub mod elunar;
pub mod encoder;
pub mod init;
pub mod norm;
pub mod ops;
pub mod precision;
pub mod resnet;
pub mod store;
pub mod swin;
pub mod unet;
