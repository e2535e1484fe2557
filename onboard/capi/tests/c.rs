//! Runs C and C++ programs with the archive: the header compiles without a warning, and the heights equal those of Rust byte for byte.

mod cc;
mod common;
use cc::*;
use common::*;
use std::ffi::OsString;
use std::process::Command;

#[test]
fn a_c_program_computes_what_rust_computes() {
    let folder = folder("tile");
    let expected = {
        let (first, second) = (Tile::golden(), Tile::other());
        let (heights_m, valid) = first.expected();
        let bytes = |values: &[f32]| values.iter().flat_map(|v| v.to_ne_bytes()).collect::<Vec<u8>>();
        [bytes(&heights_m), valid, bytes(&second.expected().0)].concat()
    };
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        let program = build(&[source("tile.c")], language, &folder);
        let out = folder.join("heights");
        let model = repository().join("host-train/models/nano.eld");
        let said = run(Command::new(&program).arg(model).arg(repository().join("tests/golden/flight_tile")).arg(&out));
        println!("{language}: {}", said.trim());
        assert!(std::fs::read(&out).unwrap() == expected, "{language}: other bytes than Rust's");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn what_c_gets_wrong_has_a_status() {
    let folder = folder("misuse");
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        run(&mut Command::new(build(&[source("misuse.c")], language, &folder)));
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A program around the function that is the example of `onboard/README.md`.
const README_MAIN: &str = r#"
#include <stdio.h>
void kick_the_watchdog(void) {}
int main(void) {
    return heights(NULL, 0, NULL, 0, NULL, NULL, NULL) == ELD_REFUSED_NULL ? 0 : 1;
}
"#;

#[test]
fn the_readme_links() {
    let readme = std::fs::read_to_string(repository().join("onboard/README.md")).unwrap();
    let (_, rest) = readme.split_once("```c\n").expect("onboard/README.md has a block of C");
    let (block, _) = rest.split_once("```").unwrap();
    let lines = block.lines().filter(|line| !line.trim().is_empty()).count();
    assert!(lines <= 16, "{lines} lines");
    let folder = folder("readme");
    let path = folder.join("readme.c");
    std::fs::write(&path, format!("{block}{README_MAIN}")).unwrap();
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        run(&mut Command::new(build(std::slice::from_ref(&path), language, &folder)));
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Sizes and offsets of the C compiler equal those of Rust.
#[test]
fn structures_are_laid_out_alike() {
    use elunar_capi::types::*;
    use std::mem::{offset_of, size_of};
    let mut text = String::from("#include \"elunar.h\"\n#include <stddef.h>\n");
    macro_rules! lay_out {
        ($($structure:ident { $($field:ident),* })*) => {$(
            text += &format!("typedef char size_of_{0}[sizeof({0}) == {1} ? 1 : -1];\n", stringify!($structure), size_of::<$structure>());
            $(text += &format!("typedef char {0}_{1}[offsetof({0}, {1}) == {2} ? 1 : -1];\n", stringify!($structure), stringify!($field),
                offset_of!($structure, $field));)*
        )*};
    }
    lay_out! {
        eld_model_info_t { struct_bytes, memory_bytes, largest_unit_macs, header_crc, range_margin }
        eld_pixels_t { data, data_bytes, row_bytes, format, flags, gain, offset, null_code, saturated_from }
        eld_tile_t { struct_bytes, pixel_m, sun_elevation_deg, network_alone, image, coarse_m, coarse_len, valid, valid_len }
        eld_errors_t { struct_bytes, height_m, slope, explained, dark_height_m, dark_slope, dark_below }
        eld_telemetry_t { struct_bytes, valid_px, header_crc, calls, self_test_faults }
    }
    let folder = folder("layout");
    let path = folder.join("layout.c");
    std::fs::write(&path, text).unwrap();
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        run(compiler(language).arg("-c").arg(&path).arg("-o").arg(OsString::from(folder.join("layout.o"))));
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
