//! A simulated world for tests: processes that a seed interleaves, kills and lets fail, and a disk that loses at a power cut what was not
//! synced.
//!
//! A process is a thread. One runs at a time; in front of every step ([`before`]) the seed chooses who goes on. The code under test is the real
//! one, on a real folder. A killed process unwinds; what its destructors remove is put back, because a kill runs none.

mod disk;
mod items;
mod processes;
mod rows;

use super::record::OutputRecord;
use super::step::{ASKED, Step};
use disk::Disk;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io::{Error, ErrorKind, Result};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;

/// What is wrong on purpose, so that the checks must find it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Planted {
    /// A file is renamed before it is on disk.
    NoSync,
    /// A name is not brought to disk.
    NoFolderSync,
    /// A lock is looked for and then taken, in two steps.
    CheckThenAct,
    /// An output gets its name after its lock is gone.
    UnlockFirst,
    /// Checksums of rows are not compared.
    NoSums,
    /// A process that was killed counts as one that has done its work.
    KilledIsDone,
}

/// Reproducible numbers (xorshift64*).
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        let mut random = Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        (0..4).for_each(|_| _ = random.below(2));
        random
    }

    /// Returns a number below `n`.
    pub(super) fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % n
    }
}

/// Checks that one of the first schedules finds what was planted, in these words.
fn assert_found(planted: Planted, expected: &str, play: impl Fn(u64) -> Vec<String>) {
    let is_found = |seed| Some((seed, play(seed).into_iter().find(|text| text.contains(expected))?));
    let found = (1..1000).find_map(is_found);
    println!("{planted:?}: {found:?}");
    assert!(found.is_some(), "{planted:?}");
}

/// How a process stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Runs,
    /// Waits for the end of another process.
    Waits(usize),
    /// Killed, and not yet unwound.
    Dies,
    Ended,
}

struct State {
    random: Random,
    disk: Disk,
    boot: u32,
    processes: Vec<Phase>,
    turn: usize,
    steps: usize,
    /// The step at which power is cut, and one in how many steps kills or fails.
    cut_at: usize,
    kills: usize,
    fails: usize,
    /// Whether each process runs on a machine of its own, so that only life signs tell that it has ended.
    of_machines: bool,
    /// Whether an owner may be halted for an hour, and lose its output meanwhile.
    halts: bool,
    /// How often an owner was superseded that runs.
    successions: usize,
    is_cut: bool,
    planted: Option<Planted>,
    /// Who makes an output.
    holders: BTreeMap<PathBuf, usize>,
    /// Rows that are on disk, as their maker was told.
    rows_kept: usize,
    /// What must not be.
    faults: Vec<String>,
}

/// Processes, disk and clock.
pub(super) struct World {
    state: Mutex<State>,
    next: Condvar,
}

/// What a process does.
pub(super) type Job<T> = Box<dyn FnOnce() -> T + Send>;

/// The payload of a killed process.
struct Killed;

thread_local! {
    static PROCESS: RefCell<Option<(Arc<World>, usize)>> = const { RefCell::new(None) };
}

fn process() -> Option<(Arc<World>, usize)> {
    PROCESS.try_with(|process| process.borrow().clone()).ok().flatten()
}

/// Returns whether this thread is a simulated process.
pub(super) fn is_active() -> bool {
    process().is_some()
}

/// Returns whether machines see nothing of each other's kernel locks.
pub(super) fn has_no_flock() -> bool {
    process().is_some_and(|(world, _)| world.lock().halts)
}

/// Returns the record of the simulated process.
pub(super) fn here() -> Option<OutputRecord> {
    let (world, me) = process()?;
    let state = world.lock();
    let [host, namespace] = ["moon", "n"].map(String::from);
    let (machine, pid) = (if state.of_machines { me } else { 0 }, me as u32);
    let boot = format!("boot {} of {machine}", state.boot);
    Some(OutputRecord { host, boot, namespace, pid, process_start: Some(1), since_s: 0, is_renewed: true })
}

/// Returns the start of a process that runs.
pub(super) fn start_of(pid: u32) -> Option<u64> {
    let (world, _) = process()?;
    let runs = world.lock().processes.get(pid as usize) == Some(&Phase::Runs);
    runs.then_some(1)
}

/// Lets others go on first; then the step may be done, fails, or the process is killed in front of it.
fn before(step: Step, path: &Path) -> Result<()> {
    let Some((world, me)) = process() else { return Ok(()) };
    let mut state = world.lock();
    if state.processes[me] == Phase::Dies {
        return Err(Error::from(ErrorKind::Interrupted));
    }
    state.disk.look();
    state.pass_on();
    world.next.notify_all();
    state = world.wait(state, me);
    state.steps += 1;
    if state.steps >= state.cut_at && !state.is_cut {
        state.is_cut = true;
        state.disk.cut();
        state.boot += 1;
    }
    let kills = state.kills;
    let is_killed = state.is_cut || kills > 0 && state.random.below(kills) == 0;
    // Unwinding from there would leak the file that `inherit` returns, and with it the kernel's lock.
    if is_killed && step != Step::EndSuccession {
        state.kill(me);
        drop(state);
        resume_unwind(Box::new(Killed));
    }
    if state.of_machines && state.random.below(20) == 0 {
        state.age();
    }
    let fails = state.fails;
    if fails > 0 && state.random.below(fails) == 0 {
        return Err(Error::from(ErrorKind::StorageFull));
    }
    match (step, state.planted) {
        (Step::Sync, Some(Planted::NoSync)) | (Step::SyncFolder, Some(Planted::NoFolderSync)) => {}
        (Step::Sync, _) => state.disk.sync(path),
        (Step::SyncFolder, _) => state.disk.sync_names(),
        // As if the name was taken by a rename that replaces.
        (Step::Take, Some(Planted::CheckThenAct)) => _ = std::fs::remove_file(path),
        _ => {}
    }
    Ok(())
}

impl State {
    /// Chooses who goes on. One that waits is chosen when what it waits for has ended, or to be killed.
    fn pass_on(&mut self) {
        let kills = self.kills > 0 && self.random.below(self.kills) == 0;
        let may = |phase: Phase| match phase {
            Phase::Ended => false,
            Phase::Waits(other) => kills || self.processes[other] == Phase::Ended,
            Phase::Runs | Phase::Dies => true,
        };
        let running: Vec<usize> = (0..self.processes.len()).filter(|p| may(self.processes[*p])).collect();
        if !running.is_empty() {
            self.turn = running[self.random.below(running.len())];
        }
    }

    /// Lets an hour go by, in which owners that run give life signs, but one that is halted.
    fn age(&mut self) {
        let halted = if self.halts { self.random.below(self.processes.len()) } else { usize::MAX };
        let runs = |record: OutputRecord| {
            record.pid as usize != halted && self.processes.get(record.pid as usize) == Some(&Phase::Runs)
        };
        self.disk.age(|text| OutputRecord::parse(text).is_some_and(runs));
    }

    fn kill(&mut self, me: usize) {
        self.processes[me] = Phase::Dies;
        self.disk.remember();
        self.holders.retain(|_, holder| *holder != me);
    }
}

impl World {
    /// Makes a world on a new folder.
    pub(super) fn new(seed: u64, planted: Option<Planted>) -> Arc<Self> {
        let mut random = Random::new(seed);
        let cut_at = if random.below(2) == 0 { 1 + random.below(150) } else { usize::MAX };
        let (kills, fails) = ([0, 20, 60][random.below(3)], [0, 0, 50][random.below(3)]);
        let (disk, processes, faults) = (Disk::new(Random::new(!seed)), Vec::new(), Vec::new());
        let (of_machines, is_cut, holders) = (random.below(2) == 0, false, BTreeMap::new());
        let (boot, turn, steps) = (0, 0, 0);
        let state = State {
            random,
            disk,
            boot,
            processes,
            turn,
            steps,
            cut_at,
            kills,
            fails,
            of_machines,
            halts: false,
            successions: 0,
            is_cut,
            planted,
            holders,
            rows_kept: 0,
            faults,
        };
        Arc::new(Self { state: Mutex::new(state), next: Condvar::new() })
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no process panics with the state")
    }

    fn wait<'s>(&self, mut state: MutexGuard<'s, State>, me: usize) -> MutexGuard<'s, State> {
        while state.turn != me {
            state = self.next.wait(state).expect("no process panics with the state");
        }
        state
    }

    /// Runs processes until all have ended; returns what those gave that were not killed.
    pub(super) fn run<T: Send + 'static>(self: &Arc<Self>, jobs: Vec<Job<T>>) -> Vec<T> {
        let mut state = self.lock();
        let threads: Vec<_> = jobs.into_iter().map(|job| self.start(&mut state, job).1).collect();
        state.pass_on();
        self.next.notify_all();
        // Processes that outlive the one that started them, too.
        while state.processes.iter().any(|phase| *phase != Phase::Ended) {
            state = self.next.wait(state).expect("no process panics with the state");
        }
        drop(state);
        threads.into_iter().filter_map(|thread| thread.join().expect("a process that is only killed")).collect()
    }

    fn start<T: Send + 'static>(self: &Arc<Self>, state: &mut State, job: Job<T>) -> (usize, JoinHandle<Option<T>>) {
        let (world, me) = (self.clone(), state.processes.len());
        state.processes.push(Phase::Runs);
        (me, std::thread::spawn(move || world.process(me, job)))
    }

    /// Runs a job as a process that process `me` waits for; `None` if it is killed. It goes on if `me` is killed. May be called by any thread of
    /// `me`, if the others wait.
    fn child<T: Send + 'static>(self: &Arc<Self>, me: usize, job: Job<T>) -> Option<T> {
        let mut state = self.lock();
        let (child, thread) = self.start(&mut state, job);
        state.processes[me] = Phase::Waits(child);
        state.pass_on();
        self.next.notify_all();
        state = self.wait(state, me);
        if state.is_cut || state.processes[child] != Phase::Ended {
            state.kill(me);
            drop(state);
            resume_unwind(Box::new(Killed));
        }
        state.processes[me] = Phase::Runs;
        drop(state);
        thread.join().expect("a process that is only killed")
    }

    /// Ends all faults, and lets what a cut has left be found.
    fn calm(&self) {
        let mut state = self.lock();
        state.disk.start_again();
        (state.kills, state.fails, state.cut_at, state.halts) = (0, 0, usize::MAX, false);
        if std::mem::take(&mut state.is_cut) || state.of_machines {
            state.age();
        }
    }

    fn enter(&self, out: &Path, me: usize) {
        let mut state = self.lock();
        let other = state.holders.insert(out.into(), me);
        // Who was halted does not know yet that it is no owner.
        if other.is_some() && state.halts {
            state.successions += 1;
        } else if let Some(other) = other {
            state
                .faults
                .push(format!("processes {other} and {me} own {}", out.file_name().unwrap_or_default().display()));
        }
    }

    fn leave(&self, out: &Path, me: usize) {
        self.lock().holders.retain(|held, holder| held != out || *holder != me);
    }

    fn process<T>(self: &Arc<Self>, me: usize, job: Job<T>) -> Option<T> {
        drop(self.wait(self.lock(), me));
        PROCESS.set(Some((self.clone(), me)));
        ASKED.set(Some(before));
        let done = catch_unwind(AssertUnwindSafe(job));
        ASKED.set(None);
        PROCESS.set(None);
        let mut state = self.lock();
        if state.processes[me] == Phase::Dies {
            state.disk.put_back();
        } else {
            state.disk.look();
        }
        state.processes[me] = Phase::Ended;
        state.pass_on();
        self.next.notify_all();
        drop(state);
        match done {
            Ok(value) => Some(value),
            Err(why) if why.is::<Killed>() => None,
            Err(why) => resume_unwind(why),
        }
    }
}
