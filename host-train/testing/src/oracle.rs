//! Outside programs for comparison: GDAL's, and Python's packages.
//!
//! If one is absent, the comparison is skipped, and the terminal shows that. With [`REQUIRE`] set to 1 the test fails instead.

use crate::skipped;
use std::path::Path;
use std::process::Command;
use std::sync::{Mutex, PoisonError};

/// Environment variable. With 1, a test whose oracle is absent fails. Unset, empty or 0, the test is skipped.
pub const REQUIRE: &str = "ELUNAR_REQUIRE_ORACLES";

/// Returns whether an absent oracle is a failure.
pub fn required() -> bool {
    std::env::var(REQUIRE).is_ok_and(|value| !value.is_empty() && value != "0")
}

/// Returns the name of the running test. With `--test-threads=1` there is none.
pub(crate) fn current_test() -> String {
    std::thread::current().name().filter(|name| *name != "main").unwrap_or("a comparison").into()
}

/// Reports that the oracle `tool` is absent. `install` says how to install it.
///
/// # Panics
/// If oracles are [`required`].
pub fn absent(tool: &str, install: &str) {
    let why = format!("{tool} is not here ({install})");
    assert!(!required(), "{REQUIRE}=1, but {why}");
    skipped(&current_test(), &why);
}

/// Returns a command for a program of GDAL (`gdaldem`), ready for arguments; `None` if it is absent.
///
/// # Panics
/// If the program is absent and oracles are [`required`].
pub fn gdal(program: &str) -> Option<Command> {
    if Command::new(program).arg("--version").output().is_ok() {
        return Some(Command::new(program));
    }
    absent(program, "Debian package gdal-bin");
    None
}

/// Runs a Python script in `folder` and returns its output; `None` if Python or one of `packages` is absent. A script fails by raising an
/// exception.
///
/// # Panics
/// If the script fails, or if something is absent and oracles are [`required`].
pub fn python(packages: &[&str], script: &str, folder: &Path) -> Option<String> {
    let missing: Vec<&str> = packages.iter().copied().filter(|package| !importable(package)).collect();
    if !missing.is_empty() {
        let distributions = missing.join(" ").replace('_', "-");
        absent(&format!("python3 with {}", missing.join(", ")), &format!("python3 -m pip install {distributions}"));
        return None;
    }
    let out =
        Command::new("python3").args(["-W", "ignore", "-c", script]).current_dir(folder).output().expect("python3");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    Some(String::from_utf8_lossy(&out.stdout).into_owned())
}

/// Runs a script as [`python`], with `rasterio`, numpy as `np`, `struct` and `Affine` imported. `rasterio` includes GDAL and PROJ.
///
/// # Panics
/// As [`python`].
pub fn rasterio(script: &str, folder: &Path) -> Option<String> {
    rasterio_with(&[], script, folder)
}

/// Runs a script as [`rasterio`] that needs further packages.
///
/// # Panics
/// As [`python`].
pub fn rasterio_with(packages: &[&str], script: &str, folder: &Path) -> Option<String> {
    let imports = "import rasterio, numpy as np, struct\nfrom rasterio.transform import Affine";
    python(&[&["rasterio", "numpy"], packages].concat(), &format!("{imports}\n{script}"), folder)
}

/// Returns whether `python3` imports this package. The answer is stored for the process.
fn importable(package: &str) -> bool {
    static KNOWN: Mutex<Vec<(String, bool)>> = Mutex::new(Vec::new());
    // A test that panicked with the lock leaves a valid list.
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, answer)) = known.iter().find(|(name, _)| name == package) {
        return *answer;
    }
    let out = Command::new("python3").args(["-c", &format!("import {package}")]).output();
    let answer = out.is_ok_and(|out| out.status.success());
    known.push((package.into(), answer));
    answer
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Output;

    /// The test runner does not start this test directly. It runs in a separate process without any installed package.
    #[test]
    #[ignore = "run by an_absent_oracle_is_reported_or_fails"]
    fn child_without_oracles() {
        let here = Path::new(".");
        assert_eq!(rasterio("raise SystemExit('no python3 to raise it')", here), None);
        assert_eq!(rasterio_with(&["rio_cogeo"], "", here), None);
        assert!(gdal("gdaldem").is_none());
    }

    /// Runs the child as `cargo test` does, with captured output.
    fn child(require: &str) -> Output {
        Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "oracle::tests::child_without_oracles", "--ignored"])
            .env("PATH", "")
            .env(REQUIRE, require)
            .env_remove("RUST_TEST_NOCAPTURE")
            .env_remove("RUST_TEST_THREADS")
            .output()
            .unwrap()
    }

    #[test]
    fn an_absent_oracle_is_reported_or_fails() {
        for unset in ["", "0"] {
            let out = child(unset);
            let (text, said) = (String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
            assert!(out.status.success() && text.contains("1 passed"), "{text}\n{said}");
            let first = "SKIPPED: oracle::tests::child_without_oracles: python3 with rasterio, numpy is not here";
            assert!(said.starts_with(first), "{said}");
            assert!(said.contains("pip install rasterio numpy rio-cogeo") && said.contains("gdal-bin"), "{said}");
        }
        let out = child("1");
        let text = String::from_utf8_lossy(&out.stdout);
        assert!(!out.status.success() && text.contains("1 failed"), "{text}");
        assert!(text.contains("ELUNAR_REQUIRE_ORACLES=1, but python3 with rasterio, numpy is not here"), "{text}");
    }
}
