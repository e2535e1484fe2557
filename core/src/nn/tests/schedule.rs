//! Schedules: legal ones run, and reads of missing rows are refused.

use super::Random;
use super::draft::Draft;
use super::shadow;
use crate::nn::file::{Dtype, Entry, Operator, Tensor};
use crate::nn::{Model, ModelError, Progress, Runner, required};

const ROWS: usize = 8;

/// image -> a (3x3) -> b (3x3) -> sum = 1x1 of b + c, where c is 1x1 of the image -> output; tensors by name.
struct Chain {
    draft: Draft,
    a: usize,
    b: usize,
    c: usize,
    sum: usize,
}

/// Indices of the operators of [`Chain`].
const A: usize = 0;
const B: usize = 1;
const C: usize = 2;
const SUM: usize = 3;
const OUT: usize = 4;

fn chain() -> Chain {
    let mut draft = Draft::new((ROWS, 6));
    (draft.tensors[0].margin, draft.tensors[0].pitch) = (1, 8);
    let t = Tensor { hi: 255, margin: 1, ..Tensor::new(Dtype::U8, (ROWS, 6), 2) };
    let end = draft.tensors[0].size_bytes();
    let mut add = |tensor: Tensor| {
        draft.tensors.push(Tensor { offset: end + 1000 * draft.tensors.len(), pitch: tensor.row_bytes(), ..tensor });
        draft.tensors.len() as u32 - 1
    };
    let (a, b, c, sum) = (add(Tensor { ring: 3, ..t }), add(Tensor { ring: 1, ..t }), add(t), add(t));
    let out = add(Tensor::new(Dtype::F32, (ROWS, 6), 1));
    for (input, made, form) in
        [(0, a, (3, 1, 1)), (a, b, (3, 1, 1)), (0, c, (1, 1, 0)), (b, sum, (1, 1, 0)), (sum, out, (1, 1, 0))]
    {
        let mut conv = draft.silent(input, made, form);
        if made == sum {
            conv.add = Some(c);
            conv.add_multipliers = conv.multipliers;
        }
        draft.operator(Operator::Conv(conv));
    }
    draft.output = out;
    // Row by row: a runs one row ahead of b; b, c, sum and the output go together.
    let entry = |operator: usize, first: usize, count: usize| Entry { operator, first, count };
    draft.schedule.push(entry(A, 0, 1));
    for row in 0..ROWS {
        if row + 1 < ROWS {
            draft.schedule.push(entry(A, row + 1, 1));
        }
        draft.schedule.extend([B, C, SUM, OUT].map(|op| entry(op, row, 1)));
    }
    let [a, b, c, sum] = [a, b, c, sum].map(|t| t as usize);
    Chain { draft, a, b, c, sum }
}

/// Returns the runner's validation, after a check that the shadow's agrees.
fn validate(draft: &Draft) -> Result<(), ModelError> {
    let found = Model::new(&draft.file()).map(|_| ());
    assert_eq!(found.is_ok(), shadow::play(draft).is_ok(), "{found:?}, {:?}", shadow::play(draft));
    found
}

#[test]
fn rings_as_short_as_the_kernels_reach_are_legal_and_run() {
    let mut chain = chain();
    assert_eq!(validate(&chain.draft), Ok(()));
    // The sum overwrites the added tensor; both need one row only.
    chain.draft.tensors[chain.c].ring = 1;
    chain.draft.tensors[chain.sum].ring = 1;
    chain.draft.tensors[chain.sum].offset = chain.draft.tensors[chain.c].offset;
    assert_eq!(validate(&chain.draft), Ok(()));
    let file = chain.draft.file();
    let model = Model::new(&file).unwrap();
    let mut arena = vec![0x77; required(&model)];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    runner.begin(&[0.5; ROWS * 6], &[]).unwrap_err();
    runner.begin(&[0.5; ROWS * 6], &[0.0; ROWS * 6]).unwrap();
    let mut seen = Vec::new();
    let mut progress = Progress::Running;
    while progress == Progress::Running {
        seen.extend(runner.position());
        progress = runner.step(1).unwrap();
    }
    assert_eq!(runner.position(), Some(model.entry_count()));
    seen.dedup();
    assert_eq!(seen, (0..=model.entry_count()).collect::<Vec<_>>(), "every entry in its turn, then the validation");
    assert_eq!(runner.telemetry().macs, model.macs());
}

#[test]
fn rings_too_short_are_refused() {
    let mut chain = chain();
    chain.draft.tensors[chain.a].ring = 2;
    // Row 0 of b needs rows 0 and 1 of a; row 1 needs 0, 1 and 2.
    let entry = chain.draft.schedule.iter().position(|e| (e.operator, e.first) == (B, 1)).unwrap() as u32;
    assert_eq!(validate(&chain.draft), Err(ModelError::Schedule { entry }));
}

#[test]
fn a_ring_that_nobody_outruns_may_be_shorter_than_what_was_made_in_all() {
    let mut chain = chain();
    chain.draft.tensors[chain.b].ring = 1;
    assert_eq!(validate(&chain.draft), Ok(()));
    // b runs two rows ahead.
    let places: Vec<usize> =
        (0..chain.draft.schedule.len()).filter(|i| chain.draft.schedule[*i].operator == B).collect();
    let second = chain.draft.schedule.remove(places[1]);
    chain.draft.schedule.insert(places[0] + 1, second);
    let ahead = chain.draft.schedule.iter().position(|e| (e.operator, e.first) == (A, 2)).unwrap();
    let third = chain.draft.schedule.remove(ahead);
    chain.draft.schedule.insert(places[0], third);
    assert!(matches!(validate(&chain.draft), Err(ModelError::Schedule { .. })));
    chain.draft.tensors[chain.b].ring = 2;
    chain.draft.tensors[chain.a].ring = 4;
    assert_eq!(validate(&chain.draft), Ok(()));
}

#[test]
fn rows_not_made_yet_are_refused() {
    let mut chain = chain();
    chain.draft.schedule.swap(1, 2); // b before the second row of a
    assert_eq!(validate(&chain.draft), Err(ModelError::Schedule { entry: 1 }));
}

#[test]
fn every_step_runs_once_and_in_order() {
    let good = chain().draft;
    let with = |change: &dyn Fn(&mut Vec<Entry>)| {
        let mut draft = good.clone();
        change(&mut draft.schedule);
        validate(&draft)
    };
    let last = good.schedule.len() as u32;
    assert_eq!(
        with(&|s| s.push(Entry { operator: OUT, first: 7, count: 1 })),
        Err(ModelError::Schedule { entry: last })
    );
    assert_eq!(
        with(&|s| s.push(Entry { operator: OUT, first: 8, count: 1 })),
        Err(ModelError::Schedule { entry: last })
    );
    assert_eq!(
        with(&|s| s.push(Entry { operator: 99, first: 0, count: 1 })),
        Err(ModelError::Schedule { entry: last })
    );
    assert_eq!(
        with(&|s| s.push(Entry { operator: OUT, first: 8, count: 0 })),
        Err(ModelError::Schedule { entry: last })
    );
    assert_eq!(with(&|s| _ = s.pop()), Err(ModelError::Schedule { entry: last - 1 }), "left undone");
    assert_eq!(with(&|s| s[0].first = 1), Err(ModelError::Schedule { entry: 0 }), "not from the start");
    assert_eq!(with(&|s| s[0].count = 9), Err(ModelError::Schedule { entry: 0 }), "more than there are");
    assert!(with(&|s| s.insert(0, Entry { operator: OUT, first: 0, count: 1 })).is_err());
    assert_eq!(with(&|s| s.clear()), Err(ModelError::Schedule { entry: 0 }));
}

#[test]
fn a_sum_may_not_take_a_place_that_is_still_read() {
    let mut chain = chain();
    chain.draft.tensors[chain.sum].offset = chain.draft.tensors[chain.c].offset;
    assert_eq!(validate(&chain.draft), Ok(()), "in place");
    // The output reads c instead of the sum, which has overwritten c by then.
    let Operator::Conv(mut out) = chain.draft.operators[OUT] else { panic!() };
    out.first = chain.c as u32;
    chain.draft.operators[OUT] = Operator::Conv(out);
    assert!(validate(&chain.draft).is_err());
    // A convolution over the added tensor, in the same place.
    let mut chain = self::chain();
    chain.draft.tensors[chain.sum].offset = chain.draft.tensors[chain.c].offset;
    let Operator::Conv(mut sum) = chain.draft.operators[SUM] else { panic!() };
    sum.second = None;
    sum.first = chain.c as u32;
    chain.draft.operators[SUM] = Operator::Conv(sum);
    assert!(validate(&chain.draft).is_err());
}

/// A map that keeps one row may be overwritten by a sum that adds it, and by no other map.
#[test]
fn only_a_sum_takes_the_place_of_a_ring() {
    let mut chain = chain();
    let (c, sum) = (chain.c, chain.sum);
    (chain.draft.tensors[c].ring, chain.draft.tensors[sum].ring) = (1, 1);
    chain.draft.tensors[sum].offset = chain.draft.tensors[c].offset;
    assert_eq!(validate(&chain.draft), Ok(()));
    let Operator::Conv(mut conv) = chain.draft.operators[SUM] else { panic!() };
    conv.add = None;
    chain.draft.operators[SUM] = Operator::Conv(conv);
    let found = Model::new(&chain.draft.file()).map(|_| ());
    assert_eq!(found, Err(ModelError::Tensor { tensor: sum as u32 }));
}

#[test]
fn tensors_alive_together_may_not_share_bytes() {
    let chain = chain();
    for (one, other) in [(chain.a, chain.b), (chain.b, chain.sum), (chain.a, 0), (chain.sum, 5)] {
        for moved in [0, 1, chain.draft.tensors[other].size_bytes() - 1] {
            let mut draft = chain.draft.clone();
            draft.tensors[one].offset = draft.tensors[other].offset + moved;
            assert!(Model::new(&draft.file()).is_err(), "{one} on {other} + {moved}");
        }
    }
}

#[test]
fn tensors_may_share_bytes_one_after_the_other() {
    // Whole operators one by one: a is no longer needed when the sum is first written.
    let mut chain = chain();
    for t in [chain.a, chain.b, chain.c, chain.sum] {
        chain.draft.tensors[t].ring = ROWS;
    }
    chain.draft.in_order();
    chain.draft.tensors[chain.sum].offset = chain.draft.tensors[chain.a].offset + 5;
    assert_eq!(validate(&chain.draft), Ok(()));
}

#[test]
fn the_output_may_take_the_place_of_the_image_row_by_row() {
    // Row r of the output overwrites row r - 1 of the image, which is not read any more.
    let mut chain = chain();
    lay_on(&mut chain.draft, 0, 5, 24);
    let size = chain.draft.tensors[0].size_bytes();
    assert_eq!(validate(&chain.draft), Ok(()));
    assert!(size > 8 * ROWS, "rows lie apart");
    // On row r itself: c reads it last, before the output's row is written. Row r + 1 is still to be read.
    lay_on(&mut chain.draft, 0, 5, 16);
    assert_eq!(validate(&chain.draft), Ok(()));
    chain.draft.tensors[0].offset -= 24;
    assert!(validate(&chain.draft).is_err());
}

#[test]
fn the_two_inputs_may_not_share_bytes() {
    let mut chain = chain();
    // Rows of the coarse DTM may lie between those of the image, where its rows are far enough apart.
    for (offset, pitch, legal) in [(0, 8, false), (8, 8, false), (7, 8, false), (8, 16, true), (11, 16, false)] {
        chain.draft.tensors[0].pitch = pitch;
        chain.draft.tensors[0].offset = 100_000;
        let coarse = Tensor { hi: 255, offset: 100_000 + offset, pitch, ..Tensor::new(Dtype::U8, (ROWS, 6), 1) };
        let number = chain.draft.tensors.len() as u32;
        chain.draft.tensors.push(coarse);
        chain.draft.coarse = number;
        let refused = Err(ModelError::Tensor { tensor: number });
        assert_eq!(validate(&chain.draft), if legal { Ok(()) } else { refused }, "{offset} bytes on, pitch {pitch}");
        chain.draft.tensors.pop();
    }
}

#[test]
fn tensors_have_one_writer_and_inputs_none() {
    for out in [0, 1] {
        let mut chain = chain();
        let Operator::Conv(mut c) = chain.draft.operators[C] else { panic!() };
        c.out = out;
        chain.draft.operators[C] = Operator::Conv(c);
        assert!(Model::new(&chain.draft.file()).is_err(), "tensor {out}");
    }
}

#[test]
fn whatever_is_accepted_reads_what_it_should() {
    let (mut accepted, mut clean, rounds) = (0, 0, 60_000);
    for seed in 0..rounds {
        let mut random = Random::new(seed);
        let r = &mut random;
        let Chain { mut draft, a, b, c, sum } = chain();
        if r.one_in(3) {
            draft.in_order();
            [a, b, c, sum].iter().for_each(|t| draft.tensors[*t].ring = ROWS);
        }
        if r.one_in(2) {
            draft.tensors[sum].offset = draft.tensors[c].offset;
        }
        if r.one_in(2) {
            // The output's rows end where the rows of a map that is kept whole begin.
            let (on, out) = (r.pick(&[0, a, c]), draft.tensors.len() - 1);
            draft.tensors[on].ring = ROWS;
            lay_on(&mut draft, on, out, 24);
        }
        for _ in 0..r.size(1, 3) {
            mutate(r, &mut draft);
        }
        let found = Model::new(&draft.file()).is_ok();
        let shadow = shadow::play(&draft);
        clean += shadow.is_ok() as usize;
        if found {
            accepted += 1;
            assert_eq!(shadow, Ok(()), "seed {seed}: {:?} {:?}", draft.tensors, draft.schedule);
        }
    }
    println!("{accepted} of {rounds} accepted, {clean} clean");
    assert!(accepted > rounds as usize / 20 && accepted < clean, "{accepted} accepted, {clean} clean");
}

/// Places rows of `one` between rows of `other`, with one pitch, `skew` bytes behind the start of `other`.
fn lay_on(draft: &mut Draft, one: usize, other: usize, skew: usize) {
    let pitch = draft.tensors[one].pitch.max(draft.tensors[other].pitch);
    draft.tensors[one].offset = draft.tensors[other].offset + skew;
    (draft.tensors[one].pitch, draft.tensors[other].pitch) = (pitch, pitch);
}

fn mutate(r: &mut Random, draft: &mut Draft) {
    let tensor = r.size(1, draft.tensors.len() - 2);
    let at = r.size(0, draft.schedule.len() - 1);
    let other = r.size(0, draft.schedule.len() - 1);
    match r.size(0, 8) {
        8 => {
            let (onto, skew) = (r.size(0, draft.tensors.len() - 1), r.pick(&[0, 8, 16, 24, 32, 1]));
            lay_on(draft, tensor, onto, skew);
            if r.one_in(2) {
                (draft.tensors[tensor].ring, draft.tensors[onto].ring) = (ROWS, ROWS);
            }
        }
        0 => draft.tensors[tensor].ring = r.size(1, ROWS),
        1 => {
            let onto = r.size(0, draft.tensors.len() - 1);
            let moved = r.pick(&[0, 0, 1, draft.tensors[onto].row_bytes()]);
            draft.tensors[tensor].offset = draft.tensors[onto].offset + moved;
        }
        2 => draft.schedule.swap(at, other),
        3 => {
            let entry = draft.schedule.remove(at);
            draft.schedule.insert(other.min(draft.schedule.len()), entry);
        }
        4 => {
            // Cut an entry in two.
            let entry = draft.schedule[at];
            if entry.count > 1 {
                let first = r.size(1, entry.count - 1);
                draft.schedule[at].count = first;
                let rest = Entry { first: entry.first + first, count: entry.count - first, ..entry };
                draft.schedule.insert(at + 1, rest);
            }
        }
        5 => {
            // Another source or another added map.
            let operator = r.size(1, draft.operators.len() - 1);
            let Operator::Conv(mut conv) = draft.operators[operator] else { return };
            let input = r.size(1, draft.tensors.len() - 2) as u32;
            if r.one_in(2) && conv.add.is_some() {
                conv.add = Some(input)
            } else {
                conv.first = input
            }
            draft.operators[operator] = Operator::Conv(conv);
        }
        6 => draft.schedule[at].count = r.size(0, 3),
        _ => draft.schedule[at].first = r.size(0, ROWS),
    }
}

#[test]
fn whatever_program_is_accepted_reads_what_it_should() {
    let (mut accepted, mut shared, rounds) = (0, 0, 60_000);
    for seed in 0..rounds {
        let draft = random_program(&mut Random::new(seed));
        if Model::new(&draft.file()).is_ok() {
            accepted += 1;
            shared += overlaps(&draft) as usize;
            assert_eq!(shadow::play(&draft), Ok(()), "seed {seed}: {:#?} {:?}", draft.tensors, draft.schedule);
        }
    }
    println!("{accepted} of {rounds} accepted, {shared} of them with tensors that share bytes");
    assert!(shared > rounds as usize / 100, "{shared}");
}

/// Returns convolutions of any earlier maps, in any order of steps that writes rows before they are read, with tensors at any place.
fn random_program(r: &mut Random) -> Draft {
    let mut draft = Draft::new((ROWS, 6));
    let pitch = r.pick(&[16, 24, 24, 32, 48]);
    (draft.tensors[0].margin, draft.tensors[0].pitch) = (1, pitch);
    let place = |r: &mut Random| if r.one_in(2) { 8 * r.size(0, 9) } else { pitch * r.size(0, 30) };
    draft.tensors[0].offset = place(r);
    let count = r.size(1, 4);
    for number in 1..=count + 1 {
        let last = number > count;
        let t = if last { Tensor::new(Dtype::F32, (ROWS, 6), 1) } else { Tensor::new(Dtype::U8, (ROWS, 6), 2) };
        let t = Tensor { hi: if last { 0 } else { 255 }, margin: !last as usize, ..t };
        let ring = if last || r.one_in(2) { ROWS } else { r.size(1, ROWS) };
        draft.tensors.push(Tensor { offset: place(r), pitch: pitch.max(t.row_bytes()), ring, ..t });
        let input = r.size(0, number - 1) as u32;
        let mut conv = draft.silent(input, number as u32, r.pick(&[(1, 1, 0), (3, 1, 1)]));
        if !last && number > 1 && r.one_in(2) {
            let add = r.size(1, number - 1);
            (conv.add, conv.add_multipliers) = (Some(add as u32), conv.multipliers);
            if r.one_in(2) {
                draft.tensors[number] = Tensor { ..draft.tensors[add] };
            }
        }
        draft.operator(Operator::Conv(conv));
    }
    draft.output = count as u32 + 1;
    order(r, &mut draft);
    draft
}

/// Orders the steps of operators at random: each step as soon as its rows are written, or later.
fn order(r: &mut Random, draft: &mut Draft) {
    let mut done = vec![0; draft.operators.len()];
    let mut favourite = 0;
    while done.iter().any(|d| *d < ROWS) {
        if r.one_in(2) {
            favourite = r.size(0, done.len() - 1);
        }
        let ready = |op: usize| {
            let operator = &draft.operators[op];
            let made = |t: u32| if t == 0 { ROWS } else { done[t as usize - 1] };
            let reads = operator.inputs().into_iter().enumerate();
            let out = &draft.tensors[operator.output() as usize];
            done[op] < ROWS
                && reads
                    .filter_map(|(slot, t)| Some((slot, t?)))
                    .all(|(slot, t)| operator.rows_read(out, slot, ROWS, done[op]).end <= made(t))
        };
        let next = Some(favourite).filter(|op| ready(*op)).or_else(|| (0..done.len()).find(|op| ready(*op)));
        let Some(operator) = next else { unreachable!("inputs come first") };
        draft.schedule.push(Entry { operator, first: done[operator], count: 1 });
        done[operator] += 1;
    }
}

fn overlaps(draft: &Draft) -> bool {
    let tensors = &draft.tensors;
    (0..tensors.len()).any(|a| (0..a).any(|b| tensors[a].overlaps(&tensors[b])))
}
