//! The operators, one file each. Every function does one unit of one step of work (see [`super::Model::units`]) and returns how
//! many results had to be cut to their tensor's largest code (or, below a zero that is not the smallest code, to the smallest).
//!
//! All of them are inlined into one function per kernel, so that each is compiled for the kernel's instruction set.

pub(crate) mod conv;
pub(crate) mod enlarge;
pub(crate) mod finish;
pub(crate) mod layer_norm;
pub(crate) mod window_attention;

use super::arena::Arena;
use super::kernels::Isa;
use super::model::Model;
use super::prepared::Prepared;
use super::program::Operator;

/// Runs unit `unit` of step `step`.
#[inline(always)]
pub(crate) fn run<I: Isa>(
    model: &Model<'_>,
    prepared: &Prepared,
    arena: &mut Arena<'_>,
    step: usize,
    unit: usize,
) -> u64 {
    match &prepared.operator {
        Operator::Conv(op) => conv::run::<I>(model, (op, prepared), arena, step, unit),
        Operator::LayerNorm(op) => layer_norm::run::<I>(model, (op, prepared), arena, step),
        Operator::Attention(op) => window_attention::run::<I>(model, (op, prepared), arena, step, unit),
        Operator::Enlarge(_) => enlarge::run(prepared, arena, step),
    }
}
