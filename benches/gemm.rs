//! Matrix products of this network's shapes with every kernel of this processor, as fractions of its measured peak.
//!
//! `cargo bench -p elunar-benches --bench gemm`
//!
//! A benchmark is one step of a convolution: a row of output pixels or a block of them, all output channels, weights in the order
//! in which the runner reads them. The peak is measured beside every sample, so that a change of clock reaches both. `Kernel::matrix_product`
//! copies accumulators in and out of every block of pixels, which the runner does not: the fractions contain it. The last column
//! is free of it: what twice as many samples cost more.

#![allow(missing_docs)] // criterion's macros make undocumented functions

use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use elunar_benches::models::{exported, name, presets};
use elunar_benches::peak::{self, Peak};
use elunar_benches::samples::{Timings, measure, seconds};
use elunar_benches::shapes::{self, Products, StepShape, Use};
use elunar_benches::table::{Table, number, publish};
use elunar_core::nn::{Kernel, Model};
use elunar_net::kernels;
use std::time::Duration;

/// Shapes below this share of every network's products are left out.
const SMALLEST_SHARE: f64 = 0.005;

/// A shape, and its share of the products of every network.
struct Row {
    use_: Use,
    shares: Vec<f64>,
    /// Fraction of peak by kernel.
    fractions: Vec<Option<f64>>,
    /// Fraction of peak of the fastest kernel's inner loop.
    inner: Option<f64>,
}

/// A fraction with two digits that say something.
fn short(fraction: Option<f64>) -> String {
    number(fraction, if fraction.is_some_and(|f| f < 0.1) { 4 } else { 2 })
}

/// The shapes of all networks, largest share of any network first.
fn rows(networks: &[(&str, Vec<Use>)]) -> Vec<Row> {
    let mut rows: Vec<Row> = Vec::new();
    for (index, (_, uses)) in networks.iter().enumerate() {
        let macs = |use_: &Use| (use_.times * use_.shape.macs()) as f64;
        let total: f64 = uses.iter().map(macs).sum();
        for use_ in uses {
            let found = rows.iter().position(|row| row.use_.shape == use_.shape);
            let at = found.unwrap_or_else(|| {
                let shares = vec![0.0; networks.len()];
                rows.push(Row { use_: *use_, shares, fractions: Vec::new(), inner: None });
                rows.len() - 1
            });
            rows[at].shares[index] += macs(use_) / total;
        }
    }
    let largest = |row: &Row| row.shares.iter().copied().fold(0.0, f64::max);
    rows.retain(|row| largest(row) >= SMALLEST_SHARE);
    rows.sort_by(|a, b| largest(b).total_cmp(&largest(a)));
    rows
}

fn gemm(criterion: &mut Criterion) {
    let networks: Vec<(&str, Vec<Use>)> = presets()
        .into_iter()
        .map(|preset| {
            let bytes = exported(preset).expect("a preset can be exported");
            (name(preset), shapes::of(&Model::new(&bytes).expect("an exported model is valid")))
        })
        .collect();
    let (mut rows, kernels) = (rows(&networks), kernels::kernels().collect::<Vec<_>>());
    let Some(peak) = peak::dot_product() else {
        println!("SKIPPED: gemm: no peak is known for this processor");
        return;
    };
    let mut group = criterion.benchmark_group("gemm");
    group.sampling_mode(SamplingMode::Flat).sample_size(15).nresamples(2000);
    group.warm_up_time(Duration::from_millis(20)).measurement_time(Duration::from_millis(100));
    for row in &mut rows {
        let products = Products::new(&row.use_);
        let macs = row.use_.shape.macs();
        for (index, kernel) in kernels.iter().enumerate() {
            let id = format!("{}/{}", kernel.name(), row.use_.shape.id());
            let work = |times| seconds(|| (0..times).for_each(|_| products.run(kernel, row.use_.shape.groups())));
            let (samples, peaks) = measure(&mut group, &id, work, || peak.seconds());
            // Time at peak over time taken.
            let scale = macs as f64 / peak.macs as f64;
            row.fractions.push(peaks.over(&samples).median().map(|ratio| ratio * scale));
            if index == 0 {
                row.inner = samples.median().and_then(|_| inner_loop(&products, &row.use_.shape, kernel, &peak));
            }
        }
    }
    group.finish();
    if rows.iter().any(|row| row.fractions.iter().any(Option::is_some)) {
        let names: Vec<&str> = networks.iter().map(|(name, _)| *name).collect();
        println!("Fractions below are of {}.", peak.name);
        let tables = [peaks(), products(&rows, &names, &kernels), means(&rows, &names, &kernels)];
        publish(env!("CARGO_TARGET_TMPDIR"), &tables);
    }
}

/// Fraction of peak at which a kernel makes the second half of a step's products: what the first half costs contains calls,
/// loads and stores of sums. `None` where there are too few to halve.
fn inner_loop(products: &Products, shape: &StepShape, kernel: &Kernel, peak: &Peak) -> Option<f64> {
    let (all, half) = (shape.groups(), shape.groups() / 2);
    if all < 8 {
        return None;
    }
    let macs = shape.macs() as f64 * (all - half) as f64 / all as f64;
    let mut fractions = Timings::default();
    for _ in 0..51 {
        let one = seconds(|| products.run(kernel, half));
        let two = seconds(|| products.run(kernel, all));
        fractions.push(macs / (two - one) * peak.seconds() / peak.macs as f64);
    }
    fractions.median()
}

/// Rates that the peaks of one core were measured at.
fn peaks() -> Table {
    let mut table = Table::new("peaks", &["instruction", "GMAC/s"]);
    for peak in peak::available() {
        let mut samples = Timings::default();
        (0..101).for_each(|_| samples.push(peak.seconds()));
        table.row(vec![peak.name.to_string(), number(samples.median().map(|s| peak.macs as f64 / s / 1e9), 1)]);
    }
    table
}

/// Fractions of peak of every shape.
fn products(rows: &[Row], networks: &[&str], kernels: &[Kernel]) -> Table {
    let shares: Vec<String> = networks.iter().map(|network| format!("% of {network}")).collect();
    let mut head: Vec<&str> =
        vec!["panels", "sets", "rows x pixels", "stride", "kernel rows x samples", "weights, KiB", "useful"];
    head.extend(shares.iter().map(String::as_str));
    head.extend(kernels.iter().map(|kernel| -> &str { kernel.name() }));
    head.push("inner loop");
    let mut table = Table::new("products", &head);
    for row in rows {
        let StepShape { sets, lines, pixels, stride, rows: kernel_rows, samples, .. } = row.use_.shape;
        let shape = &row.use_.shape;
        let mut cells = vec![shape.widths(), sets.to_string(), format!("{lines} x {pixels}"), stride.to_string()];
        cells.push(format!("{kernel_rows} x {samples}"));
        cells.push(number(Some(shape.weight_bytes() as f64 / 1024.0), 1));
        cells.push(number(Some(shape.useful()), 2));
        cells.extend(row.shares.iter().map(|&share| number(Some(100.0 * share).filter(|s| *s > 0.0), 1)));
        cells.extend(row.fractions.iter().map(|&fraction| short(fraction)));
        cells.push(short(row.inner));
        table.row(cells);
    }
    table
}

/// The fraction of peak over all products of every network.
fn means(rows: &[Row], networks: &[&str], kernels: &[Kernel]) -> Table {
    let mut head = vec!["network", "% of its products above"];
    head.extend(kernels.iter().map(Kernel::name));
    let mut table = Table::new("products_together", &head);
    for (index, network) in networks.iter().enumerate() {
        let covered: f64 = rows.iter().map(|row| row.shares[index]).sum();
        let mean = |fraction: &dyn Fn(&Row) -> Option<f64>| {
            let time: Option<f64> = rows.iter().map(|row| fraction(row).map(|f| row.shares[index] / f)).sum();
            short(time.map(|time| covered / time))
        };
        let mut cells = vec![(*network).to_string(), number(Some(100.0 * covered), 1)];
        cells.extend((0..kernels.len()).map(|kernel| mean(&|row| row.fractions.get(kernel).copied().flatten())));
        table.row(cells);
    }
    table
}

criterion_group!(benches, gemm);
criterion_main!(benches);
