//! What tests of several packages share: outside oracles, outside data, damaged files.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

/// The folder of outside test data, by `ELUNAR_SHARED` or beside the repository; says aloud where it is absent.
pub fn shared_folder() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let folder = std::env::var_os("ELUNAR_SHARED").map_or_else(beside, Into::into);
    if !folder.join("data").is_dir() {
        println!("SKIPPED: no test data at {} (set ELUNAR_SHARED)", folder.display());
        return None;
    }
    Some(folder)
}

/// Runs a script with rasterio and numpy imported and gives its output; `None`, said aloud, where they are missing. A script fails by
/// raising.
pub fn rasterio(script: &str, folder: &Path) -> Option<String> {
    static PRESENT: LazyLock<bool> = LazyLock::new(|| {
        Command::new("python3").args(["-c", "import rasterio, numpy"]).output().is_ok_and(|out| out.status.success())
    });
    if !*PRESENT {
        println!("SKIPPED: python3 with rasterio is not here");
        return None;
    }
    let script = format!("import rasterio, numpy as np, struct\nfrom rasterio.transform import Affine\n{script}");
    let out =
        Command::new("python3").args(["-W", "ignore", "-c", &script]).current_dir(folder).output().expect("python3");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    Some(String::from_utf8_lossy(&out.stdout).into_owned())
}

/// Damages a file in one to three places: a byte changed, the end cut off, a piece taken out or doubled, or one of `pieces` put in. Pieces that mean
/// something to the format reach deeper than random bytes.
pub fn mutate(bytes: &mut Vec<u8>, pieces: &[&str], rng: &mut ChaCha8Rng) {
    for _ in 0..rng.random_range(1..4) {
        let at = rng.random_range(0..=bytes.len());
        let end = (at + rng.random_range(0..12)).min(bytes.len());
        match rng.random_range(0..5) {
            0 if at < bytes.len() => bytes[at] = rng.random(),
            1 => bytes.truncate(at),
            2 => drop(bytes.drain(at..end)),
            3 => drop(bytes.splice(at..at, pieces[rng.random_range(0..pieces.len())].bytes())),
            _ => {
                let copy = bytes[at..end].to_vec();
                drop(bytes.splice(at..at, copy));
            }
        }
    }
}
