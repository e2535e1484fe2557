//! Strips that are paused after every step, and models that change during a tile.

use super::rig::{Blocks, Scene, TILE, assert_same, file, file_of, run, settings, take};
use crate::nn::{Kernel, Model, RunError, Runner};
use crate::strip::{Next, Strip, StripCounters, StripError, StripPaused, StripPlan};

const ROWS: usize = 31;
const COLS: usize = 17;
const BUDGET: u64 = 900;

/// Runs a strip that is paused after every call. In between, `between` gets the number of steps and may change the model's bytes.
fn run_in_pieces(
    mut bytes: Vec<u8>,
    scene: &Scene,
    mut between: impl FnMut(usize, &mut [u8]),
) -> (Vec<f32>, StripCounters) {
    let validated = bytes.clone();
    let model = Model::new(&validated).unwrap();
    let (plan, verdict) = (StripPlan::new(&model, settings(COLS, TILE.rows + 3)).unwrap(), model.verdict());
    let mut blocks = Blocks::new(&plan);
    let mut paused: StripPaused = {
        let (arena, memory) = blocks.lend();
        Strip::new(plan, Runner::with_kernel(Kernel::SCALAR, model, arena).unwrap(), memory).unwrap().pause()
    };
    let (mut found, mut row, mut steps) = (vec![], 0, 0);
    loop {
        // A model whose header changed would not open; the tested bytes are behind the header.
        let model = Model::reopen(&bytes, &verdict).unwrap();
        let (arena, memory) = blocks.lend();
        let runner = Runner::resume(Kernel::SCALAR, model, arena, &paused.runner).unwrap();
        let mut strip = Strip::resume(plan, runner, memory, &paused).unwrap();
        assert_eq!(strip.pause(), paused, "nothing is lost on the way");
        match strip.wants() {
            Next::Push if row < scene.rows => {
                strip.push_line(scene.line(row).0, scene.line(row).1).unwrap();
                row += 1;
            }
            Next::Push => strip.finish(),
            Next::Posts => unreachable!("a strip without posts"),
            Next::Step => {
                strip.step(BUDGET);
                steps += 1;
            }
            Next::Take => take(&mut strip, scene.cols, &mut found),
            Next::Done => {
                take(&mut strip, scene.cols, &mut found);
                let counters = strip.counters();
                assert_eq!(strip.push_line(&[0.0; COLS], &[0.0; COLS]), Err(StripError::Ended));
                blocks.assert_guards();
                return (found, counters);
            }
        }
        paused = strip.pause();
        let words = paused.to_words();
        assert_eq!(StripPaused::from_words(words, model.input_rules(), TILE), Some(paused));
        between(steps, &mut bytes);
    }
}

#[test]
fn a_strip_resumed_after_every_call_is_the_same_strip() {
    let (file, scene) = (file(), Scene::new(ROWS, COLS));
    let mut steps = 0;
    let (found, counters) = run_in_pieces(file.clone(), &scene, |n, _| steps = n);
    assert_same(&found, &run(&file, &scene, settings(COLS, 40), u64::MAX, true), "in pieces");
    assert_eq!((counters.tiles, counters.tiles_again, counters.tiles_lost), (6 + 2, 0, 0));
    assert!(steps > 8 * 6, "{steps}");
}

/// Returns the offset of a byte of the model's constants, which are the last of the file.
fn constant(file: &[u8]) -> usize {
    file.len() - Model::new(file).unwrap().constants_bytes()
}

#[test]
fn a_tile_that_finds_the_model_changed_is_begun_again() {
    let (file, scene) = (file(), Scene::new(ROWS, COLS));
    let expected = scene.heights_m(&file, &settings(COLS, 40));
    // Changed in the middle of a tile, and repaired before the tile begins again.
    let mut hits = 0;
    for at in (0..).map(|i| 8 * i).take(80) {
        let mut was = None;
        let spoilt = constant(&file);
        let mended = file[spoilt];
        let (found, counters) = run_in_pieces(file.clone(), &scene, |steps, bytes| match was {
            None if steps == at => {
                bytes[spoilt] ^= 0x10;
                was = Some(steps);
            }
            Some(then) if steps > then + 40 => bytes[spoilt] = mended,
            _ => (),
        });
        hits += counters.tiles_again;
        if counters.tiles_lost == 0 {
            scene.assert_heights(&found, &expected, &settings(COLS, 40), "begun again");
        }
        assert_eq!(found.len(), ROWS * COLS, "no line is lost");
        assert!(counters.tiles_again > 0 || counters.last_fault.is_none());
    }
    assert!(hits >= 20, "{hits}");
}

#[test]
fn a_tile_that_fails_twice_keeps_its_coarse_heights() {
    let (file, scene) = (file(), Scene::new(ROWS, COLS));
    let expected = scene.heights_m(&file, &settings(COLS, 40));
    let (spoilt, mut all) = (constant(&file), 0);
    run_in_pieces(file.clone(), &scene, |steps, _| all = steps);
    let (found, counters) = run_in_pieces(file.clone(), &scene, |steps, bytes| {
        // After the first tiles, and permanently.
        if steps == all / 3 {
            bytes[spoilt] ^= 0x10;
        }
    });
    assert!(matches!(counters.last_fault, Some(RunError::ModelChanged { .. })), "{counters:?}");
    assert!(counters.tiles_lost > 0 && counters.tiles_lost == counters.tiles_again, "{counters:?}");
    assert!(counters.tiles_lost < counters.tiles && counters.tiles == 8, "{counters:?}");
    assert_eq!(found.len(), ROWS * COLS);
    let last = (ROWS - 2) * COLS..ROWS * COLS;
    for i in last {
        assert_eq!(found[i].is_nan(), expected[i].is_nan());
        assert!(found[i].is_nan() || (found[i] - scene.coarse_m[i]).abs() < 1e-3, "{i}: the coarse heights stand");
    }
    let top = found[..2 * COLS].iter().zip(&expected);
    assert!(top.clone().any(|(a, _)| a.is_finite()));
    assert!(top.take(TILE.cols - 3).all(|(a, b)| a == b || a.is_nan()), "tiles before are as they were");
}

#[test]
fn heights_that_no_ground_has_leave_the_coarse_ones() {
    let scene = Scene::new(ROWS, COLS);
    let expected = scene.heights_m(&file(), &settings(COLS, 40));
    let (found, counters) = run_in_pieces(file_of(1e8), &scene, |_, _| ());
    // It is no fault of the runner.
    assert_eq!((counters.tiles, counters.tiles_again, counters.tiles_lost, counters.tiles_void), (8, 8, 8, 0));
    assert_eq!((counters.last_fault, counters.memory_faults), (None, 0));
    for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
        assert_eq!(found.is_nan(), expected.is_nan(), "{i}");
        assert!(found.is_nan() || (found - scene.coarse_m[i]).abs() < 1e-3, "{i}: {found}");
    }
}
