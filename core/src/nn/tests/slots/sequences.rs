//! Random lives of two slots: boots, confirmations, rejections and uploads, with power cuts, torn sectors, and a worn record.
//!
//! ```sh
//! ELUNAR_BOOTS=100000 cargo test -p elunar-core many_boots -- --ignored --nocapture
//! ```

use super::flash::{Cut, Flash};
use super::*;
use crate::nn::tests::Random;

/// What happened.
#[derive(Debug, Default)]
struct Tally {
    lives: usize,
    boots: usize,
    trials: usize,
    cuts: usize,
    uploads: usize,
    confirmed: usize,
    rejected: usize,
    /// Boots with a worn copy of the record.
    worn: usize,
    /// Boots that found no model: before the first confirmation alone.
    nothing: usize,
}

/// What flight software knows of its slots.
struct Known {
    /// Bytes of the model that was confirmed last.
    confirmed: Option<Vec<u8>>,
    /// Boots that the trial has left; none if there is no trial.
    left: u32,
}

/// One life of the slots, which mostly begins with a model that was delivered with the hardware, sound or not.
fn live(random: &mut Random, models: &[Vec<u8>], tally: &mut Tally) {
    let longest = models.iter().map(Vec::len).max().unwrap();
    let mut flash = Flash::new(longest + 100, random.pick(&[1, 64, 128, 256, 1024]));
    if !random.one_in(8) {
        let delivered = &models[random.size(0, models.len() - 1)];
        flash.region(Region::Model(Slot::A))[..delivered.len()].copy_from_slice(delivered);
    }
    if random.one_in(8) {
        flash.worn = Some(random.pick(&[Region::Record, Region::RecordCopy]));
    }
    let mut known = Known { confirmed: None, left: 0 };
    for _ in 0..random.size(5, 35) {
        let most = random.pick(&[100, 400, 4000]);
        flash.power = if random.one_in(3) { None } else { Some(random.size(1, most)) };
        (flash.cut, flash.noise) = (random.pick(&[Cut::Clean, Cut::Garbage, Cut::Torn]), Random::new(random.next()));
        tally.worn += usize::from(flash.worn.is_some());
        cycle(&mut Slots::new(&mut flash), random, models, &mut known, tally);
        tally.cuts += usize::from(flash.dead());
        if let Some(confirmed) = &known.confirmed {
            let holds = |slot| flash.bytes(Region::Model(slot))[..confirmed.len()] == *confirmed;
            assert!(holds(Slot::A) || holds(Slot::B), "the confirmed model is gone");
        }
    }
    tally.lives += 1;
}

/// From one reset to the next.
fn cycle(slots: &mut Slots<&mut Flash>, random: &mut Random, models: &[Vec<u8>], known: &mut Known, tally: &mut Tally) {
    tally.boots += 1;
    match slots.boot() {
        Ok(boot) => {
            judge(slots, boot, known);
            tally.trials += usize::from(boot.standing == Standing::Trial);
            act(slots, boot.standing, random, known, tally);
        }
        Err(error) => {
            assert_eq!((error, &known.confirmed), (SlotError::NothingRuns, &None));
            tally.nothing += 1;
        }
    }
    if !random.one_in(3) {
        upload_some(slots, &models[random.size(0, models.len() - 1)], random, known, tally);
    }
}

/// Checks the choice of a boot.
fn judge(slots: &Slots<&mut Flash>, boot: Boot, known: &mut Known) {
    match (boot.standing, &known.confirmed) {
        (Standing::Trial, _) => {
            known.left = known.left.checked_sub(1).expect("no more boots than the trial was given");
        }
        (Standing::Confirmed, Some(confirmed)) => assert_eq!(running(slots), confirmed),
        (standing, confirmed) => {
            let both = (standing, confirmed.is_some());
            assert_eq!(both, (Standing::Salvaged, false), "a record is whole once one was written");
        }
    }
}

/// What flight software does with the model: nothing, as after a fault; rejects it; or tests and confirms it.
fn act(slots: &mut Slots<&mut Flash>, standing: Standing, random: &mut Random, known: &mut Known, tally: &mut Tally) {
    let tried = running(slots).to_vec();
    let passed = self_test(slots);
    match random.size(0, 3) {
        0 => {}
        1 if standing == Standing::Trial => reject(slots, known, tally),
        _ => match passed {
            Ok(passed) => {
                let done = slots.confirm(passed);
                // A record that landed counts, even if power went before the answer.
                let record = slots.record().unwrap_or_default();
                let recorded = record.confirmed.is_some_and(|entry| entry.id == ModelId::of(&tried));
                assert!(done.is_err() || recorded);
                if recorded && record.trial.is_none() {
                    (known.confirmed, known.left) = (Some(tried), 0);
                    tally.confirmed += 1;
                }
            }
            Err(_) => reject(slots, known, tally),
        },
    }
}

fn reject(slots: &mut Slots<&mut Flash>, known: &mut Known, tally: &mut Tally) {
    tally.rejected += 1;
    match (slots.reject(), &known.confirmed) {
        (Ok(_), Some(confirmed)) => assert_eq!(running(slots), confirmed),
        (Ok(_), None) => {}
        (Err(error), confirmed) => assert_eq!((error, confirmed), (SlotError::NothingRuns, &None)),
    }
    if slots.record().is_none_or(|record| record.trial.is_none()) {
        known.left = 0;
    }
}

/// Uploads a model or a part of it, in chunks of any length, and puts a whole one on trial.
fn upload_some(slots: &mut Slots<&mut Flash>, file: &[u8], random: &mut Random, known: &mut Known, tally: &mut Tally) {
    let Ok(mut there) = slots.begin_upload(ModelId::of(file)) else { return };
    tally.uploads += 1;
    let chunk = random.pick(&[64, 150, 1024, 100_000]);
    let end = if random.one_in(4) { random.size(0, file.len()) } else { file.len() };
    while there < end {
        match slots.write(there, &file[there..end.min(there + chunk)]) {
            Ok(now) => there = now,
            Err(_) => return,
        }
    }
    let boots = random.size(0, 3) as u32;
    let begun = there == file.len() && slots.start_trial(boots).is_ok();
    let recorded = slots.record().is_some_and(|record| record.trial.is_some());
    assert!(recorded || !begun);
    if recorded {
        known.left = boots;
    }
}

fn campaign(seed: u64, boots: usize) -> Tally {
    let models = [model(1, 0), model(2, 30), model(3, 200), failing_model(4)];
    let (mut tally, mut at) = (Tally::default(), seed);
    while tally.boots < boots {
        let live = std::panic::AssertUnwindSafe(|| live(&mut Random::new(at), &models, &mut tally));
        std::panic::catch_unwind(live).unwrap_or_else(|_| panic!("seed {at}"));
        at += 1;
    }
    println!("seeds {seed}..{at}: {tally:?}");
    tally
}

#[test]
fn boots_with_cuts_and_wear_keep_what_was_confirmed() {
    let tally = campaign(1, 3000);
    let each = [tally.trials, tally.cuts, tally.uploads, tally.confirmed, tally.rejected, tally.worn, tally.nothing];
    assert!(each.iter().all(|count| *count > 20), "each occurs: {tally:?}");
}

#[test]
#[ignore = "a campaign: a minute or more"]
fn many_boots() {
    let number = |name: &str, default| {
        std::env::var(name)
            .map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{name}: expected a number, found {text}")))
    };
    campaign(number("ELUNAR_SEED", 1), number("ELUNAR_BOOTS", 100_000) as usize);
}
