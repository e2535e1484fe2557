//! What the tests with C programs share: compilers, the archive, folders.
//!
//! The archive is the example of this package (the functions with the host's panic handler), or the one that `ELUNAR_ARCHIVE` names:
//! `libelunar.a` of `onboard/flight`, which needs no other library.
#![allow(dead_code)] // each test file uses a part

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// The languages a caller may write in.
pub(crate) const LANGUAGES: [&str; 2] = ["c99", "c++17"];

pub(crate) fn compiler(language: &str) -> Command {
    let (variable, default) = if language.starts_with("c++") { ("CXX", "c++") } else { ("CC", "cc") };
    let mut command = Command::new(std::env::var_os(variable).unwrap_or_else(|| default.into()));
    let kind = if language.starts_with("c++") { "c++" } else { "c" };
    command.args(["-x", kind, &format!("-std={language}"), "-Wall", "-Wextra", "-pedantic", "-Werror", "-I"]);
    command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("include"));
    command
}

/// Whether there is a compiler for this language; says so if not.
pub(crate) fn exists(language: &str) -> bool {
    let found = compiler(language).arg("--version").output().is_ok_and(|out| out.status.success());
    if !found {
        crate::common::absent(&format!("{language} programs: no compiler (CC, CXX; Debian packages gcc, g++)"));
    }
    found
}

pub(crate) fn target() -> PathBuf {
    // .../target/debug/deps/c-0123: the folder cargo builds in, whatever its name.
    std::env::current_exe().unwrap().ancestors().nth(3).unwrap().to_path_buf()
}

/// The archive, and what else a program needs to link.
pub(crate) fn archive() -> &'static (PathBuf, Vec<&'static str>) {
    static ARCHIVE: OnceLock<(PathBuf, Vec<&'static str>)> = OnceLock::new();
    ARCHIVE.get_or_init(|| {
        if let Some(path) = std::env::var_os("ELUNAR_ARCHIVE") {
            return (path.into(), vec![]);
        }
        // Cargo builds examples with some selections of tests only; where it has, this does nothing.
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

/// A folder for what a test makes; one per process.
pub(crate) fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// Compiles and links a program of these sources, the first of which names it.
pub(crate) fn build(sources: &[PathBuf], language: &str, folder: &Path) -> PathBuf {
    let (archive, libraries) = archive();
    let program = folder.join(format!("{}-{language}", sources[0].file_stem().unwrap().display()));
    run(compiler(language)
        .arg("-O1")
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
