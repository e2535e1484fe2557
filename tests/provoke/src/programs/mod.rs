//! Random programs whose tensors share bytes, each with the same program laid out apart: both must compute the same output.

mod file;
mod operators;
mod places;
mod steps;

pub use file::Program;

use crate::Random;
use elunar_core::nn::file::{Dtype, NONE};
use elunar_core::nn::{Kernel, Model, ModelError, Progress, Runner, required};

/// Largest arena and largest constants of a program, bytes.
const LARGEST: usize = 1 << 21;
/// Most places that are tried for the tensors of one program.
const TRIES: usize = 60;

/// Random choices.
pub(crate) struct Dice<'r>(pub(crate) &'r mut Random);

impl Dice<'_> {
    /// Returns a number of `low..=high`.
    pub(crate) fn size(&mut self, low: usize, high: usize) -> usize {
        low + (self.0.number() >> 11) as usize % (high - low + 1)
    }

    /// Returns `true` `percent` times in a hundred.
    pub(crate) fn chance(&mut self, percent: usize) -> bool {
        self.size(0, 99) < percent
    }

    pub(crate) fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.size(0, from.len() - 1)]
    }

    /// Returns a number of `-size..=size`.
    pub(crate) fn signed(&mut self, size: i64) -> i64 {
        (self.0.number() >> 1) as i64 % (size + 1) * if self.chance(50) { 1 } else { -1 }
    }
}

/// A program, and the same one with all tensors apart and kept whole.
pub struct Pair {
    /// With shared bytes, rings and pitches of any kind.
    pub wild: Program,
    /// Laid out apart.
    pub tame: Program,
}

/// Returns a program; `None` if the random choices do not lead to one.
#[must_use]
pub fn pair(random: &mut Random) -> Option<Pair> {
    let mut dice = Dice(random);
    let d = &mut dice;
    let tile = (d.size(1, 20), d.size(1, 14));
    let (tensors, operators, schedule, constants) = Default::default();
    let seed = d.size(0, u32::MAX as usize) as u32;
    let mut program = Program { tensors, operators, schedule, constants, tile, coarse: NONE, seed };
    operators::inputs(d, &mut program);
    for _ in 0..d.size(1, 6) {
        operators::add(d, &mut program)?;
    }
    operators::output(d, &mut program)?;
    steps::order(d, &mut program)?;
    let tame = places::apart(&program);
    let small = |p: &Program| p.end() < LARGEST && p.constants.len() < LARGEST;
    if !small(&tame) {
        return None;
    }
    // Most places are illegal, and many of the others are apart.
    for attempt in 0..TRIES {
        places::share(d, &mut program);
        let legal = small(&program) && Model::new(&program.file()).is_ok();
        if legal && (attempt > TRIES / 2 || program.shares_bytes()) {
            break;
        }
    }
    small(&program).then_some(Pair { wild: program, tame })
}

/// How a pair was judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Judged {
    /// The program is refused even if it is laid out apart.
    Illegal(ModelError),
    /// Only the wild file is refused.
    Refused(ModelError),
    /// Both ran, and tensors of the wild one share bytes or do not.
    Ran {
        /// Whether tensors share bytes.
        shared: bool,
        /// Number of runs.
        runs: usize,
    },
}

/// Runs both programs with every kernel and other budgets, in memory that `lend` gives: filled with rubbish, and of exactly this length.
///
/// # Panics
/// If an accepted program ends with an error, or outputs or counters differ.
pub fn judge(pair: &Pair, random: &mut Random, lend: &mut impl FnMut(usize, u8) -> &'static mut [u8]) -> Judged {
    let (wild, tame) = (pair.wild.file(), pair.tame.file());
    let tame = match Model::new(&tame) {
        Ok(tame) => tame,
        Err(error) => return Judged::Illegal(error),
    };
    let wild = match Model::new(&wild) {
        Ok(wild) => wild,
        Err(error) => return Judged::Refused(error),
    };
    let mut run = |kernel: Kernel, model: Model<'_>| {
        let dice = &mut Dice(random);
        let (rubbish, budget) = (dice.size(0, 255) as u8, dice.pick(&[1, 100, 5000, u64::MAX]));
        let mut runner = Runner::with_kernel(kernel, model, lend(required(&model), rubbish)).expect("enough memory");
        runner.begin_self_test().expect("the model is as it was");
        while runner.step(budget).unwrap_or_else(|error| panic!("{error}: {:?}", pair.wild)) == Progress::Running {}
        (runner.output_crc().expect("done"), runner.telemetry().saturated, runner.telemetry().macs)
    };
    let expected = run(Kernel::SCALAR, tame);
    let mut runs = 1;
    for kernel in Kernel::available() {
        assert_eq!(run(kernel, tame), expected, "apart, {kernel:?}: {:?}", pair.tame);
        assert_eq!(run(kernel, wild), expected, "{kernel:?}: {:?}", pair.wild);
        runs += 2;
    }
    Judged::Ran { shared: pair.wild.shares_bytes(), runs }
}

/// Returns the legal ends of codes of a type.
pub(crate) fn ends(dtype: Dtype) -> (i32, i32) {
    match dtype {
        Dtype::U8 => (0, 255),
        Dtype::I16 => (-32767, 32767),
        Dtype::F32 => (0, 0),
    }
}
