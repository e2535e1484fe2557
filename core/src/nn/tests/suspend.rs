//! Runs that are suspended and resumed after every unit of work, and positions that no run has.

use super::draft::Draft;
use crate::nn::file::{Dtype, Tensor, word};
use crate::nn::{Kernel, Model, ModelError, Progress, RunError, Runner, Suspended, Verdict, required};

/// Three operators over a small tile, with several panels and steps as points of suspension.
fn file() -> Vec<u8> {
    let tile = (12, 10);
    let mut draft = Draft::new(tile);
    for channels in [70, 40] {
        draft.made(Tensor { lo: 0, hi: 255, ..Tensor::new(Dtype::U8, tile, channels) });
    }
    draft.finish();
    draft.in_order();
    draft.file()
}

#[test]
fn a_run_resumed_after_every_unit_is_the_same_run() {
    let file = file();
    let model = Model::new(&file).unwrap();
    let image: Vec<f32> = (0..120).map(|i| i as f32 / 120.0).collect();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::with_kernel(Kernel::SCALAR, model, &mut arena).unwrap();
    runner.begin(&image, &image).unwrap();
    while runner.step(1).unwrap() == Progress::Running {
        runner.scrub(100).unwrap();
    }
    let expected = (runner.output_crc().unwrap(), runner.telemetry());

    let (mut arena, verdict) = (vec![7; required(&model)], model.verdict());
    let mut suspended = {
        let mut runner = Runner::with_kernel(Kernel::SCALAR, model, &mut arena).unwrap();
        assert_eq!(runner.suspend(), Suspended::default());
        runner.begin(&image, &image).unwrap();
        runner.suspend()
    };
    let mut resumed = 0;
    loop {
        let model = Model::reopen(&file, &verdict).unwrap();
        let mut runner = Runner::resume(Kernel::SCALAR, model, &mut arena, &suspended).unwrap();
        assert_eq!(runner.suspend(), suspended, "nothing is lost on the way");
        let progress = runner.step(1).unwrap();
        if progress == Progress::Running {
            runner.scrub(100).unwrap();
        }
        suspended = runner.suspend();
        resumed += 1;
        if progress == Progress::Done {
            assert_eq!((runner.output_crc().unwrap(), runner.telemetry()), expected);
            break;
        }
    }
    assert!(resumed > 20, "{resumed} steps");
    assert_eq!(suspended.phase, Suspended::DONE);
}

#[test]
fn a_self_test_begun_in_steps_is_the_same_run() {
    let file = file();
    let model = Model::new(&file).unwrap();
    let (mut arena, mut other) = (vec![0; required(&model)], vec![7; required(&model)]);
    let mut runner = Runner::with_kernel(Kernel::SCALAR, model, &mut arena).unwrap();
    runner.begin_self_test().unwrap();
    while runner.step(1).unwrap() == Progress::Running {}
    let (expected, steps) = (runner.output_crc().unwrap(), runner.telemetry().steps);
    let mut suspended = Suspended { phase: Suspended::LOADING, ..Suspended::default() };
    loop {
        let mut runner = Runner::resume(Kernel::SCALAR, model, &mut other, &suspended).unwrap();
        if suspended.telemetry.steps == 0 {
            runner.begin_self_test_in_steps().unwrap();
        }
        let progress = runner.step(1).unwrap();
        suspended = runner.suspend();
        if progress == Progress::Done {
            assert_eq!(runner.output_crc().unwrap(), expected);
            break;
        }
    }
    // A row of each input takes a step.
    assert_eq!(suspended.telemetry.steps, steps + 12);
}

#[test]
fn bytes_that_are_compared_and_summed_count_as_work() {
    let tile = (12, 10);
    let mut draft = Draft::new(tile);
    draft.made(Tensor { lo: 0, hi: 255, ..Tensor::new(Dtype::U8, tile, 70) });
    draft.finish();
    draft.in_order();
    let file = draft.file();
    let model = Model::new(&file).unwrap();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    // Panels of 32, 32 and 8 channels from one of the image. A product and its rounded sum are 17. The first unit compares a row
    // of 10 bytes; the last sums one of 700.
    let macs = [320, 320, 60];
    let units = [10 + 17 * macs[0], 17 * macs[1], 17 * macs[2] + 700];
    for (budget, done) in [(1, 1), (units[0], 1), (units[0] + 1, 2), (units[0] + units[1], 2)] {
        runner.begin(&[0.5; 120], &[0.0; 120]).unwrap();
        let before = runner.telemetry().macs;
        runner.step(budget).unwrap();
        assert_eq!(runner.telemetry().macs - before, macs[..done].iter().sum::<u64>(), "budget {budget}");
    }
    // Three units are a step; the fourth begins the next one.
    let step: u64 = units.iter().sum();
    for (budget, expected) in [(step, 700), (step + 1, 1020), (step + units[0] + 1, 1340)] {
        runner.begin(&[0.5; 120], &[0.0; 120]).unwrap();
        let before = runner.telemetry().macs;
        runner.step(budget).unwrap();
        assert_eq!(runner.telemetry().macs - before, expected, "budget {budget}");
    }
    // Without protection nothing is compared.
    runner.protect(false);
    runner.begin(&[0.5; 120], &[0.0; 120]).unwrap();
    let before = runner.telemetry().macs;
    runner.step(17 * 700 + 1).unwrap();
    assert_eq!(runner.telemetry().macs - before, 1020);
    assert!(model.largest_unit() >= *units.iter().max().unwrap());
}

#[test]
fn places_that_no_run_has_are_refused() {
    let file = file();
    let model = Model::new(&file).unwrap();
    let mut arena = vec![0; required(&model)];
    let at_work = Suspended { phase: Suspended::AT_WORK, ..Suspended::default() };
    let entries = model.entry_count() as u32;
    let operator = model.operator(0).unwrap();
    let (steps, units) = (model.entry(0).unwrap().count as u32, model.units(&operator) as u32);
    let mut resume = |at: Suspended| Runner::resume(Kernel::SCALAR, model, &mut arena, &at).map(|r| r.suspend());
    for good in [
        Suspended::default(),
        at_work,
        Suspended { entry: entries - 1, ..at_work },
        Suspended { step: steps - 1, unit: units - 1, ..at_work },
        Suspended { phase: Suspended::VERIFYING, ..at_work },
        Suspended { phase: Suspended::DONE, ..at_work },
        Suspended { phase: Suspended::LOADING, entry: 11, ..at_work },
        Suspended { protection: Suspended::TRUSTING, ..at_work },
        Suspended { protection: Suspended::CHECKED, ..at_work },
    ] {
        assert_eq!(resume(good), Ok(good));
    }
    for bad in [
        Suspended { phase: 4, ..at_work },
        Suspended { phase: Suspended::LOADING, entry: 12, ..at_work },
        Suspended { phase: Suspended::LOADING, step: 1, ..at_work },
        Suspended { protection: 4, ..at_work },
        Suspended { phase: Suspended::VERIFYING, entry: model.raw().chunks(), ..at_work },
        Suspended { phase: Suspended::VERIFYING, step: 1, ..at_work },
        Suspended { phase: Suspended::VERIFYING, unit: 1, ..at_work },
        Suspended { phase: Suspended::LOADING, unit: 1, ..at_work },
        Suspended { entry: 1, ..Suspended::default() },
        Suspended { phase: Suspended::DONE, unit: 1, ..at_work },
        Suspended { entry: entries, ..at_work },
        Suspended { entry: u32::MAX, ..at_work },
        Suspended { step: steps, ..at_work },
        Suspended { unit: units, ..at_work },
        Suspended { scrub_chunk: model.raw().chunks(), ..at_work },
        Suspended { scrub_offset: model.raw().chunk(0).len() as u32 + 1, ..at_work },
    ] {
        assert_eq!(resume(bad), Err(RunError::State), "{bad:?}");
    }
    let short = arena.len() - 1;
    let refused = Runner::resume(Kernel::SCALAR, model, &mut arena[..short], &at_work).map(|r| r.suspend());
    assert!(matches!(refused, Err(RunError::ArenaTooSmall { .. })));
}

#[test]
fn only_the_model_that_was_validated_is_opened_again() {
    let file = file();
    let model = Model::new(&file).unwrap();
    let verdict = model.verdict();
    let again = Model::reopen(&file, &verdict).unwrap();
    assert_eq!((again.verdict(), required(&again), again.macs()), (verdict, required(&model), model.macs()));
    for other in [
        Verdict { header_crc: verdict.header_crc ^ 1, ..verdict },
        Verdict { file_bytes: verdict.file_bytes + 1, ..verdict },
        Verdict { scratch_offset: u32::MAX, ..verdict },
    ] {
        assert_eq!(Model::reopen(&file, &other).map(|m| m.verdict()), Err(ModelError::HeaderChecksum), "{other:?}");
    }
    for bit in 0..8 * 4 * (word::HEADER_CRC + 1) {
        let mut flipped = file.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        assert!(Model::reopen(&flipped, &verdict).is_err(), "bit {bit} of the header");
    }
    assert!(Model::reopen(&file[..file.len() - 1], &verdict).is_err());
}
