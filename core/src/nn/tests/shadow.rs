//! A memory that stores for each byte which row of which tensor it holds. It simulates a schedule byte by byte and reports reads of missing
//! rows. It is slow and simple, and has no notion of rings, heirs and lifetimes.

use super::draft::Draft;
use crate::nn::file::Operator;
use std::ops::Range;

/// Returns the first read of a missing row, or the work that a schedule leaves undone.
pub(super) fn play(draft: &Draft) -> Result<(), String> {
    let end = draft.tensors.iter().map(|t| t.offset + t.size_bytes()).max().unwrap_or(0);
    let mut memory: Vec<Option<(usize, usize)>> = vec![None; end];
    let place = |tensor: usize, row: usize| -> Range<usize> {
        let t = &draft.tensors[tensor];
        let start = t.offset + row % t.ring * t.pitch;
        start..start + t.row_bytes()
    };
    for input in [0, draft.coarse as usize].into_iter().filter(|t| *t < draft.tensors.len()) {
        for row in 0..draft.tensors[input].rows {
            memory[place(input, row)].fill(Some((input, row)));
        }
    }
    let mut done = vec![0; draft.operators.len()];
    for (number, entry) in draft.schedule.iter().enumerate() {
        let operator = draft.operators.get(entry.operator).ok_or(format!("entry {number}: operator"))?;
        let out = operator.output() as usize;
        let t = &draft.tensors[out];
        if entry.count == 0 || entry.first != done[entry.operator] {
            return Err(format!("entry {number}: out of order"));
        }
        for step in entry.first..entry.first + entry.count {
            if step >= operator.steps(t) {
                return Err(format!("entry {number}: step {step}"));
            }
            let made = operator.rows_after(t, step)..operator.rows_after(t, step + 1);
            for (slot, input) in operator.inputs().into_iter().enumerate() {
                let Some(input) = input.map(|i| i as usize) else { continue };
                for row in operator.rows_read(t, slot, draft.tensors[input].rows, step) {
                    let range = place(input, row);
                    if memory[range.clone()].iter().any(|byte| *byte != Some((input, row))) {
                        return Err(format!("entry {number}, step {step}: row {row} of tensor {input} is not there"));
                    }
                    // Channels and pixels are computed one after the other, so a step must not write what it still reads. An added row may
                    // become the sum.
                    let adds = slot == 2 && matches!(operator, Operator::Conv(_));
                    let meets = |other: usize| {
                        let to = place(out, other);
                        to.start < range.end && range.start < to.end && !(adds && to == range && other == row)
                    };
                    if made.clone().any(meets) {
                        return Err(format!("entry {number}, step {step}: writes over what it reads"));
                    }
                }
            }
            for row in made {
                memory[place(out, row)].fill(Some((out, row)));
            }
            done[entry.operator] += 1;
        }
    }
    let finished =
        draft.operators.iter().zip(&done).all(|(op, done)| op.steps(&draft.tensors[op.output() as usize]) == *done);
    let out = draft.output as usize;
    let whole = (0..draft.tensors[out].rows).all(|row| memory[place(out, row)].iter().all(|b| *b == Some((out, row))));
    if finished && whole { Ok(()) } else { Err("left undone or overwritten".into()) }
}
