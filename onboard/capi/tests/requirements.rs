//! Checks that the requirements of `onboard/docs/requirements.md` are numbered and complete, and that every verification exists.

mod pages;
use pages::{read, repository};

/// The parts of every requirement, in this order.
const PARTS: [&str; 3] = ["- *Rationale:* ", "- *Verification:* ", "- *Source:* "];

/// A requirement of the page.
struct Requirement {
    number: u32,
    text: String,
    parts: [String; 3],
}

fn requirements(page: &str) -> Result<Vec<Requirement>, String> {
    let mut found = Vec::new();
    for block in page.split("\n### ").skip(1) {
        let block = block.split("\n## ").next().unwrap_or_default();
        let (heading, rest) = block.split_once('\n').ok_or(format!("{block}: only a heading"))?;
        let number = heading
            .strip_prefix("ELD-REQ-")
            .and_then(|id| id.get(..3)?.parse().ok())
            .ok_or(format!("{heading}: expected ELD-REQ-nnn and a title"))?;
        let mut parts = PARTS.map(|_| String::new());
        for (part, begin) in parts.iter_mut().zip(PARTS) {
            let line = rest.lines().find_map(|line| line.strip_prefix(begin));
            *part = line.filter(|line| !line.is_empty()).ok_or(format!("{heading}: no {begin}"))?.to_string();
        }
        let text = rest.split("\n- ").next().unwrap_or_default().trim().to_string();
        found.push(Requirement { number, text, parts });
    }
    Ok(found)
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

/// Returns the errors of a page.
fn complaints(page: &str) -> Vec<String> {
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
    for Requirement { number, text, parts } in &all {
        if text.matches(" shall ").count() == 0 {
            wrong.push(format!("ELD-REQ-{number}: nothing shall be"));
        }
        let named: Vec<&str> = parts[1].split('`').skip(1).step_by(2).collect();
        if named.is_empty() {
            wrong.push(format!("ELD-REQ-{number}: no verification"));
        }
        wrong.extend(named.iter().filter_map(|one| exists(one).err()).map(|why| format!("ELD-REQ-{number}: {why}")));
    }
    for word in ["TBD", "TBC", "TODO", "???"] {
        if page.contains(word) {
            wrong.push(format!("{word} on the page"));
        }
    }
    wrong
}

#[test]
fn every_requirement_names_a_verification_that_exists() {
    let page = read("onboard/docs/requirements.md");
    assert_eq!(complaints(&page), [""; 0]);
    let count = requirements(&page).unwrap().len();
    assert_eq!(count, page.matches("ELD-REQ-").count());
    assert!(count >= 40, "{count} requirements");
    println!("{count} requirements");
}

#[test]
fn what_is_missing_is_noticed() {
    let sound = |number: u32| {
        format!(
            "\n### ELD-REQ-{number} Title\n\nIt shall be.\n\n- *Rationale:* so\n- *Verification:* `ci.sh::no_std`\n- *Source:* here\n"
        )
    };
    assert_eq!(complaints(&format!("# Page\n{}{}", sound(101), sound(102))), [""; 0]);
    let changed = |from: &str, to: &str| complaints(&sound(101).replace(from, to));
    assert_eq!(complaints(&format!("{}{}", sound(102), sound(101))).len(), 1, "order");
    assert_eq!(complaints(&format!("{}{}", sound(101), sound(101))).len(), 1, "twice");
    for (from, to) in [
        ("ELD-REQ-101", "REQ-101"),
        ("shall be", "is"),
        ("*Rationale:* so", "so"),
        ("*Source:* here", "*Source:* TBD"),
        ("`ci.sh::no_std`", "by inspection"),
        ("no_std", "no_such_step"),
        ("ci.sh::no_std", "no_such_file.rs::no_std"),
        ("ci.sh::no_std", "onboard/capi/tests/common/mod.rs::nano"),
        ("ci.sh::no_std", "onboard/capi/tests/tiles.rs::telemetry_count"),
    ] {
        assert_eq!(changed(from, to).len(), 1, "{from} -> {to}: {:?}", changed(from, to));
    }
}
