//! Checks that the requirements of `onboard/docs/requirements.md` are numbered and complete, that the code and every verification of
//! `verification.csv` beside it exist, and that every C function and every source file of the C interface has a requirement.

mod pages;
use pages::items::{exists, functions, implements};
use pages::{read, repository};

/// A requirement of the page.
struct Requirement {
    number: u32,
    text: String,
}

fn requirements(page: &str) -> Result<Vec<Requirement>, String> {
    let mut found = Vec::new();
    for item in page.split("\n- ").skip(1) {
        let item = item.split("\n\n").next().unwrap_or_default();
        let begin = item.strip_prefix("**ELD-REQ-").and_then(|rest| rest.split_once("** "));
        let (number, text) = begin
            .and_then(|(id, text)| Some((id.parse().ok()?, text)))
            .ok_or(format!("{item}: expected **ELD-REQ-nnn** and a text"))?;
        let text =
            text.trim_end().strip_suffix("*").and_then(|text| text.rsplit_once(" *").or(text.rsplit_once("\n  *")));
        let (text, _) = text.filter(|(_, why)| !why.is_empty()).ok_or(format!("{item}: no rationale"))?;
        found.push(Requirement { number, text: text.replace('\n', " ") });
    }
    Ok(found)
}

/// A row of the table.
struct Row<'t> {
    number: u32,
    /// The items that implement the requirement.
    code: Vec<&'t str>,
    /// What verifies it.
    named: Vec<&'t str>,
    source: &'t str,
}

fn rows<'t>(table: &'t str) -> Vec<Row<'t>> {
    let words =
        |cell: Option<&'t str>| cell.unwrap_or_default().split(' ').filter(|one| !one.is_empty()).collect::<Vec<_>>();
    table
        .lines()
        .skip(1)
        .map(|line| {
            let mut cells = line.splitn(4, ',');
            Row {
                number: cells.next().and_then(|id| id.strip_prefix("ELD-REQ-")?.parse().ok()).unwrap_or(0),
                code: words(cells.next()),
                named: words(cells.next()),
                source: cells.next().unwrap_or_default().trim_matches('"'),
            }
        })
        .collect()
}

/// Returns the errors of a page and its table.
fn complaints(page: &str, table: &str) -> Vec<String> {
    let all = match requirements(page) {
        Ok(all) => all,
        Err(complaint) => return vec![complaint],
    };
    let mut wrong = Vec::new();
    for pair in all.windows(2) {
        if pair[0].number >= pair[1].number {
            wrong.push(format!("ELD-REQ-{} stands before ELD-REQ-{}", pair[0].number, pair[1].number));
        }
    }
    for Requirement { number, text } in all.iter().filter(|one| !one.text.contains(" shall ")) {
        wrong.push(format!("ELD-REQ-{number}: nothing shall be: {text}"));
    }
    let rows = rows(table);
    if !rows.iter().map(|row| row.number).eq(all.iter().map(|one| one.number)) {
        wrong.push("the table has other requirements".into());
    }
    for Row { number, code, named, source } in &rows {
        if code.is_empty() || named.is_empty() || source.is_empty() {
            wrong.push(format!("ELD-REQ-{number}: no code, no verification, or no source"));
        }
        let faults = code.iter().filter_map(|one| implements(one).err());
        let faults = faults.chain(named.iter().filter_map(|one| exists(one).err()));
        wrong.extend(faults.map(|why| format!("ELD-REQ-{number}: {why}")));
    }
    for word in ["TBD", "TBC", "TODO", "???"] {
        if page.contains(word) || table.contains(word) {
            wrong.push(format!("{word} on the page"));
        }
    }
    wrong
}

#[test]
fn every_requirement_names_code_and_a_verification_that_exist() {
    let page = read("onboard/docs/requirements.md");
    assert_eq!(complaints(&page, &read("onboard/docs/verification.csv")), [""; 0]);
    let count = requirements(&page).unwrap().len();
    assert_eq!(count, page.matches("ELD-REQ-").count());
    assert!(count >= 40, "{count} requirements");
    println!("{count} requirements");
}

/// Returns the C functions of a header, and the source files of the C interface, that no row of a table names.
fn without_requirement(header: &str, table: &str) -> Vec<String> {
    let rows = rows(table);
    let code: Vec<&str> = rows.iter().flat_map(|row| row.code.iter().copied()).collect();
    let functions = functions(header).into_iter().map(|function| format!("::{function}"));
    let files = sources("onboard/capi/src").into_iter().filter(|path| !path.ends_with("/lib.rs"));
    functions
        .chain(files)
        .filter(|one| !code.iter().any(|item| item.ends_with(one.as_str()) || item.split("::").next() == Some(one)))
        .collect()
}

/// Returns the files below a folder of the repository, as paths from there.
fn sources(folder: &str) -> Vec<String> {
    let entries = std::fs::read_dir(repository().join(folder)).unwrap().map(|entry| entry.unwrap());
    let below = |entry: std::fs::DirEntry| {
        let path = format!("{folder}/{}", entry.file_name().display());
        if entry.path().is_dir() { sources(&path) } else { vec![path] }
    };
    entries.flat_map(below).collect()
}

#[test]
fn every_c_function_and_file_has_a_requirement() {
    let (header, table) = (read("onboard/capi/include/elunar.h"), read("onboard/docs/verification.csv"));
    assert_eq!(without_requirement(&header, &table), [""; 0]);
    let more = header.replace("eld_status_t eld_scrub(", "eld_status_t eld_scrubs(");
    assert_eq!(without_requirement(&more, &table), ["::eld_scrubs"]);
    let less = table.replace("onboard/capi/src/layout.rs::Layout ", "").replace("::eld_version ", " ");
    assert_eq!(without_requirement(&header, &less), ["::eld_version", "onboard/capi/src/layout.rs"]);
}

#[test]
fn what_is_missing_is_noticed() {
    let sound = |numbers: &[u32]| {
        let page: String = numbers.iter().map(|n| format!("- **ELD-REQ-{n}** It shall be. *So.*\n")).collect();
        let rows: String =
            numbers.iter().map(|n| format!("ELD-REQ-{n},core/src/nn/sum.rs::sum ci.sh,ci.sh::no_std,here\n")).collect();
        (format!("# Page\n\n{page}"), format!("requirement,implemented by,verified by,source\n{rows}"))
    };
    let count = |(page, table): (String, String)| complaints(&page, &table).len();
    assert_eq!(count(sound(&[101, 102])), 0);
    assert_eq!((count(sound(&[102, 101])), count(sound(&[101, 101]))), (1, 1), "order, twice");
    assert_eq!(count((sound(&[101, 102]).0, sound(&[101]).1)), 1, "not in the table");
    for (from, to) in [
        ("**ELD-REQ-101", "**REQ-101"),
        ("shall be", "is"),
        (" *So.*", ""),
        ("core/src/nn/sum.rs::sum ci.sh", ""),
        ("sum.rs::sum", "sum.rs::su"),
        ("sum.rs::sum", "no_such_file.rs::sum"),
        (" ci.sh,", " no_such_file,"),
        (" ci.sh,", " onboard/capi/tests/common/mod.rs::nano,"),
        ("here", "TBD"),
        (",here", ","),
        (",ci.sh::no_std", ","),
        (",ci.sh::no_std", ",by-inspection"),
        ("no_std", "no_such_step"),
        ("ci.sh::no_std", "no_such_file.rs::no_std"),
        ("ci.sh::no_std", "onboard/capi/tests/common/mod.rs::nano"),
        ("ci.sh::no_std", "onboard/capi/tests/tiles.rs::telemetry_count"),
    ] {
        let (page, table) = sound(&[101]);
        assert_eq!(count((page.replace(from, to), table.replace(from, to))), 1, "{from} -> {to}");
    }
}
