//! Tables and a picture of a campaign.

use super::injection::InjectionTarget;
use super::outcome::{FaultOutcome, OutcomeCounts, Tried};
use elunar_base::Result;
use elunar_picture::{Bars, bars};
use image::RgbImage;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Outcomes by target, number of bits, and current operator.
#[derive(Debug, Clone, Default)]
pub struct CampaignResults {
    by_target: BTreeMap<(InjectionTarget, usize), OutcomeCounts>,
    by_operator: BTreeMap<String, OutcomeCounts>,
}

impl CampaignResults {
    /// Adds one injection.
    pub fn add(&mut self, tried: &Tried) {
        self.by_target.entry((tried.target, tried.bits)).or_default().add(tried.outcome);
        if !tried.target.is_model() && tried.target != InjectionTarget::Place {
            self.by_operator.entry(tried.operator.clone()).or_default().add(tried.outcome);
        }
    }

    /// Adds the results of another thread.
    pub fn merge(&mut self, other: &Self) {
        for (key, counts) in &other.by_target {
            self.by_target.entry(*key).or_default().merge(counts);
        }
        for (key, counts) in &other.by_operator {
            self.by_operator.entry(key.clone()).or_default().merge(counts);
        }
    }

    /// Returns the counts of all injections into a target.
    pub fn of(&self, target: InjectionTarget) -> OutcomeCounts {
        let mut all = OutcomeCounts::default();
        self.by_target.iter().filter(|((t, _), _)| *t == target).for_each(|(_, counts)| all.merge(counts));
        all
    }

    /// Returns the counts of all injections.
    pub fn all(&self) -> OutcomeCounts {
        let mut all = OutcomeCounts::default();
        self.by_target.values().for_each(|counts| all.merge(counts));
        all
    }
}

/// Returns the tables.
pub fn markdown(results: &CampaignResults) -> String {
    let mut text = String::new();
    head(&mut text, "hit | bits");
    for ((target, bits), counts) in &results.by_target {
        line(&mut text, &format!("{} | {bits}", target.name()), counts);
    }
    line(&mut text, "all | ", &results.all());
    text.push_str("\nAll but the model and the place, by the operator or the call at work:\n\n");
    head(&mut text, "operator");
    for (operator, counts) in &results.by_operator {
        line(&mut text, operator, counts);
    }
    text
}

fn head(text: &mut String, first: &str) {
    let names = FaultOutcome::ALL.map(FaultOutcome::name).join(" | ");
    let columns = first.split('|').count() + FaultOutcome::ALL.len() + 1;
    // Writing to a String does not fail.
    let _ = writeln!(text, "| {first} | injections | {names} |\n|{}", "---|".repeat(columns));
}

fn line(text: &mut String, name: &str, counts: &OutcomeCounts) {
    let _ = write!(text, "| {name} | {} |", counts.all());
    for outcome in FaultOutcome::ALL {
        let (count, percent) = (counts.of(outcome), 100.0 * counts.share(outcome));
        let _ = if count == 0 { write!(text, " 0 |") } else { write!(text, " {count} ({percent:.3} %) |") };
    }
    text.push('\n');
}

/// Draws the shares of detected, masked and silent runs by target, percent.
///
/// # Errors
/// If there is no injection.
pub fn picture(results: &CampaignResults) -> Result<RgbImage> {
    let share = |counts: &OutcomeCounts, outcomes: &[FaultOutcome]| {
        Some(100.0 * outcomes.iter().map(|&outcome| counts.share(outcome)).sum::<f64>())
    };
    let groups: [&[FaultOutcome]; 3] = [
        &[FaultOutcome::Recovered, FaultOutcome::Reported],
        &[FaultOutcome::Masked],
        &[FaultOutcome::Silent, FaultOutcome::Hang, FaultOutcome::Crash],
    ];
    let of = |(key, counts): (&(InjectionTarget, usize), &OutcomeCounts)| {
        let bits = if key.1 == 1 { "1 bit" } else { "2 bits" };
        (format!("{}, {bits}", key.0.name()), groups.map(|outcomes| share(counts, outcomes)).to_vec())
    };
    bars(&Bars {
        title: "Flipped bits: share of injections, percent",
        legend: &["detected", "masked", "silent, hang, crash"],
        lines: results.by_target.iter().map(of).collect(),
    })
}
