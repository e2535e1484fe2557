//! Calls out of order and invalid uploads: each gives one clear error, and the model that runs is unchanged.

use super::*;
use crate::nn::ModelError;
use crate::nn::file::{HEADER_BYTES, VERSION};
use crate::nn::slots::SlotError as E;

/// Uploads `file` under the identity `id`; the model that runs must not change.
fn refused(id: ModelId, file: &[u8]) -> SlotError {
    let old = model(1, 0);
    let mut slots = Slots::new(commissioned(&old, Slot::A, &[]));
    slots.boot().unwrap();
    let error = slots.begin_upload(id).and_then(|_| slots.write(0, file)).and_then(|_| slots.start_trial(1));
    let error = error.expect_err("a refusal");
    assert_eq!(slots.boot().map(|b| (b.slot, b.standing)), Ok((Slot::A, Standing::Confirmed)));
    assert_eq!(running(&slots), old);
    assert_eq!(slots.record().unwrap().trial, None);
    let text = error.to_string();
    assert!(!text.is_empty() && !text.contains('\n'), "{text}");
    error
}

#[test]
fn uploads_that_are_no_models_are_refused() {
    let new = model(2, 0);
    let id = ModelId::of(&new);
    let as_it_says = |file: &[u8]| refused(ModelId::of(file), file);

    let mut older = new.clone();
    set(&mut older, word::VERSION, VERSION - 1);
    assert_eq!(as_it_says(&older), E::Model(ModelError::Version { found: VERSION - 1 }));
    let garbage: Vec<u8> = (0..new.len()).map(|i| (i * 7 + 3) as u8).collect();
    assert_eq!(refused(id, &garbage), E::Model(ModelError::Magic));
    assert!(matches!(refused(id, &vec![0xff; new.len()]), E::Model(ModelError::Magic)));
    let other = model(3, 0);
    let found = ModelId::of(&other).header_crc;
    assert_eq!(refused(id, &other), E::OtherModel { expected: id.header_crc, found });
    // Truncated in the upload, or before it was announced.
    let short = &new[..new.len() - 1];
    assert_eq!(refused(id, short), E::Length { expected: new.len(), found: short.len() });
    let announced = ModelId { file_bytes: short.len() as u32, ..id };
    let (expected, found) = (new.len() as u64, short.len() as u64);
    assert_eq!(refused(announced, short), E::Model(ModelError::Length { expected, found }));
    // Correct checksums over illegal contents.
    let mut nonsense = new.clone();
    set(&mut nonsense, word::OUTPUT, 77);
    assert_eq!(as_it_says(&nonsense), E::Model(ModelError::Header));
    for at in (0..new.len()).step_by(5) {
        let mut flipped = new.clone();
        flipped[at] ^= 0x10;
        assert!(matches!(refused(id, &flipped), E::Model(_) | E::OtherModel { .. }), "byte {at}");
    }
    for file_bytes in [0, HEADER_BYTES as u32 - 1, 1 << 20, u32::MAX] {
        let error = refused(ModelId { file_bytes, ..id }, &new);
        assert!(matches!(error, E::FileBytes { found, .. } if found == file_bytes), "{error}");
    }
}

#[test]
fn a_header_is_validated_as_soon_as_it_is_there() {
    let new = model(2, 0);
    let mut slots = Slots::new(commissioned(&model(1, 0), Slot::A, &[]));
    slots.boot().unwrap();
    slots.begin_upload(ModelId::of(&new)).unwrap();
    let other = model(3, 0);
    slots.write(0, &other[..100]).unwrap();
    assert!(matches!(slots.write(100, &other[100..140]), Err(E::OtherModel { .. })));
    assert_eq!(slots.write(140, &other[140..]), Err(E::NoUpload));
}

#[test]
fn calls_out_of_order_are_refused_and_change_nothing() {
    let (old, new) = (model(1, 0), model(2, 0));
    let id = ModelId::of(&new);
    let mut slots = Slots::new(commissioned(&old, Slot::A, &[]));
    assert_eq!(slots.begin_upload(id), Err(E::NotBooted));
    assert_eq!(slots.model().map(|_| ()), Err(E::NotBooted));
    assert_eq!(slots.reject(), Err(E::NotBooted));
    slots.boot().unwrap();
    assert_eq!(slots.write(0, &new), Err(E::NoUpload));
    assert_eq!(slots.start_trial(1), Err(E::NoUpload));
    assert_eq!(slots.reject(), Err(E::Confirmed));
    slots.begin_upload(id).unwrap();
    assert_eq!(slots.write(0, &new[..200]), Ok(200));
    assert_eq!(slots.write(0, &new[..200]), Err(E::Offset { expected: 200, found: 0 }));
    assert_eq!(slots.write(usize::MAX, &[]), Err(E::Offset { expected: 200, found: usize::MAX }));
    let long = [&new[200..], &[0]].concat();
    assert_eq!(slots.write(200, &long), Err(E::Length { expected: new.len(), found: new.len() + 1 }));
    assert_eq!(slots.start_trial(1), Err(E::Length { expected: new.len(), found: 200 }));
    assert_eq!(slots.write(200, &new[200..]), Ok(new.len()));
    for found in [0, MAX_TRIAL_BOOTS + 1, u32::MAX] {
        assert_eq!(slots.start_trial(found), Err(E::TrialBoots { found }));
    }
    slots.start_trial(2).unwrap();
    assert_eq!(slots.begin_upload(id), Err(E::Unconfirmed), "it is to be tried");
    let of_old = self_test(&slots).unwrap();
    slots.boot().unwrap();
    assert_eq!(slots.begin_upload(ModelId::of(&old)), Err(E::Unconfirmed), "it is on trial");
    assert!(matches!(slots.confirm(of_old), Err(E::OtherModel { .. })), "another model has passed");
    assert_eq!(running(&slots), new);
}

#[test]
fn a_rejected_model_without_a_record_gives_way_to_the_slot_behind_it() {
    let file = model(1, 0);
    for (slot, other, then) in [
        (Slot::A, true, Ok((Slot::B, Standing::Salvaged))),
        (Slot::A, false, Err(E::NothingRuns)),
        (Slot::B, false, Err(E::NothingRuns)),
    ] {
        let mut flash = Flash::new(file.len(), 128);
        flash.region(Region::Model(slot))[..file.len()].copy_from_slice(&file);
        if other {
            flash.region(Region::Model(slot.other()))[..file.len()].copy_from_slice(&file);
        }
        let mut slots = Slots::new(flash);
        assert_eq!(slots.boot().map(|b| (b.slot, b.standing)), Ok((slot, Standing::Salvaged)));
        assert_eq!(slots.reject().map(|b| (b.slot, b.standing)), then);
    }
}

#[test]
fn what_the_storage_refuses_or_forgets_is_reported() {
    let (old, new) = (model(1, 0), model(2, 0));
    let flash = commissioned(&old, Slot::A, &[]);
    let with = |lies: &[Region], refuses: &[Region]| {
        let mut slots = Slots::new(Flash { lies: lies.to_vec(), refuses: refuses.to_vec(), ..flash.clone() });
        assert_eq!(slots.boot().map(|b| b.standing), Ok(Standing::Confirmed));
        let outcome = upload(&mut slots, &new);
        let boot = slots.boot().map(|b| b.standing);
        (outcome, boot, slots.record_copies())
    };
    let slot = Region::Model(Slot::B);
    let refusal = Err(E::Storage(StorageError { code: 2 }));
    let confirmed = Ok(Standing::Confirmed);
    assert_eq!(with(&[], &[slot]), (refusal, confirmed, 2));
    assert_eq!(with(&[slot], &[]), (Err(E::NotWritten { offset_bytes: 0 }), confirmed, 2));
    // The copy is written first; if that fails, nothing has changed.
    assert_eq!(with(&[], &[Region::RecordCopy]), (refusal, confirmed, 2));
    assert_eq!(with(&[Region::RecordCopy], &[]), (Err(E::NotWritten { offset_bytes: 0 }), confirmed, 1));
    // The trial is written to one copy only. Then its boot cannot be counted over the only intact copy, so it is not run.
    assert_eq!(with(&[], &[Region::Record]).0, Ok(()));
    assert_eq!(with(&[], &[Region::Record]).1, confirmed);
}
