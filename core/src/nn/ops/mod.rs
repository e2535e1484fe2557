//! The operators: what each reads and writes (`reach.rs`), its cost (`prepared.rs`), and its unit of work, one file each.
//!
//! Every `run` does one unit of one step of work (see [`Prepared::units`]) and returns how many results were cut to their tensor's largest
//! code (or to the smallest, below a zero that is not the smallest code). All of them are inlined into one function per kernel, so that
//! each is compiled for the kernel's instruction set.

mod attention;
mod attention_layout;
mod constants;
mod conv;
mod layer_norm;
mod prepared;
mod reach;
mod requantise;
mod upsample;
mod witness;

pub(crate) use constants::Constants;
pub(crate) use prepared::Prepared;
#[cfg(test)]
pub(crate) use witness::LEAST_PIXELS;

use super::arena::Arena;
use super::file::Operator;
use super::kernels::Isa;

/// Runs unit `unit` of step `step`; `None` if its products differ from their checksums.
#[inline(always)]
pub(crate) fn run<I: Isa>(
    constants: &Constants<'_>,
    prepared: &Prepared,
    arena: &mut Arena<'_>,
    step: usize,
    unit: usize,
) -> Option<u64> {
    Some(match &prepared.operator {
        Operator::Conv(op) => return conv::run(&mut I::default(), constants, op, prepared, arena, step, unit),
        Operator::LayerNorm(op) => layer_norm::run::<I>(constants, op, prepared, arena, step),
        Operator::Attention(op) => attention::run(&mut I::default(), constants, op, prepared, arena, step, unit),
        Operator::Upsample2(_) => upsample::run(prepared, arena, step),
    })
}
