//! Durations for tables, beside criterion's own statistics.

use criterion::BenchmarkGroup;
use criterion::measurement::WallTime;
use std::time::Instant;

/// Seconds of repeated measurements of the same work.
#[derive(Debug, Clone, Default)]
pub struct Timings {
    seconds: Vec<f64>,
}

impl Timings {
    /// Adds a measurement, seconds.
    pub fn push(&mut self, seconds: f64) {
        self.seconds.push(seconds);
    }

    /// Returns the median; `None` without measurements.
    pub fn median(&self) -> Option<f64> {
        let mut sorted = self.seconds.clone();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied()
    }

    /// Returns the smallest measurement; `None` without measurements.
    pub fn fastest(&self) -> Option<f64> {
        self.seconds.iter().copied().min_by(f64::total_cmp)
    }

    /// Returns each measurement of `self` divided by the measurement of `other` that was taken with it.
    #[must_use]
    pub fn over(&self, other: &Self) -> Self {
        Self { seconds: self.seconds.iter().zip(&other.seconds).map(|(a, b)| a / b).collect() }
    }
}

/// Returns the seconds that `work` takes.
pub fn seconds(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64()
}

/// Measures with criterion. `work(times)` returns the seconds of `times` repetitions; `beside` returns the seconds of a second measurement,
/// taken with every sample. Returns the samples of both, per repetition and per call; both are empty if criterion's filter excludes `id`.
/// The group must sample [flat](criterion::SamplingMode::Flat): samples of another number of repetitions are its warm-up.
pub fn measure(
    group: &mut BenchmarkGroup<'_, WallTime>,
    id: &str,
    mut work: impl FnMut(u64) -> f64,
    mut beside: impl FnMut() -> f64,
) -> (Timings, Timings) {
    let mut all: Vec<(u64, f64, f64)> = Vec::new();
    group.bench_function(id, |bencher| {
        bencher.iter_custom(|times| {
            let other_s = beside();
            let total_s = work(times);
            all.push((times, total_s / times as f64, other_s));
            std::time::Duration::from_secs_f64(total_s)
        });
    });
    let real = all.last().map_or(0, |last| last.0);
    // The first run has cold caches.
    let first = usize::from(all.len() > 1);
    let kept = all.iter().skip(first).filter(|sample| sample.0 == real);
    let (mut samples, mut others) = (Timings::default(), Timings::default());
    kept.for_each(|&(_, one, other)| {
        samples.push(one);
        others.push(other);
    });
    (samples, others)
}
