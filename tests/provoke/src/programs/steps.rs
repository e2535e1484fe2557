//! Random orders of steps in which every row is written before it is read.

use super::{Dice, Program};
use alloc::vec;
use alloc::vec::Vec;
use elunar_core::nn::file::{Entry, Operator};

/// Orders the steps: operator after operator, as late as possible, or at random.
pub(super) fn order(d: &mut Dice<'_>, program: &mut Program) -> Option<()> {
    let count = program.operators.len();
    let steps: Vec<usize> = program.operators.iter().map(|op| op.steps(&program.tensor(op.output()))).collect();
    let (mut done, way) = (vec![0; count], d.size(0, 2));
    for _ in 0..20_000 {
        if done == steps {
            return Some(());
        }
        let open = |k: &usize| done[*k] < steps[*k];
        let next = match way {
            0 => (0..count).find(open)?,
            1 => (0..count).rev().find(|k| open(k) && ready(program, &done, *k))?,
            _ => d.size(0, count - 1),
        };
        let (first, most) = (done[next], if way == 0 { usize::MAX } else { d.size(1, 3) });
        while done[next] - first < most && done[next] < steps[next] && ready(program, &done, next) {
            done[next] += 1;
        }
        if done[next] > first {
            program.schedule.push(Entry { operator: next, first, count: done[next] - first });
        }
    }
    None
}

/// Returns whether all rows exist that the next step of an operator reads.
fn ready(program: &Program, done: &[usize], index: usize) -> bool {
    let operator = &program.operators[index];
    let out = program.tensor(operator.output());
    let made = |tensor: u32| {
        let t = program.tensor(tensor);
        let writer = program.operators.iter().position(|op: &Operator| op.output() == tensor);
        writer.map_or(t.rows, |writer| program.operators[writer].rows_after(&t, done[writer]).min(t.rows))
    };
    let inputs = operator.inputs().into_iter().enumerate().filter_map(|(slot, tensor)| Some((slot, tensor?)));
    inputs.into_iter().all(|(slot, tensor)| {
        operator.rows_read(&out, slot, program.tensor(tensor).rows, done[index]).end <= made(tensor)
    })
}
