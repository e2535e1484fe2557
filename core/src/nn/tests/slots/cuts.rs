//! Cuts power after every byte that an update writes or erases.

use super::flash::{Cut, Flash};
use super::*;
use crate::nn::tests::Random;

/// Flight software that installs `new`: starts, uploads the model if it does not run yet, resets, starts. Returns whether it finished.
fn update(flash: &mut Flash, new: &[u8]) -> bool {
    let mut slots = Slots::new(&mut *flash);
    let done = start(&mut slots).and_then(|()| {
        if running(&slots) != new {
            upload(&mut slots, new)?;
            start(&mut slots)?;
        }
        Ok(())
    });
    assert!(done.is_ok() || flash.dead(), "{done:?} without a cut");
    !flash.dead()
}

/// After a cut, checks that a model runs and that it is one of these.
fn runs_one_of(flash: &Flash, models: [&[u8]; 2]) {
    let mut slots = Slots::new(Flash { power: None, ..flash.clone() });
    let boot = slots.boot().expect("a slot that runs");
    assert!(models.contains(&running(&slots)), "{boot:?}");
    assert_ne!(boot.standing, Standing::Salvaged, "at least one record is whole");
    if boot.standing == Standing::Confirmed {
        self_test(&slots).expect("a confirmed model that passes");
    }
}

/// Cuts an update from `old` in `slot` to `new` after each byte, and a second time during recovery. `end` is the model that runs at the
/// end. Returns the number of first cuts.
fn cut_everywhere(old: &[u8], slot: Slot, new: &[u8], end: &[u8], cut: Cut) -> usize {
    let third = model(7, 40);
    let flash = commissioned(old, slot, &third);
    let mut whole = flash.clone();
    whole.traffic = 0;
    assert!(update(&mut whole, new));
    let (traffic, mut random) = (whole.traffic, Random::new(9));
    for at in 1..=traffic {
        let noise = Random::new(at as u64);
        let mut flash = Flash { power: Some(at), cut, noise, traffic: 0, ..flash.clone() };
        assert!(!update(&mut flash, new), "cut after {at} bytes");
        // The confirmed model is unchanged, also after the other model was tried.
        let confirmed = |flash: &Flash| flash.bytes(Region::Model(slot))[..old.len()] == *old;
        assert!(confirmed(&flash), "cut after {at} bytes");
        runs_one_of(&flash, [old, new]);
        let mut second = Flash { power: Some(random.size(1, traffic)), ..flash.clone() };
        if !update(&mut second, new) {
            assert!(confirmed(&second), "cut after {at} bytes, and again");
            runs_one_of(&second, [old, new]);
        }
        finish(second, new, end);
        finish(flash, new, end);
    }
    traffic
}

/// With power restored, the update finishes.
fn finish(mut flash: Flash, new: &[u8], end: &[u8]) {
    flash.power = None;
    assert!(update(&mut flash, new));
    let mut slots = Slots::new(flash);
    assert_eq!(slots.boot().map(|b| b.standing), Ok(Standing::Confirmed));
    assert_eq!(running(&slots), end);
    assert!(self_test(&slots).is_ok() && slots.record_copies() == 2);
}

#[test]
fn power_may_go_after_any_byte_of_an_update() {
    let (old, new) = (model(1, 0), model(2, 30));
    let mut cuts = 0;
    for cut in [Cut::Clean, Cut::Garbage, Cut::Torn] {
        for slot in [Slot::A, Slot::B] {
            cuts += cut_everywhere(&old, slot, &new, &new, cut);
        }
    }
    println!("updates of {} bytes: {cuts} cuts, and as many again on the way back", new.len());
    // Erased and written: the model, and two copies of three records in sectors of 128 bytes.
    assert!(cuts >= 6 * (2 * new.len() + 2 * 3 * (128 + RECORD_BYTES)), "only {cuts} cuts");
}

#[test]
fn power_may_go_after_any_byte_of_an_update_that_fails_its_self_test() {
    let (old, bad) = (model(1, 0), failing_model(2));
    let cuts = [Cut::Clean, Cut::Torn].map(|cut| cut_everywhere(&old, Slot::A, &bad, &old, cut));
    println!("updates that fail: {} cuts, and as many again on the way back", cuts.iter().sum::<usize>());
}

#[test]
fn power_may_go_after_any_byte_of_the_first_confirmation() {
    let first = model(1, 0);
    let mut blank = Flash::new(first.len(), 128);
    blank.region(Region::Model(Slot::A))[..first.len()].copy_from_slice(&first);
    let mut whole = blank.clone();
    start(&mut Slots::new(&mut whole)).unwrap();
    assert_eq!(whole.traffic, 2 * (128 + RECORD_BYTES));
    println!("first confirmation: {} cuts", 3 * whole.traffic);
    for (at, cut) in (1..=whole.traffic).flat_map(|at| [Cut::Clean, Cut::Garbage, Cut::Torn].map(|cut| (at, cut))) {
        let mut flash = Flash { power: Some(at), cut, ..blank.clone() };
        let _ = start(&mut Slots::new(&mut flash));
        flash.power = None;
        let mut slots = Slots::new(flash);
        start(&mut slots).unwrap();
        assert_eq!((running(&slots), slots.record_copies()), (&first[..], 2), "cut after {at} bytes");
    }
}

#[test]
fn an_upload_goes_on_at_the_sector_whose_bytes_are_not_all_there() {
    // Three chunks under checksums and a part of one, in sectors of 4 KiB.
    let (old, new) = (model(1, 0), model(2, 50_000));
    let sector = 4096;
    let mut flash = Flash::new(new.len(), sector);
    flash.region(Region::Model(Slot::A))[..old.len()].copy_from_slice(&old);
    start(&mut Slots::new(&mut flash)).unwrap();
    let body = Model::new(&new).unwrap().raw().body_offset();
    for sent in [0, 100, body - 1, body, 16_384, body + 16_384, body + 40_000, new.len() - 1, new.len()] {
        let mut slots = Slots::new(flash.clone());
        slots.boot().unwrap();
        slots.begin_upload(ModelId::of(&old)).unwrap();
        slots.write(0, &old[..130]).unwrap();
        assert_eq!(slots.begin_upload(ModelId::of(&new)), Ok(0), "another model");
        slots.write(0, &new[..sent]).unwrap();
        slots.boot().unwrap();
        // The bytes of whole chunks count as written, and of these whole sectors are kept.
        let whole = if sent < body { 0 } else { body + (sent - body) / 16_384 * 16_384 };
        let expected = if sent == new.len() { sent } else { whole / sector * sector };
        let mut there = slots.begin_upload(ModelId::of(&new)).unwrap();
        assert_eq!(there, expected, "{sent} bytes sent");
        while there < new.len() {
            there = slots.write(there, &new[there..new.len().min(there + 1000)]).unwrap();
        }
        assert_eq!(slots.storage().bytes(Region::Model(Slot::B))[..new.len()], new);
    }
}
