//! Updates in flight: power cut after every byte, models that fail, records that are damaged.

mod cuts;
mod damage;
mod flash;
mod pieces;
mod refusals;
mod sequences;

use super::draft::Draft;
use crate::nn::file::{Dtype, Operator, Tensor, seal_file, set_word, word};
use crate::nn::slots::*;
use crate::nn::{Kernel, Model, Progress, RunError, Runner, required};
use flash::Flash;

/// Returns a model whose output is the image's codes times `weight`, with `filling` bytes of unused constants.
fn model(weight: u8, filling: usize) -> Vec<u8> {
    let mut draft = Draft::new((4, 4));
    draft.tensors[0].scale = 1.0 / 255.0;
    draft.output = draft.place(Tensor::new(Dtype::F32, (4, 4), 1));
    let conv = draft.silent(0, draft.output, (1, 1, 0));
    draft.constants[conv.weights] = weight;
    draft.constants[conv.multipliers..conv.multipliers + 4].copy_from_slice(&1f32.to_le_bytes());
    draft.constant((0..filling).map(|i| (i * i) as u8));
    draft.operator(Operator::Conv(conv));
    draft.in_order();
    let mut file = draft.file();
    let crc = test_crc(&file);
    set(&mut file, word::SELF_TEST_CRC, crc);
    file
}

/// Returns a valid file whose self test fails.
fn failing_model(weight: u8) -> Vec<u8> {
    let mut file = model(weight, 0);
    let wrong = test_crc(&file) ^ 1;
    set(&mut file, word::SELF_TEST_CRC, wrong);
    file
}

fn set(file: &mut [u8], index: usize, value: u32) {
    set_word(file, index, value);
    seal_file(file);
}

fn test_crc(file: &[u8]) -> u32 {
    let model = Model::new(file).unwrap();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::with_kernel(Kernel::SCALAR, model, &mut arena).unwrap();
    runner.begin_self_test().unwrap();
    while runner.step(u64::MAX).unwrap() == Progress::Running {}
    runner.output_crc().unwrap()
}

/// Runs the self test of the model that runs.
fn self_test(slots: &Slots<impl Storage>) -> Result<SelfTestPassed, RunError> {
    let model = slots.model().unwrap();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::with_kernel(Kernel::SCALAR, model, &mut arena)?;
    runner.begin_self_test()?;
    while runner.step(u64::MAX)? == Progress::Running {}
    SelfTestPassed::of(&mut runner)
}

/// The work of flight software after a reset; at the end a model is confirmed.
fn start(slots: &mut Slots<impl Storage>) -> Result<(), SlotError> {
    let mut boot = slots.boot()?;
    while boot.standing != Standing::Confirmed {
        match self_test(slots) {
            Ok(passed) => {
                slots.confirm(passed)?;
                break;
            }
            Err(_) => boot = slots.reject()?,
        }
    }
    Ok(())
}

/// Uploads a model in chunks of a length that divides no sector, and puts it on trial.
fn upload(slots: &mut Slots<impl Storage>, file: &[u8]) -> Result<(), SlotError> {
    let mut there = slots.begin_upload(ModelId::of(file))?;
    while there < file.len() {
        there = slots.write(there, &file[there..file.len().min(there + 150)])?;
    }
    slots.start_trial(1)
}

/// Returns the bytes of the model that runs.
fn running(slots: &Slots<impl Storage>) -> &[u8] {
    slots.model().unwrap().raw().bytes()
}

/// Returns storage with a confirmed model in this slot, and another model in the other slot.
fn commissioned(confirmed: &[u8], slot: Slot, other: &[u8]) -> Flash {
    let mut flash = Flash::new(confirmed.len().max(other.len()) + 100, 128);
    flash.region(Region::Model(slot))[..confirmed.len()].copy_from_slice(confirmed);
    start(&mut Slots::new(&mut flash)).unwrap();
    flash.region(Region::Model(slot.other()))[..other.len()].copy_from_slice(other);
    flash
}

#[test]
fn the_models_of_these_tests_are_sound_differ_and_mind_their_input() {
    let [old, new, failing] = [model(1, 0), model(2, 0), failing_model(3)];
    assert!([&old, &new, &failing].into_iter().all(|file| Model::new(file).is_ok()));
    assert_ne!(test_crc(&old), test_crc(&new));
    for (file, passes) in [(&old, true), (&new, true), (&failing, false)] {
        let flash = Flash { regions: [file.clone(), vec![], vec![], vec![]], ..Flash::new(1, 1) };
        let mut slots = Slots::new(flash);
        slots.boot().unwrap();
        let passed = self_test(&slots);
        assert_eq!(passed.is_ok(), passes);
        // There is no room for a record.
        if let Ok(passed) = passed {
            assert_eq!(slots.confirm(passed), Err(SlotError::NotWritten { offset_bytes: 0 }));
        }
    }
}

#[test]
fn an_update_from_the_first_model_to_the_third() {
    let models = [model(1, 0), model(2, 0), model(3, 0)];
    let mut flash = Flash::new(models[0].len(), 128);
    flash.region(Region::Model(Slot::A))[..models[0].len()].copy_from_slice(&models[0]);
    let mut slots = Slots::new(&mut flash);
    // Delivered with the hardware: the model is found without a record.
    assert_eq!(slots.boot().map(|b| (b.slot, b.standing)), Ok((Slot::A, Standing::Salvaged)));
    let passed = self_test(&slots).unwrap();
    slots.confirm(passed).unwrap();
    for (next, slot) in [(&models[1], Slot::B), (&models[2], Slot::A)] {
        let before = running(&slots).to_vec();
        upload(&mut slots, next).unwrap();
        assert_eq!(running(&slots), before, "until the next boot");
        assert_eq!(slots.boot().map(|b| (b.slot, b.standing)), Ok((slot, Standing::Trial)));
        assert_eq!(running(&slots), next);
        assert_eq!(slots.record().unwrap().confirmed.unwrap().slot, slot.other());
        let passed = self_test(&slots).unwrap();
        slots.confirm(passed).unwrap();
        assert_eq!(slots.confirm(passed), Ok(()), "once more does nothing");
        assert_eq!(slots.boot().map(|b| (b.slot, b.standing)), Ok((slot, Standing::Confirmed)));
        assert_eq!((slots.record_copies(), slots.record().unwrap().rollbacks), (2, 0));
    }
    // Back to the previous model, which is still in its slot: only records are written.
    assert_eq!(slots.begin_upload(ModelId::of(&models[1])), Ok(models[1].len()));
    slots.start_trial(1).unwrap();
    start(&mut slots).unwrap();
    assert_eq!(running(&slots), models[1]);
}

#[test]
fn a_trial_lasts_as_many_boots_as_it_was_given() {
    let (old, new) = (model(1, 0), model(2, 0));
    for boots in [1, 3, MAX_TRIAL_BOOTS] {
        let mut slots = Slots::new(commissioned(&old, Slot::A, &[]));
        slots.boot().unwrap();
        assert_eq!(slots.begin_upload(ModelId::of(&new)), Ok(0));
        slots.write(0, &new).unwrap();
        slots.start_trial(boots).unwrap();
        for left in (0..boots).rev() {
            assert_eq!(slots.boot().map(|b| (b.slot, b.standing)), Ok((Slot::B, Standing::Trial)));
            assert_eq!(slots.record().unwrap().trial.unwrap().boots_left, left);
        }
        // The last one was not confirmed either.
        assert_eq!(slots.boot().map(|b| (b.slot, b.standing)), Ok((Slot::A, Standing::Confirmed)));
        assert_eq!(slots.record().map(|r| (r.trial, r.rollbacks)), Some((None, 1)));
    }
}

#[test]
fn a_model_that_fails_its_self_test_is_rolled_back_without_a_reset() {
    let (old, bad) = (model(1, 0), failing_model(2));
    let mut slots = Slots::new(commissioned(&old, Slot::B, &[]));
    slots.boot().unwrap();
    upload(&mut slots, &bad).unwrap();
    assert_eq!(slots.boot().map(|b| (b.slot, b.standing)), Ok((Slot::A, Standing::Trial)));
    assert!(matches!(self_test(&slots), Err(RunError::SelfTest { .. })));
    assert_eq!(slots.reject().map(|b| (b.slot, b.standing)), Ok((Slot::B, Standing::Confirmed)));
    assert_eq!(running(&slots), old);
    assert_eq!(slots.record().map(|r| (r.trial, r.rollbacks)), Some((None, 1)));
    assert_eq!(slots.boot().map(|b| b.standing), Ok(Standing::Confirmed));
    // A trial that has not begun can be withdrawn, too.
    upload(&mut slots, &model(3, 0)).unwrap();
    assert_eq!(slots.reject().map(|b| (b.slot, b.standing)), Ok((Slot::B, Standing::Confirmed)));
    assert_eq!(slots.boot().map(|b| b.standing), Ok(Standing::Confirmed));
    assert_eq!(slots.record().unwrap().rollbacks, 2);
}
