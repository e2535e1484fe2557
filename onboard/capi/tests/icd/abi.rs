//! Compares the C interface in the page with the header: functions, statuses and structures.

use crate::page;
use crate::pages::read;
use elunar_capi::slots::types::*;
use elunar_capi::status::STATUSES;
use elunar_capi::strip::types::*;
use elunar_capi::types::*;
use std::collections::{BTreeMap, BTreeSet};
use std::mem::{offset_of, size_of};

/// Returns the part of the page that describes the functions.
fn functions(page: &str) -> &str {
    let (_, part) = page.split_once("### 2.2 Functions").unwrap();
    part.split_once("### 2.3").unwrap().0
}

#[test]
fn every_function_of_the_header_is_on_the_page_with_its_timing_class() {
    let (header, page) = (read("onboard/capi/include/elunar.h"), page());
    let declared: BTreeSet<&str> = header
        .split(|c: char| !(c.is_ascii_alphanumeric() || "_(".contains(c)))
        .filter_map(|word| word.strip_suffix('(').or_else(|| word.split_once('(').map(|(name, _)| name)))
        .filter(|name| name.starts_with("eld_"))
        .collect();
    assert!(declared.len() >= 13, "{declared:?}");
    let mut found = BTreeSet::new();
    for item in functions(&page).split("\n- ").skip(1) {
        let (names, rest) = item.split_once(" (").unwrap_or_else(|| panic!("{item}: no timing class"));
        found.extend(names.split(", ").map(|name| name.trim_matches(['*', '`'])));
        let class = rest.split([')', ',', ';']).next().unwrap();
        assert!(["constant", "budget", "line", "tile", "file"].contains(&class), "{item}: no timing class");
    }
    assert_eq!(found, declared);
}

#[test]
fn every_status_is_answered_by_some_function() {
    let page = page();
    let (_, rules) = page.split_once("### 2.1").unwrap();
    let (rules, _) = rules.split_once("### 2.3").unwrap();
    for name in STATUSES.iter().map(|known| known.name) {
        let family = ["ELD_REFUSED_MODEL_", "ELD_REFUSED_TILE_", "ELD_NOTICE_STRIP_", "ELD_NOTICE_SLOTS_"]
            .into_iter()
            .find(|family| name.starts_with(family));
        let said = family.map_or(format!("`{name}`"), |family| format!("`{family}*`"));
        assert!(rules.contains(&said), "{name}: no function answers it");
    }
    let version = [ELD_VERSION >> 16, ELD_VERSION >> 8 & 255, ELD_VERSION & 255].map(|part| part.to_string());
    assert!(page.contains(&format!("version {} (`ELD_VERSION`", version.join("."))));
}

/// A row of `structures.csv`: structure, field, type, and offsets with pointers of 64 and of 32 bits.
type Row = (String, String, String, [usize; 2]);

/// Lays the structures of the header out by the rules of C, for pointers of 64 and of 32 bits; a row without a field has the size.
fn structures(header: &str) -> Vec<Row> {
    let mut rows = Vec::new();
    let mut known: BTreeMap<String, [[usize; 2]; 2]> = BTreeMap::new(); // bytes and alignment
    for (name, bytes) in [("uint32_t", 4), ("float", 4), ("eld_status_t", 4), ("uint64_t", 8), ("double", 8)] {
        known.insert(name.into(), [[bytes; 2]; 2]);
    }
    known.insert("size_t".into(), [[8, 4]; 2]);
    for part in header.split("typedef struct {\n").skip(1) {
        let (body, rest) = part.split_once("\n} ").unwrap();
        let structure = rest.split(';').next().unwrap();
        let (mut at, mut alignment) = ([0; 2], [1; 2]);
        for line in body.lines().filter_map(|line| line.trim().strip_suffix(';')) {
            let split = line.rfind([' ', '*']).unwrap() + 1;
            let (kind, field) = (line[..split].trim(), &line[split..]);
            // An array has its length behind the name.
            let (field, count) = field
                .split_once('[')
                .map_or((field, 1), |(name, count)| (name, count.trim_end_matches(']').parse().unwrap()));
            let [one, align] = if kind.ends_with('*') { [[8, 4]; 2] } else { known[kind] };
            let bytes = one.map(|bytes: usize| bytes * count);
            let offset = [0, 1].map(|i| usize::next_multiple_of(at[i], align[i]));
            rows.push((structure.into(), field.into(), kind.into(), offset));
            at = [0, 1].map(|i| offset[i] + bytes[i]);
            alignment = [0, 1].map(|i| alignment[i].max(align[i]));
        }
        let bytes = [0, 1].map(|i| usize::next_multiple_of(at[i], alignment[i]));
        rows.push((structure.into(), String::new(), "whole".into(), bytes));
        known.insert(structure.into(), [bytes, alignment]);
    }
    rows
}

#[test]
fn structures_are_laid_out_as_listed() {
    let rows = structures(&read("onboard/capi/include/elunar.h"));
    let line = |(structure, field, kind, [wide, narrow]): &Row| format!("{structure},{field},{kind},{wide},{narrow}\n");
    let expected: String = rows.iter().map(line).collect();
    let found = read("onboard/docs/structures.csv");
    let found = found.strip_prefix("structure,field,type,offset_64,offset_32\n").unwrap();
    assert_eq!(found, expected, "onboard/docs/structures.csv");
    let names: BTreeSet<&str> = rows.iter().map(|row| row.0.as_str()).collect();
    assert_eq!(names.len(), 16, "{names:?}");
}

/// Compares the layout of structures in Rust with the one that is listed; it does not compile if a field is left out.
macro_rules! compare {
    ($($structure:ident { $($field:ident),* })*) => {$(
        fn $structure(it: &$structure) { let $structure { $($field: _),* } = it; }
        let _ = $structure;
        let code = [$((offset_of!($structure, $field), stringify!($field))),*, (size_of::<$structure>(), "")];
        compare_layout(stringify!($structure), &code);
    )*};
}

fn compare_layout(name: &str, code: &[(usize, &str)]) {
    let rows = structures(&read("onboard/capi/include/elunar.h"));
    let listed: Vec<(usize, &str)> =
        rows.iter().filter(|row| row.0 == name).map(|row| (row.3[0], row.1.as_str())).collect();
    assert_eq!(listed, code, "{name}");
}

#[test]
#[cfg(target_pointer_width = "64")]
fn structures_are_laid_out_in_rust_as_in_c() {
    compare! {
        eld_model_info_t { struct_bytes, format_version, tile_rows, tile_cols, image_maps, light, heights, memory_align, memory_bytes,
            arena_bytes, file_bytes, tile_macs, largest_unit_macs, header_crc, self_test_crc, nr, range_margin }
        eld_errors_t { struct_bytes, height_m, slope, explained, dark_height_m, dark_slope, dark_below }
        eld_lighting_t { struct_bytes, source, east, south, trust, related, long_share, log_strength_sd, azimuth_sd_deg }
        eld_sun_t { struct_bytes, azimuth_deg, elevation_deg, sub_solar_lat_deg, sub_solar_lon_deg, distance_au }
        eld_terrain_options_t { struct_bytes, cols, radius_px, row_m, col_m, slope_deg, roughness_m, sigmas, sun_azimuth_deg,
            sun_elevation_deg }
        eld_telemetry_t { struct_bytes, phase, entry, valid_px, last_fault, header_crc, calls, faults, context_repairs, lights_assumed,
            tiles_dropped, tiles, steps, macs, inputs_clamped, saturated, scrubbed_bytes, scrub_passes, scrub_faults, self_test_faults,
            tile_faults }
        eld_strip_telemetry_t { struct_bytes, last_fault, ready, calls, faults, context_repairs, tiles, tiles_coarse, tiles_empty,
            tiles_again, tiles_lost, tiles_void, memory_faults, pieces_lost, steps, macs, inputs_clamped, saturated, scrubbed_bytes,
            scrub_passes, scrub_faults, tile_faults }
        eld_strip_settings_t { struct_bytes, cols, ring_lines, overlap_px, pixel_m, coarse_px, sun_azimuth_deg, sun_elevation_deg,
            network_alone, expected_errors, post_cols, processor_checks, post_row0, post_rows_per_line, post_col0, post_cols_per_px, pixels, light,
            check }
        eld_pixels_t { data, data_bytes, row_bytes, format, flags, gain, offset, null_code, saturated_from }
        eld_tile_t { struct_bytes, pixel_m, coarse_px, sun_azimuth_deg, sun_elevation_deg, network_alone, processor_checks, image, coarse_m, coarse_len,
            valid, valid_len, posts, light }
        eld_posts_t { posts_m, posts_len, cols, row0, rows_per_line, col0, cols_per_px }
        eld_check_t { words }
        eld_slots_storage_t { struct_bytes, slot_sector_bytes, record_bytes, record_sector_bytes, slot_bytes }
        eld_slots_want_t { struct_bytes, what, region, reserved, offset_bytes, bytes, data }
        eld_slots_state_t { struct_bytes, standing, slot, file_bytes, header_crc, boots_left, rollbacks, record_copies, uploading, last_fault,
            uploaded_bytes, calls, faults, context_repairs, check }
        eld_terrain_maps_t { struct_bytes, slope_deg, hillshade, footprint_slope_deg, roughness_m, hazard }
    }
}
