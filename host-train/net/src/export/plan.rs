//! Memory: the number of rows kept of every tensor, and their place in the arena. Two tensors may share bytes if they are never in use at
//! the same time. A sum may take the place of what was added.

use super::schedule::{Play, schedule};
use elunar_core::nn::file::{Entry, Operator, Tensor};

/// Alignment of tensors, bytes. The runner does not need it, but caches profit.
const ALIGNMENT: usize = 64;

/// Orders the steps and places the tensors. Milestones reduce the memory: every operator is tried as a milestone, and the one that saves
/// most is kept, until none saves any.
pub fn order_and_plan(tensors: &mut [Tensor], operators: &[Operator], inputs: &[u32], output: u32) -> Vec<Entry> {
    let attempt = |milestones: &[usize]| {
        let (mut placed, schedule) = (tensors.to_vec(), schedule(tensors, operators, milestones));
        (plan(&mut placed, operators, &schedule, inputs, output), placed, schedule)
    };
    let (mut milestones, mut best) = (Vec::new(), attempt(&[]));
    loop {
        let mut found = None;
        for operator in 0..operators.len() {
            let mut more = milestones.clone();
            more.push(operator);
            more.sort_unstable();
            let attempt = attempt(&more);
            if attempt.0 < best.0 {
                (best, found) = (attempt, Some(more));
            }
        }
        let Some(more) = found else { break };
        milestones = more;
    }
    tensors.clone_from_slice(&best.1);
    best.2
}

/// Sets every tensor's ring, pitch and offset. Returns the bytes of all tensors together. `inputs` are written before the first step and `output`
/// is read after the last one, so both keep all rows.
pub fn plan(tensors: &mut [Tensor], operators: &[Operator], schedule: &[Entry], inputs: &[u32], output: u32) -> usize {
    let mut homes = find_homes(tensors, operators, schedule);
    let mut rings = vec![1; tensors.len()];
    play(tensors, operators, schedule, |play, tensor, rows| {
        // In a chain of sums that share a place, the first tensor is the furthest ahead.
        rings[homes[tensor]] = rings[homes[tensor]].max(play.made(homes[tensor]).max(play.made(tensor)) - rows.start);
    });
    for t in 0..tensors.len() {
        let all = inputs.contains(&(t as u32)) || t == output as usize;
        tensors[t].ring = if all { tensors[t].rows } else { rings[homes[t]].min(tensors[t].rows) };
        tensors[t].pitch = tensors[t].row_bytes();
        tensors[t].sums = tensors[..t].iter().map(|before| before.ring).sum();
    }
    let mut skews = vec![0; tensors.len()];
    lay_output_on_inputs(tensors, operators, schedule, inputs, output, (&mut homes, &mut skews));
    let lives = find_lives(tensors, operators, schedule, inputs, output, &homes);
    place(tensors, &lives, &homes, &skews)
}

/// Interleaves the rows of the inputs and puts the rows of the output on top of them. This needs each input row to be read for the last
/// time before its output row is made. An input that is added to the output is read with it. Its row must not be overwritten before the
/// next one, so the output's rows end where the added rows begin.
fn lay_output_on_inputs(
    tensors: &mut [Tensor],
    operators: &[Operator],
    schedule: &[Entry],
    inputs: &[u32],
    output: u32,
    (homes, skews): (&mut [usize], &mut [usize]),
) {
    let mut inputs: Vec<usize> = inputs.iter().map(|&i| i as usize).filter(|&i| i < tensors.len()).collect();
    let output = output as usize;
    let mut free = inputs.iter().all(|&i| tensors[i].rows == tensors[output].rows);
    play(tensors, operators, schedule, |play, tensor, rows| {
        free &= !inputs.contains(&tensor) || play.made(output) <= rows.start;
    });
    let added =
        |i: &usize| operators.iter().any(|op| op.output() as usize == output && op.inputs().contains(&Some(*i as u32)));
    inputs.sort_by_key(added);
    let Some(&home) = inputs.first().filter(|_| free) else { return };
    let bytes = |i: &usize| tensors[*i].row_bytes();
    let (others, all): (usize, usize) =
        (inputs.iter().filter(|i| !added(i)).map(bytes).sum(), inputs.iter().map(bytes).sum());
    let pitch = all.max(tensors[output].row_bytes());
    // Distance from the output's first row to the first input row.
    let mut skew = tensors[output].row_bytes().saturating_sub(others);
    for &input in &inputs {
        (homes[input], skews[input]) = (home, skew);
        tensors[input].pitch = pitch;
        skew += tensors[input].row_bytes();
    }
    homes[output] = home;
    tensors[output].pitch = pitch;
}

/// Calls `read` before each step, with every tensor and the rows that the step reads.
fn play(
    tensors: &[Tensor],
    operators: &[Operator],
    schedule: &[Entry],
    mut read: impl FnMut(&Play<'_>, usize, std::ops::Range<usize>),
) {
    let mut play = Play::new(tensors, operators);
    for entry in schedule {
        for step in entry.first..entry.first + entry.count {
            play.reads(entry.operator, step).filter(|(_, rows)| !rows.is_empty()).for_each(|(t, r)| read(&play, t, r));
            play.advance(entry.operator);
        }
    }
}

/// Returns the tensor whose place each tensor takes: itself, or the first in a chain of sums. A sum may take the place of an added tensor
/// if no operator reads a row of that tensor after the sum's row is written.
fn find_homes(tensors: &[Tensor], operators: &[Operator], schedule: &[Entry]) -> Vec<usize> {
    let mut homes: Vec<usize> = (0..tensors.len()).collect();
    for operator in operators {
        let Operator::Conv(conv) = operator else { continue };
        let (Some(add), out) = (conv.add.map(|add| add as usize), conv.out as usize) else { continue };
        let form = |t: &Tensor| (t.dtype, t.rows, t.cols, t.channels, t.margin);
        let written = operators.iter().any(|op| op.output() as usize == add);
        let also_source = conv.sources().any(|s| s as usize == add);
        if !written || also_source || form(&tensors[add]) != form(&tensors[out]) {
            continue;
        }
        let mut free = true;
        play(tensors, operators, schedule, |play, tensor, rows| {
            free &= tensor != add || play.made(out) <= rows.start;
        });
        if free {
            homes[out] = homes[add];
        }
    }
    homes
}

/// First and last entry (from 1; 0 is before the first) that uses a place.
#[derive(Debug, Clone, Copy)]
struct Life {
    first: usize,
    last: usize,
}

fn find_lives(
    tensors: &[Tensor],
    operators: &[Operator],
    schedule: &[Entry],
    inputs: &[u32],
    output: u32,
    homes: &[usize],
) -> Vec<Option<Life>> {
    let mut lives: Vec<Option<Life>> = vec![None; tensors.len()];
    let mut touch = |tensor: u32, time: usize| {
        let life = lives[homes[tensor as usize]].get_or_insert(Life { first: time, last: time });
        life.last = time;
    };
    inputs.iter().filter(|i| (**i as usize) < tensors.len()).for_each(|&input| touch(input, 0));
    for (index, entry) in schedule.iter().enumerate() {
        let op = &operators[entry.operator];
        op.inputs().into_iter().flatten().chain([op.output()]).for_each(|tensor| touch(tensor, index + 1));
    }
    touch(output, usize::MAX);
    lives
}

/// Places the largest tensor first, each at the lowest offset without conflict with a placed tensor in use at the same time.
fn place(tensors: &mut [Tensor], lives: &[Option<Life>], homes: &[usize], skews: &[usize]) -> usize {
    // The size of a place is from the first to the last byte of all its tensors.
    let mut sizes = vec![0; tensors.len()];
    for t in 0..tensors.len() {
        sizes[homes[t]] = sizes[homes[t]].max(skews[t] + tensors[t].size_bytes());
    }
    let mut order: Vec<usize> = (0..tensors.len()).filter(|&t| homes[t] == t && lives[t].is_some()).collect();
    order.sort_by_key(|&t| (std::cmp::Reverse(sizes[t]), t));
    let mut placed: Vec<(usize, usize)> = Vec::new();
    let mut end = 0;
    for &t in &order {
        let Some(life) = lives[t] else { continue };
        let alive = |p: usize| lives[p].is_some_and(|l| l.first <= life.last && life.first <= l.last);
        let rivals = placed.iter().filter(|&&(p, _)| alive(p));
        let mut taken: Vec<(usize, usize)> = rivals.map(|&(p, offset)| (offset, offset + sizes[p])).collect();
        taken.sort_unstable();
        let mut offset = 0;
        for (from, to) in taken {
            if offset + sizes[t] <= from {
                break;
            }
            offset = offset.max(to.next_multiple_of(ALIGNMENT));
        }
        end = end.max(offset + sizes[t]);
        placed.push((t, offset));
    }
    for t in 0..tensors.len() {
        if let Some(&(_, offset)) = placed.iter().find(|(home, _)| *home == homes[t]) {
            tensors[t].offset = offset + skews[t];
        }
    }
    end
}
