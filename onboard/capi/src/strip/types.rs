//! Types of strips, with C names.
#![allow(non_camel_case_types)]

use crate::types::{eld_check_t, eld_lighting_t, eld_pixels_t, eld_status_t};

/// A strip with its model's working memory, at the start of the memory lent to `eld_strip_init`. What holds for a context holds for it, too.
pub struct eld_strip_t {
    _opaque: [u8; 0],
}

/// Settings of a strip, known before its first line.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct eld_strip_settings_t {
    /// sizeof(eld_strip_settings_t), set by the caller.
    pub struct_bytes: u32,
    /// Pixels of a line. A line shorter than a tile is continued by its last pixel.
    pub cols: u32,
    /// Number of lines kept, at least the rows of a tile plus one; 0 for that number.
    pub ring_lines: u32,
    /// Overlap of neighbouring tiles, pixels; less than either side of a tile. The ground's `elunar predict` takes 100.
    pub overlap_px: u32,
    /// Ground size of a pixel, metres.
    pub pixel_m: f32,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub coarse_px: f32,
    /// Azimuth of the Sun, degrees clockwise from the direction of decreasing lines; NaN if unknown.
    pub sun_azimuth_deg: f32,
    /// Elevation of the Sun above the horizon, degrees; NaN if unknown.
    pub sun_elevation_deg: f32,
    /// 0: heights as the ground's `elunar predict` writes them. 1: the network decides about long and short waves, too (the paper).
    pub network_alone: u32,
    /// 1 if `eld_strip_take` shall give expected errors, else 0. Finished lines then keep their place until they are taken.
    pub expected_errors: u32,
    /// Number of posts in a row of the coarse DTM; 0 if coarse heights come with every line, on the image's pixels.
    pub post_cols: u32,
    /// 1: sums of the network's products are found in a second way, and heights are made twice, because the processor may err. 0: neither.
    pub processor_checks: u32,
    /// Row of the posts at the centre of the strip's first line. (0, 0) is the centre of the first post.
    pub post_row0: f64,
    /// Rows of posts per line; above 0.
    pub post_rows_per_line: f64,
    /// Column of the posts at the centre of the strip's first column.
    pub post_col0: f64,
    /// Columns of posts per pixel.
    pub post_cols_per_px: f64,
    /// The pixels of a line: format, flags, gain, offset and codes. `data`, `data_bytes` and `row_bytes` are not used.
    pub pixels: eld_pixels_t,
    /// The light of the strip, as `eld_light_decide` gives it; NULL: decided from the stated angles of the Sun alone.
    pub light: *const eld_lighting_t,
    /// The finished check of the model (`eld_model_check_step`); NULL: the model is validated at once.
    pub check: *const eld_check_t,
}

/// Counters of a strip since `eld_strip_init`. They do not wrap within the time of a mission.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct eld_strip_telemetry_t {
    /// sizeof(eld_strip_telemetry_t), set by the caller.
    pub struct_bytes: u32,
    /// Latest fault; 0 if there was none.
    pub last_fault: eld_status_t,
    /// Lines that `eld_strip_take` can return now.
    pub ready: u64,
    /// Calls with this strip.
    pub calls: u64,
    /// Calls that ended with a fault.
    pub faults: u64,
    /// Damaged copies of the strip's state that were repaired.
    pub context_repairs: u64,
    /// Tiles done, with those below.
    pub tiles: u64,
    /// Tiles without image contrast or coarse relief, which keep the coarse heights.
    pub tiles_coarse: u64,
    /// Tiles without a valid pixel.
    pub tiles_empty: u64,
    /// Tiles that began again after a fault.
    pub tiles_again: u64,
    /// Tiles given up after a second fault, which keep the coarse heights.
    pub tiles_lost: u64,
    /// Tiles given up after a third fault, which have no heights.
    pub tiles_void: u64,
    /// Times that the memory of a tile was found to have changed between two steps.
    pub memory_faults: u64,
    /// Pieces of kept lines, means or expected errors that were found to have changed. Their pixels are voids.
    pub pieces_lost: u64,
    /// Steps of the network.
    pub steps: u64,
    /// Multiply-accumulates.
    pub macs: u64,
    /// Input samples outside the range that the model was calibrated for.
    pub inputs_clamped: u64,
    /// Intermediate results cut to their tensor's range.
    pub saturated: u64,
    /// Bytes of the model compared with their checksums.
    pub scrubbed_bytes: u64,
    /// Complete passes over the model.
    pub scrub_passes: u64,
    /// Chunks of the model found to have changed.
    pub scrub_faults: u64,
    /// Tiles that were given up because the model or a map had changed in memory.
    pub tile_faults: u64,
}
