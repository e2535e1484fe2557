//! Batches that work on the same items, each item by a process of its own, under every kind of fault.

use super::processes::number;
use super::*;
use crate::output::step::write;
use crate::output::{Owner, Staged, settle};
use crate::rounds::{ItemCounts, ItemEnd, ItemRounds};
use std::collections::BTreeSet;

/// Schedules of a usual run; see [`number`].
const SCHEDULES: u64 = 200;
/// Number of batches at a time.
const BATCHES: usize = 2;
/// Number of items; the last one's input is wrong.
const ITEMS: usize = 4;
const WRONG: usize = ITEMS - 1;
/// Rounds that a batch goes on for.
const ROUNDS: usize = 4;

/// What a process said before it ended.
type Said = std::result::Result<bool, ItemEnd>;

/// Makes item `item`, as its process `me` does; returns whether it was not there before.
fn make(world: &World, out: &Path, item: usize, me: usize) -> Said {
    let again = |_: crate::Error| ItemEnd::TryAgain;
    if item == WRONG {
        return Err(ItemEnd::Failed);
    }
    let owner = Owner::of_file(out).map_err(again)?;
    world.enter(out, me);
    let made = || {
        if out.exists() {
            settle(out)?;
            return Ok(false);
        }
        let mut staged = Staged::create(out)?;
        write(staged.file(), out, &bytes_of(item, me)).map_err(crate::Error::io(out))?;
        owner.check()?;
        staged.publish().map(|()| true)
    };
    let made = made().map_err(again);
    world.leave(out, me);
    made
}

/// What process `me` writes for an item.
fn bytes_of(item: usize, me: usize) -> Vec<u8> {
    [vec![item as u8; 40], (me as u32).to_le_bytes().to_vec(), vec![0xff; 20]].concat()
}

/// Returns whether bytes are what one process writes for an item.
fn is_whole(item: usize, bytes: &[u8]) -> bool {
    let me = bytes.get(40..44).map(|me| u32::from_le_bytes([me[0], me[1], me[2], me[3]]));
    me.is_some_and(|me| bytes == bytes_of(item, me as usize))
}

/// What was told of the items: the bytes of those that are done, and the names of those that failed.
#[derive(Default)]
struct Told {
    done: BTreeMap<usize, Vec<u8>>,
    failed: BTreeSet<usize>,
    faults: Vec<String>,
}

impl Told {
    fn take(&mut self, folder: &Path, item: usize, ended: ItemEnd) {
        let found = std::fs::read(path_of(folder, item)).unwrap_or_default();
        match ended {
            ItemEnd::Done if !is_whole(item, &found) => {
                self.faults.push(format!("item {item} is told as done and is not there"))
            }
            ItemEnd::Done => {
                if *self.done.entry(item).or_insert_with(|| found.clone()) != found {
                    self.faults.push(format!("item {item} was done and is made again"));
                }
            }
            ItemEnd::Failed => _ = self.failed.insert(item),
            ItemEnd::TryAgain => {}
        }
    }
}

fn path_of(folder: &Path, item: usize) -> PathBuf {
    folder.join(format!("{item}.tif"))
}

/// A batch over all items, as process `me`.
fn batch(world: &Arc<World>, folder: &Path, told: &Mutex<Told>, me: usize) -> ItemCounts {
    let items: Vec<usize> = (0..ITEMS).collect();
    let attempt = |item: &usize, _: usize| {
        let (inner, item, out) = (world.clone(), *item, path_of(folder, *item));
        let job: Job<Said> = Box::new(move || {
            let me = process().map_or(0, |(_, me)| me);
            make(&inner, &out, item, me)
        });
        match world.child(me, job) {
            Some(Ok(_)) => ItemEnd::Done,
            Some(Err(ended)) => ended,
            None if world.lock().planted == Some(Planted::KilledIsDone) => ItemEnd::Done,
            None => ItemEnd::TryAgain,
        }
    };
    let rounds = ItemRounds { slots: 1, attempt: &attempt, stops: &|| false };
    let mut tell = |item: &usize, ended: ItemEnd| {
        told.lock().expect("no batch panics with it").take(folder, *item, ended);
        Ok(ended)
    };
    let mut round = 1;
    let mut waits = || {
        round += 1;
        // Others go on meanwhile. Whether the step fails does not matter.
        let _ = before(Step::Judge, folder);
        round <= ROUNDS
    };
    rounds.run(&items.iter().collect::<Vec<_>>(), &mut tell, &mut waits).expect("telling does not fail")
}

/// Plays a schedule; returns what must not be, and how many batches said that all is done.
fn play(seed: u64, planted: Option<Planted>) -> (Vec<String>, usize) {
    let world = World::new(seed, planted);
    let folder = world.lock().disk.folder.clone();
    let told = Arc::new(Mutex::new(Told::default()));
    let batches = |count: usize| -> Vec<Job<ItemCounts>> {
        let one = |_| -> Job<ItemCounts> {
            let (world, folder, told) = (world.clone(), folder.clone(), told.clone());
            Box::new(move || {
                let me = process().map_or(0, |(_, me)| me);
                batch(&world, &folder, &told, me)
            })
        };
        (0..count).map(one).collect()
    };
    let all_done = ItemCounts { done: ITEMS - 1, failed: 1, again: 0 };
    let ended = world.run(batches(BATCHES));
    world.calm();
    let mut faults = Vec::new();
    let mut compare = |when: &str| {
        let told = told.lock().expect("no batch panics with it");
        for (item, bytes) in &told.done {
            if std::fs::read(path_of(&folder, *item)).ok().as_ref() != Some(bytes) {
                faults.push(format!("{when}, item {item} was told as done and is lost or another"));
            }
        }
        if told.failed.iter().any(|item| *item != WRONG) {
            faults.push(format!("{when}, of items {:?} more failed than the wrong one", told.failed));
        }
        if ended.contains(&all_done) && told.done.len() < ITEMS - 1 {
            faults.push(format!("{when}, a batch said that all is done"));
        }
    };
    compare("after the faults");
    let last = world.run(batches(1));
    compare("at the end");
    if last[..] != [all_done] {
        faults.push(format!("not all ends when all faults are over: {last:?}"));
    }
    for entry in std::fs::read_dir(&folder).expect("a folder").flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        // What a killed process was writing stays where no command owns the folder.
        if name.ends_with(".lock") && !name.starts_with(".tmp") {
            faults.push(format!("{name} is left at the end"));
        }
    }
    let counts_sum = |counts: &ItemCounts| counts.done + counts.failed + counts.again == ITEMS;
    if !ended.iter().chain(&last).all(counts_sum) {
        faults.push(format!("counts are not those of {ITEMS} items: {ended:?} {last:?}"));
    }
    faults.append(&mut told.lock().expect("no batch panics with it").faults);
    faults.append(&mut world.lock().faults);
    (faults, ended.iter().filter(|counts| **counts == all_done).count())
}

#[test]
fn no_schedule_of_batches_loses_an_item_or_makes_it_twice() {
    let (first, count) = (number("ELUNAR_SEED", 1), number("ELUNAR_SCHEDULES", SCHEDULES));
    let (began, mut finished) = (std::time::Instant::now(), 0);
    for seed in first..first + count {
        let (faults, all_done) = play(seed, None);
        assert!(faults.is_empty(), "ELUNAR_SEED={seed} ELUNAR_SCHEDULES=1: {faults:?}");
        finished += all_done;
    }
    println!("{count} schedules of batches in {} s, {finished} ended with all items", began.elapsed().as_secs());
    assert!(count < SCHEDULES || (count as usize / 4..BATCHES * count as usize).contains(&finished), "{finished}");
}

#[test]
fn planted_faults_are_found() {
    for (planted, expected) in [
        (Planted::KilledIsDone, "is told as done and is not there"),
        (Planted::NoFolderSync, "is lost or another"),
        (Planted::NoSync, "is lost or another"),
        (Planted::CheckThenAct, " own "),
    ] {
        assert_found(planted, expected, |seed| play(seed, Some(planted)).0);
    }
}

#[test]
fn a_schedule_can_be_played_again() {
    assert_eq!(play(3, Some(Planted::NoSync)), play(3, Some(Planted::NoSync)));
}
