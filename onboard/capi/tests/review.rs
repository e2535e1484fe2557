//! The tables of `onboard/docs/review.md`: failure modes have every fault of the library and the figures of their records; what standards ask for
//! is met by files that exist.

mod pages;
use elunar_capi::status::{FAULT, STATUSES, severity};
use pages::items::{exists, functions};
use pages::{csv, read, repository};

/// Returns the numbers of a text, as written.
fn numbers(text: &str) -> impl Iterator<Item = &str> {
    let words = text.split(|c: char| !(c.is_ascii_digit() || c == '.' || c == ','));
    words.map(|word| word.trim_matches(['.', ','])).filter(|word| !word.is_empty())
}

/// Returns what is wrong with a record: a test that exists, or a file that has every number of the figure.
fn record(figure: &str, record: &str) -> Vec<String> {
    if record.contains("::") {
        let faults = exists(record).err();
        return faults
            .into_iter()
            .chain((!figure.is_empty()).then(|| format!("{record}: a test has no figures")))
            .collect();
    }
    if !repository().join(record).is_file() {
        return vec![format!("{record}: no such file")];
    }
    let text = read(record);
    let known: Vec<&str> = numbers(&text).collect();
    numbers(figure).filter(|n| !known.contains(n)).map(|n| format!("{record}: expected {n}, found none")).collect()
}

/// Returns what is wrong with the table of failure modes.
fn wrong_failures(table: &str) -> Vec<String> {
    let rows = csv(table);
    let mut wrong = Vec::new();
    for row in &rows {
        let [failure, cause, effect, detection, statuses, figure, place, left] = row.as_slice() else {
            wrong.push(format!("{row:?}: expected 8 cells"));
            continue;
        };
        if [failure, cause, effect, detection, left].iter().any(|cell| cell.is_empty()) {
            wrong.push(format!("{failure}: a cell is empty"));
        }
        let unknown = statuses.split_whitespace().filter(|name| !STATUSES.iter().any(|known| known.name == *name));
        wrong.extend(unknown.map(|name| format!("{failure}: {name}: no such status")));
        wrong.extend(record(figure, place).into_iter().map(|why| format!("{failure}: {why}")));
    }
    let named =
        |name: &str| rows.iter().any(|row| row.get(4).is_some_and(|cell| cell.split(' ').any(|one| one == name)));
    let faults = STATUSES.iter().filter(|known| severity(known.status) == FAULT);
    wrong.extend(faults.filter(|known| !named(known.name)).map(|known| format!("{}: no failure", known.name)));
    wrong
}

#[test]
fn every_fault_is_a_failure_mode_with_the_figures_of_its_record() {
    let table = read("onboard/docs/failure-modes.csv");
    assert_eq!(wrong_failures(&table), [""; 0]);
    for (from, to) in [
        ("ELD_FAULT_LINES", "ELD_FAULT_LINE"),
        ("11,445 recovered", "11,446 recovered"),
        ("check_step.rs::what_goes_wrong", "check_step.rs::what_goes"),
        ("SECURITY.md", "SECURITY.txt"),
        ("ELD_FAULT_HEIGHT", ""),
        (",Begin the check again.", ","),
    ] {
        assert!(table.contains(from) && !wrong_failures(&table.replace(from, to)).is_empty(), "{from} -> {to}");
    }
}

#[test]
fn what_standards_ask_for_is_met_by_what_exists() {
    let rows = csv(&read("onboard/docs/standards.csv"));
    assert!(rows.len() > 20, "{} clauses", rows.len());
    for row in rows {
        let [standard, clause, subject, state, met_by, mission] = row.as_slice() else {
            panic!("{row:?}: expected 6 cells")
        };
        assert!(["met", "part", "mission"].contains(&state.as_str()), "{standard} {clause}: {state}");
        assert_eq!(met_by.is_empty(), state == "mission", "{standard} {clause}");
        assert!(!subject.is_empty() && (state == "met" || mission.len() > 1), "{standard} {clause}: what is left?");
        for path in met_by.split_whitespace() {
            assert!(repository().join(path).exists(), "{standard} {clause}: {path}: no such file");
        }
    }
}

/// Returns the sum of some columns.
fn sum(rows: &[Vec<String>], columns: &[usize]) -> usize {
    rows.iter().flat_map(|row| columns.iter().map(|k| row[*k].parse::<usize>().unwrap())).sum()
}

#[test]
fn records_of_what_takes_hours_keep_their_floors() {
    let rows = |path: &str| csv(&read(path));
    for row in rows("tests/mutants/record.csv") {
        assert!(row[7].parse::<f64>().unwrap() >= 95.0 && row[6] == "0", "mutants of {}: {row:?}", row[0]);
    }
    assert!(rows("tests/mutants/survivors.csv").iter().all(|row| row[2].len() > 10), "a survivor without a reason");
    for row in rows("onboard/flight/boards/outcomes.csv") {
        assert_eq!(row.last().unwrap(), "0", "branches of {} that are not argued", row[0]);
    }
    let roundings = rows("tests/campaigns/roundings.csv");
    assert!(sum(&roundings, &[4]) > 1_000_000_000 && sum(&roundings, &[6]) == 0, "roundings that differ");
}

#[test]
fn the_page_has_the_figures_of_its_tables() {
    let rows = |path: &str| csv(&read(path));
    let (standards, deviations) = (rows("onboard/docs/standards.csv"), rows("onboard/capi/misra.csv"));
    let state = |state: &str| standards.iter().filter(|row| row[3] == state).count();
    let counted = deviations.iter().flat_map(|row| row[3].split(' ')).map(|file| file.rsplit_once(':').unwrap().1);
    let found: usize = counted.map(|count| count.parse::<usize>().unwrap()).sum();
    assert!(deviations.iter().all(|row| row[..3].iter().all(|cell| !cell.is_empty())), "a rule without a reason");
    let (areas, core) = (rows("tests/mutants/record.csv"), rows("onboard/flight/proofs/core.csv"));
    let (killed, mutants) = (sum(&areas, &[4]), sum(&areas, &[4, 5, 6]));
    let certified = core.iter().filter(|row| row[1] == "yes").count();
    assert_eq!(areas.len(), 11);
    let page = read("onboard/docs/review.md").split_whitespace().collect::<Vec<_>>().join(" ");
    for expected in [
        format!("{} C functions", functions(&read("onboard/capi/include/elunar.h")).len()),
        format!("[{} requirements]", rows("onboard/docs/verification.csv").len()),
        format!("[{} failure modes]", rows("onboard/docs/failure-modes.csv").len()),
        format!("{found} findings of {} rules", deviations.len()),
        format!("[{} subjects]", standards.len()),
        format!("[eleven areas](../../tests/mutants/record.csv): {killed} of {mutants} samples"),
        format!(
            "[{}](../flight/proofs/core.csv), called or inlined; Ferrocene certifies {certified} of them",
            core.len()
        ),
        format!("{} functions of `core` are not on Ferrocene's list", core.len() - certified),
        format!("{} met, {} in part, {} left to the mission", state("met"), state("part"), state("mission")),
    ] {
        assert!(page.contains(&expected), "onboard/docs/review.md: expected '{expected}'");
    }
}
