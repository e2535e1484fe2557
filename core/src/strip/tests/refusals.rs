//! Lines that cannot be pushed, and lines that are not taken.

use super::rig::{Blocks, Scene, TILE, file, settings, take};
use crate::error::LengthError;
use crate::nn::{Model, Runner};
use crate::photoclinometry::Origin;
use crate::strip::{LineErrors, Next, Strip, StripError, StripMemory, StripPlan};

#[test]
fn a_full_ring_refuses_lines_and_loses_none() {
    let (file, scene) = (file(), Scene::new(40, 25));
    let settings = settings(25, TILE.rows + 4);
    let model = Model::new(&file).unwrap();
    let plan = StripPlan::new(&model, settings).unwrap();
    let mut blocks = Blocks::new(&plan);
    let (arena, memory) = blocks.lend();
    let mut strip = Strip::new(plan, Runner::new(model, arena).unwrap(), memory).unwrap();
    let mut found = vec![];
    let mut row = 0;
    let push = |strip: &mut Strip<'_, '_>, row: &mut usize| {
        while *row < 40 {
            match strip.push_line(scene.line(*row).0, scene.line(*row).1) {
                Ok(number) => assert_eq!(number, *row),
                Err(refused) => return assert_eq!(refused, StripError::Full),
            }
            *row += 1;
        }
    };
    push(&mut strip, &mut row);
    assert_eq!((row, strip.wants(), strip.ready()), (16, Next::Step, 0), "as many lines as are kept");
    // Lines are not taken: the next row of tiles is computed, but not added, and the ring fills up again.
    let mut ran = [0, 0];
    while strip.step(1000) != Next::Take {
        ran[usize::from(strip.is_running())] += 1;
        push(&mut strip, &mut row);
    }
    assert!(ran[1] > 10 && ran[0] > 2 && !strip.is_running(), "{ran:?}");
    assert_eq!((row, strip.wants(), strip.ready()), (25, Next::Take, 9), "9 lines further: the overlap is 3");
    assert_eq!(strip.step(1), Next::Take, "steps change nothing");
    let before = strip.pause();
    assert_eq!(strip.push_line(scene.line(row).0, scene.line(row).1), Err(StripError::Full));
    assert_eq!(strip.take_line(&mut [0.0; 24]), Err(StripError::Line(LengthError { expected: 25, found: 24 })));
    assert_eq!(strip.pause(), before);
    while row < 40 {
        take(&mut strip, 25, &mut found);
        while strip.step(1000) == Next::Step {}
        push(&mut strip, &mut row);
    }
    strip.finish();
    while strip.wants() != Next::Done {
        take(&mut strip, 25, &mut found);
        strip.step(u64::MAX);
    }
    take(&mut strip, 25, &mut found);
    scene.assert_heights(&found, &scene.heights_m(&file, &settings), &settings, "after two full rings");
}

#[test]
fn lines_of_other_lengths_or_after_the_end_are_refused() {
    let file = file();
    let model = Model::new(&file).unwrap();
    let plan = StripPlan::new(&model, settings(25, 20)).unwrap();
    let mut blocks = Blocks::new(&plan);
    let (arena, memory) = blocks.lend();
    let mut strip = Strip::new(plan, Runner::new(model, arena).unwrap(), memory).unwrap();
    let wrong = |found| Err(StripError::Line(LengthError { expected: 25, found }));
    assert_eq!(strip.push_line(&[1.0; 24], &[1.0; 25]), wrong(24));
    assert_eq!(strip.push_line(&[1.0; 25], &[1.0; 26]), wrong(26));
    assert_eq!((strip.wants(), strip.step(9)), (Next::Push, Next::Push));
    strip.finish();
    assert_eq!(strip.push_line(&[1.0; 25], &[1.0; 25]), Err(StripError::Ended));
    assert_eq!((strip.wants(), strip.step(9), strip.ready()), (Next::Done, Next::Done, 0), "a strip without lines");
    assert_eq!(strip.take_line(&mut [0.0; 25]), Ok(None));
    assert_eq!(strip.scrub(100), Ok(()));
    assert_eq!(strip.telemetry().scrubbed_bytes, 100);
}

#[test]
fn errors_that_were_not_asked_for_are_unknown() {
    let (file, scene) = (file(), Scene::new(14, 10));
    let (settings, model) = (settings(10, 20), Model::new(&file).unwrap());
    let plan = StripPlan::new(&model, settings).unwrap();
    let mut blocks = Blocks::new(&plan);
    let (arena, memory) = blocks.lend();
    let mut strip = Strip::new(plan, Runner::new(model, arena).unwrap(), memory).unwrap();
    for row in 0..14 {
        strip.push_line(scene.line(row).0, scene.line(row).1).unwrap();
    }
    strip.finish();
    let (mut found, mut line) = (vec![], [0.0; 10]);
    while found.len() < 140 {
        let (mut height_m, mut slope, mut origin) = ([7.0; 10], [7.0; 10], [7; 10]);
        let errors = LineErrors { height_m: &mut height_m, slope: &mut slope, origin: &mut origin };
        if strip.take_line_with(&mut line, errors).unwrap().is_none() {
            assert_eq!((height_m, slope, origin), ([7.0; 10], [7.0; 10], [7; 10]), "without a line nothing is written");
            assert_ne!(strip.step(u64::MAX), Next::Push);
            continue;
        }
        assert!(height_m.iter().chain(&slope).all(|v| v.is_nan()) && origin == [Origin::Void as u8; 10], "{found:?}");
        found.extend(line);
    }
    scene.assert_heights(&found, &scene.heights_m(&file, &settings), &settings, "with errors that are unknown");
}

#[test]
fn short_memory_and_other_models_are_refused() {
    let file = file();
    let model = Model::new(&file).unwrap();
    let plan = StripPlan::new(&model, settings(25, 20)).unwrap();
    let whole = [plan.samples_len(), plan.sums_len(), plan.bytes_len()];
    for short in 0..3 {
        let mut lens = whole;
        lens[short] -= 1;
        let (mut samples, mut sums, mut valid) = (vec![0.0; lens[0]], vec![0.0; lens[1]], vec![0; lens[2]]);
        let memory = StripMemory { samples: &mut samples, sums: &mut sums, bytes: &mut valid };
        let mut arena = vec![0; plan.arena_bytes()];
        let refused = Strip::new(plan, Runner::new(model, &mut arena).unwrap(), memory).unwrap_err();
        assert_eq!(refused, StripError::Memory(LengthError { expected: whole[short], found: whole[short] - 1 }));
    }
    let other = crate::nn::tests::draft::Draft::new((12, 11));
    let other = {
        let mut draft = other;
        draft.finish();
        draft.in_order();
        draft.file()
    };
    let other = Model::new(&other).unwrap();
    let mut arena = vec![0; crate::nn::required(&other)];
    let mut blocks = Blocks::new(&plan);
    let refused = Strip::new(plan, Runner::new(other, &mut arena).unwrap(), blocks.lend().1).unwrap_err();
    assert_eq!(refused, StripError::Model);
}

#[test]
fn refusals_are_one_line_each() {
    let length = LengthError { expected: 4, found: 3 };
    for error in [
        StripError::Columns { found: 0 },
        StripError::Tile(crate::tile::TilingError::Overlap { overlap_px: 9, tile: crate::tile::Shape::new(8, 8) }),
        StripError::Ring { expected: 13, found: 12 },
        StripError::Pixel,
        StripError::Light,
        StripError::Model,
        StripError::Memory(length),
        StripError::Line(length),
        StripError::Full,
        StripError::Ended,
        StripError::Posts,
        StripError::PostsFirst,
        StripError::NoPosts,
    ] {
        let text = error.to_string();
        assert!(text.contains("expected") && text.contains("found") && !text.contains('\n'), "{text}");
    }
}
