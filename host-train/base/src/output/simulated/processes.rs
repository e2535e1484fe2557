//! Processes that make the same output, under every kind of fault.

use super::*;
use crate::digest::sha256_of;
use crate::output::step::write;
use crate::output::{Owner, Staged, atomic_write, settle};
use std::result::Result;

/// Schedules of a usual run. `ELUNAR_SCHEDULES` tries more, from `ELUNAR_SEED` on.
const SCHEDULES: u64 = 300;
/// Number of processes.
const PROCESSES: usize = 3;

pub(super) fn number(name: &str, usual: u64) -> u64 {
    std::env::var(name).ok().map_or(usual, |text| text.parse().expect("a number"))
}

/// What process `me` writes: its length and its number in every byte.
fn payload(me: usize) -> Vec<u8> {
    vec![me as u8; 100 + me]
}

/// Returns whether a file is what one process writes.
fn is_whole(bytes: &[u8]) -> bool {
    bytes.first().is_some_and(|me| bytes == payload(usize::from(*me)))
}

/// Returns whether the output and its checksum are there and agree.
fn is_finished(folder: &Path) -> bool {
    let sum = std::fs::read_to_string(folder.join("out.sha256"));
    let file = std::fs::File::open(folder.join("out"));
    file.is_ok_and(|mut file| sha256_of(&mut file).ok() == sum.ok())
}

impl World {
    /// Makes the output, as commands do; returns whether it was not there before.
    fn job(&self, folder: &Path, of_folder: bool, me: usize) -> crate::Result<bool> {
        let out = folder.join("out");
        let owner = if of_folder {
            Owner::of_folder(folder, "sim", ["out", "out.sha256"].map(String::from))?
        } else {
            Owner::of_file(&out)?
        };
        self.enter(&out, me);
        let done = match self.write(folder, &owner, me) {
            Ok(Some(staged)) if self.lock().planted == Some(Planted::UnlockFirst) => {
                self.leave(&out, me);
                drop(owner);
                return finish(folder, staged).map(|()| true);
            }
            Ok(Some(staged)) => finish(folder, staged).map(|()| true),
            Ok(None) => Ok(false),
            Err(error) => Err(error),
        };
        self.leave(&out, me);
        done
    }

    /// Writes the output under another name; `None` if it is finished.
    fn write(&self, folder: &Path, owner: &Owner, me: usize) -> crate::Result<Option<Staged>> {
        if is_finished(folder) {
            settle(&folder.join("out"))?;
            return Ok(None);
        }
        let out = folder.join("out");
        let mut staged = Staged::create(&out)?;
        write(staged.file(), &out, &payload(me)).map_err(crate::Error::io(&out))?;
        owner.check()?;
        Ok(Some(staged))
    }
}

/// Gives the output its name, and states its checksum.
fn finish(folder: &Path, mut staged: Staged) -> crate::Result<()> {
    let sum = staged.sha256()?;
    staged.publish()?;
    atomic_write(&folder.join("out.sha256"), sum.as_bytes())
}

/// Plays a schedule; returns what must not be.
fn play(seed: u64, planted: Option<Planted>) -> Vec<String> {
    let world = World::new(seed, planted);
    let folder = world.lock().disk.folder.clone();
    let of_folder = seed.is_multiple_of(2);
    let jobs = |world: &Arc<World>, from: usize, count: usize| {
        let one = |me| -> Job<Result<bool, String>> {
            let (world, folder) = (world.clone(), folder.clone());
            Box::new(move || {
                let mut last = Err(String::new());
                for _ in 0..3 {
                    last = world.job(&folder, of_folder, me).map_err(|error| error.to_string());
                    if last.is_ok() {
                        break;
                    }
                }
                last
            })
        };
        (from..from + count).map(one).collect::<Vec<_>>()
    };
    let finished = world.run(jobs(&world, 0, PROCESSES)).iter().any(|done| done.is_ok());
    world.calm();
    let mut faults = Vec::new();
    let whole = |when: &str, faults: &mut Vec<String>| {
        if std::fs::read(folder.join("out")).is_ok_and(|bytes| !is_whole(&bytes)) {
            faults.push(format!("{when}, half an output has its name"));
        }
    };
    whole("after the faults", &mut faults);
    if finished && !is_finished(&folder) {
        faults.push("what was finished is lost".into());
    }
    let last = world.run(jobs(&world, PROCESSES, 1));
    if !matches!(last[..], [Ok(_)]) || !is_finished(&folder) {
        faults.push(format!("nothing finishes when all faults are over: {last:?}"));
    }
    whole("at the end", &mut faults);
    for lock in ["out.lock", "owner.lock"].iter().filter(|lock| folder.join(lock).exists()) {
        faults.push(format!("{lock} is left at the end"));
    }
    faults.append(&mut world.lock().faults);
    faults
}

#[test]
fn no_schedule_of_kills_cuts_and_failures_loses_anything() {
    let (first, count) = (number("ELUNAR_SEED", 1), number("ELUNAR_SCHEDULES", SCHEDULES));
    let began = std::time::Instant::now();
    for seed in first..first + count {
        let faults = play(seed, None);
        assert!(faults.is_empty(), "ELUNAR_SEED={seed} ELUNAR_SCHEDULES=1: {faults:?}");
    }
    println!("{count} schedules in {} s", began.elapsed().as_secs());
}

#[test]
fn planted_faults_are_found() {
    for planted in [Planted::NoSync, Planted::NoFolderSync, Planted::CheckThenAct, Planted::UnlockFirst] {
        assert_found(planted, "", |seed| play(seed, Some(planted)));
    }
}

#[test]
fn a_schedule_can_be_played_again() {
    assert_eq!(play(5, Some(Planted::CheckThenAct)), play(5, Some(Planted::CheckThenAct)));
}
