//! C and C++ programs against the archive: the header compiles without a warning, and the heights are Rust's, byte for byte.
//!
//! The archive is the example of this package (the functions with the host's panic handler), or the one that `ELUNAR_ARCHIVE` names:
//! `libelunar.a` of `onboard/flight`, which needs no other library.

mod common;
use common::*;
use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// The languages a caller may write in.
const LANGUAGES: [&str; 2] = ["c99", "c++17"];

/// Says on stderr that a check does not run; not by `eprintln!`, which passing tests keep to themselves.
fn skipped(why: &str) {
    let _ = writeln!(std::io::stderr(), "SKIPPED: {why}");
}

fn compiler(language: &str) -> Command {
    let (variable, default) = if language.starts_with("c++") { ("CXX", "c++") } else { ("CC", "cc") };
    let mut command = Command::new(std::env::var_os(variable).unwrap_or_else(|| default.into()));
    let kind = if language.starts_with("c++") { "c++" } else { "c" };
    command.args(["-x", kind, &format!("-std={language}"), "-Wall", "-Wextra", "-pedantic", "-Werror", "-I"]);
    command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("include"));
    command
}

/// Whether there is a compiler for this language; says so if not.
fn exists(language: &str) -> bool {
    let found = compiler(language).arg("--version").output().is_ok_and(|out| out.status.success());
    if !found {
        skipped(&format!("{language} programs: no compiler (CC, CXX; Debian packages gcc, g++)"));
    }
    found
}

fn target() -> PathBuf {
    // .../target/debug/deps/c-0123: the folder cargo builds in, whatever its name.
    std::env::current_exe().unwrap().ancestors().nth(3).unwrap().to_path_buf()
}

/// The archive, and what else a program needs to link.
fn archive() -> &'static (PathBuf, Vec<&'static str>) {
    static ARCHIVE: OnceLock<(PathBuf, Vec<&'static str>)> = OnceLock::new();
    ARCHIVE.get_or_init(|| {
        if let Some(path) = std::env::var_os("ELUNAR_ARCHIVE") {
            return (path.into(), vec![]);
        }
        // Cargo builds examples with some selections of tests only; where it has, this does nothing.
        let built = Command::new(env!("CARGO"))
            .args(["build", "--locked", "--quiet", "--package", "elunar-capi", "--example", "elunar", "--target-dir"])
            .arg(target())
            .current_dir(repository())
            .status();
        assert!(built.unwrap().success(), "building the archive");
        (target().join("debug/examples/libelunar.a"), vec!["-lpthread", "-ldl", "-lm", "-lgcc_s", "-lc"])
    })
}

fn run(command: &mut Command) -> String {
    let out = command.output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(out.status.success(), "{command:?}:\n{}{}", text(&out.stdout), text(&out.stderr));
    text(&out.stdout)
}

/// A folder for what a test makes; one per process.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// Compiles and links a program.
fn build(source: &Path, language: &str, folder: &Path) -> PathBuf {
    let (archive, libraries) = archive();
    let program = folder.join(format!("{}-{language}", source.file_stem().unwrap().display()));
    run(compiler(language)
        .arg("-O1")
        .arg(source)
        .args(["-x", "none"])
        .arg(archive)
        .args(libraries)
        .arg("-o")
        .arg(&program));
    program
}

fn source(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/c").join(name)
}

#[test]
fn a_c_program_computes_what_rust_computes() {
    let folder = folder("tile");
    let expected = {
        let (first, second) = (Tile::golden(), Tile::other());
        let (heights_m, valid) = first.expected();
        let bytes = |values: &[f32]| values.iter().flat_map(|v| v.to_ne_bytes()).collect::<Vec<u8>>();
        [bytes(&heights_m), valid, bytes(&second.expected().0)].concat()
    };
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        let program = build(&source("tile.c"), language, &folder);
        let out = folder.join("heights");
        let model = repository().join("host-train/models/nano.eld");
        let said = run(Command::new(&program).arg(model).arg(repository().join("tests/golden/flight_tile")).arg(&out));
        println!("{language}: {}", said.trim());
        assert!(std::fs::read(&out).unwrap() == expected, "{language}: other bytes than Rust's");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn what_c_gets_wrong_has_a_status() {
    let folder = folder("misuse");
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        run(&mut Command::new(build(&source("misuse.c"), language, &folder)));
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// The example of `onboard/README.md` is a function; this gives it a program around it.
const README_MAIN: &str = r#"
#include <stdio.h>
void kick_the_watchdog(void) {}
int main(void) {
    return heights(NULL, 0, NULL, 0, NULL, NULL, NULL) == ELD_REFUSED_NULL ? 0 : 1;
}
"#;

#[test]
fn the_readme_links() {
    let readme = std::fs::read_to_string(repository().join("onboard/README.md")).unwrap();
    let (_, rest) = readme.split_once("```c\n").expect("onboard/README.md has a block of C");
    let (block, _) = rest.split_once("```").unwrap();
    let lines = block.lines().filter(|line| !line.trim().is_empty()).count();
    assert!(lines <= 16, "{lines} lines");
    let folder = folder("readme");
    let path = folder.join("readme.c");
    std::fs::write(&path, format!("{block}{README_MAIN}")).unwrap();
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        run(&mut Command::new(build(&path, language, &folder)));
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// The C compiler's sizes and offsets are Rust's.
#[test]
fn structures_are_laid_out_alike() {
    use elunar_capi::types::*;
    use std::mem::{offset_of, size_of};
    let mut text = String::from("#include \"elunar.h\"\n#include <stddef.h>\n");
    macro_rules! lay_out {
        ($($structure:ident { $($field:ident),* })*) => {$(
            text += &format!("typedef char size_of_{0}[sizeof({0}) == {1} ? 1 : -1];\n", stringify!($structure), size_of::<$structure>());
            $(text += &format!("typedef char {0}_{1}[offsetof({0}, {1}) == {2} ? 1 : -1];\n", stringify!($structure), stringify!($field),
                offset_of!($structure, $field));)*
        )*};
    }
    lay_out! {
        eld_model_info_t { struct_bytes, memory_bytes, largest_unit_macs, header_crc, range_margin }
        eld_tile_t { struct_bytes, pixel_m, sun_elevation_deg, reserved, image, image_len, coarse_m, coarse_len, valid, valid_len }
        eld_telemetry_t { struct_bytes, valid_px, header_crc, calls, self_test_faults }
    }
    let folder = folder("layout");
    let path = folder.join("layout.c");
    std::fs::write(&path, text).unwrap();
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        run(compiler(language).arg("-c").arg(&path).arg("-o").arg(OsString::from(folder.join("layout.o"))));
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
