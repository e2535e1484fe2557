//! Time of every operator inside whole tiles, fastest kernel, by kind (criterion: `nano`, `tiny`) and one by one (table).
//!
//! `cargo bench -p elunar-benches --bench operators`
//!
//! The runner's schedule makes a few rows of one operator at a time. The clock is read before and after every entry, which runs by single
//! units of work: some ten nanoseconds beside tens of microseconds.

#![allow(missing_docs)] // criterion's macros make undocumented functions

use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use elunar_benches::models::{exported, name, presets, tile};
use elunar_benches::peak;
use elunar_benches::samples::{Timings, measure, seconds};
use elunar_benches::table::{Table, number, publish};
use elunar_core::nn::file::Operator;
use elunar_core::nn::{Model, Progress, Runner, required};
use elunar_core::tile::Shape;
use elunar_net::config::Preset;
use elunar_net::kernels;
use std::collections::BTreeMap;
use std::time::Duration;

/// Tiles behind the tables.
const TILES: usize = 15;
/// Operators below this share of a tile's time are not listed one by one.
const SMALLEST_SHARE: f64 = 0.02;

/// A network to be run entry by entry.
struct Stepper<'a, 'm> {
    runner: Runner<'a, 'm>,
    model: Model<'a>,
    /// Operator of every entry of the schedule.
    entries: Vec<usize>,
    image: Vec<f32>,
    coarse: Vec<f32>,
    output: Vec<f32>,
}

/// Seconds of one tile's parts.
struct Times {
    operators: Vec<f64>,
    begin: f64,
    output: f64,
}

impl<'a, 'm> Stepper<'a, 'm> {
    fn new(model: Model<'a>, arena: &'m mut [u8]) -> Self {
        let entries = (0..).map_while(|index| Some(model.entry(index)?.operator)).collect();
        let Shape { rows, cols } = model.tile();
        let (image, coarse) = tile(rows, cols, model.image_maps());
        let runner =
            Runner::with_kernel(kernels::best(), model, arena).expect("the arena is as large as the model says");
        Self { runner, model, entries, image, coarse, output: vec![0.0; rows * cols] }
    }

    /// Runs a tile and times every part of it.
    fn tile(&mut self) -> Times {
        let mut times = Times { operators: vec![0.0; self.model.operator_count()], begin: 0.0, output: 0.0 };
        times.begin = seconds(|| self.runner.begin(&self.image, &self.coarse).expect("the tile has the right size"));
        for (index, &operator) in self.entries.iter().enumerate() {
            times.operators[operator] += seconds(|| {
                while self.runner.position() == Some(index) {
                    self.runner.step(1).expect("a tile was begun");
                }
            });
        }
        times.output = seconds(|| {
            while self.runner.step(u64::MAX).expect("a tile was begun") == Progress::Running {}
            self.runner.output(&mut self.output).expect("the tile is done");
        });
        times
    }
}

/// What kind of work an operator is: convolutions by their kernel, and apart where few channels make another shape of it.
fn kind(model: &Model<'_>, operator: &Operator) -> String {
    let Operator::Conv(conv) = operator else { return operator.name().into() };
    let channels: usize = conv.sources().map(|source| model.tensor(source).channels).sum();
    let special = match (channels, conv.stride_cols / conv.stride) {
        (1, _) => ", one channel in".into(),
        (_, 1) => String::new(),
        (_, columns) => format!(", {columns} columns as channels"),
    };
    let stride = if conv.stride > 1 { format!("/{}", conv.stride) } else { String::new() };
    format!("{} {}x{}{stride}{special}", operator.name(), conv.kernel_rows, conv.kernel_cols)
}

/// An operator's place in the network: input and output shapes.
fn place(model: &Model<'_>, operator: &Operator) -> String {
    let shape = |index: u32| {
        let t = model.tensor(index);
        format!("{}x{}x{} {:?}", t.rows, t.cols, t.channels, t.dtype).to_lowercase()
    };
    let inputs: Vec<String> = operator.inputs().into_iter().flatten().map(shape).collect();
    format!("{} → {}", inputs.join(", "), shape(operator.output()))
}

/// The names that the exporter has left in the file.
fn names(model: &Model<'_>) -> Vec<String> {
    let text: serde_json::Value = serde_json::from_str(model.text()).unwrap_or_default();
    let names = text["operators"].as_array().cloned().unwrap_or_default();
    names.iter().map(|name| name.as_str().unwrap_or("?").to_string()).collect()
}

fn network(criterion: &mut Criterion, preset: Preset, tables: &mut Tables) {
    let bytes = exported(preset).expect("a preset can be exported");
    let model = Model::new(&bytes).expect("an exported model is valid");
    let mut arena = vec![0; required(&model)];
    let mut stepper = Stepper::new(model, &mut arena);
    let operators: Vec<Operator> = (0..).map_while(|index| model.operator(index)).collect();
    let kinds: Vec<String> = operators.iter().map(|operator| kind(&model, operator)).collect();
    // Larger networks take their time; the table has them.
    if matches!(preset, Preset::Nano | Preset::Tiny) {
        let mut distinct: Vec<&String> = kinds.iter().collect();
        distinct.sort();
        distinct.dedup();
        let mut group = criterion.benchmark_group(format!("operators/{}", name(preset)));
        group.sampling_mode(SamplingMode::Flat).sample_size(10).nresamples(2000);
        group.warm_up_time(Duration::from_millis(100)).measurement_time(Duration::from_millis(500));
        for wanted in distinct {
            let mut of_kind = || {
                let times = stepper.tile();
                let mine = times.operators.iter().zip(&kinds).filter(|(_, kind)| *kind == wanted);
                mine.map(|(seconds, _)| seconds).sum::<f64>()
            };
            measure(&mut group, wanted, |times| (0..times).map(|_| of_kind()).sum(), || 0.0);
        }
        group.finish();
    }
    tables.add(preset, &mut stepper, &operators, &kinds);
}

/// One line of a table: cells that say what it is, how many operators, multiply-accumulates, seconds.
struct Line {
    what: Vec<String>,
    count: usize,
    macs: u64,
    seconds: f64,
}

/// The tables of all networks.
struct Tables {
    /// By kind, everything counted.
    kinds: Table,
    /// One by one, from [`SMALLEST_SHARE`] on.
    single: Table,
}

impl Tables {
    fn new() -> Self {
        let kinds = ["network", "kernel", "kind", "operators", "MMAC", "ms", "% of time", "GMAC/s", "of peak"];
        let single =
            ["network", "kernel", "operator", "kind", "shapes", "MMAC", "ms", "% of time", "GMAC/s", "of peak"];
        Self { kinds: Table::new("operator_kinds", &kinds), single: Table::new("operators", &single) }
    }

    /// Runs a network's tiles and adds its rows.
    fn add(&mut self, preset: Preset, stepper: &mut Stepper<'_, '_>, operators: &[Operator], kinds: &[String]) {
        let model = stepper.model;
        stepper.tile(); // the first one is cold
        let mut samples = vec![Timings::default(); operators.len()];
        let (mut begin, mut output, mut peaks) = (Timings::default(), Timings::default(), Timings::default());
        let peak = peak::dot_product();
        for _ in 0..TILES {
            let times = stepper.tile();
            samples.iter_mut().zip(&times.operators).for_each(|(samples, &seconds)| samples.push(seconds));
            begin.push(times.begin);
            output.push(times.output);
            peak.iter().for_each(|peak| peaks.push(peak.seconds()));
        }
        let median = |samples: &Timings| samples.median().unwrap_or_default();
        let mut by_kind: BTreeMap<&str, Line> = BTreeMap::new();
        let mut single = Vec::new();
        let names = names(&model);
        for (index, operator) in operators.iter().enumerate() {
            let (macs, seconds) = (model.operator_macs(operator), median(&samples[index]));
            let kind = kinds[index].clone();
            let empty = || Line { what: vec![kind.clone()], count: 0, macs: 0, seconds: 0.0 };
            let line = by_kind.entry(&kinds[index]).or_insert_with(empty);
            (line.count, line.macs, line.seconds) = (line.count + 1, line.macs + macs, line.seconds + seconds);
            let name = names.get(index).map_or("?", String::as_str).to_string();
            single.push(Line { what: vec![name, kind, place(&model, operator)], count: 1, macs, seconds });
        }
        let mut grouped: Vec<Line> = by_kind.into_values().collect();
        for (what, samples) in [("quantise the inputs", &begin), ("compare the model, copy the output", &output)] {
            grouped.push(Line { what: vec![what.into()], count: 0, macs: 0, seconds: median(samples) });
        }
        let total_s: f64 = grouped.iter().map(|line| line.seconds).sum();
        single.retain(|line| line.seconds >= SMALLEST_SHARE * total_s);
        let peak_rate = peak.map(|peak| peak.macs as f64 / median(&peaks) / 1e9);
        let (network, kernel) = (name(preset).to_string(), stepper.runner.kernel().to_string());
        println!("{network}: kernel {kernel}, medians of {TILES} tiles, together {:.2} ms", total_s * 1e3);
        for (table, mut lines, counted) in [(&mut self.kinds, grouped, true), (&mut self.single, single, false)] {
            lines.sort_by(|a, b| b.seconds.total_cmp(&a.seconds));
            for line in lines {
                let rate = Some(line.macs as f64 / line.seconds / 1e9).filter(|_| line.macs > 0);
                let mut cells = vec![network.clone(), kernel.clone()];
                cells.extend(line.what);
                cells.extend(counted.then(|| line.count.to_string()));
                cells.push(number(Some(line.macs as f64 / 1e6), 1));
                cells.push(number(Some(line.seconds * 1e3), 3));
                cells.push(number(Some(100.0 * line.seconds / total_s), 1));
                cells.push(number(rate, 1));
                cells.push(number(rate.zip(peak_rate).map(|(rate, peak)| rate / peak), 2));
                table.row(cells);
            }
        }
    }
}

fn operators(criterion: &mut Criterion) {
    let mut tables = Tables::new();
    presets().into_iter().for_each(|preset| network(criterion, preset, &mut tables));
    publish(env!("CARGO_TARGET_TMPDIR"), &[tables.kinds, tables.single]);
}

criterion_group!(benches, operators);
criterion_main!(benches);
