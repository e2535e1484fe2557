//! Shared by the tests with C programs: compilers, the archive, folders.
//!
//! The archive is an example of this package (the functions with the host's panic handler), or the one that `ELUNAR_ARCHIVE` names:
//! `libelunar.a` of `onboard/flight`, which needs no other library.
#![allow(dead_code)] // each test file uses only some functions

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// The languages supported for callers.
pub(crate) const LANGUAGES: [&str; 2] = ["c99", "c++17"];

pub(crate) fn compiler(language: &str) -> Command {
    let (variable, default) = if language.starts_with("c++") { ("CXX", "c++") } else { ("CC", "cc") };
    let mut command = Command::new(std::env::var_os(variable).unwrap_or_else(|| default.into()));
    let kind = if language.starts_with("c++") { "c++" } else { "c" };
    command.args([
        "-x",
        kind,
        &format!("-std={language}"),
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-Wconversion",
        "-Werror",
        "-I",
    ]);
    command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("include"));
    command
}

/// Returns whether there is a compiler for this language; reports it if not.
pub(crate) fn exists(language: &str) -> bool {
    let found = compiler(language).arg("--version").output().is_ok_and(|out| out.status.success());
    if !found {
        crate::common::absent(&format!("{language} programs: no compiler (CC, CXX; Debian packages gcc, g++)"));
    }
    found
}

pub(crate) fn target() -> PathBuf {
    // .../target/debug/deps/c-0123: cargo's target folder, whatever its name.
    std::env::current_exe().unwrap().ancestors().nth(3).unwrap().to_path_buf()
}

/// Returns the archive, and the other libraries that a program links.
pub(crate) fn archive() -> &'static (PathBuf, Vec<&'static str>) {
    static ARCHIVE: OnceLock<(PathBuf, Vec<&'static str>)> = OnceLock::new();
    ARCHIVE.get_or_init(|| {
        if let Some(path) = std::env::var_os("ELUNAR_ARCHIVE") {
            return (path.into(), vec![]);
        }
        // Cargo builds examples with some selections of tests only. If the example is built already, this command does nothing.
        let built = Command::new(env!("CARGO"))
            .args(["build", "--locked", "--quiet", "--package", "elunar-capi", "--example", "elunar", "--target-dir"])
            .arg(target())
            .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")))
            .status();
        assert!(built.unwrap().success(), "building the archive");
        (target().join("debug/examples/libelunar.a"), vec!["-lpthread", "-ldl", "-lm", "-lgcc_s", "-lc"])
    })
}

pub(crate) fn run(command: &mut Command) -> String {
    let out = command.output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(out.status.success(), "{command:?}:\n{}{}", text(&out.stdout), text(&out.stderr));
    text(&out.stdout)
}

/// Returns a folder for the output of a test; one per process.
pub(crate) fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// Compiles and links a program of these sources; the first source gives its name.
pub(crate) fn build(sources: &[PathBuf], language: &str, folder: &Path) -> PathBuf {
    let (archive, libraries) = archive();
    let program = folder.join(format!("{}-{language}", sources[0].file_stem().unwrap().display()));
    run(compiler(language)
        .arg("-O1")
        .arg("-I")
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("examples"))
        .args(sources)
        .args(["-x", "none"])
        .arg(archive)
        .args(libraries)
        .arg("-o")
        .arg(&program));
    program
}

pub(crate) fn source(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/c").join(name)
}
