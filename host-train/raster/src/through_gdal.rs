//! Files of other formats, through GDAL's `gdal_translate` if it is installed: a temporary GeoTIFF, which is open and has no name any more when it is
//! read, so that nothing of it remains however the program ends.

use super::geotiff;
use super::source::{Info, Source};
use elunar_base::{Error, Result, interrupt};
use elunar_core::tile::Window;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

/// The program.
const PROGRAM: &str = "gdal_translate";

/// Time between two looks at the program.
const PAUSE: Duration = Duration::from_millis(5);

/// Most converted files that stay open for the next command in this process (our choice).
const MOST_KEPT: usize = 4;

/// What became of a conversion.
pub(crate) enum Outcome {
    /// The file as GDAL reads it.
    Read(Box<dyn Source>),
    /// GDAL does not read it; its message.
    Refused(String),
    /// There is no `gdal_translate`.
    Absent,
}

/// A file at one time, and the user's nodata value, bits.
#[derive(Debug, Clone, PartialEq)]
struct Key {
    path: PathBuf,
    bytes: u64,
    changed: Option<SystemTime>,
    nodata: Option<u64>,
}

static KEPT: Mutex<Vec<(Key, Arc<dyn Source>)>> = Mutex::new(Vec::new());

/// Converts a file and opens the result. A file that did not change since is converted once.
///
/// # Errors
/// [`Error::Io`] if there is no room, as [`geotiff::open`] about the result, under the name of the file, and [`Error::Stopped`] on Ctrl-C.
pub(crate) fn open_with(path: &Path, nodata: Option<f64>) -> Result<Outcome> {
    let found = std::fs::metadata(path).map_err(Error::io(path))?;
    let path = std::path::absolute(path).map_err(Error::io(path))?;
    let key = Key { bytes: found.len(), changed: found.modified().ok(), nodata: nodata.map(f64::to_bits), path };
    // A list that lacks a file is no bad state. The lock holds a second conversion back until the first one is done.
    let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, source)) = kept.iter().find(|(known, _)| *known == key) {
        return Ok(Outcome::Read(Box::new(Converted(Arc::clone(source)))));
    }
    let source: Arc<dyn Source> = match converted(PROGRAM, &key.path, nodata)? {
        Outcome::Read(source) => Arc::from(source),
        other => return Ok(other),
    };
    kept.truncate(MOST_KEPT - 1);
    kept.insert(0, (key, Arc::clone(&source)));
    Ok(Outcome::Read(Box::new(Converted(source))))
}

/// A converted file that others may read, too.
struct Converted(Arc<dyn Source>);

impl Source for Converted {
    fn info(&self) -> &Info {
        self.0.info()
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        self.0.read(window)
    }
}

/// A converted file with the warning about it.
struct Told {
    tiff: Box<dyn Source>,
    info: Info,
}

impl Source for Told {
    fn info(&self) -> &Info {
        &self.info
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        self.tiff.read(window)
    }
}

fn converted(program: &str, path: &Path, nodata: Option<f64>) -> Result<Outcome> {
    // From here on Ctrl-C lets the folder be removed.
    interrupt::listen();
    let folder = tempfile::Builder::new().prefix("elunar-gdal-").tempdir();
    let folder = folder.map_err(Error::io(std::env::temp_dir()))?;
    let out = folder.path().join("converted.tif");
    let mut command = Command::new(program);
    command.args(["-q", "-of", "GTiff", "-co", "TILED=YES", "-co", "BIGTIFF=IF_SAFER"]).arg(path).arg(&out);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = match command.spawn() {
        Ok(child) => child,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Outcome::Absent),
        Err(error) => return Err(Error::io(program)(error)),
    };
    let (succeeded, said) = outcome(&mut child, path)?;
    if !succeeded || !out.is_file() {
        return Ok(Outcome::Refused(said));
    }
    let tiff = geotiff::open_with(&out, nodata).map_err(|error| renamed(error, path))?;
    let mut info = tiff.info().clone();
    info.format = format!("{}, converted by {program}", info.format);
    let note =
        format!("converted by {program} into a temporary GeoTIFF; its samples, place and nodata value are taken");
    info.warnings.push(note);
    Ok(Outcome::Read(Box::new(Told { tiff, info })))
}

/// Waits for the program, and returns whether it succeeded, and its first line. Ctrl-C ends it.
fn outcome(child: &mut Child, path: &Path) -> Result<(bool, String)> {
    let stderr = child.stderr.take();
    // Read beside the program, which would wait for room in the pipe.
    let reader = std::thread::spawn(move || {
        let mut text = Vec::new();
        let _ = stderr.map(|mut stderr| stderr.read_to_end(&mut text));
        String::from_utf8_lossy(&text)
            .lines()
            .find(|line| !line.trim().is_empty())
            .unwrap_or("no reason")
            .trim()
            .to_owned()
    });
    loop {
        if let Some(status) = child.try_wait().map_err(Error::io(PROGRAM))? {
            let said = reader.join().unwrap_or_default();
            interrupt::check(&path.display().to_string())?;
            return Ok((status.success(), said));
        }
        if interrupt::requested() {
            // It may have ended by itself.
            let _ = child.kill();
            let _ = child.wait();
        }
        std::thread::sleep(PAUSE);
    }
}

/// Returns an error about the temporary file as one about the file that was converted.
fn renamed(error: Error, path: &Path) -> Error {
    match error {
        Error::Broken { what, .. } => Error::broken(path, what),
        Error::Unsupported { what, .. } => Error::unsupported(path, what),
        Error::Io { source, .. } => Error::io(path)(source),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::{open, read_all};
    use elunar_testing::oracle;
    use std::collections::BTreeSet;
    use std::ffi::OsString;

    /// Returns the folders of conversions.
    fn folders() -> BTreeSet<OsString> {
        let all = std::fs::read_dir(std::env::temp_dir()).unwrap().flatten().map(|entry| entry.file_name());
        all.filter(|name| name.to_string_lossy().starts_with("elunar-gdal-")).collect()
    }

    #[test]
    fn what_gdal_reads_is_read_and_nothing_remains() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let raster = crate::Raster { rows: 2, cols: 3, samples: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], georef: None };
        let options = crate::geotiff::WriteOptions::image(crate::geotiff::SampleType::U8, "t");
        crate::geotiff::write(&at("a.tif"), &raster, &options).unwrap();
        let Some(mut command) = oracle::gdal("gdal_translate") else { return };
        assert!(
            command
                .args(["-q", "-of", "PNG", "a.tif", "a b.png"])
                .current_dir(folder.path())
                .status()
                .unwrap()
                .success()
        );
        let before = folders();
        let source = open(&at("a b.png")).unwrap();
        assert_eq!(read_all(&*source).unwrap().samples, raster.samples);
        assert_eq!(source.info().format.split(", converted by ").nth(1), Some("gdal_translate"));
        assert_eq!(
            source.info().warnings,
            ["converted by gdal_translate into a temporary GeoTIFF; its samples, place and nodata value are taken"]
        );
        assert_eq!(read_all(&*open(&at("a b.png")).unwrap()).unwrap().samples, raster.samples);
        // A text, and a file of a known format that is broken.
        std::fs::write(at("a.txt"), "no raster\n").unwrap();
        std::fs::write(at("b.png"), b"\x89PNG\r\n\x1a\n").unwrap();
        for (name, what) in [("a.txt", "begins with \"no raster\\n\""), ("b.png", "a PNG or JPEG picture")] {
            let text = open(&at(name)).err().expect("refused").to_string();
            assert!(
                text.contains(name) && text.contains(what) && text.contains("ERROR") && !text.contains('\n'),
                "{text}"
            );
            assert!(text.contains("gdal_translate -of GTiff") && !text.contains("elunar-gdal-"), "{text}");
        }
        // A character of a name that no line of a message has.
        std::fs::write(at("b\u{7}.txt"), "no raster\n").unwrap();
        let text = open(&at("b\u{7}.txt")).err().expect("refused").to_string();
        let said = text.split_once("(tried: ").expect("GDAL's message").1;
        assert!(said.contains("b .txt") && !said.contains('\u{7}'), "{text:?}");
        // Others may convert at the same time. Their folders go; one of this test would stay.
        let mut left = &folders() - &before;
        for _ in 0..600 {
            left = &left & &folders();
            if left.is_empty() {
                return;
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        panic!("folders remain: {left:?}");
    }

    #[test]
    fn without_gdal_there_is_no_outcome() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        std::fs::write(&path, "x").unwrap();
        assert!(matches!(converted("no-such-gdal_translate", &path, None), Ok(Outcome::Absent)));
        for program in ["false", "true"] {
            let outcome = converted(program, &path, None);
            assert!(matches!(outcome, Ok(Outcome::Refused(said)) if said == "no reason"), "{program}");
        }
        let folder = folder.path().display().to_string();
        let text = converted(&folder, &path, None).err().expect("a folder is no program").to_string();
        assert!(text.starts_with(&folder), "{text}");
    }

    const CHILD_FOLDER: &str = "ELUNAR_TEST_CTRL_C";

    /// The test runner does not start this test directly. The test below starts it in a process of its own and sends that process Ctrl-C.
    #[test]
    #[cfg(unix)]
    #[ignore = "run by ctrl_c_ends_a_conversion"]
    fn child_converting_for_ever() {
        use std::os::unix::fs::PermissionsExt;
        let folder = PathBuf::from(std::env::var(CHILD_FOLDER).expect("the parent's folder"));
        let program = folder.join("program");
        std::fs::write(&program, "#!/bin/sh\nkill -INT $PPID\nexec sleep 600\n").unwrap();
        std::fs::set_permissions(&program, PermissionsExt::from_mode(0o755)).unwrap();
        let outcome = converted(&program.display().to_string(), &folder.join("a.png"), None);
        let error = outcome.err().expect("stopped");
        assert!(matches!(error, Error::Stopped(_)) && error.to_string().contains("a.png: interrupted"), "{error}");
    }

    #[test]
    #[cfg(unix)]
    fn ctrl_c_ends_a_conversion() {
        let folder = tempfile::tempdir().unwrap();
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "through_gdal::tests::child_converting_for_ever", "--ignored", "--nocapture"]);
        let out = command.env(CHILD_FOLDER, folder.path()).env("TMPDIR", folder.path()).output().unwrap();
        let text = String::from_utf8_lossy(&out.stdout);
        assert!(out.status.success() && text.contains("1 passed"), "{text}{}", String::from_utf8_lossy(&out.stderr));
        let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().flatten().map(|entry| entry.file_name()).collect();
        assert_eq!(left, ["program"], "nothing else remains");
    }
}
