//! The model file, for programs that write or read its parts: header, records, numbers of enums, limits, checksums.
//!
//! A file is a program: tensors at planned places in one arena ([`Tensor`]), constants, a list of operators over the tensors
//! ([`Operator`]), and a schedule ([`Entry`]) with the order in which operators compute the rows of their outputs. An operator may run a
//! few rows ahead of its reader, so that only those rows need memory.
//!
//! [`Content`] writes a file, and [`super::Model::new`] validates it. Every record has `encode` and `decode`; every enum in the file has
//! `code` and `from_code`. After a change of single bytes [`seal_file`] makes all checksums right. `onboard/docs/icd.md` describes the file
//! byte by byte; `onboard/capi/tests/icd/reader.rs` reads it by that page alone, without this module.

mod attention;
mod bytes;
mod checksums;
mod codes;
mod content;
mod conv;
pub(crate) mod count;
mod entry;
pub(crate) mod error;
mod layer_norm;
mod layout;
mod limits;
mod operator;
mod raw;
mod seal;
mod tensor;
mod upsample;

pub use super::crc::{Crc32c, crc32c};
pub use super::panels::{PANEL, groups, panel, panel_count, panelled, panels};
pub use super::tensor::{Dtype, Edge, Tensor};
pub use attention::Attention;
pub use bytes::{i32_at, i64_at, u32_at};
pub use checksums::seal_file;
pub use content::{Content, set_word};
pub(crate) use conv::VARIANT_KINDS;
pub use conv::{Conv, PHASE_TAPS, PHASES, Phase};
pub use entry::{ENTRY_BYTES, Entry};
pub(crate) use error::ModelError;
pub use error::OperatorFault;
pub use layer_norm::LayerNorm;
pub use layout::{CHUNK_BYTES, CHUNK_RECORD_BYTES, HEADER_BYTES, MAGIC, NONE, VERSION, word};
pub use limits::*;
pub use operator::{OPERATOR_BYTES, Operator};
pub use raw::RawModel;
pub use seal::{seal_record, sealed};
pub use tensor::TENSOR_BYTES;
pub use upsample::Upsample2;
