//! Compares the rows that operators write and read with the definitions.

use super::Random;
use super::conv::phases;
use crate::nn::file::{Attention, Conv, Dtype, LayerNorm, Operator, PHASE_TAPS, Phase, Tensor, Upsample2};
use crate::nn::ops::Prepared;
use proptest::prelude::*;
use std::collections::BTreeSet;

#[test]
fn phases_read_what_an_upsampled_patch_needs() {
    for len in 4..40usize {
        for index in 0..2 * len {
            let found = Phase::of(index, len);
            let read: Vec<isize> = (found.first..).take(PHASE_TAPS[found.filter]).collect();
            let correction = found.correction.map(|(number, at)| (number, vec![at as isize]));
            let all: Vec<_> = std::iter::once((found.filter, read.clone())).chain(correction).collect();
            assert_eq!(all, phases(index, len), "output {index} of {len}");
            // The five samples of the upsampled map lie between these samples of the small map; samples in the padding have a correction.
            let seen = index as isize - 2..=index as isize + 2;
            let centres = seen.clone().map(|at| (at as f64 + 0.5) / 2.0 - 0.5);
            let needed: BTreeSet<isize> = centres.flat_map(|c| [c.floor() as isize, c.ceil() as isize]).collect();
            assert_eq!(read.into_iter().collect::<BTreeSet<_>>(), needed, "output {index} of {len}");
            let padded = seen.clone().any(|at| !(0..2 * len as isize).contains(&at));
            assert_eq!(found.correction.is_some(), padded, "output {index} of {len}");
        }
    }
}

fn attention(window: usize, shift_rows: usize) -> Attention {
    Attention { heads: 1, window, shift_rows, ..Attention::default() }
}

#[test]
fn pieces_are_the_windows_of_the_cyclic_shift_without_the_masked_part() {
    for window in 1..9usize {
        for (len, shift) in (1..30usize).flat_map(|len| (0..window.min(len)).map(move |shift| (len, shift))) {
            // On the extended and shifted axis, places with the same window and the same side of the seam belong together.
            let whole = len.div_ceil(window) * window;
            let mut together = std::collections::BTreeMap::<(usize, bool), BTreeSet<usize>>::new();
            for at in 0..whole {
                together.entry((at / window, at + shift >= whole)).or_default().insert((at + shift) % whole);
            }
            let mut pieces: Vec<(usize, usize)> = together
                .values()
                .map(|piece| {
                    let (first, last) = (*piece.first().unwrap(), *piece.last().unwrap());
                    assert_eq!(last + 1 - first, piece.len(), "a piece has no holes");
                    (first, last + 1)
                })
                .filter(|(first, _)| *first < len)
                .collect();
            pieces.sort();
            let a = attention(window, shift);
            let found: Vec<(usize, usize)> = (0..a.pieces(len, shift)).map(|i| a.piece(len, shift, i)).collect();
            assert_eq!(found, pieces, "{len} pixels, windows of {window}, shift {shift}");
            let (op, out) = (Operator::Attention(a), Tensor::new(Dtype::U8, (len, 1), 1));
            assert_eq!((op.rows_after(&out, 0), op.rows_after(&out, op.steps(&out))), (0, len));
            for (step, piece) in pieces.iter().enumerate() {
                assert_eq!(op.rows_read(&out, 0, len, step), piece.0..piece.1.min(len));
            }
        }
    }
}

/// Returns the smallest range that contains all of `rows`; `None` if `rows` is empty.
fn span(rows: impl Iterator<Item = usize>) -> Option<(usize, usize)> {
    let rows: BTreeSet<usize> = rows.collect();
    Some((*rows.first()?, rows.last()? + 1))
}

proptest! {
    #[test]
    fn rows_read_are_those_under_the_kernel(
        rows in 1usize..40, kernel in 1usize..16, pad in 0usize..15, stride in 1usize..16,
    ) {
        prop_assume!(pad < kernel && rows + 2 * pad >= kernel);
        let out = Tensor::new(Dtype::U8, ((rows + 2 * pad - kernel) / stride + 1, 1), 1);
        let conv = Conv { kernel_rows: kernel, kernel_cols: kernel, stride, pad, ..Conv::default() };
        let op = Operator::Conv(conv);
        for step in 0..op.steps(&out) {
            let under = (step * stride..step * stride + kernel).filter_map(|r| r.checked_sub(pad)).filter(|r| *r < rows);
            let read = op.rows_read(&out, 0, rows, step);
            prop_assert_eq!(Some((read.start, read.end)), span(under));
            prop_assert_eq!(op.rows_read(&out, 2, out.rows, step), step..step + 1);
            prop_assert_eq!(op.rows_after(&out, step + 1), step + 1);
        }
    }

    #[test]
    fn upsamplings_make_two_rows_from_their_neighbours(rows in 4usize..40) {
        let out = Tensor::new(Dtype::U8, (2 * rows, 1), 1);
        let upsample = Operator::Upsample2(Upsample2::default());
        prop_assert_eq!(upsample.steps(&out), rows);
        for step in 0..rows {
            let bilinear = |at: usize| {
                let centre = (at as f64 + 0.5) / 2.0 - 0.5;
                [centre.floor().max(0.0) as usize, (centre.ceil() as usize).min(rows - 1)]
            };
            let own = span((2 * step..2 * step + 2).flat_map(bilinear));
            let read = upsample.rows_read(&out, 0, rows, step);
            prop_assert_eq!(Some((read.start, read.end)), own);
            prop_assert_eq!(upsample.rows_after(&out, step + 1), 2 * step + 2);
        }
    }

    #[test]
    fn folded_convolutions_read_what_their_phases_read(rows in 4usize..40, block in 1usize..17) {
        let out = Tensor::new(Dtype::U8, (2 * rows, 1), 1);
        let fold = Operator::Conv(Conv { kernel_rows: 5, kernel_cols: 5, pad: 2, fold: true, block, ..Conv::default() });
        prop_assert_eq!(fold.steps(&out), rows.div_ceil(block));
        for step in 0..fold.steps(&out) {
            let made = 2 * block * step..(2 * block * (step + 1)).min(2 * rows);
            let clamp = |sample: isize| sample.clamp(0, rows as isize - 1) as usize;
            let needed = span(made.clone().flat_map(|row| phases(row, rows)).flat_map(|phase| phase.1).map(clamp));
            let read = fold.rows_read(&out, 0, rows, step);
            prop_assert_eq!(Some((read.start, read.end)), needed);
            prop_assert_eq!(fold.rows_read(&out, 2, 2 * rows, step), made.clone());
            prop_assert_eq!(fold.rows_after(&out, step + 1), made.end);
        }
    }

    #[test]
    fn norms_read_the_rows_they_merge(step in 0usize..50, merge in 1usize..3) {
        let norm = LayerNorm { merge, shift: 1, epsilon: 1, ..LayerNorm::default() };
        let (op, out) = (Operator::LayerNorm(norm), Tensor::new(Dtype::U8, (50, 1), 1));
        prop_assert_eq!(op.rows_read(&out, 0, 50 * merge, step), merge * step..merge * (step + 1));
        prop_assert_eq!((op.steps(&out), op.rows_after(&out, step)), (50, step));
    }

    #[test]
    fn a_few_steps_decide_for_all(seed in any::<u64>()) {
        let (op, out, rows) = any_reach(&mut Random::new(seed));
        let steps = op.steps(&out);
        for slot in [0, 2] {
            let rows = if slot == 2 { out.rows } else { rows };
            let reads = |step: usize| op.rows_read(&out, slot, rows, step);
            for (first, end) in [(0, steps), (steps / 3, steps), (0, steps.div_ceil(2)), (steps / 4, 3 * steps / 4)] {
                for after in [0, 1] {
                    let lead = |step: usize| op.rows_after(&out, step + after) as isize - reads(step).start as isize;
                    let all = (first..end).map(lead).max();
                    prop_assert_eq!(op.deciding_steps(&(first..end)).map(lead).max(), all, "{:?}, {:?}", op, first..end);
                }
            }
            for step in 0..steps {
                prop_assert!(!reads(step).is_empty() && reads(step).len() <= op.most_rows_read(slot, rows));
                let written = op.rows_after(&out, step + 1) - op.rows_after(&out, step);
                prop_assert!(step == 0 || reads(step).start >= reads(step - 1).start);
                prop_assert!(step == 0 || reads(step).end >= reads(step - 1).end);
                prop_assert!(written <= op.most_rows_written(&out));
            }
        }
    }

    #[test]
    fn the_cost_of_an_operator_is_that_of_its_units(seed in any::<u64>()) {
        let mut r = Random::new(seed);
        let (operator, out, rows) = any_reach(&mut r);
        let channels = r.size(1, 70);
        let cols = if matches!(operator, Operator::Conv(_) | Operator::Attention(_)) { 2 * r.size(8, 30) } else { out.cols };
        let out = Tensor { cols, channels, ..out };
        let input = Tensor { rows, cols, channels, ..out };
        let prepared = Prepared { operator, out, inputs: [Some(input), None, None], checked: true };
        let units = (0..prepared.steps()).flat_map(|step| (0..prepared.units()).map(move |unit| (step, unit)));
        let macs = units.clone().map(|(step, unit)| prepared.unit_macs(step, unit));
        let macs = macs.sum::<u64>();
        prop_assert_eq!(prepared.macs(), macs, "{:?}", operator);
        let work = units.map(|(step, unit)| prepared.unit_work(step, unit));
        let expected = match operator {
            Operator::Conv(_) => macs * input.dtype.bytes().min(2) as u64 + 16 * out.len() as u64,
            Operator::Attention(_) => macs / 2 * 3,
            Operator::LayerNorm(_) => 40 * out.len() as u64,
            Operator::Upsample2(_) => 16 * out.len() as u64,
        };
        prop_assert_eq!(expected, work.clone().sum::<u64>(), "{:?}", operator);
        let bytes = operator.most_rows_read(0, rows) * input.row_bytes() + operator.most_rows_written(&out) * out.row_bytes();
        prop_assert_eq!(prepared.largest_unit(), work.max().unwrap() + bytes as u64, "{:?}", operator);
    }
}

/// Returns an operator, its output and the rows of its input.
fn any_reach(r: &mut Random) -> (Operator, Tensor, usize) {
    let rows = r.size(16, 60);
    let out = |rows: usize| Tensor::new(Dtype::U8, (rows, 20), 1);
    match r.size(0, 5) {
        0 => (Operator::Upsample2(Upsample2::default()), out(2 * rows), rows),
        1 => {
            let merge = r.size(1, 2);
            let norm = LayerNorm { merge, shift: 1, epsilon: 1, ..LayerNorm::default() };
            (Operator::LayerNorm(norm), out(rows), merge * rows)
        }
        2 => {
            let window = r.size(1, 8);
            let (shift_rows, shift_cols) = (r.size(0, window - 1), r.size(0, window - 1));
            (Operator::Attention(Attention { shift_cols, ..attention(window, shift_rows) }), out(rows), rows)
        }
        3 => {
            let block = r.size(1, 16);
            let fold = Conv { kernel_rows: 5, kernel_cols: 5, pad: 2, fold: true, block, ..Conv::default() };
            (Operator::Conv(fold), out(2 * rows), rows)
        }
        _ => {
            let kernel_rows = r.size(1, 15);
            let pad = r.size(0, kernel_rows - 1);
            let (stride, block) = (r.size(1, 15), r.size(1, 16));
            let conv = Conv { kernel_rows, kernel_cols: kernel_rows, pad, stride, block, ..Conv::default() };
            (Operator::Conv(conv), out((rows + 2 * pad - kernel_rows) / stride + 1), rows)
        }
    }
}
