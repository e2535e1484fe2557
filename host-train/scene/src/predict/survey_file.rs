//! The survey of a scene in a file, so that runs that share an image make it once.

use super::survey::Survey;
use elunar_base::digest::sha256_hex;
use elunar_base::output::Owner;
use elunar_base::{Error, Result, atomic_write, interrupt, read};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// First line of the file. The job and the SHA-256 of the survey follow, a line each, then the survey as MessagePack.
const MAGIC: &str = "elunar survey 2";
/// What it begins with in all versions.
const KIND: &str = "elunar survey ";
/// Time between two looks for the survey that another run makes.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Returns the path of the survey of `output`: `dtm.tif.survey` beside `dtm.tif`.
#[must_use]
pub fn survey_path(output: &Path) -> PathBuf {
    let mut name = output.file_name().unwrap_or_default().to_os_string();
    name.push(".survey");
    output.with_file_name(name)
}

/// Returns the survey of `job` that lies at `path`. If there is none, or that of another job, `make` makes it, and it is written. If another run is
/// making it, waits for that.
///
/// # Errors
/// [`Error::Stopped`] if the user stops the program meanwhile; [`Error::Io`] if the file cannot be written; errors of `make` are passed on.
pub fn shared_survey(path: &Path, job: &str, make: impl FnOnce() -> Result<Survey>) -> Result<Survey> {
    loop {
        if let Some(survey) = read(path, job) {
            return Ok(survey);
        }
        match Owner::of_file(path) {
            Ok(owner) => {
                // The run before may have written it between the two looks.
                if let Some(survey) = read(path, job) {
                    return Ok(survey);
                }
                let survey = make()?;
                let wrong = |e: rmp_serde::encode::Error| Error::broken(path, e.to_string());
                let body = rmp_serde::to_vec_named(&survey).map_err(wrong)?;
                let mut bytes = format!("{MAGIC}\n{job}\n{}\n", sha256_hex(&body)).into_bytes();
                bytes.extend(body);
                owner.check()?;
                atomic_write(path, &bytes)?;
                return Ok(survey);
            }
            Err(Error::Busy { .. }) if interrupt::requested() => {
                return Err(Error::stopped("interrupted while another run makes the survey"));
            }
            Err(Error::Busy { .. }) => std::thread::sleep(LOOK_EVERY),
            Err(other) => return Err(other),
        }
    }
}

/// Returns whether a file is a survey, of whatever job.
#[must_use]
pub fn is_survey(path: &Path) -> bool {
    read::begins_with(path, KIND)
}

/// Reads the survey of a job; `None` for anything else.
fn read(path: &Path, job: &str) -> Option<Survey> {
    let bytes = read::bytes(path, read::MOST_BYTES).ok()?;
    let mut lines = bytes.splitn(4, |&byte| byte == b'\n');
    let mut is = |expected: &str| lines.next() == Some(expected.as_bytes());
    if !(is(MAGIC) && is(job)) {
        return None;
    }
    let (sum, body) = (lines.next()?, lines.next()?);
    (sum == sha256_hex(body).as_bytes()).then(|| rmp_serde::from_slice(body).ok())?
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_core::norm::LightFit;
    use elunar_core::terrain::PixelSize;

    /// A survey with a light, and without heights: infinities are kept, too.
    fn survey() -> Survey {
        let wave = |k: usize| (k as f32 * 0.37).sin();
        let map: Vec<f32> = (0..64 * 64).map(|i| 100.0 + wave(i / 64) + wave(i % 64 * 2)).collect();
        let mut light = LightFit::default();
        light.add(&map, &map, 64, PixelSize::square(2.0), 2);
        let mut survey = Survey { light, lowest_m: f32::INFINITY, highest_m: f32::NEG_INFINITY, ..Survey::default() };
        survey.brightness.add(&map);
        survey
    }

    #[test]
    fn a_survey_is_made_once_and_reads_back_exactly() {
        let folder = tempfile::tempdir().unwrap();
        let path = survey_path(&folder.path().join("dtm.tif"));
        assert_eq!(path, folder.path().join("dtm.tif.survey"));
        assert_eq!(shared_survey(&path, "a", || Ok(survey())).unwrap(), survey());
        let never = || -> Result<Survey> { panic!("made before") };
        assert_eq!(shared_survey(&path, "a", never).unwrap(), survey());
        // That of another job, or one that is damaged, is replaced.
        assert_eq!(shared_survey(&path, "b", || Ok(Survey::default())).unwrap(), Survey::default());
        assert_eq!(shared_survey(&path, "a", || Ok(survey())).unwrap(), survey());
        let whole = std::fs::read(&path).unwrap();
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 4;
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(read(&path, "a"), None, "byte {at}");
        }
        std::fs::write(&path, &whole[..whole.len() - 1]).unwrap();
        assert_eq!(read(&path, "a"), None);
        assert!(shared_survey(&path, "a", || Err(Error::usage("no survey"))).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no lock remains");
    }

    #[test]
    fn runs_that_begin_together_make_one_survey() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dtm.tif.survey");
        let made = std::sync::atomic::AtomicUsize::new(0);
        let make = || {
            made.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            std::thread::sleep(LOOK_EVERY);
            Ok(survey())
        };
        std::thread::scope(|scope| {
            let runs: Vec<_> = (0..8).map(|_| scope.spawn(|| shared_survey(&path, "a", make).unwrap())).collect();
            runs.into_iter().for_each(|run| assert_eq!(run.join().unwrap(), survey()));
        });
        assert_eq!(made.into_inner(), 1);
    }
}
