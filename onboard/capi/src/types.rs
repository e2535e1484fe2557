//! Types shared by C and the library, with C names.
#![allow(non_camel_case_types)]

use core::ffi::c_void;

/// Result of a call: severity in bits 31-30 (0 good, 1 notice, 2 refused, 3 fault), unit in bits 23-16, code in bits 15-0.
pub type eld_status_t = u32;

/// A model's working memory and the state of its tile, at the start of the memory lent to `eld_init`. It must not be moved or read.
/// A copy of all lent memory that was made between two calls may be written back to the same place, for the same model.
/// It ends with that memory: there is no function to close it. One thread at a time may use it; different contexts are independent.
pub struct eld_context_t {
    _opaque: [u8; 0],
}

/// Version of the header's interface, major << 16 | minor << 8 | patch. Compare with `eld_version()`.
pub const ELD_VERSION: u32 = 0x0002_0000;

/// Light: the network works with any Sun and takes the image unchanged.
pub const ELD_LIGHT_ANY: u32 = 0;
/// Light: the network knows the Sun in the north-west; tiles with another Sun are mirrored, and the heights are mirrored back.
pub const ELD_LIGHT_NORTHWEST: u32 = 1;
/// Light: as `ELD_LIGHT_NORTHWEST`, and the network takes maps computed from the image and the light.
pub const ELD_LIGHT_GIVEN: u32 = 2;
/// Light: as `ELD_LIGHT_GIVEN`, and the maps are weighed by the trust in the light and by the share of the contrast that is relief.
pub const ELD_LIGHT_WEIGHED: u32 = 3;
/// Light: as `ELD_LIGHT_WEIGHED`, with more maps: the slopes of the first estimate, and the direction of the light.
pub const ELD_LIGHT_SLOPED: u32 = 4;

/// Heights: scaled by the relief of the tile's own truth, which the relief of the coarse DTM replaces.
pub const ELD_HEIGHTS_OWN_RELIEF: u32 = 0;
/// Heights: scaled by the coarse DTM's relief.
pub const ELD_HEIGHTS_COARSE_RELIEF: u32 = 1;
/// Heights: counted in pixels about the coarse DTM's mean; level ground is legal.
pub const ELD_HEIGHTS_PIXELS: u32 = 2;

/// Phase: no tile was begun.
pub const ELD_PHASE_EMPTY: u32 = 0;
/// Phase: a tile is in progress.
pub const ELD_PHASE_TILE: u32 = 1;
/// Phase: a tile is finished; its heights can be read.
pub const ELD_PHASE_TILE_DONE: u32 = 2;
/// Phase: the self test is in progress.
pub const ELD_PHASE_SELF_TEST: u32 = 3;
/// Phase: the self test is finished and can be checked.
pub const ELD_PHASE_SELF_TEST_DONE: u32 = 4;

/// Phase: `eld_begin_step` prepares a tile.
pub const ELD_PHASE_PREPARING: u32 = 5;
/// Phase: `eld_light_add` looks at a tile.
pub const ELD_PHASE_LIGHT: u32 = 6;

/// Pixels: a float in the processor's own byte order.
pub const ELD_PIXELS_F32: u32 = 0;
/// Pixels: a byte.
pub const ELD_PIXELS_U8: u32 = 1;
/// Pixels: two bytes, the low one first.
pub const ELD_PIXELS_U16_LE: u32 = 2;
/// Pixels: two bytes, the high one first.
pub const ELD_PIXELS_U16_BE: u32 = 3;
/// Pixels: twelve bits, two pixels in three bytes, the high bits first; a row begins with a byte.
pub const ELD_PIXELS_U12_PACKED: u32 = 4;

/// Flag of pixels: those with `null_code` are void.
pub const ELD_PIXELS_HAS_NULL: u32 = 1;
/// Flag of pixels: those with `saturated_from` or more are void.
pub const ELD_PIXELS_HAS_SATURATED: u32 = 2;

/// Origin of a height: the image explains at least half of the relief between the coarse DTM's pixels.
pub const ELD_ORIGIN_IMAGE: u8 = 0;
/// Origin of a height: the image explains a tenth to a half of it.
pub const ELD_ORIGIN_BLENDED: u8 = 1;
/// Origin of a height: the image explains less; the height is that of the coarse DTM.
pub const ELD_ORIGIN_COARSE: u8 = 2;
/// Origin of a height: the pixel is dark; the height is that of its surroundings and of the coarse DTM.
pub const ELD_ORIGIN_SHADOW: u8 = 3;
/// Origin of a height: image or coarse DTM is void; the height is filled.
pub const ELD_ORIGIN_VOID: u8 = 4;

/// Hazard: the plane under the footprint is steeper than the limit.
pub const ELD_HAZARD_TOO_STEEP: u8 = 1;
/// Hazard: a pixel is above or below that plane by more than the limit.
pub const ELD_HAZARD_TOO_ROUGH: u8 = 2;
/// Hazard: the footprint leaves the grid or has a void.
pub const ELD_HAZARD_UNKNOWN: u8 = 4;
/// Hazard: the plane may be steeper than the limit within the stated number of standard deviations.
pub const ELD_HAZARD_MAYBE_TOO_STEEP: u8 = 8;

/// Terrain maps of a grid whose lines come one at a time, at the start of the memory lent to `eld_terrain_init`. The rules of `eld_context_t` hold.
pub struct eld_terrain_t {
    _opaque: [u8; 0],
}

/// Where the Sun stands at a place.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct eld_sun_t {
    /// sizeof(eld_sun_t), set by the caller.
    pub struct_bytes: u32,
    /// Azimuth, degrees clockwise from north, 0 to 360.
    pub azimuth_deg: f32,
    /// Elevation of the Sun's centre above the horizon of the sphere, degrees.
    pub elevation_deg: f32,
    /// Latitude of the point under the Sun, degrees north.
    pub sub_solar_lat_deg: f32,
    /// Longitude of that point, degrees east, -180 to 180.
    pub sub_solar_lon_deg: f32,
    /// Distance of the Moon from the Sun, astronomical units.
    pub distance_au: f32,
}

/// What terrain maps are made of a grid.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct eld_terrain_options_t {
    /// sizeof(eld_terrain_options_t), set by the caller.
    pub struct_bytes: u32,
    /// Samples of a line, at least 1.
    pub cols: u32,
    /// Radius r of a vehicle's footprint, pixels, 1 to 16: a square of 2r + 1 pixels a side.
    pub radius_px: u32,
    /// Ground size of a pixel from one line to the next, metres.
    pub row_m: f32,
    /// Ground size of a pixel along a line, metres.
    pub col_m: f32,
    /// Largest safe slope of the footprint's plane, degrees, above 0 and at most 90.
    pub slope_deg: f32,
    /// Largest safe distance of a pixel of the footprint from that plane, metres, above 0.
    pub roughness_m: f32,
    /// Number of standard deviations of the slope's error for `ELD_HAZARD_MAYBE_TOO_STEEP`; 0: errors do not count.
    pub sigmas: f32,
    /// Azimuth of the light of the hillshade, degrees clockwise from the direction of decreasing rows.
    pub sun_azimuth_deg: f32,
    /// Its elevation, degrees.
    pub sun_elevation_deg: f32,
}

/// The maps of a line: `cols` samples each, or NULL: not wanted.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct eld_terrain_maps_t {
    /// sizeof(eld_terrain_maps_t), set by the caller.
    pub struct_bytes: u32,
    /// Horn's slope of the pixel, degrees; NaN at edges and beside voids.
    pub slope_deg: *mut f32,
    /// Shaded relief, 1 to 255; 0 at edges and beside voids.
    pub hillshade: *mut u8,
    /// Slope of the plane under the footprint, degrees; NaN where the footprint leaves the grid or has a void.
    pub footprint_slope_deg: *mut f32,
    /// Largest distance of a pixel of the footprint from that plane, metres; NaN as above.
    pub roughness_m: *mut f32,
    /// Sum of `ELD_HAZARD_*`; 0 is safe.
    pub hazard: *mut u8,
}

/// Properties and requirements of a model. All sizes are exact.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct eld_model_info_t {
    /// sizeof(eld_model_info_t), set by the caller.
    pub struct_bytes: u32,
    /// Version of the file's format.
    pub format_version: u32,
    /// Rows of a tile.
    pub tile_rows: u32,
    /// Columns of a tile.
    pub tile_cols: u32,
    /// Number of maps for the image: 1, 4 with `ELD_LIGHT_GIVEN` or `ELD_LIGHT_WEIGHED`, 8 with `ELD_LIGHT_SLOPED`.
    pub image_maps: u32,
    /// Light that the network knows: one of `ELD_LIGHT_*`.
    pub light: u32,
    /// Scale of heights: one of `ELD_HEIGHTS_*`.
    pub heights: u32,
    /// Alignment of the memory for `eld_init`, bytes.
    pub memory_align: u32,
    /// Bytes of memory for `eld_init`; one byte less is refused.
    pub memory_bytes: u64,
    /// Bytes of `memory_bytes` that are the arena of the network's tensors.
    pub arena_bytes: u64,
    /// Length of the file, bytes.
    pub file_bytes: u64,
    /// Multiply-accumulates of a tile.
    pub tile_macs: u64,
    /// Bound of a unit of work, multiply-accumulates and bytes that are compared: a step exceeds its budget by less than this.
    pub largest_unit_macs: u64,
    /// CRC32C of the header, which depends on all other bytes: the model's identity.
    pub header_crc: u32,
    /// CRC32C of the self test's output.
    pub self_test_crc: u32,
    /// Upper end of the normalised elevation range.
    pub nr: f32,
    /// Share by which the range of the coarse DTM is widened below and above.
    pub range_margin: f32,
}

/// The check of a model in pieces, which the caller keeps: zero before the first call of `eld_model_check_step`. It has a checksum and may be
/// copied.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct eld_check_t {
    /// Known to the library.
    pub words: [u64; 11],
}

/// Pixels as the camera has them, perhaps within a larger frame. Brightness is `gain * code + offset`, relative to any unit.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct eld_pixels_t {
    /// The first pixel, first row first. Any address is legal.
    pub data: *const c_void,
    /// Number of bytes from the first pixel on.
    pub data_bytes: usize,
    /// Bytes from a row to the next; 0 if rows follow each other without a gap.
    pub row_bytes: usize,
    /// One of `ELD_PIXELS_*`.
    pub format: u32,
    /// `ELD_PIXELS_HAS_NULL`, `ELD_PIXELS_HAS_SATURATED`, both or 0; 0 for floats.
    pub flags: u32,
    /// Brightness of a step of the code; 1 for floats that are brightness.
    pub gain: f32,
    /// Brightness of code 0.
    pub offset: f32,
    /// The code of a pixel without a value.
    pub null_code: u32,
    /// The smallest code of a saturated pixel.
    pub saturated_from: u32,
}

/// A coarse DTM as posts on its own grid. The library interpolates it onto the image's grid as the ground does. Rows and columns of the posts run
/// along those of the image: the centre of the image's pixel (row, column) is at row `row0 + row * rows_per_line` and column
/// `col0 + column * cols_per_px` of the posts, where (0, 0) is the centre of the first post.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct eld_posts_t {
    /// Heights at the posts, metres above the 1737.4 km sphere, row-major; samples that are not real are voids.
    pub posts_m: *const f32,
    /// Number of posts: whole rows.
    pub posts_len: usize,
    /// Posts in a row.
    pub cols: usize,
    /// Row of the posts at the image's first row.
    pub row0: f64,
    /// Rows of posts from a row of the image to the next; negative if they run the other way.
    pub rows_per_line: f64,
    /// Column of the posts at the image's first column.
    pub col0: f64,
    /// Columns of posts from a column of the image to the next.
    pub cols_per_px: f64,
}

/// Source of a light: the network works with any light and takes none.
pub const ELD_SOURCE_NOT_ASKED: u32 = 0;
/// Source of a light: every angle of the Sun that the network needs was stated.
pub const ELD_SOURCE_GIVEN: u32 = 1;
/// Source of a light: fitted to image and coarse DTM, at least in part.
pub const ELD_SOURCE_FITTED: u32 = 2;
/// Source of a light: neither stated nor shown.
pub const ELD_SOURCE_ASSUMED: u32 = 3;

/// The light of a scene, decided by `eld_light_decide`. Tiles of one scene, and a strip, have one light: with a light of its own for each, heights
/// would have steps at the seams. It holds for the models of one `ELD_LIGHT_*`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct eld_lighting_t {
    /// sizeof(eld_lighting_t), set by the caller.
    pub struct_bytes: u32,
    /// Where the light comes from: one of `ELD_SOURCE_*`.
    pub source: u32,
    /// Change of relative brightness per slope of the ground, which rises towards increasing columns.
    pub east: f32,
    /// The same for ground that rises towards increasing rows.
    pub south: f32,
    /// Share of the relief found under this light that is kept, 0 to 1.
    pub trust: f32,
    /// Probability that the image shows the ground of the coarse DTM under this light, 0 to 1.
    pub related: f32,
    /// Share of the contrast of long waves that is relief, 0 to 1; NaN if unknown.
    pub long_share: f32,
    /// Standard deviation of the logarithm of the light's strength.
    pub log_strength_sd: f32,
    /// Standard deviation of the light's azimuth, degrees, 0 to 180.
    pub azimuth_sd_deg: f32,
}

/// A tile in physical units. Maps are row-major, tile_rows x tile_cols samples, first row first; they are read until the tile is begun.
/// Samples that are not real (NaN, or 1e30 or more from zero, as PDS3 and ISIS specials are) are voids.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct eld_tile_t {
    /// sizeof(eld_tile_t), set by the caller.
    pub struct_bytes: u32,
    /// Ground size of a pixel, metres.
    pub pixel_m: f32,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub coarse_px: f32,
    /// Azimuth of the Sun, degrees clockwise from the direction of decreasing rows; NaN if unknown.
    pub sun_azimuth_deg: f32,
    /// Elevation of the Sun above the horizon, degrees, above 0 and below 90; NaN if unknown.
    pub sun_elevation_deg: f32,
    /// 0: heights as the ground's `elunar predict` writes them. 1: the network decides about long and short waves, too (the paper).
    pub network_alone: u32,
    /// 1: sums of the network's products are found in a second way, and heights are made twice, because the processor may err. 0: neither.
    pub processor_checks: u32,
    /// Relative brightness.
    pub image: eld_pixels_t,
    /// Coarse DTM on the image's grid, metres above the 1737.4 km sphere; NULL with `posts`.
    pub coarse_m: *const f32,
    /// Number of samples of the coarse DTM; 0 with `posts`.
    pub coarse_len: usize,
    /// Mask: 1 or 0 per pixel; NULL: every real pixel is valid.
    pub valid: *const u8,
    /// Bytes of the mask; 0 with NULL.
    pub valid_len: usize,
    /// Coarse DTM on its own grid; NULL with `coarse_m`.
    pub posts: *const eld_posts_t,
    /// The light of the tile's scene, in place of the Sun's angles; NULL: the tile's own.
    pub light: *const eld_lighting_t,
}

/// The errors that the heights and slopes of a tile are expected to have: standard deviations, without the error of the coarse DTM itself.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct eld_errors_t {
    /// sizeof(eld_errors_t), set by the caller.
    pub struct_bytes: u32,
    /// Of heights, metres.
    pub height_m: f32,
    /// Of slopes along either axis, metres per metre.
    pub slope: f32,
    /// Share of the relief between the coarse DTM's pixels that the image explains, 0 to 1.
    pub explained: f32,
    /// Of heights of dark pixels, metres.
    pub dark_height_m: f32,
    /// Of slopes of dark pixels along either axis, metres per metre.
    pub dark_slope: f32,
    /// A pixel is dark if its brightness (`gain * code + offset`) is below this.
    pub dark_below: f32,
}

/// Counters of a context since `eld_init`. They do not wrap within the time of a mission.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct eld_telemetry_t {
    /// sizeof(eld_telemetry_t), set by the caller.
    pub struct_bytes: u32,
    /// One of `ELD_PHASE_*`.
    pub phase: u32,
    /// Current entry of the schedule; 0 unless a tile is in progress.
    pub entry: u32,
    /// Number of pixels of the tile with valid heights.
    pub valid_px: u32,
    /// Latest fault; 0 if there was none.
    pub last_fault: eld_status_t,
    /// CRC32C of the model's header.
    pub header_crc: u32,
    /// Calls with this context.
    pub calls: u64,
    /// Calls that ended with a fault.
    pub faults: u64,
    /// Damaged copies of the context that were repaired.
    pub context_repairs: u64,
    /// Tiles begun with an assumed light.
    pub lights_assumed: u64,
    /// Tiles dropped before they were finished, or lost.
    pub tiles_dropped: u64,
    /// Tiles finished, self tests included.
    pub tiles: u64,
    /// Steps.
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
    /// Self tests that failed.
    pub self_test_faults: u64,
    /// Tiles that were given up because the model or a map had changed in memory.
    pub tile_faults: u64,
}
