//! Strips and terrain maps through the C functions, with marks around every call and a checksum of what comes out. A strip of one brightness
//! comes out whole; of one that shows ground only the first steps are made, unless the model is small.

use crate::c_calls::{BUDGET_MACS, counted};
use core::fmt::Write;
use elunar_capi::elunar_core::nn::file::Crc32c;
use elunar_capi::ffi;
use elunar_capi::ffi::strip::*;
use elunar_capi::status::*;
use elunar_capi::strip::types::*;
use elunar_capi::types::*;

/// Samples of a line of terrain maps.
const TERRAIN_COLS: usize = 1024;
/// Posts in a row, 40 pixels apart.
const POST_COLS: usize = 12;

fn settings(info: &eld_model_info_t, check: &eld_check_t) -> eld_strip_settings_t {
    let pixels = eld_pixels_t {
        data: core::ptr::null(),
        data_bytes: 0,
        row_bytes: 0,
        format: ELD_PIXELS_U16_LE,
        flags: 0,
        gain: 1.0,
        offset: 0.0,
        null_code: 0,
        saturated_from: 0,
    };
    eld_strip_settings_t {
        struct_bytes: size_of::<eld_strip_settings_t>() as u32,
        cols: info.tile_cols,
        ring_lines: 0,
        overlap_px: 4,
        pixel_m: 2.0,
        coarse_px: 40.0,
        sun_azimuth_deg: 315.0,
        sun_elevation_deg: 35.0,
        network_alone: 0,
        expected_errors: 1,
        post_cols: POST_COLS as u32,
        processor_checks: 0,
        post_row0: 1.5,
        post_rows_per_line: 1.0 / 40.0,
        post_col0: 1.5,
        post_cols_per_px: 1.0 / 40.0,
        pixels,
        light: core::ptr::null(),
        check: &raw const *check,
    }
}

/// The line that is pushed or taken.
struct Lines<'l> {
    pixels: &'l mut [u8],
    floats: [&'l mut [f32]; 3],
    origins: &'l mut [u8],
    crc: Crc32c,
    pushed: usize,
    posts: usize,
    taken: usize,
}

impl Lines<'_> {
    /// Makes the next line; `even` has one brightness.
    fn paint(&mut self, even: bool) {
        for (col, code) in self.pixels.as_chunks_mut::<2>().0.iter_mut().enumerate() {
            let noise = ((self.pushed * 131 + col * 71) as u32).wrapping_mul(2_654_435_761) >> 16 & 511;
            *code = if even { 1000u16 } else { 1500 + noise as u16 }.to_le_bytes();
        }
        self.pushed += 1;
    }

    fn posts(&mut self) -> [f32; POST_COLS] {
        self.posts += 1;
        core::array::from_fn(|col| -1900.0 + ((self.posts * 7 + col * 5) % 11) as f32)
    }
}

/// Makes a strip of one tile of a model whose check is finished; at most `most` steps. Returns whether no call reported a fault.
pub(crate) fn strip(
    (model, check, info): (&[u8], &eld_check_t, &eld_model_info_t),
    memory: &mut [u64],
    (even, most): (bool, usize),
    console: &mut impl Write,
) -> bool {
    let _ = writeln!(console, "tile {}", if even { "StripEven" } else { "Strip" });
    let (settings, cols) = (settings(info, check), info.tile_cols as usize);
    let (lines, memory) = memory.split_at_mut(4 * cols);
    let (mut bytes, mut strip, file) = (0, core::ptr::null_mut(), (model.as_ptr().cast(), model.len()));
    // SAFETY: buffers and structures of our own, here and below.
    let mut worst = counted("eld_strip_plan", console, || unsafe {
        eld_strip_plan(file.0, file.1, &raw const settings, &raw mut bytes)
    });
    // SAFETY: as above.
    worst = worst.max(counted("eld_strip_init", console, || unsafe {
        let place = memory.as_mut_ptr().cast();
        eld_strip_init(place, bytes as usize, file.0, file.1, &raw const settings, &raw mut strip)
    }));
    if bytes as usize > size_of_val(memory) || severity(worst) > NOTICE {
        let _ = writeln!(console, "ERROR: a strip of {bytes} bytes: {worst:08x}");
        return false;
    }
    let (pixels, rest) = lines.split_at_mut(cols);
    // SAFETY: any bits are numbers; numbers of eight bytes are aligned for shorter ones.
    let (pixels, floats) = unsafe { (pixels.align_to_mut::<u8>().1, rest.align_to_mut::<f32>().1) };
    let (a, rest) = floats.split_at_mut(cols);
    let (b, rest) = rest.split_at_mut(cols);
    let (c, rest) = rest.split_at_mut(cols);
    // SAFETY: as above.
    let origins = unsafe { rest.align_to_mut::<u8>().1 };
    let mut lines = Lines {
        pixels: &mut pixels[..2 * cols],
        floats: [a, b, c],
        origins: &mut origins[..cols],
        crc: Crc32c::default(),
        pushed: 0,
        posts: 0,
        taken: 0,
    };
    for _ in 0..most {
        // SAFETY: as above.
        let next = counted("eld_strip_step", console, || unsafe { eld_strip_step(strip, BUDGET_MACS) });
        worst = worst.max(next);
        match next {
            ELD_RUNNING => {}
            ELD_NOTICE_STRIP_POSTS => {
                let posts = lines.posts();
                // SAFETY: as above.
                worst = worst.max(counted("eld_strip_push_posts", console, || unsafe {
                    eld_strip_push_posts(strip, posts.as_ptr(), POST_COLS)
                }));
            }
            ELD_NOTICE_STRIP_PUSH if lines.pushed < info.tile_rows as usize => {
                lines.paint(even);
                // SAFETY: as above.
                worst = worst.max(counted("eld_strip_push", console, || unsafe {
                    eld_strip_push(strip, lines.pixels.as_ptr().cast(), lines.pixels.len(), core::ptr::null(), 0)
                }));
            }
            ELD_NOTICE_STRIP_PUSH => {
                // SAFETY: as above.
                worst =
                    worst.max(counted("eld_strip_finish_posts", console, || unsafe { eld_strip_finish_posts(strip) }));
                // SAFETY: as above.
                worst = worst.max(counted("eld_strip_finish", console, || unsafe { eld_strip_finish(strip) }));
            }
            _ => {
                worst = worst.max(take(strip, &mut lines, console));
                if next == ELD_NOTICE_STRIP_DONE {
                    break;
                }
            }
        }
        if severity(worst) > NOTICE {
            break;
        }
    }
    let mut told =
        eld_strip_telemetry_t { struct_bytes: size_of::<eld_strip_telemetry_t>() as u32, ..Default::default() };
    // SAFETY: as above.
    worst = worst.max(counted("eld_strip_scrub", console, || unsafe { eld_strip_scrub(strip, 1 << 14) }));
    // SAFETY: as above.
    worst = worst.max(counted("eld_strip_telemetry", console, || unsafe { eld_strip_telemetry(strip, &raw mut told) }));
    let lost = told.memory_faults + told.pieces_lost + told.tiles_again;
    let (kind, taken, crc) = (if even { "StripEven" } else { "Strip" }, lines.taken, lines.crc.value());
    let _ = writeln!(console, "tile {kind} lines {taken} tiles {} lost {lost} sum {crc:08x}", told.tiles);
    severity(worst) <= NOTICE && lost == 0
}

/// Takes all finished lines.
fn take(strip: *mut eld_strip_t, lines: &mut Lines<'_>, console: &mut impl Write) -> eld_status_t {
    loop {
        let (mut line, cols, Lines { floats: [a, b, c], origins, crc, taken, .. }) =
            (0, lines.origins.len(), &mut *lines);
        // SAFETY: a strip and buffers of our own.
        let status = counted("eld_strip_take", console, || unsafe {
            let (a, b, c) = (a.as_mut_ptr(), b.as_mut_ptr(), c.as_mut_ptr());
            eld_strip_take(strip, a, b, c, origins.as_mut_ptr(), cols, &raw mut line)
        });
        if status == ELD_NOTICE_STRIP_NO_LINE || severity(status) > NOTICE {
            return status;
        }
        for value in a.iter().chain(b.iter()).chain(c.iter()) {
            // Which NaN it is differs between processors.
            let bits = if value.is_nan() { u32::MAX } else { value.to_bits() };
            crc.update(&bits.to_le_bytes());
        }
        crc.update(origins);
        *taken += 1;
    }
}

/// Makes terrain maps of a few lines, for a vehicle of seven pixels.
pub(crate) fn terrain(memory: &mut [u64], console: &mut impl Write) -> bool {
    let _ = writeln!(console, "tile Terrain");
    let options = eld_terrain_options_t {
        struct_bytes: size_of::<eld_terrain_options_t>() as u32,
        cols: TERRAIN_COLS as u32,
        radius_px: 3,
        row_m: 2.0,
        col_m: 2.0,
        slope_deg: 8.0,
        roughness_m: 0.6,
        sigmas: 1.0,
        sun_azimuth_deg: 315.0,
        sun_elevation_deg: 35.0,
    };
    let (maps_memory, memory) = memory.split_at_mut(5 * TERRAIN_COLS);
    let (mut bytes, mut terrain, mut row, mut crc) = (0, core::ptr::null_mut(), 0, Crc32c::default());
    let mut sun = eld_sun_t { struct_bytes: size_of::<eld_sun_t>() as u32, ..Default::default() };
    // SAFETY: buffers and structures of our own, here and below.
    let seen =
        counted("eld_sun_position", console, || unsafe { ffi::eld_sun_position(3529.0, 26.13, 3.63, &raw mut sun) });
    // SAFETY: as above.
    let mut worst = seen.max(counted("eld_terrain_plan", console, || unsafe {
        ffi::eld_terrain_plan(&raw const options, &raw mut bytes)
    }));
    // SAFETY: as above.
    worst = worst.max(counted("eld_terrain_init", console, || unsafe {
        ffi::eld_terrain_init(memory.as_mut_ptr().cast(), size_of_val(memory), &raw const options, &raw mut terrain)
    }));
    // SAFETY: any bits are numbers; numbers of eight bytes are aligned for shorter ones.
    let maps_memory = unsafe { maps_memory.align_to_mut::<f32>().1 };
    let (line_m, rest) = maps_memory.split_at_mut(TERRAIN_COLS);
    let (slopes, rest) = rest.split_at_mut(TERRAIN_COLS);
    let (floats, rest) = rest.split_at_mut(3 * TERRAIN_COLS);
    // SAFETY: as above.
    let codes = unsafe { rest.align_to_mut::<u8>().1 };
    let (hillshade, hazard) = codes[..2 * TERRAIN_COLS].split_at_mut(TERRAIN_COLS);
    let maps = eld_terrain_maps_t {
        struct_bytes: size_of::<eld_terrain_maps_t>() as u32,
        slope_deg: floats.as_mut_ptr(),
        footprint_slope_deg: floats.as_mut_ptr().wrapping_add(TERRAIN_COLS),
        roughness_m: floats.as_mut_ptr().wrapping_add(2 * TERRAIN_COLS),
        hillshade: hillshade.as_mut_ptr(),
        hazard: hazard.as_mut_ptr(),
    };
    for line in 0..24 {
        for (col, (z, slope)) in line_m.iter_mut().zip(&mut *slopes).enumerate() {
            (*z, *slope) = (((line * 5 + col * 3) % 17) as f32 * 0.1 + ((line + col) % 101) as f32 * 0.2, 0.02);
        }
        let status = if line < 16 {
            // SAFETY: as above.
            counted("eld_terrain_push", console, || unsafe {
                ffi::eld_terrain_push(
                    terrain,
                    line_m.as_ptr(),
                    slopes.as_ptr(),
                    TERRAIN_COLS,
                    &raw const maps,
                    &raw mut row,
                )
            })
        } else {
            // SAFETY: as above.
            counted("eld_terrain_finish", console, || unsafe {
                ffi::eld_terrain_finish(terrain, &raw const maps, &raw mut row)
            })
        };
        worst = worst.max(status);
        if status == ELD_OK {
            crc.update(hazard);
        }
    }
    let _ = writeln!(console, "tile Terrain status {worst:08x} sum {:08x}", crc.value());
    severity(worst) <= NOTICE
}
