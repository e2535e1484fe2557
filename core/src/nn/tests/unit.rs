//! Runs one operator with every kernel, in an arena filled with random bytes.

use super::draft::Draft;
use super::{Random, kernels};
use crate::nn::arena::Arena;
use crate::nn::file::{Dtype, Edge, Operator, Tensor};
use crate::nn::{Kernel, Model, required};

/// Values of a map (zero points removed; with F32 the bits), `[rows][cols][channels]`.
pub(super) type Map = Vec<i64>;

/// Returns random codes for a tensor, as values.
pub(super) fn random_map(random: &mut Random, t: &Tensor) -> Map {
    let codes = random.list(t.len(), t.lo as i64, t.hi as i64);
    codes.into_iter().map(|code| code - t.zero as i64).collect()
}

/// Writes a map into a tensor that keeps all its rows, margins included.
pub(super) fn fill(bytes: &mut [u8], t: &Tensor, values: &[i64]) {
    let last = t.cols as isize - 1;
    for row in 0..t.rows {
        for col in -(t.margin as isize)..=last + t.margin as isize {
            for k in 0..t.channels {
                let at = |col: isize| values[(row * t.cols + col as usize) * t.channels + k];
                let value = match t.edge {
                    _ if (0..=last).contains(&col) => at(col),
                    Edge::Zero => 0,
                    Edge::Nearest => at(col.clamp(0, last)),
                };
                let code = value + t.zero as i64;
                let plane = (t.cols + 2 * t.margin) * t.channels;
                let place = t.offset + row * t.pitch + (col + t.margin as isize) as usize * t.channels + k;
                bytes[place] = code.rem_euclid(256) as u8;
                if t.dtype == Dtype::I16 {
                    bytes[place + plane] = (code.div_euclid(256) + 128) as u8;
                }
            }
        }
    }
}

/// Returns one row of a tensor, with margins: `[margin + cols + margin][channels]`.
fn row_now(bytes: &[u8], t: &Tensor, row: usize) -> Map {
    let samples = (t.cols + 2 * t.margin) * t.channels;
    let start = t.offset + row % t.ring * t.pitch;
    let sample = |i: usize| match t.dtype {
        Dtype::U8 => bytes[start + i] as i64 - t.zero as i64,
        Dtype::I16 => (bytes[start + samples + i] as i64 - 128) * 256 + bytes[start + i] as i64,
        Dtype::F32 => u32::from_le_bytes(bytes[start + 4 * i..][..4].try_into().unwrap()) as i64,
    };
    (0..samples).map(sample).collect()
}

/// The expected result of an operator.
pub(super) struct Expected {
    pub(super) map: Map,
    /// Results cut to their tensor's range; `None` if the simple implementation does not count them.
    pub(super) cut: Option<u64>,
}

/// Runs operator `index` of a draft step by step with every kernel on `inputs`. Every row must be within `tolerance` of the expected one,
/// margins included, and no other byte of the tensors may change. Returns the results.
pub(super) fn check(draft: &Draft, index: usize, inputs: &[(u32, &Map)], expected: &Expected, tolerance: i64) -> Map {
    let file = draft.file();
    let model = Model::new(&file).unwrap_or_else(|e| panic!("{e}: {:?}", draft.operators[index]));
    let operator = model.operator(index).unwrap();
    let mut rubbish = Random::new(index as u64 + file.len() as u64);
    let mut before = rubbish.bytes(required(&model));
    inputs.iter().for_each(|(tensor, map)| fill(&mut before, &model.tensor(*tensor), map));
    let mut results: Option<(Map, u64)> = None;
    for kernel in kernels() {
        let mut bytes = before.clone();
        let found = run(kernel, &model, &operator, &mut bytes, &before);
        if let Some(cut) = expected.cut {
            assert_eq!(found.1, cut, "cut by {kernel:?}: {operator:?}");
        }
        assert_eq!(found.0.len(), expected.map.len());
        for (i, (a, b)) in found.0.iter().zip(&expected.map).enumerate() {
            assert!((a - b).abs() <= tolerance, "{kernel:?}, sample {i}: {a}, expected {b}: {operator:?}");
        }
        // Kernels agree in every bit, whatever the tolerance.
        assert!(*results.get_or_insert_with(|| found.clone()) == found, "{kernel:?}: {operator:?}");
    }
    results.map_or(Vec::new(), |r| r.0)
}

fn run(kernel: Kernel, model: &Model<'_>, operator: &Operator, bytes: &mut [u8], before: &[u8]) -> (Map, u64) {
    let out = model.tensor(operator.output());
    let (mut map, mut cut) = (Vec::new(), 0);
    for step in 0..operator.steps(&out) {
        for unit in 0..model.units(operator) {
            let mut arena = Arena { bytes: &mut *bytes, scratch: model.scratch_offset() };
            let made = (kernel.unit)(model.constants(), &model.prepared(operator), &mut arena, step, unit);
            cut += made.expect("the products are right");
        }
        for row in operator.rows_after(&out, step)..operator.rows_after(&out, step + 1) {
            let (line, side) = (row_now(bytes, &out, row), out.margin * out.channels);
            let inner = &line[side..line.len() - side];
            check_margins(&out, &line, inner);
            map.extend_from_slice(inner);
        }
    }
    let mine = |i: usize| {
        (out.offset..out.offset + out.size_bytes()).contains(&i) && (i - out.offset) % out.pitch < out.row_bytes()
    };
    let changed = (0..model.scratch_offset()).find(|i| !mine(*i) && bytes[*i] != before[*i]);
    assert_eq!(changed, None, "a byte outside the output: {operator:?}");
    (map, cut)
}

fn check_margins(t: &Tensor, line: &[i64], inner: &[i64]) {
    for m in 0..t.margin {
        let (left, right) = (&line[m * t.channels..], &line[(t.margin + t.cols + m) * t.channels..]);
        let (first, last) = match t.edge {
            Edge::Zero => (vec![0; t.channels], vec![0; t.channels]),
            Edge::Nearest => (inner[..t.channels].to_vec(), inner[inner.len() - t.channels..].to_vec()),
        };
        assert_eq!((&left[..t.channels], &right[..t.channels]), (&first[..], &last[..]), "margin column {m}");
    }
}
