//! Checks that `include/elunar.h` is cbindgen's output for the sources. To write it:
//! `ELUNAR_WRITE_HEADER=1 cargo test -p elunar-capi --test header`.

use cbindgen::{Builder, Config, DocumentationStyle, Language, Style};
use elunar_capi::status::{FAULT, GOOD, NOTICE, REFUSED, STATUSES, severity};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// The text of the header before its definitions.
const PREAMBLE: &str = "\
/* ELunarDTM, the flight runner: one orbiter image and a coarse DTM in, a DTM at the image's resolution out.
 *
 *     eld_model_check -> eld_init -> eld_begin, or eld_begin_step ... -> eld_step ... -> eld_output
 *     or in pieces: eld_model_check_step ... -> eld_init_checked -> eld_begin_step ... -> eld_step ...
 *                                    eld_scrub between steps, eld_self_test_* now and then, eld_telemetry always
 *     eld_slots_init -> eld_slots_boot, _upload, _write, _start_trial, _confirm or _reject -> eld_slots_step ...
 *     eld_strip_plan -> eld_strip_init -> what eld_strip_step asks for: eld_strip_push, _push_posts, _take, _finish
 *
 * Made by cbindgen from onboard/capi/src (tests/header.rs); do not edit. C99 and C++17.
 *
 * The library allocates nothing, has no globals and takes no locks: all memory is the caller's, and contexts are independent. Every function
 * returns a status. Refused means: nothing has changed. NULL, misaligned pointers, lengths that wrap, overlapping buffers and calls out of
 * order are refused. What the caller promises:
 *
 * - a pointer with its length names memory that exists, and that nobody else writes during the call (nor reads, if the library writes it);
 * - the memory lent to eld_init or eld_strip_init, and the model, live at their places as long as the context is used;
 * - a pointer given as a context or a strip came from eld_init or eld_strip_init, or points at 4 KiB that may be read and written;
 * - one thread at a time uses a context.
 */";

/// Returns severities and statuses, from the table of the library.
fn statuses() -> String {
    let mut text = String::from(
        "
/* A status: severity, unit and code.
 *
 *  31 30 29         24 23             16 15                              0
 * +-----+-------------+-----------------+---------------------------------+
 * | sev |  0 (unused) |      unit       |              code               |
 * +-----+-------------+-----------------+---------------------------------+
 * unit: 1 the call, 2 the lent memory, 3 the model, 4 the tile, 5 the run, 6 the context, 7 the strip, 8 the slots
 */
/** ELD_GOOD, ELD_NOTICE, ELD_REFUSED or ELD_FAULT. */
#define ELD_SEVERITY(status) ((uint32_t)(status) >> 30)
/** Whether the call did its work: good or notice. */
#define ELD_WORKED(status) (ELD_SEVERITY(status) <= ELD_NOTICE)

",
    );
    for (name, value, what) in [
        ("ELD_GOOD", GOOD, "done"),
        ("ELD_NOTICE", NOTICE, "done, and there is something to know"),
        ("ELD_REFUSED", REFUSED, "not done, and nothing has changed"),
        (
            "ELD_FAULT",
            FAULT,
            "memory has changed or a result is wrong: what the context or the model holds cannot be trusted",
        ),
    ] {
        writeln!(text, "#define {name:<11} {value}u /**< severity: {what} */").unwrap();
    }
    let mut last = (GOOD, 0);
    for known in STATUSES {
        // A blank line between severities and between units.
        let group = (severity(known.status), known.status >> 16);
        text += if group == last { "" } else { "\n" };
        last = group;
        let what = known.text.to_str().unwrap();
        writeln!(text, "#define {:<33} UINT32_C(0x{:08x}) /**< {what} */", known.name, known.status).unwrap();
    }
    text
}

/// Returns the sources of the functions, in the order of the header.
fn functions() -> impl Iterator<Item = PathBuf> {
    let source = |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join("src").join(name);
    ["ffi.rs", "ffi/light.rs", "ffi/slots.rs", "ffi/strip.rs", "ffi/sun.rs", "ffi/terrain.rs"].map(source).into_iter()
}

fn generated() -> String {
    let config = Config {
        language: Language::C,
        style: Style::Type,
        cpp_compat: true,
        no_includes: true,
        sys_includes: vec!["stddef.h".into(), "stdint.h".into()],
        usize_is_size_t: true,
        header: Some(PREAMBLE.into()),
        include_guard: Some("ELUNAR_H".into()),
        after_includes: Some(statuses()),
        documentation_style: DocumentationStyle::Doxy,
        tab_width: 4,
        line_length: 120,
        ..Config::default()
    };
    let types = ["types.rs", "slots/types.rs", "strip/types.rs"]
        .map(|name| Path::new(env!("CARGO_MANIFEST_DIR")).join("src").join(name));
    let sources = types.into_iter().chain(functions());
    let builder = sources.fold(Builder::new().with_config(config), |builder, source| builder.with_src(source));
    let mut bytes = Vec::new();
    builder.generate().expect("cbindgen").write(&mut bytes);
    String::from_utf8(bytes).unwrap()
}

#[test]
fn the_header_is_up_to_date() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("include/elunar.h");
    let expected = generated();
    if std::env::var_os("ELUNAR_WRITE_HEADER").is_some() {
        std::fs::write(&path, &expected).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    let line = found.lines().zip(expected.lines()).position(|(a, b)| a != b);
    assert!(
        found == expected,
        "include/elunar.h differs from the sources (line {line:?}): ELUNAR_WRITE_HEADER=1 cargo test -p elunar-capi --test header"
    );
}

#[test]
fn the_header_has_every_function_and_status() {
    let header = generated();
    let source: String = functions().map(|path| std::fs::read_to_string(path).unwrap()).collect();
    let functions: Vec<&str> = source
        .lines()
        .filter_map(|line| line.split_once("extern \"C\" fn ")?.1.split_once('('))
        .map(|(name, _)| name)
        .collect();
    assert_eq!(functions.len(), 47, "{functions:?}");
    for name in functions.iter().copied().chain(STATUSES.iter().map(|known| known.name)) {
        assert!(header.contains(name), "{name}");
    }
}
