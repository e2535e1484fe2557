//! Bit flips in stored data.

use super::*;
use crate::nn::slots::SlotError as E;

fn boot(flash: &Flash) -> (Result<(Slot, Standing), SlotError>, usize) {
    let mut slots = Slots::new(flash.clone());
    let boot = slots.boot().map(|b| (b.slot, b.standing));
    (boot, slots.record_copies())
}

/// Flips a bit.
fn flip(flash: &mut Flash, region: Region, bit: usize) {
    flash.region(region)[bit / 8] ^= 1 << (bit % 8);
}

#[test]
fn a_damaged_copy_of_the_record_is_mended_from_the_other() {
    let (old, new) = (model(1, 0), model(2, 0));
    let flash = commissioned(&old, Slot::B, &new);
    for bit in 0..8 * RECORD_BYTES {
        for copy in [Region::Record, Region::RecordCopy] {
            let mut flash = flash.clone();
            flip(&mut flash, copy, bit);
            assert_eq!(boot(&flash), (Ok((Slot::B, Standing::Confirmed)), 2), "bit {bit}");
        }
    }
}

#[test]
fn without_a_record_any_model_that_passes_its_self_test_is_run_and_confirmed() {
    let (old, new, failing) = (model(1, 0), model(2, 0), failing_model(3));
    let lost = |confirmed: &[u8], slot: Slot, other: &[u8]| {
        let mut flash = commissioned(confirmed, slot, other);
        flip(&mut flash, Region::Record, 300);
        flip(&mut flash, Region::RecordCopy, 17);
        flash
    };
    // Both models would run: the first is taken, whichever was confirmed.
    assert_eq!(boot(&lost(&old, Slot::B, &new)), (Ok((Slot::A, Standing::Salvaged)), 0));
    // Only one model would run.
    assert_eq!(boot(&lost(&old, Slot::B, &[])).0, Ok((Slot::B, Standing::Salvaged)));
    // The first model is accepted, and fails its self test.
    let mut slots = Slots::new(lost(&old, Slot::B, &failing));
    assert_eq!(slots.boot().map(|b| (b.slot, b.standing)), Ok((Slot::A, Standing::Salvaged)));
    assert_eq!(slots.begin_upload(ModelId::of(&new)), Err(E::Unconfirmed));
    assert_eq!(slots.reject().map(|b| (b.slot, b.standing)), Ok((Slot::B, Standing::Salvaged)));
    let passed = self_test(&slots).unwrap();
    slots.confirm(passed).unwrap();
    assert_eq!(slots.boot().map(|b| (b.slot, b.standing)), Ok((Slot::B, Standing::Confirmed)));
    assert_eq!(slots.record_copies(), 2);
}

#[test]
fn a_damaged_model_is_not_run() {
    let (old, new) = (model(1, 0), model(2, 0));
    for bit in (0..8 * old.len()).step_by(37) {
        // A flip in the confirmed model: the other model is found, and must pass its self test.
        let mut flash = commissioned(&old, Slot::A, &new);
        flip(&mut flash, Region::Model(Slot::A), bit);
        assert_eq!(boot(&flash), (Ok((Slot::B, Standing::Salvaged)), 2), "bit {bit}");
        // A flip in a model that is to be tried: it is rolled back at once.
        let mut slots = Slots::new(commissioned(&old, Slot::A, &[]));
        slots.boot().unwrap();
        upload(&mut slots, &new).unwrap();
        let mut flash = slots.storage().clone();
        flip(&mut flash, Region::Model(Slot::B), bit);
        assert_eq!(boot(&flash), (Ok((Slot::A, Standing::Confirmed)), 2), "bit {bit}");
    }
}

#[test]
fn when_nothing_runs_a_model_can_be_uploaded() {
    let new = model(2, 0);
    // Storage that was never used, or with the confirmed model damaged.
    let blank = Flash::new(new.len(), 128);
    let mut damaged = commissioned(&model(1, 0), Slot::A, &[]);
    flip(&mut damaged, Region::Model(Slot::A), 8 * 150);
    for (flash, slot) in [(blank, Slot::A), (damaged, Slot::B)] {
        let mut slots = Slots::new(flash);
        assert_eq!(slots.boot().map(|_| ()), Err(E::NothingRuns));
        assert_eq!(slots.model().map(|_| ()), Err(E::NothingRuns));
        upload(&mut slots, &new).unwrap();
        assert_eq!(slots.boot().map(|b| (b.slot, b.standing)), Ok((slot, Standing::Trial)));
        let passed = self_test(&slots).unwrap();
        slots.confirm(passed).unwrap();
        assert_eq!(boot(slots.storage()), (Ok((slot, Standing::Confirmed)), 2));
    }
    // After a model that fails, again no model runs.
    let mut slots = Slots::new(Flash::new(new.len(), 128));
    assert!(slots.boot().is_err());
    upload(&mut slots, &failing_model(3)).unwrap();
    assert_eq!(slots.boot().map(|b| b.standing), Ok(Standing::Trial));
    assert_eq!(slots.reject().map(|b| (b.slot, b.standing)), Ok((Slot::A, Standing::Salvaged)), "it is all there is");
    assert_eq!(slots.reject(), Err(E::NothingRuns));
}

#[test]
fn storage_that_is_too_small_holds_nothing_and_harms_nothing() {
    for lengths in [[0, 0, 0, 0], [100, 0, 3, 3], [700, 700, 63, 63]] {
        let mut flash = Flash::new(1, 1);
        flash.regions = lengths.map(|len| vec![0xff; len]);
        let mut slots = Slots::new(flash);
        assert_eq!(slots.boot(), Err(E::NothingRuns));
        assert_eq!(slots.record(), None);
    }
}
