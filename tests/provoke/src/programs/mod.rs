//! Random programs whose tensors share bytes, beside the same programs laid out apart: all must compute the same output.

mod dice;
mod file;
mod judge;
mod operators;
mod places;
mod sizes;
mod steps;

pub use file::Program;
pub use judge::{Judged, Lent, Output, judge, output};
pub use sizes::Sizes;

use crate::Random;
use dice::{Dice, ends};
use elunar_core::nn::Illumination;
use elunar_core::nn::file::NONE;

/// Returns a program with all tensors apart and kept whole; `None` if the random choices do not lead to one. What a choice makes illegal, the
/// model's validation refuses.
#[must_use]
pub fn program(random: &mut Random, sizes: &Sizes) -> Option<Program> {
    let d = &mut Dice { random, sizes };
    let tile = (d.size(1, sizes.tile.0), d.size(1, sizes.tile.1));
    let (tensors, operators, schedule, constants) = Default::default();
    let seed = d.size(0, u32::MAX as usize) as u32;
    let (coarse, illumination) = (NONE, Illumination::Any);
    let mut program = Program { tensors, operators, schedule, constants, tile, coarse, illumination, seed };
    operators::inputs(d, &mut program);
    for _ in 0..d.size(1, sizes.operators) {
        operators::add(d, &mut program)?;
        // Before the next one makes it larger still.
        if program.constants.len() > sizes.constant_bytes {
            return None;
        }
    }
    operators::output(d, &mut program)?;
    steps::order(d, &mut program)?;
    places::apart(&mut program);
    (program.end() <= sizes.arena_bytes && program.constants.len() <= sizes.constant_bytes).then_some(program)
}
