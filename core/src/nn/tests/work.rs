//! The work of a validation is proportional to the file: files made to take long are accepted or refused within the limit.

use super::draft::Draft;
use crate::nn::file::{Attention, Dtype, Entry, MAX_WORK, ModelError, Operator, OperatorFault, Tensor};
use crate::nn::{Model, ModelError as Error};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

/// Returns the processor's time of this thread where the system tells it, because other programs take none of that; else the clock's.
fn now() -> Duration {
    static BEGIN: LazyLock<Instant> = LazyLock::new(Instant::now);
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text.split(' ').next().and_then(|text| text.parse().ok()).filter(|spent| *spent > 0);
    nanoseconds.map_or_else(|| BEGIN.elapsed(), Duration::from_nanos)
}

/// Validates a file; its work must be within the limit, and its time far below what steps or windows one by one would take.
fn validate(name: &str, draft: &Draft) -> Result<(), Error> {
    let file = draft.file();
    let (mut work, begin) = (0, now());
    let found = Model::new_counted(&file, &mut work).map(|_| ());
    let (time, ratio) = (now().saturating_sub(begin), work as f64 / file.len() as f64);
    println!("{name}: {} bytes, {ratio:.1} of {MAX_WORK} for each, {time:?}, {found:?}", file.len());
    assert!(work <= MAX_WORK * file.len() as u64, "{name}");
    // Milliseconds to a tenth of a second; what is played step by step, or window by window, takes minutes.
    assert!(time < Duration::from_secs(20), "{name}: {time:?}");
    found
}

/// `count` maps of one column, each computed from the one before by a 1x1 convolution, and the output.
fn line(count: usize, rows: usize, offset: impl Fn(usize) -> usize) -> Draft {
    let mut draft = Draft::new((rows, 1));
    draft.tensors[0].offset = offset(0);
    let t = Tensor { hi: 255, pitch: 1, ..Tensor::new(Dtype::U8, (rows, 1), 1) };
    let first = draft.silent(0, 0, (1, 1, 0));
    for number in 1..count {
        draft.tensors.push(Tensor { offset: offset(number), ..t });
        let conv = crate::nn::file::Conv { out: number as u32, first: number as u32 - 1, ..first };
        draft.operator(Operator::Conv(conv));
    }
    let end = draft.tensors.iter().map(|t| t.offset + t.size_bytes()).max().unwrap();
    draft.output = count as u32;
    draft.tensors.push(Tensor { offset: end.next_multiple_of(64), pitch: 4, ..Tensor::new(Dtype::F32, (rows, 1), 1) });
    let conv = draft.silent(count as u32 - 1, draft.output, (1, 1, 0));
    draft.operator(Operator::Conv(conv));
    draft
}

/// Runs every operator over its first step, then over the others, so that all maps are in use all the time.
fn interleave(draft: &mut Draft) {
    draft.in_order();
    let whole = draft.schedule.clone();
    let heads = whole.iter().map(|e| Entry { count: 1, ..*e });
    let tails = whole.iter().map(|e| Entry { first: 1, count: e.count - 1, ..*e });
    draft.schedule = heads.chain(tails).collect();
}

#[test]
fn lines_of_maps_that_overwrite_each_other() {
    for (count, rows) in [(300, 4000), (510, 16384), (40, 16384), (8, 16384)] {
        let mut draft = line(count, rows, |number| count - number);
        draft.in_order();
        _ = validate(&format!("{count} maps a row apart, {rows} rows"), &draft);
        interleave(&mut draft);
        let found = validate(&format!("{count} maps a row apart, {rows} rows, interleaved"), &draft);
        // Short lines are legal, however many rows they have. Of long ones every map is compared with every other.
        match count {
            ..10 => assert_eq!(found, Ok(())),
            100.. => assert_eq!(found, Err(Error::Work)),
            _ => {}
        }
    }
}

#[test]
fn lines_of_sums() {
    for (count, rows) in [(300, 4000), (510, 16384), (8, 16384)] {
        let mut draft = line(count, rows, |number| rows * number.min(1));
        for (index, operator) in draft.operators.iter_mut().enumerate().take(count - 1).skip(1) {
            let Operator::Conv(conv) = operator else { unreachable!() };
            (conv.first, conv.add, conv.add_multipliers) = (0, Some(index as u32), conv.multipliers);
        }
        draft.in_order();
        let found = validate(&format!("{count} sums in one place, {rows} rows"), &draft);
        assert!(count > 100 || found.is_ok(), "{found:?}");
        interleave(&mut draft);
        let found = validate(&format!("{count} sums in one place, {rows} rows, interleaved"), &draft);
        assert_eq!(found, if count > 100 { Err(Error::Work) } else { Ok(()) });
    }
}

#[test]
fn maps_apart_with_many_rows() {
    let (count, rows) = (510, 16384);
    let mut draft = line(count, rows, |number| number * rows);
    interleave(&mut draft);
    _ = validate("510 maps apart, interleaved", &draft);
    draft.in_order();
    assert_eq!(validate("510 maps apart", &draft), Ok(()), "the largest number of records, with the most rows");
}

#[test]
fn schedules_of_single_steps() {
    let mut draft = line(4, 16384, |number| number * 16384);
    draft.schedule.clear();
    for step in 0..16000 {
        draft.schedule.extend((0..4).map(|operator| Entry { operator, first: step, count: 1 }));
    }
    draft.schedule.extend((0..4).map(|operator| Entry { operator, first: 16000, count: 384 }));
    assert_eq!(validate("64,000 steps one by one", &draft), Ok(()));
}

#[test]
fn attentions_with_many_windows() {
    let (side, count) = ((4096, 4096), 500);
    let mut draft = Draft::new(side);
    let input = draft.made(Tensor { zero: 128, lo: 1, hi: 255, ring: 1, ..Tensor::new(Dtype::U8, side, 3) });
    let out = draft.place(Tensor { hi: 255, ring: 1, ..Tensor::new(Dtype::U8, side, 1) });
    let one = draft.words([1]);
    let (pad_codes, position_bias) = (draft.constant([1; 3]), draft.constant([0; 2]));
    let exp_table = draft.constant([0, 0x40].repeat(96));
    let attention = Attention {
        out,
        input,
        heads: 1,
        window: 1,
        shift_rows: 0,
        shift_cols: 0,
        pad_codes,
        logit_multipliers: one,
        logit_shift: 1,
        position_bias,
        exp_table,
        multipliers: one,
        shift: 1,
    };
    (0..count).for_each(|_| _ = draft.operator(Operator::Attention(attention)));
    draft.finish();
    draft.in_order();
    assert!(validate("500 attentions of 16,777,216 windows", &draft).is_err());
}

#[test]
fn weights_that_many_operators_share() {
    for (count, legal) in [(500, false), (10, true)] {
        let channels = 1024;
        let mut draft = Draft::new((1, 1));
        let t = Tensor { hi: 255, ..Tensor::new(Dtype::U8, (1, 1), channels) };
        let first = draft.made(t);
        let second = draft.place(t);
        let shared = draft.silent(first, second, (1, 1, 0));
        draft.operator(Operator::Conv(shared));
        for _ in 2..count {
            let before = draft.tensors.len() as u32 - 1;
            let out = draft.place(t);
            draft.operator(Operator::Conv(crate::nn::file::Conv { out, first: before, ..shared }));
        }
        draft.finish();
        draft.in_order();
        let found = validate(&format!("{count} convolutions with the same {channels} x {channels} weights"), &draft);
        match found {
            Err(ModelError::Operator { reason: OperatorFault::Work, .. }) => assert!(!legal),
            found => assert!(legal && found.is_ok(), "{found:?}"),
        }
    }
}
