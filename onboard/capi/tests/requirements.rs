//! Checks that the requirements of `onboard/docs/requirements.md` are numbered and complete, and that every verification of
//! `verification.csv` beside it exists.

mod pages;
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

/// Returns number, verifications and source of every row of the table.
fn verifications<'t>(table: &'t str) -> Vec<(u32, Vec<&'t str>, &'t str)> {
    let row = |line: &'t str| {
        let mut cells = line.splitn(3, ',');
        let number = cells.next().and_then(|id| id.strip_prefix("ELD-REQ-")?.parse().ok());
        let named = cells.next().unwrap_or_default().split(' ').filter(|one| !one.is_empty()).collect();
        (number.unwrap_or(0), named, cells.next().unwrap_or_default().trim_matches('"'))
    };
    table.lines().skip(1).map(row).collect()
}

/// Returns an error unless a verification, `path::name`, exists: a test in Rust, or a function of a script.
fn exists(verification: &str) -> Result<(), String> {
    let (path, name) = verification.split_once("::").ok_or(format!("{verification}: expected path::name"))?;
    if !repository().join(path).is_file() {
        return Err(format!("{verification}: no such file"));
    }
    let text = read(path);
    let lines: Vec<&str> = text.lines().collect();
    let script = path.ends_with(".sh");
    let declares = |line: &str| match script {
        true => line.starts_with(&format!("{name}() {{")),
        false => line.trim_start().starts_with(&format!("fn {name}(")),
    };
    let at = lines.iter().position(|line| declares(line)).ok_or(format!("{verification}: no such function"))?;
    // Attributes are before the function, one per line.
    let attributes = lines[..at].iter().rev().take_while(|line| line.trim_start().starts_with("#["));
    match script || attributes.into_iter().any(|line| line.trim() == "#[test]") {
        true => Ok(()),
        false => Err(format!("{verification}: no test")),
    }
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
    let rows = verifications(table);
    if !rows.iter().map(|row| row.0).eq(all.iter().map(|one| one.number)) {
        wrong.push("the table has other requirements".into());
    }
    for (number, named, source) in &rows {
        if named.is_empty() || source.is_empty() {
            wrong.push(format!("ELD-REQ-{number}: no verification, or no source"));
        }
        wrong.extend(named.iter().filter_map(|one| exists(one).err()).map(|why| format!("ELD-REQ-{number}: {why}")));
    }
    for word in ["TBD", "TBC", "TODO", "???"] {
        if page.contains(word) || table.contains(word) {
            wrong.push(format!("{word} on the page"));
        }
    }
    wrong
}

#[test]
fn every_requirement_names_a_verification_that_exists() {
    let page = read("onboard/docs/requirements.md");
    assert_eq!(complaints(&page, &read("onboard/docs/verification.csv")), [""; 0]);
    let count = requirements(&page).unwrap().len();
    assert_eq!(count, page.matches("ELD-REQ-").count());
    assert!(count >= 40, "{count} requirements");
    println!("{count} requirements");
}

#[test]
fn what_is_missing_is_noticed() {
    let sound = |numbers: &[u32]| {
        let page: String = numbers.iter().map(|n| format!("- **ELD-REQ-{n}** It shall be. *So.*\n")).collect();
        let rows: String = numbers.iter().map(|n| format!("ELD-REQ-{n},ci.sh::no_std,here\n")).collect();
        (format!("# Page\n\n{page}"), format!("requirement,verified by,source\n{rows}"))
    };
    let count = |(page, table): (String, String)| complaints(&page, &table).len();
    assert_eq!(count(sound(&[101, 102])), 0);
    assert_eq!((count(sound(&[102, 101])), count(sound(&[101, 101]))), (1, 1), "order, twice");
    assert_eq!(count((sound(&[101, 102]).0, sound(&[101]).1)), 1, "not in the table");
    for (from, to) in [
        ("**ELD-REQ-101", "**REQ-101"),
        ("shall be", "is"),
        (" *So.*", ""),
        ("here", "TBD"),
        (",here", ","),
        ("ci.sh::no_std", ""),
        ("ci.sh::no_std", "by-inspection"),
        ("no_std", "no_such_step"),
        ("ci.sh::no_std", "no_such_file.rs::no_std"),
        ("ci.sh::no_std", "onboard/capi/tests/common/mod.rs::nano"),
        ("ci.sh::no_std", "onboard/capi/tests/tiles.rs::telemetry_count"),
    ] {
        let (page, table) = sound(&[101]);
        assert_eq!(count((page.replace(from, to), table.replace(from, to))), 1, "{from} -> {to}");
    }
}
