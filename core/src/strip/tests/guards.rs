//! Bits that flip in the memory of a strip between two calls; forms of pixels and posts.

use super::rig::{Blocks, Scene, TILE, assert_same, file, run, settings, take};
use crate::nn::{Model, Runner};
use crate::pixels::{PixelForm, PixelFormat};
use crate::strip::{LineErrors, Next, PostGrid, Posts, Strip, StripCounters, StripPlan, StripSettings};

const BUDGET: u64 = 6_000;

/// Runs a strip; before each call `flip` gets the number of calls and the memory. Returns heights, counters and the number of calls.
fn run_flipped(
    file: &[u8],
    scene: &Scene,
    settings: StripSettings,
    mut flip: impl FnMut(usize, &mut Blocks),
) -> (Vec<f32>, StripCounters, usize) {
    let model = Model::new(file).unwrap();
    let plan = StripPlan::new(&model, settings).unwrap();
    let mut blocks = Blocks::new(&plan);
    let (arena, memory) = blocks.lend();
    let mut paused = Strip::new(plan, Runner::new(model, arena).unwrap(), memory).unwrap().pause();
    let (mut found, mut row, mut calls) = (vec![], 0, 0);
    let (mut height_m, mut slope, mut origin) = (vec![0.0; scene.cols], vec![0.0; scene.cols], vec![0; scene.cols]);
    loop {
        flip(calls, &mut blocks);
        calls += 1;
        let (arena, memory) = blocks.lend();
        let runner = Runner::resume(crate::nn::Kernel::best(), model, arena, &paused.runner).unwrap();
        let mut strip = Strip::resume(plan, runner, memory, &paused).unwrap();
        match strip.wants() {
            Next::Push if row < scene.rows => {
                strip.push_line(scene.line(row).0, scene.line(row).1).unwrap();
                row += 1;
            }
            Next::Push => strip.finish(),
            Next::Step => _ = strip.step(BUDGET),
            Next::Done if strip.ready() == 0 => return (found, strip.counters(), calls),
            _ if settings.expected_errors => {
                let mut line = vec![0.0; scene.cols];
                let errors = LineErrors { height_m: &mut height_m, slope: &mut slope, origin: &mut origin };
                strip.take_line_with(&mut line, errors).unwrap().unwrap();
                found.extend(line);
            }
            _ => take(&mut strip, scene.cols, &mut found),
        }
        assert!(calls < 100_000, "a strip that does not end");
        paused = strip.pause();
    }
}

#[test]
fn no_flipped_bit_changes_a_height_silently() {
    flips(800);
}

/// `ELUNAR_FLIPS=20000 cargo test -p elunar-core --lib many_flips -- --ignored --nocapture`.
#[test]
#[ignore = "minutes"]
fn many_flips_change_no_height_silently() {
    flips(std::env::var("ELUNAR_FLIPS").map_or(20_000, |n| n.parse().unwrap()) / 2);
}

/// Flips a bit in so many strips without and with expected errors.
fn flips(count: usize) {
    let (file, scene) = (file(), Scene::new(31, 17));
    for expected_errors in [false, true] {
        let settings = StripSettings { expected_errors, ..settings(17, TILE.rows + 2) };
        let (clean, counters, calls) = run_flipped(&file, &scene, settings, |_, _| ());
        assert_eq!((counters.pieces_lost, counters.memory_faults, counters.tiles_again), (0, 0, 0));
        let (mut state, mut reported, mut same) = (99_u64, 0, 0);
        let mut random = |below: usize| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as usize % below
        };
        for _ in 0..count {
            let (moment, place, bit) = (random(calls), random((1 << 30) - 1), random(8));
            let (found, counters, _) = run_flipped(&file, &scene, settings, |call, blocks| {
                if call == moment {
                    blocks.flip(place, bit);
                }
            });
            let told = counters.pieces_lost + counters.memory_faults + counters.tiles_again;
            if told == 0 {
                assert_same(&found, &clean, &format!("byte {place}, bit {bit} before call {moment}"));
                same += 1;
            } else {
                assert_eq!(counters.tiles_lost + counters.tiles_void, 0, "{counters:?}");
                reported += 1;
            }
            assert_eq!(found.len(), clean.len(), "no line is lost");
        }
        println!("{reported} reported, {same} the same, none silent");
        assert!(reported > count / 8 && same > count / 8, "{reported} reported, {same} the same");
    }
}

#[test]
fn a_lost_line_of_a_strip_narrower_than_a_tile_is_a_line_of_voids() {
    let (file, mut scene, settings) = (file(), Scene::new(14, 7), settings(7, TILE.rows + 2));
    // The last pixel of line 3, which the tile repeats beyond the edge: lines are 28 bytes and a checksum.
    let (found, counters, _) = run_flipped(&file, &scene, settings, |call, blocks| {
        if call == 6 {
            blocks.change_ring(3 * 32 + 27);
        }
    });
    assert_eq!((counters.pieces_lost, counters.tiles_lost), (1, 0), "{counters:?}");
    scene.image[3 * 7..4 * 7].fill(f32::NAN);
    scene.assert_heights(&found, &scene.heights_m(&file, &settings), &settings, "without line 3");
}

#[test]
fn expected_errors_change_no_height_of_a_wide_strip() {
    let (file, scene) = (file(), Scene::new(31, 45));
    let settings = StripSettings { expected_errors: true, ..settings(45, TILE.rows + 2) };
    let (found, ..) = run_flipped(&file, &scene, settings, |_, _| ());
    scene.assert_heights(&found, &scene.heights_m(&file, &settings), &settings, "with expected errors");
}

/// A bit that is stuck spoils tiles, not the strip.
#[test]
fn a_stuck_bit_is_reported_and_the_strip_goes_on() {
    let (file, scene) = (file(), Scene::new(31, 17));
    let settings = settings(17, TILE.rows + 2);
    let (clean, ..) = run_flipped(&file, &scene, settings, |_, _| ());
    for place in [Blocks::COARSE, Blocks::COARSE + 44, Blocks::SCRATCH + 80] {
        let mut value = 0;
        let (found, counters, _) = run_flipped(&file, &scene, settings, |_, blocks| {
            // It toggles, so that no checksum holds.
            value ^= 1;
            blocks.set(place, 0x40 | value);
        });
        assert!(counters.tiles_void > 0 && counters.tiles == 8, "{counters:?}");
        assert!(counters.memory_faults >= 3 * counters.tiles_void && found.len() == clean.len());
        let void = found.iter().filter(|z| z.is_nan()).count();
        assert!(void > clean.iter().filter(|z| z.is_nan()).count());
    }
}

#[test]
fn pixels_of_a_camera_and_posts_give_the_heights_of_floats_and_lines() {
    let (file, mut scene) = (file(), Scene::new(41, 17));
    // What 16 bits can hold; voids are code 0.
    scene.image.iter_mut().for_each(|v| *v = if v.abs() < 1e30 { v.round() * 0.5 - 3.0 } else { f32::NAN });
    let grid = PostGrid::spaced(7, (-1.5, -2.25), (5.0, 4.0));
    let row_m = |row: usize| -> Vec<f32> {
        let post =
            |col: usize| if row * 7 + col == 23 { f32::NAN } else { -1900.0 + ((row * 31 + col * 17) % 29) as f32 };
        (0..grid.cols).map(post).collect()
    };
    let mut memory = vec![0.0; Posts::memory_len(grid.cols)];
    let mut posts = Posts::new(grid, &mut memory).unwrap();
    let mut rows = 0;
    for line in scene.coarse_m.chunks_mut(17) {
        while posts.line(line).is_none() {
            if rows < 9 {
                posts.push_row(&row_m(rows)).unwrap()
            } else {
                posts.finish()
            }
            rows += 1;
        }
    }
    let floats = settings(17, TILE.rows + 3);
    let expected = run(&file, &scene, floats, 2_000, false);
    for (format, lines) in [(PixelFormat::U16Le, 2_usize), (PixelFormat::U16Be, 9), (PixelFormat::U12Packed, 30)] {
        let pixels = PixelForm { format, gain: 0.5, offset: -3.0, null_code: Some(0), saturated_from: Some(4000) };
        let settings = StripSettings { pixels, posts: Some(grid), ring_lines: TILE.rows + lines, ..floats };
        let found = run_as_a_camera(&file, &scene, settings, &row_m);
        assert_same(&found, &expected, &format!("{format:?}"));
    }
}

/// Runs a scene whose brightness is half a code minus 3 through a strip, with nine rows of posts.
fn run_as_a_camera(file: &[u8], scene: &Scene, settings: StripSettings, row_m: &dyn Fn(usize) -> Vec<f32>) -> Vec<f32> {
    let model = Model::new(file).unwrap();
    let plan = StripPlan::new(&model, settings).unwrap();
    let mut blocks = Blocks::new(&plan);
    let (arena, memory) = blocks.lend();
    let mut strip = Strip::new(plan, Runner::new(model, arena).unwrap(), memory).unwrap();
    let (mut found, mut line, mut row) = (vec![], 0, 0);
    loop {
        match strip.wants() {
            Next::Step => _ = strip.step(1_000),
            Next::Posts => {
                assert_eq!(
                    strip.push_pixels(&image(scene, 0, &settings), &[]),
                    Err(crate::strip::StripError::PostsFirst)
                );
                if row < 9 {
                    strip.push_posts(&row_m(row)).unwrap()
                } else {
                    strip.finish_posts()
                }
                row += 1;
            }
            Next::Push if line < scene.rows => {
                assert_eq!(strip.push_pixels(&image(scene, line, &settings), &[]), Ok(line));
                line += 1;
            }
            Next::Push => strip.finish(),
            Next::Done if strip.ready() == 0 => break,
            Next::Take | Next::Done => take(&mut strip, scene.cols, &mut found),
        }
    }
    blocks.assert_guards();
    found
}

/// Returns a line of codes.
fn image(scene: &Scene, line: usize, settings: &StripSettings) -> Vec<u8> {
    let code = |v: &f32| if v.is_nan() { 0 } else { ((v + 3.0) / 0.5) as u16 };
    let codes: Vec<u16> = scene.line(line).0.iter().map(code).collect();
    match settings.pixels.format {
        PixelFormat::U16Le => codes.iter().flat_map(|c| c.to_le_bytes()).collect(),
        PixelFormat::U16Be => codes.iter().flat_map(|c| c.to_be_bytes()).collect(),
        _ => {
            let pair = |pair: &[u16]| {
                let (a, b) = (pair[0], pair.get(1).copied());
                let bytes = [(a >> 4) as u8, (a << 4) as u8 | (b.unwrap_or(0) >> 8) as u8, b.unwrap_or(0) as u8];
                bytes.into_iter().take(if b.is_some() { 3 } else { 2 })
            };
            codes.chunks(2).flat_map(pair).collect()
        }
    }
}
