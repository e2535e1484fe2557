//! The path of a tile through the C functions: seven kinds of tiles, with marks around every call, so that the counter reports each call, and a
//! checksum of what comes out, which is the same on every machine.

use crate::mark::{elunar_count_start, elunar_count_stop};
use core::fmt::Write;
use elunar_capi::elunar_core::nn::file::Crc32c;
use elunar_capi::ffi;
use elunar_capi::status::{ELD_OK, ELD_RUNNING, FAULT, NOTICE, severity};
use elunar_capi::types::{
    ELD_PIXELS_HAS_NULL, ELD_PIXELS_U16_LE, eld_check_t, eld_context_t, eld_errors_t, eld_lighting_t, eld_model_info_t,
    eld_pixels_t, eld_posts_t, eld_status_t, eld_telemetry_t, eld_tile_t,
};

/// Multiply-accumulates per call, as in the budgets.
pub(crate) const BUDGET_MACS: u64 = 5_000_000;
/// Bytes of the model that are checked in a call, as in the guides.
const SCRUB_BYTES: usize = 16_384;
/// Bytes whose checksum stands for a program's.
const CODE_BYTES: usize = 65_536;
/// The code of a pixel without a value.
const NULL_CODE: u16 = 0xffff;

/// A kind of tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Under a Sun that is told.
    Told,
    /// The same, with checks of the processor.
    Checked,
    /// With voids in both maps and a shadow, under an unknown Sun.
    Voids,
    /// With one brightness: it shows nothing.
    Even,
    /// Level ground, whose light is assumed.
    Level,
    /// With a coarse DTM of small pixels, which takes the fit of the light longest.
    Fine,
    /// With a coarse DTM as posts.
    Posts,
}

impl Kind {
    /// Returns whether the Sun is told.
    fn is_told(self) -> bool {
        matches!(self, Self::Told | Self::Checked)
    }
}

/// The caller's memory.
struct Own<'m> {
    image: &'m mut [u16],
    coarse_m: &'m mut [f32],
    heights_m: &'m mut [f32],
    valid: &'m mut [u8],
}

/// Runs all kinds of tiles; prints a line per call and per tile. Returns whether no call reported a fault.
pub(crate) fn run(model: &[u8], memory: &mut [u8], console: &mut impl Write) -> bool {
    let mut info = eld_model_info_t { struct_bytes: size_of::<eld_model_info_t>() as u32, ..Default::default() };
    let mut check = eld_check_t::default();
    // SAFETY: a slice and structures of our own.
    let checked = repeated("eld_model_check_step", console, &mut || unsafe {
        let (bytes, len) = (model.as_ptr().cast(), model.len());
        ffi::eld_model_check_step(bytes, len, BUDGET_MACS, &raw mut check, &raw mut info)
    });
    let pixels = (info.tile_rows * info.tile_cols) as usize;
    let Some((context_memory, mut own, rest)) = divided(memory, info.memory_bytes as usize, pixels) else {
        let _ = writeln!(console, "ERROR: {} bytes of memory are too few", memory.len());
        return false;
    };
    let mut context = core::ptr::null_mut();
    // SAFETY: memory of our own, which lives as long as the context.
    let made = counted("eld_init_checked", console, || unsafe {
        let (memory, bytes) = (context_memory.as_mut_ptr().cast(), context_memory.len());
        ffi::eld_init_checked(memory, bytes, model.as_ptr().cast(), model.len(), &raw const check, &raw mut context)
    });
    if (checked, made) != (ELD_OK, ELD_OK) {
        let _ = writeln!(console, "ERROR: {checked:#x} {made:#x}");
        return false;
    }
    let kinds = [Kind::Told, Kind::Checked, Kind::Voids, Kind::Even, Kind::Level, Kind::Fine, Kind::Posts];
    // The network of a large tile takes long; one is enough to compare it, and one to compare what its checks cost.
    let whole = |kind: Kind| kind.is_told() || pixels < 10_000;
    let all = kinds.map(|kind| tile(context, kind, info.tile_cols as usize, whole(kind), &mut own, console));
    let small = pixels < 10_000;
    let mut passed = self_test(context, console) && all.iter().all(|passed| *passed);
    passed &= crate::c_slots::run(model, context, rest, console);
    passed &= housekeeping(context, model, console);
    passed &= crate::c_lines::terrain(rest, console);
    // The context is not needed any more.
    // SAFETY: any bits are numbers; what is not aligned is left out.
    let (memory, known) = (unsafe { memory.align_to_mut::<u64>().1 }, (model, &check, &info));
    passed &= crate::c_lines::strip(known, memory, (true, usize::MAX), console);
    passed & crate::c_lines::strip(known, memory, (false, if small { usize::MAX } else { 400 }), console)
}

/// Runs and checks the self test.
fn self_test(context: *mut eld_context_t, console: &mut impl Write) -> bool {
    let _ = writeln!(console, "tile SelfTest");
    // SAFETY: a context of our own, here and below.
    let mut status = counted("eld_self_test_begin", console, || unsafe { ffi::eld_self_test_begin(context) });
    // SAFETY: as above.
    status = status.max(repeated("eld_step", console, &mut || unsafe { ffi::eld_step(context, BUDGET_MACS) }));
    // SAFETY: as above.
    status = status.max(counted("eld_self_test_check", console, || unsafe { ffi::eld_self_test_check(context) }));
    severity(status) < FAULT
}

/// Calls what flight software calls now and then.
fn housekeeping(context: *mut eld_context_t, model: &[u8], console: &mut impl Write) -> bool {
    let _ = writeln!(console, "tile -");
    let mut told = eld_telemetry_t { struct_bytes: size_of::<eld_telemetry_t>() as u32, ..Default::default() };
    let mut light = eld_lighting_t { struct_bytes: size_of::<eld_lighting_t>() as u32, ..Default::default() };
    let (bytes, nan) = (model.get(..CODE_BYTES).unwrap_or(model), f32::NAN);
    // SAFETY: a context, structures and bytes of our own, here and below.
    let mut worst = counted("eld_scrub", console, || unsafe { ffi::eld_scrub(context, SCRUB_BYTES) });
    // SAFETY: as above.
    worst = worst.max(counted("eld_telemetry", console, || unsafe { ffi::eld_telemetry(context, &raw mut told) }));
    // SAFETY: as above.
    worst = worst.max(counted("eld_light_decide", console, || unsafe {
        ffi::eld_light_decide(context, nan, nan, &raw mut light)
    }));
    // SAFETY: as above.
    worst = worst.max(counted("eld_light_clear", console, || unsafe { ffi::eld_light_clear(context) }));
    // SAFETY: as above.
    worst = worst.max(counted("eld_abort", console, || unsafe { ffi::eld_abort(context) }));
    // As long as a page of code.
    let mut sum = 0;
    // SAFETY: as above.
    worst = worst.max(counted("eld_code_sum", console, || unsafe {
        ffi::eld_code_sum(bytes.as_ptr().cast(), bytes.len(), &raw mut sum)
    }));
    severity(worst) <= NOTICE
}

/// Calls a function between the marks and prints its name.
pub(crate) fn counted(name: &str, console: &mut impl Write, call: impl FnOnce() -> eld_status_t) -> eld_status_t {
    elunar_count_start();
    let status = call();
    elunar_count_stop();
    let _ = writeln!(console, "call {name}");
    status
}

/// Calls a function until it is done, as [`counted`].
pub(crate) fn repeated(name: &str, console: &mut impl Write, call: &mut dyn FnMut() -> eld_status_t) -> eld_status_t {
    loop {
        let status = counted(name, console, &mut *call);
        if status != ELD_RUNNING {
            return status;
        }
    }
}

/// Divides memory into that of the context, the caller's maps, and the rest.
fn divided(memory: &mut [u8], context_bytes: usize, pixels: usize) -> Option<(&mut [u8], Own<'_>, &mut [u64])> {
    // SAFETY: any bits are numbers; what is not aligned is left out.
    let memory = unsafe { memory.align_to_mut::<u64>().1 };
    let (context, memory) = memory.split_at_mut_checked(context_bytes.div_ceil(8))?;
    let (heights, memory) = memory.split_at_mut_checked(pixels.div_ceil(2))?;
    let (coarse, memory) = memory.split_at_mut_checked(pixels.div_ceil(2))?;
    let (image, memory) = memory.split_at_mut_checked(pixels.div_ceil(4))?;
    let (valid, rest) = memory.split_at_mut_checked(pixels.div_ceil(8))?;
    // SAFETY: as above; numbers of eight bytes are aligned for shorter ones.
    let (context, heights_m, coarse_m, image, valid) = unsafe {
        let context = context.align_to_mut::<u8>().1;
        (
            context,
            heights.align_to_mut::<f32>().1,
            coarse.align_to_mut::<f32>().1,
            image.align_to_mut::<u16>().1,
            valid.align_to_mut::<u8>().1,
        )
    };
    let own = Own {
        image: image.get_mut(..pixels)?,
        coarse_m: coarse_m.get_mut(..pixels)?,
        heights_m: heights_m.get_mut(..pixels)?,
        valid: valid.get_mut(..pixels)?,
    };
    Some((context.get_mut(..context_bytes)?, own, rest))
}

/// Runs a tile through all calls; prints its checksums.
fn tile(
    context: *mut eld_context_t,
    kind: Kind,
    cols: usize,
    whole: bool,
    own: &mut Own<'_>,
    console: &mut impl Write,
) -> bool {
    paint(kind, cols, own);
    let (azimuth, elevation) = if kind.is_told() { (315.0, 35.0) } else { (f32::NAN, f32::NAN) };
    let image = eld_pixels_t {
        data: own.image.as_ptr().cast(),
        data_bytes: size_of_val(own.image),
        row_bytes: 0,
        format: ELD_PIXELS_U16_LE,
        flags: ELD_PIXELS_HAS_NULL,
        gain: 1.0,
        offset: 0.0,
        null_code: NULL_CODE.into(),
        saturated_from: 0,
    };
    // Eleven rows of posts, 30 pixels apart.
    let posts = eld_posts_t {
        posts_m: own.coarse_m.as_ptr(),
        posts_len: 11 * 13,
        cols: 13,
        row0: 0.75,
        rows_per_line: 1.0 / 30.0,
        col0: 0.5,
        cols_per_px: 1.0 / 30.0,
    };
    let is_posts = kind == Kind::Posts;
    let tile = eld_tile_t {
        struct_bytes: size_of::<eld_tile_t>() as u32,
        pixel_m: 2.0,
        coarse_px: if kind == Kind::Fine { 4.0 } else { 8.0 },
        sun_azimuth_deg: azimuth,
        sun_elevation_deg: elevation,
        network_alone: 0,
        processor_checks: (kind == Kind::Checked).into(),
        image,
        coarse_m: if is_posts { core::ptr::null() } else { own.coarse_m.as_ptr() },
        coarse_len: if is_posts { 0 } else { own.coarse_m.len() },
        valid: core::ptr::null(),
        valid_len: 0,
        posts: if is_posts { &raw const posts } else { core::ptr::null() },
        light: core::ptr::null(),
    };
    let _ = writeln!(console, "tile {kind:?}");
    let mut repeat = |name: &str, call: &mut dyn FnMut() -> eld_status_t| repeated(name, console, call);
    if kind == Kind::Fine {
        // SAFETY: a context and a tile of our own.
        let _ = repeat("eld_light_add", &mut || unsafe { ffi::eld_light_add(context, &tile, BUDGET_MACS) });
    }
    // SAFETY: a context and a tile of our own, here and below.
    let begun = repeat("eld_begin_step", &mut || unsafe { ffi::eld_begin_step(context, &tile, BUDGET_MACS) });
    let mut done = begun;
    if whole && severity(begun) < 2 {
        // SAFETY: as above.
        done = repeat("eld_step", &mut || unsafe { ffi::eld_step(context, BUDGET_MACS) });
        let (heights, valid) =
            ((own.heights_m.as_mut_ptr(), own.heights_m.len()), (own.valid.as_mut_ptr(), own.valid.len()));
        // SAFETY: as above, and buffers of our own.
        done = done.max(repeat("eld_output", &mut || unsafe {
            ffi::eld_output(context, heights.0, heights.1, valid.0, valid.1)
        }));
    }
    let mut errors = eld_errors_t { struct_bytes: size_of::<eld_errors_t>() as u32, ..Default::default() };
    if whole {
        // SAFETY: as above.
        let _ = repeat("eld_errors", &mut || unsafe { ffi::eld_errors(context, &raw mut errors) });
    }
    let mut sum = checksum(own, &errors);
    if whole && severity(begun) < 2 {
        // The coarse heights are not needed any more.
        let (len, errors) = (own.heights_m.len(), (own.heights_m.as_mut_ptr(), own.coarse_m.as_mut_ptr()));
        // SAFETY: as above.
        done = done.max(repeat("eld_error_maps", &mut || unsafe {
            ffi::eld_error_maps(context, errors.0, errors.1, own.valid.as_mut_ptr(), len)
        }));
        sum ^= checksum(own, &eld_errors_t::default());
        own.heights_m.copy_from_slice(own.coarse_m);
        sum ^= checksum(own, &eld_errors_t::default()).rotate_left(1);
    }
    let _ =
        writeln!(console, "tile {kind:?} begun {begun:08x} done {done:08x} sum {:08x}", if whole { sum } else { 0 });
    severity(begun) < FAULT && severity(done) < FAULT
}

/// Returns the checksum of heights, validity and expected errors.
fn checksum(own: &Own<'_>, errors: &eld_errors_t) -> u32 {
    let mut crc = Crc32c::default();
    let eld_errors_t { height_m, slope, explained, dark_height_m, dark_slope, dark_below, .. } = *errors;
    for value in own.heights_m.iter().chain(&[height_m, slope, explained, dark_height_m, dark_slope, dark_below]) {
        crc.update(&value.to_bits().to_le_bytes());
    }
    crc.update(own.valid);
    crc.value()
}

/// Makes rough ground of waves and its image, in numbers that are the same on every machine.
fn paint(kind: Kind, cols: usize, own: &mut Own<'_>) {
    let noise = |index: usize, salt: u32| {
        let mixed = (index as u32).wrapping_mul(2_654_435_761).wrapping_add(salt.wrapping_mul(40_503));
        (mixed ^ mixed >> 15).wrapping_mul(2_246_822_519) >> 16
    };
    // A triangular wave of so many pixels, from 0 to 1.
    let wave = |place: usize, length: usize| {
        let phase = place % length;
        phase.min(length - phase) as f32 / length as f32 * 2.0
    };
    let height = |row: usize, col: usize| {
        9.0 * wave(row + 2 * col, 53) + 6.0 * wave(3 * row + 400 - col.min(400), 37) + 2.5 * wave(row * 2 + col, 17)
    };
    for (index, ((code, z), valid)) in own.image.iter_mut().zip(&mut *own.coarse_m).zip(&mut *own.valid).enumerate() {
        let (row, col) = (index / cols, index % cols);
        // Ground that rises to the south-east faces the Sun in the north-west.
        let rise = height(row + 1, col + 1) - height(row, col);
        let bright = 2000.0 + 900.0 * rise + (noise(index, 1) % 64) as f32;
        let level = kind == Kind::Level;
        *z = if level { -1900.0 } else { -1900.0 + height(row, col) };
        *code = match kind {
            Kind::Even => 1000,
            Kind::Level => 2000 + (noise(index, 2) % 512) as u16,
            // As numbers of 16 bits, whatever the processor's order of bytes.
            _ => bright.clamp(40.0, 8000.0) as u16,
        };
        if kind == Kind::Voids {
            match noise(index, 3) % 200 {
                0 => *code = NULL_CODE,
                1 => *z = f32::NAN,
                _ if row > 20 && col < 12 => *code = 30,
                _ => (),
            }
        }
        *code = code.to_le();
        *valid = 0;
    }
    own.heights_m.fill(0.0);
}
