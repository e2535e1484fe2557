//! Output of the tour: numbered steps with their times, and progress bars for long work.

use elunar_base::{Error, Result, interrupt};
use std::time::Instant;

/// Prints and times the steps of a tour.
pub(super) struct Console {
    steps: usize,
    times: Vec<StepTime>,
}

/// Time of a step.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct StepTime {
    /// The step's title.
    pub title: String,
    /// Seconds.
    pub seconds: f64,
}

impl Console {
    /// Makes a console for this number of steps.
    pub(super) fn new(steps: usize) -> Self {
        Self { steps, times: vec![] }
    }

    /// Runs one step.
    ///
    /// # Errors
    /// Errors of the step, or that the user asked to stop.
    pub(super) fn step<T>(&mut self, title: &str, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let number = self.times.len() + 1;
        println!("{number}/{}  {title}", self.steps);
        let start = Instant::now();
        let made = work();
        let seconds = start.elapsed().as_secs_f64();
        if interrupt::requested() {
            return Err(Error::stopped(format!(
                "stopped in step {number} of {}, {title}; finished files stay, and the next tour starts afresh",
                self.steps
            )));
        }
        let made = made?;
        println!("     done in {}\n", minutes(seconds));
        self.times.push(StepTime { title: title.into(), seconds });
        Ok(made)
    }

    /// Returns the steps so far.
    pub(super) fn times(&self) -> &[StepTime] {
        &self.times
    }

    /// Returns the time of all steps together, seconds.
    pub(super) fn total_s(&self) -> f64 {
        self.times.iter().map(|step| step.seconds).sum()
    }
}

/// Prints one line under the title of the current step.
pub(super) fn say(line: impl std::fmt::Display) {
    println!("     {line}");
}

/// Returns a time as `4.2 s` or `3 min 05 s`.
pub(super) fn minutes(seconds: f64) -> String {
    if seconds < 59.95 {
        return format!("{seconds:.1} s");
    }
    let whole = seconds.round() as u64;
    format!("{} min {:02} s", whole / 60, whole % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_read_well() {
        assert_eq!(["4.2 s", "1 min 00 s", "3 min 05 s"].map(String::from), [4.21, 59.97, 185.2].map(minutes));
    }

    #[test]
    fn steps_are_timed_and_failures_pass_through() {
        let mut console = Console::new(2);
        assert_eq!(console.step("a", || Ok(7)).unwrap(), 7);
        assert!(console.step("b", || Err::<(), _>(Error::input("no"))).unwrap_err().to_string().contains("no"));
        assert_eq!(console.times().len(), 1);
    }
}
