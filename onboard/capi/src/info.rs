//! The properties and requirements of a model, and the reasons why a file is refused.

use crate::layout::{ALIGN_BYTES, Layout};
use crate::status::*;
use crate::types::{
    ELD_HEIGHTS_COARSE_RELIEF, ELD_HEIGHTS_OWN_RELIEF, ELD_HEIGHTS_PIXELS, ELD_LIGHT_ANY, ELD_LIGHT_GIVEN,
    ELD_LIGHT_NORTHWEST, ELD_LIGHT_SLOPED, ELD_LIGHT_WEIGHED, eld_model_info_t, eld_status_t,
};
use elunar_core::nn::file::{OperatorFault, VERSION, u32_at, word};
use elunar_core::nn::{Illumination, Model, ModelError, TruthRange, Validation};
use elunar_core::tile::Shape;

/// Validates a file.
///
/// # Errors
/// The status of the first error found.
pub(crate) fn open(bytes: &[u8]) -> Result<(Model<'_>, Layout), eld_status_t> {
    let all = go_on(&mut Validation::default(), bytes, u64::MAX)?;
    all.ok_or(ELD_REFUSED_MODEL_WORK)
}

/// Validates a part of a file; returns the model when all is done.
///
/// # Errors
/// As [`open`].
pub(crate) fn go_on<'m>(
    validation: &mut Validation,
    bytes: &'m [u8],
    budget_macs: u64,
) -> Result<Option<(Model<'m>, Layout)>, eld_status_t> {
    let validated = validation.advance(bytes, budget_macs).map_err(|error| model_status(error, bytes))?;
    let Some(model) = validated else { return Ok(None) };
    let layout = Layout::of(&model).ok_or(ELD_REFUSED_MODEL_SIZE)?;
    Ok(Some((model, layout)))
}

/// Returns the properties and requirements of a validated model.
pub(crate) fn info(model: &Model<'_>, layout: &Layout, struct_bytes: u32) -> eld_model_info_t {
    let (Shape { rows, cols }, (_, self_test_crc)) = (model.tile(), model.self_test());
    eld_model_info_t {
        struct_bytes,
        format_version: VERSION,
        tile_rows: rows as u32,
        tile_cols: cols as u32,
        image_maps: model.image_maps() as u32,
        light: match model.illumination() {
            Illumination::Any => ELD_LIGHT_ANY,
            Illumination::Northwest => ELD_LIGHT_NORTHWEST,
            Illumination::Given => ELD_LIGHT_GIVEN,
            Illumination::Weighed => ELD_LIGHT_WEIGHED,
            Illumination::Sloped => ELD_LIGHT_SLOPED,
        },
        heights: match model.truth_range() {
            TruthRange::Own => ELD_HEIGHTS_OWN_RELIEF,
            TruthRange::Reference => ELD_HEIGHTS_COARSE_RELIEF,
            TruthRange::Pixel => ELD_HEIGHTS_PIXELS,
        },
        memory_align: ALIGN_BYTES as u32,
        memory_bytes: layout.bytes() as u64,
        arena_bytes: layout.arena.len() as u64,
        file_bytes: model.raw().bytes().len() as u64,
        tile_macs: model.macs(),
        largest_unit_macs: model.largest_unit(),
        header_crc: model.verdict().header_crc,
        self_test_crc,
        nr: model.nr(),
        range_margin: model.range_margin(),
    }
}

pub(crate) fn model_status(error: ModelError, bytes: &[u8]) -> eld_status_t {
    match error {
        ModelError::Magic => ELD_REFUSED_MODEL_MAGIC,
        ModelError::Version { .. } if u32_at(bytes, 4 * word::VERSION).swap_bytes() == VERSION => {
            ELD_REFUSED_MODEL_ENDIANNESS
        }
        ModelError::Version { .. } => ELD_REFUSED_MODEL_VERSION,
        ModelError::Length { .. } => ELD_REFUSED_MODEL_LENGTH,
        ModelError::HeaderChecksum => ELD_REFUSED_MODEL_HEADER_CHECKSUM,
        ModelError::ChunkChecksum { .. } => ELD_REFUSED_MODEL_CHECKSUM,
        ModelError::Header => ELD_REFUSED_MODEL_HEADER,
        ModelError::Tensor { .. } => ELD_REFUSED_MODEL_TENSOR,
        ModelError::Operator { reason: OperatorFault::Work, .. } | ModelError::Work => ELD_REFUSED_MODEL_WORK,
        ModelError::Operator { .. } => ELD_REFUSED_MODEL_OPERATOR,
        ModelError::Schedule { .. } => ELD_REFUSED_MODEL_SCHEDULE,
    }
}
