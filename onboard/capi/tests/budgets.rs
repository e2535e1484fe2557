//! Checks that the tables of `onboard/docs/budgets.md` are up to date: `ELUNAR_WRITE_BUDGETS=1 cargo test -p elunar-capi --test budgets`
//! writes them.

mod common;
mod pages;
use common::{absent, info, nano};
use pages::{read, repository};
use std::collections::BTreeSet;
use std::process::Command;

const PAGE: &str = "onboard/docs/budgets.md";

/// Returns a page with new text between the marks of `name`.
fn filled(page: &str, name: &str, text: &str) -> String {
    let begin = format!("<!-- {name} -->\n");
    let (before, rest) = page.split_once(&begin).unwrap_or_else(|| panic!("{PAGE}: no '{begin}'"));
    let (_, after) = rest.split_once("<!-- end -->").unwrap_or_else(|| panic!("{PAGE}: no end of '{name}'"));
    format!("{before}{begin}{text}<!-- end -->{after}")
}

/// Returns the table of all boards, or of the calls; `None` without Python, which prints it.
fn boards(what: [&str; 2]) -> Option<String> {
    let folder = repository().join("onboard/flight/boards");
    let printed = Command::new("python3").arg("budget.py").args(what).current_dir(folder).output();
    match printed {
        Ok(out) if out.status.success() => Some(String::from_utf8(out.stdout).unwrap()),
        Ok(out) => panic!("budget.py: {}", String::from_utf8_lossy(&out.stderr)),
        Err(error) => {
            absent(&format!("the table of boards: python3: {error} (Debian package python3)"));
            None
        }
    }
}

/// Formats 1234567 as 1,234,567.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let comma = |i: usize| i > 0 && (digits.len() - i).is_multiple_of(3);
    digits.char_indices().flat_map(|(i, c)| comma(i).then_some(',').into_iter().chain([c])).collect()
}

/// Returns the table of the shipped model.
fn model() -> String {
    let needs = info(nano()).unwrap();
    let rows = [
        ("model file, read in place", needs.file_bytes, "bytes"),
        ("memory of a context", needs.memory_bytes, "bytes"),
        ("of which arena of the network", needs.arena_bytes, "bytes"),
        ("alignment of that memory", needs.memory_align.into(), "bytes"),
        ("tile", (needs.tile_rows * needs.tile_cols).into(), "pixels"),
        ("work of a tile", needs.tile_macs, "multiply-accumulates"),
        ("largest unit of work", needs.largest_unit_macs, "multiply-accumulates"),
    ];
    let row = |(what, number, unit): (&str, u64, &str)| format!("| {what} | {} | {unit} |\n", grouped(number));
    format!("| what | how much | |\n|---|---|---|\n{}", rows.map(row).concat())
}

#[test]
#[cfg(target_pointer_width = "64")]
fn the_page_has_the_tables_that_are_printed() {
    let page = read(PAGE);
    let mut expected = filled(&page, "model", &model());
    if let Some(calls) = boards(["calls", "calls.csv"]) {
        expected = filled(&expected, "calls", &calls);
    }
    if let Some(boards) = boards(["table", "instructions.csv"]) {
        let folders = std::fs::read_dir(repository().join("onboard/flight/boards")).unwrap();
        let budgets = folders.filter(|entry| entry.as_ref().unwrap().path().join("budget.toml").is_file()).count();
        assert!(budgets >= 10 && boards.lines().count() == 2 + budgets, "a row for every board");
        expected = filled(&expected, "boards", &boards);
    }
    if std::env::var_os("ELUNAR_WRITE_BUDGETS").is_some() {
        std::fs::write(repository().join(PAGE), &expected).unwrap();
    }
    let line = page.lines().zip(expected.lines()).position(|(a, b)| a != b);
    assert!(
        read(PAGE) == expected,
        "{PAGE} differs from what is printed (line {line:?}): ELUNAR_WRITE_BUDGETS=1 cargo test -p elunar-capi --test budgets"
    );
}

/// Functions that `calls.csv` does not have, and why.
const NOT_COUNTED: [(&str, &str); 7] = [
    ("eld_version", "a constant"),
    ("eld_format_version", "a constant"),
    ("eld_status_text", "a table"),
    ("eld_kernel_name", "a table"),
    ("eld_model_check", "all of eld_model_check_step in one call"),
    ("eld_init", "eld_model_check and eld_init_checked in one call"),
    ("eld_begin", "all of eld_begin_step in one call"),
];

/// Every function of the header was counted on every board that counts, and no other.
#[test]
fn every_function_of_the_header_is_counted() {
    let (header, table) = (read("onboard/capi/include/elunar.h"), read("onboard/flight/boards/calls.csv"));
    let name = |line: &str| Some(line.split_once('(')?.0.rsplit([' ', '*']).next()?.to_string());
    let declared: BTreeSet<String> = header
        .lines()
        .filter(|line| line.starts_with(char::is_alphabetic) && !line.starts_with("typedef"))
        .filter_map(name)
        .filter(|name| name.starts_with("eld_"))
        .collect();
    assert!(declared.len() > 40, "{declared:?}");
    let rows: Vec<(&str, &str)> = table.lines().skip(1).filter_map(|line| line.split_once(',')).collect();
    let boards: BTreeSet<&str> = rows.iter().map(|row| row.0).collect();
    for board in boards {
        let of_board = rows.iter().filter(|row| row.0 == board).filter_map(|row| row.1.split(',').next());
        let known = of_board.chain(NOT_COUNTED.map(|known| known.0)).map(String::from);
        assert_eq!(known.collect::<BTreeSet<_>>(), declared, "{board}: onboard/flight/boards/run.sh --calls --record");
    }
    for (function, why) in NOT_COUNTED {
        assert!(rows.iter().all(|row| row.1.split(',').next() != Some(function)), "{function} is counted: not {why}");
    }
}

#[test]
fn numbers_are_grouped() {
    assert_eq!(
        [0, 12, 123, 1234, 123_456, 1_234_567].map(grouped),
        ["0", "12", "123", "1,234", "123,456", "1,234,567"]
    );
}
