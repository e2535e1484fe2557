//! The caller's tile: its structures and maps.

use super::apart_from_ours;
use super::pointers::*;
use crate::record::ContextRecord;
use crate::status::*;
use crate::tile::{CallerTile, Coarse};
use crate::types::*;
use crate::{begin, light};
use elunar_core::TileRules;
use elunar_core::nn::{Model, TileLight, file};
use elunar_core::pixels::{PixelForm, PixelFormat, Pixels};
use elunar_core::posts::PostMap;
use elunar_core::strip::PostGrid;
use elunar_core::tile::Shape;

/// Returns the caller's tile, after validation of all its pointers and numbers.
///
/// # Safety
/// The caller's promise holds for all pointers; the maps are not used after the call.
pub(super) unsafe fn caller_tile<'t>(
    tile: *const eld_tile_t,
    record: &ContextRecord,
    model: &Model<'_>,
) -> Result<CallerTile<'t>, eld_status_t> {
    apart_from_ours(record, &span(tile, 1)?)?;
    // SAFETY: the caller's promise; the structure does not overlap any memory that is borrowed.
    let tile = unsafe { structure(tile) }?;
    // SAFETY: as above.
    let (posts, scene_light) = unsafe { (posts_of(&tile, record)?, light_of(&tile, record)?) };
    let (shape, pixels) = (model.tile(), model.tile().pixels());
    let masked = !tile.valid.is_null() || tile.valid_len != 0;
    let own_grid = |posts: &eld_posts_t| (posts.posts_m, posts.posts_len);
    let coarse = posts.as_ref().map_or((tile.coarse_m, tile.coarse_len), own_grid);
    let image = bytes_of(tile.image.data, tile.image.data_bytes)?;
    let mut maps = [image, span(coarse.0, coarse.1)?, 0..0];
    if masked {
        maps[2] = span(tile.valid, tile.valid_len)?;
    }
    // SAFETY: the caller's promise.
    let image = pixels_of(&tile.image, shape, unsafe { slice(tile.image.data.cast(), tile.image.data_bytes) }?)?;
    if tile.network_alone > 1 || tile.processor_checks > 1 {
        return Err(ELD_REFUSED_TILE_OPTION);
    }
    if posts.is_none() && tile.coarse_len != pixels || masked && tile.valid_len != pixels || !image.is_whole() {
        return Err(ELD_REFUSED_TILE_SIZE);
    }
    for map in &maps {
        apart_from_ours(record, map)?;
    }
    // SAFETY: the caller's promise; the maps do not overlap any memory that is written.
    let coarse_m = unsafe { slice(coarse.0, coarse.1) }?;
    let coarse_m = match &posts {
        Some(posts) => Coarse::Posts(post_map(posts, coarse_m, shape)?),
        None => Coarse::Grid(coarse_m),
    };
    let valid = match masked {
        // SAFETY: as above; every byte is 0 or 1.
        true => Some(unsafe { mask(tile.valid, pixels) }?),
        false => None,
    };
    let sun = begin::stated_sun(tile.sun_azimuth_deg, tile.sun_elevation_deg)?;
    let light = match &scene_light {
        Some(light) => TileLight::Scene(light::of_c(light, model.illumination())?),
        None => TileLight::Own(sun),
    };
    let eld_tile_t { pixel_m, coarse_px, .. } = tile;
    let rules = TileRules { pixel_m, coarse_px, anchor: tile.network_alone == 0, checked: tile.processor_checks == 1 };
    let crc = tile_crc(&tile, posts.as_ref(), scene_light.as_ref());
    Ok(CallerTile { image, coarse_m, valid, rules, light, crc })
}

/// Reads the structure of the light of a tile's scene, if it has one.
///
/// # Safety
/// As [`posts_of`].
unsafe fn light_of(tile: &eld_tile_t, record: &ContextRecord) -> Result<Option<eld_lighting_t>, eld_status_t> {
    if tile.light.is_null() {
        return Ok(None);
    }
    apart_from_ours(record, &span(tile.light, 1)?)?;
    // SAFETY: the caller's promise.
    unsafe { structure(tile.light) }.map(Some)
}

/// Reads the structure of a tile's posts, if it has one.
///
/// # Safety
/// The caller's promise holds for the pointer, and the memory of the context is not borrowed.
unsafe fn posts_of(tile: &eld_tile_t, record: &ContextRecord) -> Result<Option<eld_posts_t>, eld_status_t> {
    if tile.posts.is_null() {
        return Ok(None);
    }
    apart_from_ours(record, &span(tile.posts, 1)?)?;
    if !tile.coarse_m.is_null() || tile.coarse_len != 0 {
        return Err(ELD_REFUSED_TILE_POSTS);
    }
    // SAFETY: not NULL and aligned; plain numbers and a pointer.
    Ok(Some(unsafe { tile.posts.read() }))
}

/// Returns the coarse DTM of these posts.
fn post_map<'p>(posts: &eld_posts_t, posts_m: &'p [f32], shape: Shape) -> Result<PostMap<'p>, eld_status_t> {
    let eld_posts_t { cols, row0, rows_per_line, col0, cols_per_px, .. } = *posts;
    let grid = PostGrid { cols, row0, rows_per_line, col0, cols_per_px };
    PostMap::new(posts_m, grid, shape).ok_or(ELD_REFUSED_TILE_POSTS)
}

/// Returns the form of pixels.
pub(super) fn form_of(pixels: &eld_pixels_t) -> Result<PixelForm, eld_status_t> {
    let format = match pixels.format {
        ELD_PIXELS_F32 => PixelFormat::F32,
        ELD_PIXELS_U8 => PixelFormat::U8,
        ELD_PIXELS_U16_LE => PixelFormat::U16Le,
        ELD_PIXELS_U16_BE => PixelFormat::U16Be,
        ELD_PIXELS_U12_PACKED => PixelFormat::U12Packed,
        _ => return Err(ELD_REFUSED_TILE_FORMAT),
    };
    let known = if format == PixelFormat::F32 { 0 } else { ELD_PIXELS_HAS_NULL | ELD_PIXELS_HAS_SATURATED };
    let code = |flag: u32, code: u32| (pixels.flags & flag != 0).then_some(code);
    let form = PixelForm {
        format,
        gain: pixels.gain,
        offset: pixels.offset,
        null_code: code(ELD_PIXELS_HAS_NULL, pixels.null_code),
        saturated_from: code(ELD_PIXELS_HAS_SATURATED, pixels.saturated_from),
    };
    if pixels.flags & !known == 0 && form.is_legal() { Ok(form) } else { Err(ELD_REFUSED_TILE_FORMAT) }
}

/// Returns the pixels of an image.
fn pixels_of<'p>(image: &eld_pixels_t, shape: Shape, bytes: &'p [u8]) -> Result<Pixels<'p>, eld_status_t> {
    let pixels = form_of(image)?.pixels(bytes, shape);
    Ok(Pixels { row_bytes: if image.row_bytes == 0 { pixels.row_bytes } else { image.row_bytes }, ..pixels })
}

/// Returns the checksum of a tile's structure, without the bytes between its fields.
fn tile_crc(tile: &eld_tile_t, posts: Option<&eld_posts_t>, light: Option<&eld_lighting_t>) -> u32 {
    let eld_tile_t {
        pixel_m,
        coarse_px,
        sun_azimuth_deg,
        sun_elevation_deg,
        network_alone,
        processor_checks,
        image,
        ..
    } = tile;
    let eld_pixels_t { data, data_bytes, row_bytes, format, flags, gain, offset, null_code, saturated_from } = image;
    let numbers = [*network_alone, *processor_checks, *format, *flags, *null_code, *saturated_from];
    let floats = [pixel_m, coarse_px, sun_azimuth_deg, sun_elevation_deg, gain, offset].map(|v| v.to_bits());
    let places = [
        data.addr(),
        *data_bytes,
        *row_bytes,
        tile.coarse_m.addr(),
        tile.coarse_len,
        tile.valid.addr(),
        tile.valid_len,
        tile.posts.addr(),
        tile.light.addr(),
    ];
    let mut crc = file::Crc32c::default();
    numbers.iter().chain(&floats).for_each(|word| crc.update(&word.to_le_bytes()));
    places.iter().for_each(|place| crc.update(&(*place as u64).to_le_bytes()));
    if let Some(eld_posts_t { posts_m, posts_len, cols, row0, rows_per_line, col0, cols_per_px }) = posts {
        [posts_m.addr(), *posts_len, *cols].iter().for_each(|place| crc.update(&(*place as u64).to_le_bytes()));
        [row0, rows_per_line, col0, cols_per_px].iter().for_each(|v| crc.update(&v.to_bits().to_le_bytes()));
    }
    if let Some(light) = light {
        let eld_lighting_t { source, east, south, trust, related, long_share, .. } = light;
        let floats = [east, south, trust, related, long_share, &light.log_strength_sd, &light.azimuth_sd_deg];
        crc.update(&source.to_le_bytes());
        floats.iter().for_each(|v| crc.update(&v.to_bits().to_le_bytes()));
    }
    crc.value()
}

/// Returns a mask of bytes as booleans.
///
/// # Safety
/// The caller's promise holds for the pointer.
unsafe fn mask<'a>(pointer: *const u8, len: usize) -> Result<&'a [bool], eld_status_t> {
    // SAFETY: the caller's promise.
    let bytes = unsafe { slice(pointer, len) }?;
    if bytes.iter().any(|byte| *byte > 1) {
        return Err(ELD_REFUSED_TILE_MASK);
    }
    // SAFETY: the same bytes, each 0 or 1, which are the bit patterns of `bool`.
    unsafe { slice(pointer.cast::<bool>(), len) }
}
