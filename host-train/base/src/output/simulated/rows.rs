//! Processes that make the rows of the same job, one after the other, under every kind of fault.

use super::processes::number;
use super::*;
use crate::output::part::seal_again;
use crate::output::step::write;
use crate::output::{Owner, PartFile, Staged, part_path, settle};
use std::path::PathBuf;

/// Schedules of a usual run; see [`number`].
const SCHEDULES: u64 = 300;
/// Number of processes.
const PROCESSES: usize = 3;
const JOB: &str = "this job";
const ROWS: usize = 11;
const COLS: usize = 5;
/// Rows that are appended at once.
const AT_ONCE: usize = 3;

/// What a job makes: no sample occurs twice.
fn samples(job: &str) -> Vec<f32> {
    let first = if job == JOB { 1.0 } else { 1000.0 };
    (0..ROWS * COLS).map(|i| if i == 7 { f32::NAN } else { first + i as f32 }).collect()
}

fn bytes(samples: &[f32]) -> Vec<u8> {
    samples.iter().flat_map(|v| v.to_le_bytes()).collect()
}

impl World {
    /// Makes the output from rows, as commands do; returns whether it was not there before.
    fn job_of_rows(&self, out: &Path, me: usize) -> crate::Result<bool> {
        let owner = Owner::of_file(out)?;
        self.enter(out, me);
        let done = self.make(out, &owner);
        self.leave(out, me);
        done
    }

    fn make(&self, out: &Path, owner: &Owner) -> crate::Result<bool> {
        let path = part_path(out, None)?;
        if out.exists() {
            settle(out)?;
            PartFile::discard(&path, JOB, COLS)?;
            return Ok(false);
        }
        let mut part = PartFile::open_at(path, JOB, COLS, owner.is_successor())?;
        self.check(&mut part)?;
        let all = samples(JOB);
        while part.rows() < ROWS {
            let (from, to) = (part.rows(), ROWS.min(part.rows() + AT_ONCE));
            owner.check()?;
            part.append(&all[from * COLS..to * COLS])?;
            let mut state = self.lock();
            // One that was halted may cut rows off before it looks. They are made again.
            state.rows_kept = if state.halts { 0 } else { to };
        }
        let mut staged = Staged::create(out)?;
        part.read(&mut |rows| write(staged.file(), out, &bytes(rows)).map_err(crate::Error::io(out)))?;
        owner.check()?;
        staged.publish()?;
        part.remove()?;
        Ok(true)
    }

    /// Compares the rows of earlier processes with those of an undisturbed one.
    fn check(&self, part: &mut PartFile) -> crate::Result<()> {
        let mut found = Vec::new();
        part.read(&mut |rows| {
            found.extend(bytes(rows));
            Ok(())
        })?;
        let mut state = self.lock();
        if !bytes(&samples(JOB)).starts_with(&found) {
            state.faults.push(format!("of {} rows some were never made", part.rows()));
        }
        if part.rows() < state.rows_kept {
            let kept = state.rows_kept;
            state.faults.push(format!("of {kept} rows on disk {} are left", part.rows()));
        }
        Ok(())
    }
}

/// Leaves the rows of another job.
fn another_job(out: &Path) {
    let mut part = PartFile::open(out, "another job", COLS).expect("rows");
    part.append(&samples("another job")).expect("rows");
}

/// Lets somebody else change the rows that are left; returns whether they are known no more.
fn damage(seed: u64, out: &Path, path: &Path) -> bool {
    let mut random = Random::new(seed ^ 0xdead);
    let kind = random.below(6);
    match (kind, std::fs::read(path)) {
        (0, Ok(mut bytes)) if !bytes.is_empty() => {
            let at = random.below(8 * bytes.len());
            bytes[at / 8] ^= 1 << (at % 8);
            std::fs::write(path, &bytes).expect("a file");
            // Zeros are what a cut leaves.
            !bytes.starts_with(b"elunar part ") && bytes.iter().take(16).any(|byte| *byte != 0)
        }
        (1, _) => {
            _ = std::fs::remove_file(path);
            another_job(out);
            false
        }
        (2, _) => {
            std::fs::write(path, "somebody's").expect("a file");
            true
        }
        _ => false,
    }
}

/// Plays a schedule; returns what must not be, and how often an owner was superseded that was only halted.
fn play(seed: u64, planted: Option<Planted>) -> (Vec<String>, usize) {
    let world = World::new(seed, planted);
    let out = world.lock().disk.folder.join("out");
    {
        let mut state = world.lock();
        state.halts = planted.is_none() && state.of_machines && seed % 4 == 1;
    }
    let path = part_path(&out, None).expect("a path");
    if seed.is_multiple_of(3) {
        another_job(&out);
        let mut state = world.lock();
        state.disk.sync(&path);
        state.disk.sync_names();
    }
    let jobs = |world: &Arc<World>, from: usize, count: usize| {
        let one = |me| -> Job<std::result::Result<bool, String>> {
            let (world, out): (_, PathBuf) = (world.clone(), out.clone());
            Box::new(move || {
                let tried = || world.job_of_rows(&out, me).map_err(|error| error.to_string());
                tried().or_else(|_| tried()).or_else(|_| tried())
            })
        };
        (from..from + count).map(one).collect::<Vec<_>>()
    };
    let finished = world.run(jobs(&world, 0, PROCESSES)).iter().any(|done| done.is_ok());
    world.calm();
    let mut faults = Vec::new();
    let is_whole = || std::fs::read(&out).is_ok_and(|found| found == bytes(&samples(JOB)));
    if (finished || out.exists()) && !is_whole() {
        faults.push("what was finished is lost or wrong".into());
    }
    if planted == Some(Planted::NoSums) {
        // There may be no rows.
        let _ = seal_again(&path, JOB, COLS);
    }
    let rows = || std::fs::read(&path).ok();
    if planted.is_none() && !out.exists() {
        let left = rows();
        let is_foreign = damage(seed, &out, &path);
        if left != rows() {
            world.lock().rows_kept = 0;
        }
        if is_foreign {
            let found = rows();
            let refused = world.run(jobs(&world, PROCESSES, 1));
            if !matches!(&refused[..], [Err(error)] if error.contains("another file found")) || found != rows() {
                faults.push(format!("what somebody else left is not refused: {refused:?}"));
            }
            _ = std::fs::remove_file(&path);
        }
    }
    let last = world.run(jobs(&world, PROCESSES + 1, 1));
    if !matches!(last[..], [Ok(_)]) || !is_whole() {
        faults.push(format!("nothing finishes when all faults are over: {last:?}"));
    }
    for left in [&path, &out.with_extension("lock")].into_iter().filter(|path| path.exists()) {
        faults.push(format!("{} is left at the end", left.display()));
    }
    let mut state = world.lock();
    faults.append(&mut state.faults);
    (faults, state.successions)
}

#[test]
fn no_schedule_loses_rows_or_invents_them() {
    let (first, count) = (number("ELUNAR_SEED", 1), number("ELUNAR_SCHEDULES", SCHEDULES));
    let began = std::time::Instant::now();
    let mut superseded = 0;
    for seed in first..first + count {
        let (faults, successions) = play(seed, None);
        superseded += successions;
        assert!(faults.is_empty(), "ELUNAR_SEED={seed} ELUNAR_SCHEDULES=1: {faults:?}");
    }
    println!("{count} schedules of rows in {} s, {superseded} owners superseded", began.elapsed().as_secs());
    assert!(count < SCHEDULES || superseded > 0, "no owner was superseded while it was halted");
}

#[test]
fn planted_faults_are_found() {
    for (planted, expected) in [
        (Planted::NoSums, "were never made"),
        (Planted::NoSync, "rows on disk"),
        (Planted::NoFolderSync, "rows on disk"),
        (Planted::CheckThenAct, " own "),
    ] {
        assert_found(planted, expected, |seed| play(seed, Some(planted)).0);
    }
}
