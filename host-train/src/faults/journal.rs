//! The file of a campaign: its identity, then one line per injection, so that a stopped campaign can be continued.

use super::outcome::Tried;
use super::table::CampaignResults;
use csv::StringRecord;
use elunar_base::output::open_growing;
use elunar_base::{Error, Result, read};
use std::collections::HashSet;
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// The columns, in the line after the campaign's identity.
const COLUMNS: &str = "injection,hit,bits,operator,outcome";
/// Most bytes of a journal: a hundred for each of the most injections of a campaign.
const MOST_JOURNAL_BYTES: u64 = 10_000_000_000;

/// The lines of a campaign. Each is written to disk at once.
#[derive(Debug)]
pub struct CampaignJournal {
    path: PathBuf,
    file: Mutex<File>,
    known: HashSet<u64>,
    results: CampaignResults,
}

impl CampaignJournal {
    /// Opens the journal of the campaign with this `identity`, or starts one. An incomplete last line is dropped.
    ///
    /// # Errors
    /// If the file belongs to another campaign, is not a journal, or cannot be read or written.
    pub fn open(path: &Path, identity: &str) -> Result<Self> {
        let mut file = open_growing(path)?;
        let text = read::text(path, MOST_JOURNAL_BYTES)?;
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        file.set_len(whole as u64).map_err(Error::io(path))?;
        let head = format!("# {identity}\n{COLUMNS}\n");
        let (mut known, mut results) = (HashSet::new(), CampaignResults::default());
        let text = text.get(..whole).unwrap_or_default();
        match text.strip_prefix(&head) {
            Some(lines) => {
                for tried in parse(path, lines)? {
                    if known.insert(tried.index) {
                        results.add(&tried);
                    }
                }
            }
            // The file is empty, or its head is incomplete.
            None if head.starts_with(text) => {
                file.set_len(0).map_err(Error::io(path))?;
                file.write_all(head.as_bytes()).map_err(Error::io(path))?;
            }
            None => {
                let found = text.lines().next().unwrap_or_default();
                return Err(Error::input(format!(
                    "{}: expected the campaign '# {identity}', found '{found}': give another folder, or remove it",
                    path.display()
                )));
            }
        }
        Ok(Self { path: path.to_path_buf(), file: Mutex::new(file), known, results })
    }

    /// Returns whether the file had this injection when it was opened.
    #[must_use]
    pub fn has(&self, index: u64) -> bool {
        self.known.contains(&index)
    }

    /// Returns the number of injections below `limit` that the file had when it was opened.
    #[must_use]
    pub fn count_below(&self, limit: u64) -> u64 {
        self.known.iter().filter(|&&index| index < limit).count() as u64
    }

    /// Writes a line.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn add(&self, tried: &Tried) -> Result<()> {
        let mut line = csv::WriterBuilder::new().has_headers(false).from_writer(vec![]);
        line.serialize(tried).map_err(|e| Error::broken(&self.path, e.to_string()))?;
        let line = line.into_inner().map_err(|e| Error::broken(&self.path, e.to_string()))?;
        // The line is written at once, so that only the file's last line can be incomplete.
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(&line).map_err(Error::io(&self.path))
    }

    /// Returns the results that the file had when it was opened.
    #[must_use]
    pub fn results(&self) -> &CampaignResults {
        &self.results
    }
}

/// Returns the injections of all lines behind the head.
fn parse(path: &Path, lines: &str) -> Result<Vec<Tried>> {
    // No line has quotes. Without quoting, a damaged line cannot include the next one.
    let mut reader =
        csv::ReaderBuilder::new().has_headers(false).flexible(true).quoting(false).from_reader(lines.as_bytes());
    let (mut row, mut all) = (StringRecord::new(), vec![]);
    let broken =
        |line: u64, found: &str| Error::broken(path, format!("line {line}: expected {COLUMNS}, found '{found}'"));
    while reader.read_record(&mut row).map_err(|e| Error::broken(path, e.to_string()))? {
        let columns = row.len() == COLUMNS.split(',').count();
        let tried = if columns { row.deserialize(None).ok() } else { None };
        // The reader is already at the next line, and the head has two lines.
        let line = reader.position().line() + 1;
        all.push(tried.ok_or_else(|| broken(line, &row.iter().collect::<Vec<_>>().join(",")))?);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::super::injection::InjectionTarget;
    use super::super::outcome::FaultOutcome;
    use super::*;

    fn tried(index: u64) -> Tried {
        let (target, outcome) = (InjectionTarget::ALL[index as usize % 7], FaultOutcome::ALL[index as usize % 6]);
        Tried { index, target, bits: 1 + index as usize % 2, operator: "conv".into(), outcome }
    }

    #[test]
    fn a_campaign_goes_on_wherever_its_file_was_cut() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("injections.csv");
        let journal = CampaignJournal::open(&path, "seed 1").unwrap();
        (0..14).for_each(|index| journal.add(&tried(index)).unwrap());
        let whole = std::fs::read(&path).unwrap();
        for cut in 0..=whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            let journal = CampaignJournal::open(&path, "seed 1").unwrap();
            let done: Vec<u64> = (0..14).filter(|&index| journal.has(index)).collect();
            assert_eq!(journal.results().all().all(), done.len() as u64, "cut at {cut}");
            let missing: Vec<u64> = (0..14).filter(|index| !done.contains(index)).collect();
            missing.iter().for_each(|&index| journal.add(&tried(index)).unwrap());
            assert_eq!(std::fs::read(&path).unwrap(), whole, "cut at {cut}");
        }
        assert_eq!(CampaignJournal::open(&path, "seed 1").unwrap().count_below(10), 10);
    }

    #[test]
    fn another_campaign_and_another_file_are_refused_and_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("injections.csv");
        CampaignJournal::open(&path, "seed 1").unwrap().add(&tried(0)).unwrap();
        let before = std::fs::read(&path).unwrap();
        let error = CampaignJournal::open(&path, "seed 2").unwrap_err().to_string();
        assert!(error.contains("expected the campaign '# seed 2', found '# seed 1'"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), before);
        let broken = String::from_utf8(before).unwrap() + "1,moon,1,conv,masked\n";
        std::fs::write(&path, broken).unwrap();
        let error = CampaignJournal::open(&path, "seed 1").unwrap_err().to_string();
        assert!(error.contains("line 4") && error.contains("moon"), "{error}");
    }
}
