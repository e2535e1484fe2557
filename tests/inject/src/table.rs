//! The table and the picture of a campaign.

use crate::row::{Class, Outcome, Row};
use elunar_base::Result;
use elunar_picture::{Bars, bars, write_png};
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

/// Returns the table: outcomes of every class, as a whole and by what was worked on.
pub(crate) fn markdown(rows: &[Row]) -> String {
    let names = Outcome::ALL.map(Outcome::name).join(" | ");
    let mut text = format!("| hit | while | injections | {names} | largest silent error, m |\n|{}\n", "---|".repeat(9));
    let phases: BTreeSet<&str> = rows.iter().map(|row| row.phase.as_str()).collect();
    for class in Class::ALL {
        let of: Vec<&Row> = rows.iter().filter(|row| row.class == class).collect();
        line(&mut text, class, "all", &of);
        for phase in &phases {
            let of: Vec<&Row> = of.iter().filter(|row| row.phase == *phase).copied().collect();
            line(&mut text, class, phase, &of);
        }
    }
    text
}

fn line(text: &mut String, class: Class, phase: &str, rows: &[&Row]) {
    if rows.is_empty() {
        return;
    }
    // Writing to a String does not fail.
    let _ = write!(text, "| {} | {phase} | {} |", class.name(), rows.len());
    for outcome in Outcome::ALL {
        let count = rows.iter().filter(|row| row.outcome == outcome).count();
        let _ = write!(text, " {count} ({:.1} %) |", 100.0 * count as f64 / rows.len() as f64);
    }
    let silent = rows.iter().filter(|row| row.outcome == Outcome::Silent);
    let _ = writeln!(text, " {:.1} |", silent.map(|row| row.error_m).fold(0.0, f32::max));
}

/// Draws the shares of the outcomes of every class, percent.
///
/// # Errors
/// If there is no injection, or the file cannot be written.
pub(crate) fn write_picture(path: &Path, rows: &[Row]) -> Result<()> {
    let groups: [&[Outcome]; 4] =
        [&[Outcome::Silent], &[Outcome::Masked], &[Outcome::Detected], &[Outcome::Crash, Outcome::Hang]];
    let of = |class: Class| {
        let rows: Vec<&Row> = rows.iter().filter(|row| row.class == class).collect();
        let share = |outcomes: &[Outcome]| {
            let count = rows.iter().filter(|row| outcomes.contains(&row.outcome)).count();
            Some(100.0 * count as f64 / rows.len().max(1) as f64)
        };
        (class.name().to_string(), groups.map(share).to_vec())
    };
    let image = bars(&Bars {
        title: "A flipped bit while a tile is made: share of injections, percent",
        legend: &["silent, above 0.1 m", "masked", "detected", "crash, hang"],
        lines: Class::ALL.into_iter().map(of).collect(),
    })?;
    write_png(path, image)
}
