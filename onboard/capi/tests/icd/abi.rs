//! Compares the C interface in the page with the header: functions, statuses and structures.

use crate::pages::{read, section, table};
use crate::{number, page};
use elunar_capi::status::STATUSES;
use elunar_capi::strip::types::*;
use elunar_capi::types::*;
use std::collections::{BTreeMap, BTreeSet};
use std::mem::{offset_of, size_of};

#[test]
fn every_function_of_the_header_has_its_section_and_every_section_its_function() {
    let (header, page) = (read("onboard/capi/include/elunar.h"), page());
    let functions: BTreeSet<&str> = header
        .split(|c: char| !(c.is_ascii_alphanumeric() || "_(".contains(c)))
        .filter_map(|word| word.strip_suffix('(').or_else(|| word.split_once('(').map(|(name, _)| name)))
        .filter(|name| name.starts_with("eld_"))
        .collect();
    assert!(functions.len() >= 13, "{functions:?}");
    let (_, part) = page.split_once("### 2.2 Functions").unwrap();
    let (part, _) = part.split_once("### 2.3").unwrap();
    let headings: BTreeSet<&str> = part
        .lines()
        .filter_map(|line| line.strip_prefix("#### "))
        .flat_map(|line| line.split(", "))
        .map(|name| name.trim_matches('`'))
        .collect();
    assert_eq!(headings, functions);
    // Each section gives the time of the call, its duration and its answers.
    for name in &functions {
        let heading = if *name == "eld_format_version" { "`eld_version`" } else { &format!("`{name}`") };
        let text = section(&page, heading);
        assert!(
            ["Constant", "Budget", "Line", "Tile", "File"].iter().any(|class| text.contains(class)),
            "{name}: no timing class"
        );
        let silent = ["eld_version", "eld_format_version", "eld_status_text"].contains(name);
        assert!(silent || text.contains("Statuses: `ELD_OK`"), "{name}: no statuses");
    }
}

#[test]
fn every_status_is_listed_with_its_word_and_answered_by_some_function() {
    let page = page();
    let found: BTreeMap<String, String> =
        table(section(&page, "Words")).into_iter().map(|row| (row[1].clone(), row[0].clone())).collect();
    let code: BTreeMap<String, String> =
        STATUSES.iter().map(|known| (known.name.to_string(), format!("{:#010x}", known.status))).collect();
    assert_eq!(found, code);
    let (_, functions) = page.split_once("### 2.1").unwrap();
    let (functions, _) = functions.split_once("### 2.3").unwrap();
    for name in code.keys() {
        let family = ["ELD_REFUSED_MODEL_", "ELD_REFUSED_TILE_", "ELD_NOTICE_STRIP_"]
            .into_iter()
            .find(|family| name.starts_with(family));
        let said = family.map_or(format!("`{name}`"), |family| format!("`{family}*`"));
        assert!(functions.contains(&said), "{name}: no function answers it");
    }
    for (word, name) in [(0, "ELD_GOOD"), (1, "ELD_NOTICE"), (2, "ELD_REFUSED"), (3, "ELD_FAULT")] {
        assert!(
            read("onboard/capi/include/elunar.h")
                .lines()
                .any(|line| { line.split_whitespace().take(3).eq(["#define", name, &format!("{word}u")]) })
        );
        assert!(page.contains(&format!("| {word} | `{name}` |")));
    }
}

/// Returns the fields of a structure with their offsets; it does not compile if a field is left out.
macro_rules! layout {
    ($structure:ident { $($field:ident),* $(,)? }) => {{
        fn complete(it: $structure) { let $structure { $($field: _),* } = it; }
        let _ = complete;
        vec![$((offset_of!($structure, $field), stringify!($field))),*]
    }};
}

fn compare_layout(name: &str, code: &[(usize, &str)], bytes: usize, field: usize) {
    let page = page();
    let part = section(&page, &format!("`{name}`"));
    let rows = table(part);
    let found: Vec<(usize, &str)> = rows.iter().map(|row| (number(&row[0]) as usize, row[field].as_str())).collect();
    assert_eq!(found, code, "{name}");
    assert!(part.contains(&format!("\n{bytes} bytes")), "{name}: {bytes} bytes");
    let header = read("onboard/capi/include/elunar.h");
    for row in &rows {
        let (kind, name) = (&row[field + 1], &row[field]);
        let declared = if kind.ends_with('*') { format!("{kind}{name};") } else { format!("{kind} {name};") };
        assert!(header.contains(&declared), "{declared}");
    }
}

#[test]
#[cfg(target_pointer_width = "64")]
fn structures_are_laid_out_as_described() {
    let info = layout!(eld_model_info_t {
        struct_bytes,
        format_version,
        tile_rows,
        tile_cols,
        image_maps,
        light,
        heights,
        memory_align,
        memory_bytes,
        arena_bytes,
        file_bytes,
        tile_macs,
        largest_unit_macs,
        header_crc,
        self_test_crc,
        nr,
        range_margin,
    });
    compare_layout("eld_model_info_t", &info, size_of::<eld_model_info_t>(), 1);
    let errors =
        layout!(eld_errors_t { struct_bytes, height_m, slope, explained, dark_height_m, dark_slope, dark_below });
    compare_layout("eld_errors_t", &errors, size_of::<eld_errors_t>(), 1);
    let lighting = layout!(eld_lighting_t {
        struct_bytes,
        source,
        east,
        south,
        trust,
        related,
        long_share,
        log_strength_sd,
        azimuth_sd_deg,
    });
    compare_layout("eld_lighting_t", &lighting, size_of::<eld_lighting_t>(), 1);
    let options = layout!(eld_terrain_options_t {
        struct_bytes,
        cols,
        radius_px,
        row_m,
        col_m,
        slope_deg,
        roughness_m,
        sigmas,
        sun_azimuth_deg,
        sun_elevation_deg,
    });
    compare_layout("eld_terrain_options_t", &options, size_of::<eld_terrain_options_t>(), 1);
}

#[test]
fn counters_are_laid_out_as_described() {
    let telemetry = layout!(eld_telemetry_t {
        struct_bytes,
        phase,
        entry,
        valid_px,
        last_fault,
        header_crc,
        calls,
        faults,
        context_repairs,
        lights_assumed,
        tiles_dropped,
        tiles,
        steps,
        macs,
        inputs_clamped,
        saturated,
        scrubbed_bytes,
        scrub_passes,
        scrub_faults,
        self_test_faults,
        tile_faults,
    });
    compare_layout("eld_telemetry_t", &telemetry, size_of::<eld_telemetry_t>(), 1);
}

#[test]
#[cfg(target_pointer_width = "64")]
fn structures_of_strips_are_laid_out_as_described() {
    let strip = layout!(eld_strip_telemetry_t {
        struct_bytes,
        last_fault,
        ready,
        calls,
        faults,
        context_repairs,
        tiles,
        tiles_coarse,
        tiles_empty,
        tiles_again,
        tiles_lost,
        tiles_void,
        memory_faults,
        pieces_lost,
        steps,
        macs,
        inputs_clamped,
        saturated,
        scrubbed_bytes,
        scrub_passes,
        scrub_faults,
        tile_faults,
    });
    compare_layout("eld_strip_telemetry_t", &strip, size_of::<eld_strip_telemetry_t>(), 1);
    let settings = layout!(eld_strip_settings_t {
        struct_bytes,
        cols,
        ring_lines,
        overlap_px,
        pixel_m,
        coarse_px,
        sun_azimuth_deg,
        sun_elevation_deg,
        network_alone,
        expected_errors,
        post_cols,
        reserved,
        post_row0,
        post_rows_per_line,
        post_col0,
        post_cols_per_px,
        pixels,
        light,
    });
    compare_layout("eld_strip_settings_t", &settings, size_of::<eld_strip_settings_t>(), 1);
}

#[test]
#[cfg(target_pointer_width = "64")]
fn the_tile_is_laid_out_as_described_on_32_bits_too() {
    let pixels =
        layout!(eld_pixels_t { data, data_bytes, row_bytes, format, flags, gain, offset, null_code, saturated_from });
    compare_layout("eld_pixels_t", &pixels, size_of::<eld_pixels_t>(), 2);
    let tile = layout!(eld_tile_t {
        struct_bytes,
        pixel_m,
        coarse_px,
        sun_azimuth_deg,
        sun_elevation_deg,
        network_alone,
        image,
        coarse_m,
        coarse_len,
        valid,
        valid_len,
        posts,
        light,
    });
    let posts = layout!(eld_posts_t { posts_m, posts_len, cols, row0, rows_per_line, col0, cols_per_px });
    compare_layout("eld_posts_t", &posts, size_of::<eld_posts_t>(), 2);
    compare_layout("eld_tile_t", &tile, size_of::<eld_tile_t>(), 2);
    // On 32 bits all fields have four bytes, and the image nine of them.
    let narrow = |name: &str| table(section(&page(), name)).iter().map(|row| number(&row[1])).collect::<Vec<u64>>();
    assert_eq!(narrow("`eld_pixels_t`"), (0..pixels.len() as u64).map(|i| 4 * i).collect::<Vec<_>>());
    let image = tile.iter().position(|field| field.1 == "image").unwrap();
    let expected = (0..tile.len()).map(|i| 4 * (i + if i > image { pixels.len() - 1 } else { 0 }) as u64);
    assert_eq!(narrow("`eld_tile_t`"), expected.collect::<Vec<_>>());
    let maps =
        layout!(eld_terrain_maps_t { struct_bytes, slope_deg, hillshade, footprint_slope_deg, roughness_m, hazard });
    compare_layout("eld_terrain_maps_t", &maps, size_of::<eld_terrain_maps_t>(), 2);
    assert_eq!(narrow("`eld_terrain_maps_t`"), [0, 4, 8, 12, 16, 20]);
    // Three fields of four bytes, then doubles, which are aligned to eight.
    assert_eq!(narrow("`eld_posts_t`"), [0, 4, 8, 16, 24, 32, 40]);
    assert!(page().contains(&format!(
        "version {}.{}.{} (`ELD_VERSION`",
        ELD_VERSION >> 16,
        ELD_VERSION >> 8 & 255,
        ELD_VERSION & 255
    )));
}
