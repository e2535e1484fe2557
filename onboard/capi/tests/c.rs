//! Runs C and C++ programs with the archive: the header compiles without a warning, and the heights equal those of Rust byte for byte.

mod cc;
mod common;
use cc::*;
use common::*;
use elunar_capi::status::ELD_RUNNING;
use elunar_capi::types::eld_tile_t;
use elunar_core::nn::{KnownSun, Lighting};
use elunar_core::norm::LightFit;
use elunar_core::pixels::PixelForm;
use elunar_core::strip::{Next, Strip, StripMemory, StripPlan, StripSettings};
use elunar_core::{Model, Runner};
use std::ffi::OsString;
use std::process::Command;

#[test]
fn a_c_program_computes_what_rust_computes() {
    let folder = folder("tile");
    let expected = {
        let (first, second) = (Tile::golden(), Tile::other());
        let (heights_m, valid) = first.expected();
        let bytes = |values: &[f32]| values.iter().flat_map(|v| v.to_ne_bytes()).collect::<Vec<u8>>();
        let (error_m, slope, origin) = first.expected_maps();
        [bytes(&heights_m), valid, bytes(&error_m), bytes(&slope), origin, bytes(&second.expected().0)].concat()
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

/// Makes the golden tile as a strip of the core, with the light of the stated Sun.
fn golden_strip() -> Vec<f32> {
    let (tile, model) = (Tile::golden(), Model::new(nano()).unwrap());
    let [azimuth_deg, elevation_deg] = tile.sun.map(|deg| Some(f64::from(deg)));
    let sun = KnownSun { azimuth_deg, elevation_deg };
    let settings = StripSettings {
        cols: COLS,
        ring_lines: StripPlan::least_lines(&model),
        overlap_px: 100,
        pixel_m: tile.pixel_m,
        coarse_px: tile.coarse_px,
        anchor: true,
        checked: false,
        light: Lighting::decide(model.illumination(), sun, &LightFit::default()),
        pixels: PixelForm::F32,
        posts: None,
        expected_errors: false,
    };
    let plan = StripPlan::new(&model, settings).unwrap();
    let (mut arena, mut bytes) = (vec![0; plan.arena_bytes()], vec![0; plan.bytes_len()]);
    let (mut samples, mut sums) = (vec![0.0; plan.samples_len()], vec![0.0; plan.sums_len()]);
    let memory = StripMemory { bytes: &mut bytes, samples: &mut samples, sums: &mut sums };
    let mut strip = Strip::new(plan, Runner::new(model, &mut arena).unwrap(), memory).unwrap();
    let mask = tile.valid.unwrap();
    let seen = |map: &[f32], row: usize| -> Vec<f32> {
        (row * COLS..(row + 1) * COLS).map(|i| if mask[i] == 1 { map[i] } else { f32::NAN }).collect()
    };
    for row in 0..ROWS {
        strip.push_line(&seen(&tile.image, row), &seen(&tile.coarse_m, row)).unwrap();
    }
    strip.finish();
    while strip.step(u64::MAX) != Next::Done {}
    let mut heights_m = vec![0.0; PX];
    heights_m.chunks_mut(COLS).for_each(|line| assert!(strip.take_line(line).unwrap().is_some()));
    heights_m
}

#[test]
fn a_strip_in_c_computes_what_rust_computes() {
    let (folder, expected) = (folder("strip"), golden_strip());
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        let service = repository().join("onboard/capi/examples/strip_service.c");
        let program = build(&[source("strip.c"), service], language, &folder);
        let out = folder.join("heights");
        let model = repository().join("host-train/models/nano.eld");
        let said = run(Command::new(&program).arg(model).arg(repository().join("tests/golden/flight_tile")).arg(&out));
        println!("{language}: {}", said.trim());
        let found: Vec<f32> =
            std::fs::read(&out).unwrap().as_chunks().0.iter().map(|bytes| f32::from_ne_bytes(*bytes)).collect();
        let same = |(a, b): (&f32, &f32)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan();
        assert!(found.len() == PX && found.iter().zip(&expected).all(same), "{language}: other heights");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_c_program_gives_posts() {
    use elunar_core::posts::PostMap;
    use elunar_core::samples::Samples;
    use elunar_core::strip::PostGrid;
    let folder = folder("posts");
    let mut tile = Tile::golden();
    // Every 16th height of every 16th row, from (8, 8) on.
    let of_row = |row: usize| tile.coarse_m[row * COLS..][..COLS].iter().skip(8).step_by(16).copied();
    let posts_m: Vec<f32> = (8..ROWS).step_by(16).flat_map(of_row).collect();
    let grid = PostGrid::spaced(20, (8.0, 8.0), (16.0, 16.0));
    let map = PostMap::new(&posts_m, grid, elunar_core::tile::Shape::new(ROWS, COLS)).unwrap();
    tile.coarse_m = (0..PX).map(|i| map.at(i)).collect();
    let expected: Vec<u8> = tile.expected().0.iter().flat_map(|z| z.to_ne_bytes()).collect();
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        let (program, out) = (build(&[source("posts.c")], language, &folder), folder.join("heights"));
        let model = repository().join("host-train/models/nano.eld");
        run(Command::new(&program).arg(model).arg(repository().join("tests/golden/flight_tile")).arg(&out));
        assert!(std::fs::read(&out).unwrap() == expected, "{language}: other bytes than Rust's");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_c_program_makes_two_tiles_under_one_light() {
    let folder = folder("light");
    let tile = Tile { sun: [f32::NAN; 2], ..Tile::golden() };
    let mut context = Context::new(nano());
    let mut half = tile.clone();
    half.image[..PX / 2].fill(f32::NAN);
    for tile in [&tile, &half] {
        while context.light_add(&tile.c(), 5_000_000) == ELD_RUNNING {}
    }
    let light = context.light_decide(tile.sun).unwrap();
    let mut expected = Vec::new();
    for tile in [&tile, &half] {
        let c = eld_tile_t { light: &raw const light, ..tile.c() };
        while context.begin_step(&c, 5_000_000) == ELD_RUNNING {}
        context.finish();
        expected.extend(context.output().unwrap().0.iter().flat_map(|z| z.to_ne_bytes()));
    }
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        let (program, out) = (build(&[source("light.c")], language, &folder), folder.join("heights"));
        let model = repository().join("host-train/models/nano.eld");
        run(Command::new(&program).arg(model).arg(repository().join("tests/golden/flight_tile")).arg(&out));
        assert!(std::fs::read(&out).unwrap() == expected, "{language}: other bytes than Rust's");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_c_program_finds_hazards() {
    use elunar_core::terrain::{HazardLimits, LineMaps, LineOptions, PixelSize, Sun, TerrainLines};
    let (folder, tile) = (folder("terrain"), Tile::golden());
    let mut heights_m = tile.coarse_m.clone();
    let valid = tile.valid.unwrap();
    heights_m.iter_mut().zip(&valid).filter(|(_, valid)| **valid == 0).for_each(|(z, _)| *z = f32::NAN);
    let limits = HazardLimits::new(4.0, 0.25).unwrap();
    let options = LineOptions { cols: COLS, pixel: PixelSize::square(2.0), radius_px: 3, sun: Sun::default(), limits };
    let mut memory = vec![0.0; options.memory_len()];
    let mut lines = TerrainLines::new(options, &mut memory).unwrap();
    let (mut expected, mut hazard) = (Vec::new(), vec![0; COLS]);
    for line in heights_m.chunks(COLS) {
        if lines.push(line, &mut LineMaps { hazard: &mut hazard, ..LineMaps::default() }).unwrap().is_some() {
            expected.extend(&hazard);
        }
    }
    while lines.finish(&mut LineMaps { hazard: &mut hazard, ..LineMaps::default() }).unwrap().is_some() {
        expected.extend(&hazard);
    }
    assert!(expected.contains(&0) && expected.iter().any(|hazard| hazard & 3 != 0));
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        let (program, out) = (build(&[source("terrain.c")], language, &folder), folder.join("hazards"));
        run(Command::new(&program).arg(repository().join("tests/golden/flight_tile")).arg(&out));
        assert!(std::fs::read(&out).unwrap() == expected, "{language}: other bytes than Rust's");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_model_is_updated_from_c() {
    let (folder, models) = (folder("slots"), repository().join("tests/golden/provoked"));
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        let program = build(&[source("slots.c")], language, &folder);
        let said = run(Command::new(&program).arg(models.join("mixed.eld")).arg(models.join("int8.eld")));
        println!("{language}: {}", said.trim());
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

/// Sizes and offsets of the C compiler are those that are listed.
#[test]
fn structures_are_laid_out_alike() {
    let mut text = String::from("#include \"elunar.h\"\n#include <stddef.h>\n");
    let listed = std::fs::read_to_string(repository().join("onboard/docs/structures.csv")).unwrap();
    for row in listed.lines().skip(1) {
        let cells: Vec<&str> = row.split(',').collect();
        let (structure, field, offset) =
            (cells[0], cells[1], cells[3 + usize::from(cfg!(target_pointer_width = "32"))]);
        let what =
            if field.is_empty() { format!("sizeof({structure})") } else { format!("offsetof({structure}, {field})") };
        text += &format!("typedef char {structure}_{field}[{what} == {offset} ? 1 : -1];\n");
    }
    let folder = folder("layout");
    let path = folder.join("layout.c");
    std::fs::write(&path, text).unwrap();
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        run(compiler(language).arg("-c").arg(&path).arg("-o").arg(OsString::from(folder.join("layout.o"))));
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
