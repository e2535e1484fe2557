//! Measures the time of each piece of a strip's work, with the shipped model.

use elunar_core::nn::{Lighting, Model, Runner};
use elunar_core::norm::Light;
use elunar_core::pixels::PixelForm;
use elunar_core::strip::{Next, Strip, StripMemory, StripPlan, StripSettings};
use std::time::{Duration, Instant};

const COLS: usize = 701;
const ROWS: usize = 600;

fn settings(model: &Model<'_>) -> StripSettings {
    StripSettings {
        cols: COLS,
        ring_lines: StripPlan::least_lines(model),
        overlap_px: 100,
        pixel_m: 2.0,
        coarse_px: 30.0,
        anchor: true,
        checked: false,
        light: Lighting::given(Light::from_sun(135.0, 35.0).unwrap()),
        pixels: PixelForm::F32,
        posts: None,
        expected_errors: false,
    }
}

/// `cargo test -p elunar-core --test strip_pieces -- --ignored --nocapture`.
#[test]
#[ignore = "a measurement"]
fn pieces_of_a_strip() {
    let file = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../host-train/models/nano.eld")).unwrap();
    let model = Model::new(&file).unwrap();
    let plan = StripPlan::new(&model, settings(&model)).unwrap();
    let (mut arena, mut valid) = (vec![0; plan.arena_bytes()], vec![0; plan.bytes_len()]);
    let (mut samples, mut sums) = (vec![0.0; plan.samples_len()], vec![0.0; plan.sums_len()]);
    let memory = StripMemory { samples: &mut samples, sums: &mut sums, bytes: &mut valid };
    let mut strip = Strip::new(plan, Runner::new(model, &mut arena).unwrap(), memory).unwrap();
    // Noise on a slope, with voids in 1 % of the pixels.
    let noise = |row: usize, col: usize| ((row * 701 + col) * 7919) % 1013;
    let bright = |row, col| if noise(row, col) < 10 { f32::NAN } else { 500.0 + noise(row, col) as f32 };
    let height = |row: usize, col: usize| row as f32 * 0.1 + (col as f32 / 90.0).sin() * 20.0;
    let mut line_m = vec![0.0; COLS];
    let (mut times, mut row, mut piece) = ([const { Vec::new() }; 6], 0, 0);
    while strip.wants() != Next::Done || strip.ready() > 0 {
        let image: Vec<f32> = (0..COLS).map(|col| bright(row, col)).collect();
        let coarse_m: Vec<f32> = (0..COLS).map(|col| height(row, col)).collect();
        let (wants, start) = (strip.wants(), Instant::now());
        let at = match wants {
            Next::Push if row == ROWS => {
                strip.finish();
                continue;
            }
            Next::Push => {
                assert_eq!(strip.push_line(&image, &coarse_m), Ok(row));
                0
            }
            Next::Step => {
                // The whole network in one step, and a step for what follows it: every tile has four steps.
                strip.step(u64::MAX - 1);
                1 + piece
            }
            Next::Posts => unreachable!("a strip without posts"),
            Next::Take | Next::Done => {
                assert!(strip.take_line(&mut line_m).unwrap().is_some());
                5
            }
        };
        times[at].push(start.elapsed());
        row += usize::from(wants == Next::Push);
        piece = (piece + usize::from(wants == Next::Step)) % 4;
    }
    let counters = strip.counters();
    assert_eq!((counters.tiles, counters.tiles_coarse, counters.tiles_empty, piece), (12, 0, 0, 0));
    for (name, mut times) in
        ["push a line", "prepare a tile", "network", "bring back", "blend", "take a line"].into_iter().zip(times)
    {
        times.sort_unstable();
        let micros = |d: Option<&Duration>| d.map_or(0.0, |d| d.as_secs_f64() * 1e6);
        println!("| {name} | {:.0} | {:.0} |", micros(times.get(times.len() / 2)), micros(times.last()));
    }
}
