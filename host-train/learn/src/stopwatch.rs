//! Times of training: parts of a step, and the operators within them. They are summed while the stopwatch runs.
//!
//! There is one stopwatch per process, since Burn calls the network's operators, and no object of ours can be passed through Burn. Parts do
//! not overlap. Operators are within forward and backward passes.

use std::fmt::Write as _;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// A part of the training time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrainingPart {
    /// The training loop waits for the thread of the tiles.
    Tiles,
    /// Samples become tensors.
    Tensors,
    /// The network's forward pass.
    Forward,
    /// The loss, until its value is known.
    Loss,
    /// The backward pass of loss and network.
    Backward,
    /// The optimiser.
    Optimiser,
    /// Convolutions, forward and backward.
    Convolution(Pass),
    /// Upsamplings with their 5x5 convolution, forward and backward.
    Upsampling(Pass),
    /// Batch normalisation, forward and backward.
    BatchNorm(Pass),
}

/// Direction of a pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pass {
    /// From inputs to the output.
    Forward,
    /// From the output's gradient to the inputs' gradients.
    Backward,
}

/// The parts of a step.
const STEP: [(TrainingPart, &str); 6] = [
    (TrainingPart::Tiles, "waiting for tiles"),
    (TrainingPart::Tensors, "samples to tensors"),
    (TrainingPart::Forward, "forward"),
    (TrainingPart::Loss, "loss"),
    (TrainingPart::Backward, "backward"),
    (TrainingPart::Optimiser, "optimiser"),
];

/// An operator's part in a pass.
type In = fn(Pass) -> TrainingPart;

/// The operators of a pass.
const OPERATORS: [(In, &str); 3] = [
    (TrainingPart::Convolution, "convolutions"),
    (TrainingPart::Upsampling, "upsampling with 5x5 convolution"),
    (TrainingPart::BatchNorm, "batch normalisation"),
];

static RUNS: AtomicBool = AtomicBool::new(false);
static NANOSECONDS: [AtomicU64; 12] = [const { AtomicU64::new(0) }; 12];

impl TrainingPart {
    fn sum(self) -> &'static AtomicU64 {
        let index = match self {
            Self::Tiles => 0,
            Self::Tensors => 1,
            Self::Forward => 2,
            Self::Loss => 3,
            Self::Backward => 4,
            Self::Optimiser => 5,
            Self::Convolution(pass) => 6 + pass as usize,
            Self::Upsampling(pass) => 8 + pass as usize,
            Self::BatchNorm(pass) => 10 + pass as usize,
        };
        &NANOSECONDS[index]
    }

    fn pass(self) -> Option<Pass> {
        match self {
            Self::Forward => Some(Pass::Forward),
            Self::Backward => Some(Pass::Backward),
            _ => None,
        }
    }

    fn so_far(self) -> Duration {
        Duration::from_nanos(self.sum().load(Ordering::Relaxed))
    }
}

/// Resets all sums and starts the stopwatch.
pub fn start() {
    NANOSECONDS.iter().for_each(|sum| sum.store(0, Ordering::Relaxed));
    RUNS.store(true, Ordering::Relaxed);
}

/// Runs `work`, and adds its time to a part if the stopwatch runs.
pub fn time<T>(part: TrainingPart, work: impl FnOnce() -> T) -> T {
    if !RUNS.load(Ordering::Relaxed) {
        return work();
    }
    let begun = Instant::now();
    let done = work();
    part.sum().fetch_add(begun.elapsed().as_nanos() as u64, Ordering::Relaxed);
    done
}

/// Runs `work` without adding any of its time.
pub fn pause<T>(work: impl FnOnce() -> T) -> T {
    let ran = RUNS.swap(false, Ordering::Relaxed);
    let done = work();
    RUNS.store(ran, Ordering::Relaxed);
    done
}

/// Returns milliseconds per step and shares of `wall`, the time of all `steps`. "The rest" is the time without its own line. In forward and
/// backward passes it is attention, matrix products, activations and copies; in the whole it is validation, checkpoints and the journal.
#[must_use]
pub fn table(steps: usize, wall: Duration) -> String {
    let mut text = String::from("| part | ms per step | share |\n|---|---|---|\n");
    let mut line = |name: &str, time: Duration| {
        let milliseconds = 1e3 * time.as_secs_f64() / steps.max(1) as f64;
        let share = 100.0 * time.as_secs_f64() / wall.as_secs_f64().max(f64::MIN_POSITIVE);
        let _ = writeln!(text, "| {name} | {milliseconds:.1} | {share:.1} % |");
    };
    let mut rest = wall;
    for (part, name) in STEP {
        line(name, part.so_far());
        rest = rest.saturating_sub(part.so_far());
        let Some(pass) = part.pass() else { continue };
        let mut without = part.so_far();
        for (operator, name) in OPERATORS {
            let time = operator(pass).so_far();
            line(&format!("– {name}"), time);
            without = without.saturating_sub(time);
        }
        line("– the rest", without);
    }
    line("the rest", rest);
    line("all", wall);
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_have_sums_of_their_own_and_every_one_has_a_line() {
        let passes = [Pass::Forward, Pass::Backward];
        let operators = OPERATORS.iter().flat_map(|(operator, _)| passes.map(operator));
        let mut places: Vec<_> =
            STEP.iter().map(|(part, _)| *part).chain(operators).map(|p| p.sum().as_ptr()).collect();
        places.sort();
        places.dedup();
        assert_eq!(places.len(), NANOSECONDS.len());
    }

    #[test]
    fn time_is_added_while_the_stopwatch_runs() {
        // Other tests of this process may add their times.
        start();
        let nap = Duration::from_millis(20);
        assert_eq!(
            time(TrainingPart::Tensors, || {
                std::thread::sleep(nap);
                7
            }),
            7
        );
        assert!(TrainingPart::Tensors.so_far() >= nap);
        let text = table(2, Duration::from_secs(1));
        assert!(text.contains("| all | 500.0 | 100.0 % |"), "{text}");
        assert_eq!(text.lines().count(), 2 + 6 + 2 * 4 + 2);
    }
}
