//! What became of the items of a manifest: from the DTMs themselves, and from the lines of all batches.

use super::item::BatchItem;
use super::manifest::BatchManifest;
use super::outcome::{AttemptRecord, ItemOutcome};
use elunar_base::{Result, read};
use elunar_scene::predict::identity::has_its_sum;
use elunar_scene::predict::sum_path;
use serde::Serialize;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

/// State of an item.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ItemState {
    /// The DTM and its SHA-256 lie there.
    Done,
    /// It never succeeds as it is.
    Failed,
    /// Its last attempt may be repeated.
    TryAgain,
    /// No attempt has ended.
    Waiting,
}

/// What became of the items.
#[derive(Debug)]
pub struct Status<'a> {
    /// Every item with its state and its last attempt.
    pub items: Vec<(&'a BatchItem, ItemState, Option<AttemptRecord>)>,
    /// All attempts.
    pub attempts: Vec<AttemptRecord>,
}

/// Reads the lines of batches. Other lines, such as those of an engine, are left out; so is a line that was cut by a kill.
///
/// # Errors
/// [`Error::Io`] if a file cannot be read.
pub fn read_logs(logs: &[PathBuf]) -> Result<Vec<AttemptRecord>> {
    let mut attempts: Vec<AttemptRecord> = vec![];
    for log in logs {
        let text = read::bytes(log, read::MOST_BYTES)?;
        attempts.extend(String::from_utf8_lossy(&text).lines().filter_map(|line| serde_json::from_str(line).ok()));
    }
    attempts.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    Ok(attempts)
}

impl<'a> Status<'a> {
    /// Finds out the state of all items. With `verify`, DTMs are read and compared with their SHA-256; a DTM that differs is to be made again.
    #[must_use]
    pub fn new(manifest: &'a BatchManifest, attempts: Vec<AttemptRecord>, verify: bool) -> Self {
        let last: HashMap<&str, &AttemptRecord> =
            attempts.iter().map(|outcome| (outcome.id.as_str(), outcome)).collect();
        let items = manifest.items.iter().map(|(_, item)| {
            let output = manifest.folder.join(&item.output);
            let is_there = if verify { has_its_sum(&output) } else { output.is_file() && sum_path(&output).is_file() };
            let last = last.get(item.id.as_str()).copied();
            let state = match last.map(|outcome| outcome.verdict) {
                // A run of another option may have failed; the DTM is that of an earlier one.
                Some(ItemOutcome::Failed) => ItemState::Failed,
                _ if is_there => ItemState::Done,
                Some(_) => ItemState::TryAgain,
                None => ItemState::Waiting,
            };
            (item, state, last.cloned())
        });
        let items = items.collect();
        Self { items, attempts }
    }

    /// Returns the number of items in a state.
    #[must_use]
    pub fn count(&self, state: ItemState) -> usize {
        self.items.iter().filter(|(_, found, _)| *found == state).count()
    }

    /// Returns the share of finished items, percent.
    #[must_use]
    pub fn done_percent(&self) -> f64 {
        100.0 * self.count(ItemState::Done) as f64 / self.items.len().max(1) as f64
    }

    /// Returns the items of some states.
    pub fn of<'s>(&'s self, states: &'s [ItemState]) -> impl Iterator<Item = &'a BatchItem> + 's {
        self.items.iter().filter(|(_, state, _)| states.contains(state)).map(|(item, ..)| *item)
    }

    /// Returns the failures by kind: their number, and one error as an example.
    #[must_use]
    pub fn failures(&self) -> BTreeMap<&'static str, (usize, String)> {
        let mut kinds: BTreeMap<&'static str, (usize, String)> = BTreeMap::new();
        let unfinished =
            self.items.iter().filter(|(_, state, _)| matches!(state, ItemState::Failed | ItemState::TryAgain));
        for outcome in unfinished.filter_map(|(.., last)| last.as_ref()) {
            let entry = kinds.entry(outcome.kind()).or_default();
            entry.0 += 1;
            entry.1 = outcome.error.clone().unwrap_or_else(|| "the DTM is gone, or differs from its SHA-256".into());
        }
        kinds
    }

    /// Returns the throughput: items and pixels made, seconds of processes, and the time from the first start to the last end.
    #[must_use]
    pub fn throughput(&self) -> Throughput {
        let made = self.attempts.iter().filter(|outcome| outcome.verdict == ItemOutcome::Done);
        let (mut items, mut pixels) = (0, 0);
        for outcome in made {
            items += 1;
            pixels += outcome.pixels.unwrap_or_default();
        }
        let process_s = self.attempts.iter().map(|outcome| outcome.seconds).sum();
        let start = self.attempts.iter().map(|outcome| outcome.start_s).fold(f64::INFINITY, f64::min);
        let end = self.attempts.iter().map(|outcome| outcome.start_s + outcome.seconds).fold(0.0, f64::max);
        Throughput { items, pixels, process_s, wall_s: (end - start).max(0.0) }
    }
}

/// What was made in which time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Throughput {
    /// DTMs made.
    pub items: usize,
    /// Their pixels.
    pub pixels: u64,
    /// Time of all processes, seconds.
    pub process_s: f64,
    /// Time from the first start to the last end, seconds.
    pub wall_s: f64,
}

/// Returns the paths of the finished DTMs, one a line.
#[must_use]
pub fn done_list(status: &Status, folder: &Path) -> String {
    status.of(&[ItemState::Done]).map(|item| format!("{}\n", folder.join(&item.output).display())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(id: &str, verdict: ItemOutcome, code: i32, start_s: f64) -> AttemptRecord {
        let error = (code != 0).then(|| format!("error of {id}"));
        let (output, host, chunk) = (format!("{id}.tif"), "h".to_string(), "1/1".to_string());
        AttemptRecord {
            id: id.into(),
            line: 1,
            verdict,
            code,
            error,
            output,
            start_s,
            seconds: 2.0,
            host,
            slot: 1,
            chunk,
            pixels: Some(100),
        }
    }

    #[test]
    fn the_last_attempt_and_the_files_decide() {
        let folder = tempfile::tempdir().unwrap();
        let names = ["done", "gone", "bad", "again", "never", "mended"];
        let item = |id: &str| BatchItem { id: id.into(), output: format!("{id}.tif").into(), ..BatchItem::default() };
        let items = names.iter().enumerate().map(|(line, id)| (line, item(id))).collect();
        let manifest = BatchManifest { folder: folder.path().into(), items };
        for id in ["done", "mended"] {
            std::fs::write(folder.path().join(format!("{id}.tif")), "abc").unwrap();
            std::fs::write(folder.path().join(format!("{id}.tif.sha256")), "12  x").unwrap();
        }
        let log = folder.path().join("log");
        let lines = [
            outcome("mended", ItemOutcome::TryAgain, 75, 1.0),
            outcome("done", ItemOutcome::Done, 0, 2.0),
            outcome("gone", ItemOutcome::Done, 0, 3.0),
            outcome("bad", ItemOutcome::Failed, 65, 4.0),
            outcome("again", ItemOutcome::TryAgain, 143, 5.0),
            outcome("mended", ItemOutcome::Done, 0, 6.0),
        ];
        let mut text = String::from("slurm says something\n");
        lines.iter().rev().for_each(|line| text += &(serde_json::to_string(line).unwrap() + "\n"));
        std::fs::write(&log, text + "{\"id\":\"cut").unwrap();
        let attempts = read_logs(&[log]).unwrap();
        assert_eq!(attempts, lines);
        let status = Status::new(&manifest, attempts.clone(), false);
        let states: Vec<ItemState> = status.items.iter().map(|(_, state, _)| *state).collect();
        use ItemState::{Done, Failed, TryAgain, Waiting};
        assert_eq!(states, [Done, TryAgain, Failed, TryAgain, Waiting, Done]);
        assert!((status.done_percent() - 100.0 / 3.0).abs() < 1e-9);
        let failures = status.failures();
        assert_eq!(failures["bad input"], (1, "error of bad".into()));
        assert_eq!(failures["ended by a signal"].0, 1);
        assert_eq!(failures["done"].0, 1, "a DTM that is gone");
        assert_eq!(done_list(&status, folder.path()).lines().count(), 2);
        let Throughput { items, pixels, process_s, wall_s } = status.throughput();
        assert_eq!((items, pixels, process_s, wall_s), (3, 300, 12.0, 7.0));
        // The sums here are of nothing.
        assert_eq!(Status::new(&manifest, attempts, true).count(Done), 0);
    }
}
