//! Runs a program apart and in layouts that share bytes, with every kernel.

use super::{Dice, Program, Sizes, places};
use crate::Random;
use alloc::vec;
use elunar_core::nn::{Kernel, Model, ModelError, Progress, Runner, required};

/// Most layouts of one program that are run.
const LAYOUTS: usize = 6;
/// Changes of places that are tried between two layouts. Half of them and more are illegal.
const CHANGES: usize = 6;

/// What memory is lent for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lent {
    /// The bytes of the file.
    Model,
    /// The runner's memory.
    Arena,
}

/// How a program was judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Judged {
    /// The program is refused even if it is laid out apart.
    Illegal(ModelError),
    /// It ran.
    Ran {
        /// Number of other layouts that were accepted and run.
        layouts: usize,
        /// Those among them in which tensors share bytes.
        shared: usize,
        /// Number of layouts that were refused.
        refused: usize,
        /// Number of runs.
        runs: usize,
    },
}

/// What a run gives: the checksum of the output, saturated values, multiply-accumulates.
pub type Output = (u32, u64, u64);

/// Runs a program, laid out apart and in layouts that are reached from there by legal changes, with every kernel and other budgets, in memory
/// that `lend` gives: of exactly this length.
///
/// # Panics
/// If an accepted program ends with an error, or outputs or counters differ.
pub fn judge(
    program: &Program,
    random: &mut Random,
    lend: &mut impl FnMut(Lent, usize) -> &'static mut [u8],
) -> Judged {
    let model = match Model::new(lent_copy(&program.file(), lend)) {
        Ok(model) => model,
        Err(error) => return Judged::Illegal(error),
    };
    let d = &mut Dice { random, sizes: &Sizes::USUAL };
    let expected = run(Kernel::SCALAR, model, d, lend, program);
    let (mut layouts, mut shared, mut refused) = (0, 0, 0);
    let mut runs = 1 + compare(expected, model, d, lend, program);
    let mut wild = program.clone();
    for _ in 0..LAYOUTS {
        let mut changed = false;
        for _ in 0..CHANGES {
            let before = wild.tensors.clone();
            places::redraw(d, &mut wild);
            let small = wild.end() <= d.sizes.arena_bytes;
            if small && Model::new(&wild.file()).is_ok() {
                changed = true;
            } else {
                refused += 1;
                wild.tensors = before;
            }
        }
        if changed {
            let model = Model::new(lent_copy(&wild.file(), lend)).expect("accepted before");
            runs += compare(expected, model, d, lend, &wild);
            layouts += 1;
            shared += usize::from(wild.shares_bytes());
        }
    }
    Judged::Ran { layouts, shared, refused, runs }
}

/// Returns what a program gives with one kernel, in one step.
///
/// # Errors
/// That the program is refused.
pub fn output(program: &Program, kernel: Kernel) -> Result<Output, ModelError> {
    let bytes = program.file();
    let model = Model::new(&bytes)?;
    let mut memory = vec![0; required(&model)];
    Ok(tile(kernel, model, &mut memory, u64::MAX, program))
}

/// Copies a file into lent memory.
fn lent_copy(bytes: &[u8], lend: &mut impl FnMut(Lent, usize) -> &'static mut [u8]) -> &'static [u8] {
    let place = lend(Lent::Model, bytes.len());
    place.copy_from_slice(bytes);
    place
}

/// Runs a model with every kernel; returns the number of runs.
fn compare(
    expected: Output,
    model: Model<'_>,
    d: &mut Dice<'_>,
    lend: &mut impl FnMut(Lent, usize) -> &'static mut [u8],
    program: &Program,
) -> usize {
    let mut runs = 0;
    for kernel in Kernel::available() {
        assert_eq!(run(kernel, model, d, lend, program), expected, "{kernel:?}: {program:?}");
        runs += 1;
    }
    runs
}

/// Runs a model in memory full of rubbish.
fn run(
    kernel: Kernel,
    model: Model<'_>,
    d: &mut Dice<'_>,
    lend: &mut impl FnMut(Lent, usize) -> &'static mut [u8],
    program: &Program,
) -> Output {
    let (rubbish, budget) = (d.size(0, 255) as u8, d.pick(&[1, 100, 5000, u64::MAX]));
    let memory = lend(Lent::Arena, required(&model));
    memory.fill(rubbish);
    tile(kernel, model, memory, budget, program)
}

/// Computes the tile of the self test in steps of a budget.
fn tile(kernel: Kernel, model: Model<'_>, memory: &mut [u8], budget: u64, program: &Program) -> Output {
    let mut runner = Runner::with_kernel(kernel, model, memory).expect("enough memory");
    runner.begin_self_test().expect("the model is as it was");
    while runner.step(budget).unwrap_or_else(|error| panic!("{error}: {program:?}")) == Progress::Running {}
    let telemetry = runner.telemetry();
    (runner.output_crc().expect("done"), telemetry.saturated, telemetry.macs)
}
