//! What the library says of itself and of a program's code, and two refusals of addresses.
#![allow(unsafe_code)] // C functions

mod common;
use common::*;
use elunar_capi::ffi::strip::eld_strip_init;
use elunar_capi::ffi::{eld_begin, eld_code_sum, eld_format_version, eld_kernel_name, eld_status_text, eld_version};
use elunar_capi::status::*;
use elunar_capi::strip::types::eld_strip_settings_t;
use elunar_capi::types::*;
use elunar_core::nn::{Kernel, code_sum, file};
use elunar_core::strip::PostGrid;
use std::ffi::CStr;
use std::ptr::null_mut;

#[test]
fn versions_and_texts_are_those_of_the_library() {
    assert_eq!((eld_version(), eld_format_version()), (ELD_VERSION, file::VERSION));
    for known in STATUSES {
        // SAFETY: never NULL, ended by NUL.
        assert_eq!(unsafe { CStr::from_ptr(eld_status_text(known.status)) }, known.text, "{}", known.name);
    }
}

#[test]
fn a_kernels_name_needs_room_for_its_nul() {
    let name = Kernel::best().name();
    let mut room = [b'x'; 64];
    for (len, expected) in [(0, ELD_REFUSED_BUFFER), (name.len(), ELD_REFUSED_BUFFER), (name.len() + 1, ELD_OK)] {
        // SAFETY: within the room.
        let status = unsafe { eld_kernel_name(room.as_mut_ptr().cast(), len) };
        assert_eq!(status, expected, "{len} bytes");
        assert!(status == ELD_OK || room == [b'x'; 64], "a refused call writes nothing");
    }
    assert_eq!(CStr::from_bytes_until_nul(&room).unwrap().to_str(), Ok(name));
}

#[test]
fn the_sum_of_code_is_that_of_its_bytes_and_lies_apart_from_them() {
    let mut code: Vec<u32> = (0..200u32).map(|i| i.wrapping_mul(2_654_435_761)).collect();
    let (place, mut sum) = (code.as_mut_ptr(), 0);
    // SAFETY: memory of our own.
    assert_eq!(unsafe { eld_code_sum(place.cast(), 799, &raw mut sum) }, ELD_OK);
    let bytes: Vec<u8> = code.iter().flat_map(|word| word.to_ne_bytes()).collect();
    assert_eq!(sum, code_sum(&bytes[..799]));
    // SAFETY: refused before anything is read or written.
    assert_eq!(unsafe { eld_code_sum(place.cast(), 800, place) }, ELD_REFUSED_OVERLAP);
}

#[test]
fn a_strip_needs_aligned_memory() {
    let (mut memory, mut strip) = (vec![0u64; 1000], null_mut());
    // SAFETY: plain numbers, and pointers that may be NULL.
    let settings: eld_strip_settings_t = unsafe { std::mem::zeroed() };
    // SAFETY: memory and model of our own.
    let status = unsafe {
        let place = memory.as_mut_ptr().cast::<u8>().add(1);
        eld_strip_init(place.cast(), 7000, nano().as_ptr().cast(), nano().len(), &settings, &raw mut strip)
    };
    assert_eq!((status, strip), (ELD_REFUSED_MEMORY_ALIGNMENT, null_mut()));
}

#[test]
fn coarse_heights_come_as_a_map_or_as_posts() {
    let tile = Tile::golden();
    let mut context = Context::new(nano());
    let posts_m = [0.0; 4];
    let posts = posts(&posts_m, PostGrid::spaced(2, (0.0, 0.0), (300.0, 300.0)));
    for (coarse_m, coarse_len) in [(tile.coarse_m.as_ptr(), PX), (tile.coarse_m.as_ptr(), 0), (std::ptr::null(), PX)] {
        let both = eld_tile_t { posts: &posts, coarse_m, coarse_len, ..tile.c() };
        // SAFETY: a context and a tile of our own.
        assert_eq!(unsafe { eld_begin(context.handle, &both) }, ELD_REFUSED_TILE_POSTS);
    }
    assert_eq!(context.telemetry().phase, ELD_PHASE_EMPTY);
}

/// The numbers of lights in a header and for C are those of the model's, whatever the light.
#[test]
fn a_models_light_is_told() {
    let guided = std::fs::read(repository().join("tests/golden/provoked/guided.eld")).unwrap();
    let lights = [ELD_LIGHT_ANY, ELD_LIGHT_NORTHWEST, ELD_LIGHT_GIVEN, ELD_LIGHT_WEIGHED, ELD_LIGHT_SLOPED];
    let mut told = vec![];
    let plain = std::fs::read(repository().join("core/fixtures/tile-v4.eld")).unwrap();
    for model in [nano(), &guided[..], &plain[..]] {
        for (code, light) in lights.into_iter().enumerate() {
            let mut model = model.to_vec();
            file::set_word(&mut model, file::word::ILLUMINATION, code as u32);
            file::seal_file(&mut model);
            // Models with another number of maps are refused.
            if let Ok(info) = info(&model) {
                assert_eq!(info.light, light);
                told.push(light);
            }
        }
    }
    assert_eq!(told.len(), lights.len(), "{told:?}");
}

#[test]
fn a_step_after_the_self_test_changes_nothing() {
    let mut context = Context::new(nano());
    assert_eq!(context.self_test_begin(), ELD_OK);
    context.finish();
    let before = context.telemetry();
    assert_eq!((context.step(1), context.self_test_check()), (ELD_OK, ELD_OK));
    let after = context.telemetry();
    assert_eq!((after.phase, after.macs), (ELD_PHASE_SELF_TEST_DONE, before.macs));
}

#[test]
fn a_light_decided_from_a_known_sun_serves_a_tile() {
    let tile = Tile::golden();
    let mut context = Context::new(nano());
    let light = context.light_decide(tile.sun).unwrap();
    assert_eq!(light.source, ELD_SOURCE_GIVEN);
    let lit = eld_tile_t { light: &light, ..tile.c() };
    // SAFETY: a context and a tile of our own.
    assert_eq!(unsafe { eld_begin(context.handle, &lit) }, ELD_OK);
}
