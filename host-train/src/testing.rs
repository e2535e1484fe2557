//! What several tests share.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

/// The folder of outside test data, by `ELUNAR_SHARED` or beside the repository; says aloud where it is absent.
pub(crate) fn shared_folder() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let folder = std::env::var_os("ELUNAR_SHARED").map_or_else(beside, Into::into);
    if !folder.join("data").is_dir() {
        println!("SKIPPED: no test data at {} (set ELUNAR_SHARED)", folder.display());
        return None;
    }
    Some(folder)
}

/// Runs a script with rasterio and numpy imported and gives its output; `None`, said aloud, where they are missing. A script fails by
/// raising.
pub(crate) fn rasterio(script: &str, folder: &Path) -> Option<String> {
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
