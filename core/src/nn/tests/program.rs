//! Encodes and decodes records.

use super::Random;
use crate::nn::file::{
    Attention, Conv, Dtype, Edge, Entry, LayerNorm, MAX_MARGIN, NONE, OPERATOR_BYTES, Operator, OperatorFault, Tensor,
    Upsample2, seal_record,
};
use proptest::prelude::*;

fn legal_tensor(r: &mut Random) -> Tensor {
    let dtype = r.pick(&[Dtype::U8, Dtype::I16, Dtype::F32]);
    let (low, high) = match dtype {
        Dtype::U8 => (0, 255),
        Dtype::I16 => (-32767, 32767),
        Dtype::F32 => (0, 0),
    };
    let lo = r.within(low, high);
    let (rows, pitch) = (r.size(1, 1 << 20), r.size(1, 1 << 24));
    Tensor {
        zero: if dtype == Dtype::U8 { r.within(low, high) as i32 } else { 0 },
        lo: lo as i32,
        hi: r.within(lo, high) as i32,
        offset: r.size(0, u32::MAX as usize),
        scale: r.within(1, 1 << 20) as f32 / 1024.0,
        ring: r.size(1, rows),
        pitch,
        margin: if dtype == Dtype::F32 { 0 } else { r.size(0, MAX_MARGIN) },
        edge: r.pick(&[Edge::Zero, Edge::Nearest]),
        cols: r.size(0, u32::MAX as usize),
        channels: r.size(0, u32::MAX as usize),
        ..Tensor::new(dtype, (rows, 1), 1)
    }
}

fn word(r: &mut Random) -> u32 {
    let any = r.next() as u32;
    r.pick(&[0, 1, NONE - 1, any, any])
}

fn any_operator(r: &mut Random) -> Operator {
    let mut size = || word(r) as usize;
    let sizes: [usize; 9] = std::array::from_fn(|_| size());
    let [w, x, y, z] = std::array::from_fn(|_| word(r));
    match r.size(0, 3) {
        0 => Operator::Conv(Conv {
            out: w,
            first: x,
            second: r.one_in(2).then_some(y),
            kernel_rows: sizes[0],
            kernel_cols: sizes[1],
            stride: sizes[2],
            stride_cols: sizes[8],
            block: sizes[3],
            pad: sizes[3],
            fold: r.one_in(2),
            weights: sizes[4],
            bias: sizes[5],
            multipliers: sizes[6],
            shift: z,
            add: r.one_in(2).then_some(word(r)),
            add_multipliers: sizes[7],
            add_shift: word(r),
            table: r.one_in(2).then_some(word(r) as usize % NONE as usize),
            table_zero: word(r) as i32,
            relu: r.one_in(2),
        }),
        1 => Operator::LayerNorm(LayerNorm {
            out: w,
            input: x,
            merge: sizes[0],
            gains: sizes[1],
            biases: sizes[2],
            shift: y,
            epsilon: r.next() as i64,
        }),
        2 => Operator::Attention(Attention {
            out: w,
            input: x,
            heads: sizes[0],
            window: sizes[1],
            shift_rows: sizes[2],
            shift_cols: sizes[3],
            pad_codes: sizes[4],
            logit_multipliers: sizes[5],
            logit_shift: y,
            position_bias: sizes[6],
            exp_table: sizes[7],
            multipliers: word(r) as usize,
            shift: z,
        }),
        _ => Operator::Upsample2(Upsample2 { out: w, input: x }),
    }
}

proptest! {
    #[test]
    fn tensors_come_back(seed in any::<u64>()) {
        let tensor = legal_tensor(&mut Random::new(seed));
        prop_assert_eq!(Tensor::decode(&tensor.encode()), Some(tensor));
        prop_assert_eq!(Tensor::read(&tensor.encode()), tensor);
    }

    #[test]
    fn operators_come_back(seed in any::<u64>()) {
        let operator = any_operator(&mut Random::new(seed));
        prop_assert_eq!(Operator::decode(&operator.encode()), Ok(operator));
    }

    #[test]
    fn entries_come_back(operator in 0usize..65536, first in 0usize..65536, count in 0usize..65536) {
        let entry = Entry { operator, first, count };
        prop_assert_eq!(Entry::decode(&entry.encode()), Some(entry));
    }

    #[test]
    fn any_record_is_a_tensor_within_its_limits_or_none(seed in any::<u64>()) {
        // Legal records with one word replaced.
        let mut r = Random::new(seed);
        let mut record = legal_tensor(&mut r).encode();
        let at = 4 * r.size(0, 12);
        record[at..at + 4].copy_from_slice(&word(&mut r).to_le_bytes());
        seal_record(&mut record);
        if let Some(t) = Tensor::decode(&record) {
            prop_assert!(t.lo <= t.hi && (1..=t.rows).contains(&t.ring) && t.margin <= MAX_MARGIN && t.scale > 0.0);
            let codes = match t.dtype {
                Dtype::U8 => 0..=255,
                Dtype::I16 => -32767..=32767,
                Dtype::F32 => 0..=0,
            };
            prop_assert!([t.lo, t.hi, t.zero].iter().all(|c| codes.contains(c)));
            prop_assert_eq!(t.encode(), record);
        }
    }
}

#[test]
fn tensors_outside_their_limits_are_refused() {
    let good = Tensor { hi: 255, zero: 7, pitch: 8, ..Tensor::new(Dtype::U8, (4, 4), 2) };
    let wide = Tensor { lo: -5, hi: 5, pitch: 16, ..Tensor::new(Dtype::I16, (4, 4), 2) };
    let float = Tensor { pitch: 32, ..Tensor::new(Dtype::F32, (4, 4), 2) };
    for (name, bad) in [
        ("code below u8", Tensor { lo: -1, ..good }),
        ("code above u8", Tensor { hi: 256, ..good }),
        ("zero above u8", Tensor { zero: 256, ..good }),
        ("ends exchanged", Tensor { lo: 9, hi: 8, ..good }),
        ("code below i16", Tensor { lo: -32768, ..wide }),
        ("16 bits with a zero point", Tensor { zero: 1, ..wide }),
        ("codes of floats", Tensor { hi: 1, ..float }),
        ("floats with a margin", Tensor { margin: 1, ..float }),
        ("no rows kept", Tensor { ring: 0, ..good }),
        ("more rows kept than there are", Tensor { ring: 5, ..good }),
        ("no pitch", Tensor { pitch: 0, ..good }),
        ("pitch", Tensor { pitch: (1 << 24) + 1, ..good }),
        ("margin", Tensor { margin: MAX_MARGIN + 1, ..good }),
        ("scale 0", Tensor { scale: 0.0, ..good }),
        ("negative scale", Tensor { scale: -1.0, ..good }),
        ("scale without end", Tensor { scale: f32::INFINITY, ..good }),
        ("no scale", Tensor { scale: f32::NAN, ..good }),
    ] {
        assert_eq!(Tensor::decode(&bad.encode()), None, "{name}");
    }
    assert!([good, wide, float].iter().all(|t| Tensor::decode(&t.encode()).is_some()));
    let mut record = good.encode();
    record[0] = 3;
    seal_record(&mut record);
    assert_eq!(Tensor::decode(&record), None, "type");
    let mut record = good.encode();
    record[44] = 2;
    seal_record(&mut record);
    assert_eq!(Tensor::decode(&record), None, "edge");
}

#[test]
fn any_flipped_bit_breaks_the_seal() {
    let mut r = Random::new(5);
    for _ in 0..20 {
        let (tensor, operator) = (legal_tensor(&mut r), any_operator(&mut r));
        let entry = Entry { operator: r.size(0, 65535), first: r.size(0, 65535), count: r.size(0, 65535) };
        flips(tensor.encode(), |record| Tensor::decode(record).is_none());
        flips(operator.encode(), |record| Operator::decode(record) == Err(OperatorFault::Seal));
        flips(entry.encode(), |record| record.first_chunk().is_none_or(|record| Entry::decode(record).is_none()));
    }
}

/// Calls `refused` for a record with each of its bits flipped.
fn flips<const N: usize>(record: [u8; N], refused: impl Fn(&[u8]) -> bool) {
    assert!(!refused(&record));
    for bit in 0..8 * N {
        let mut changed = record;
        changed[bit / 8] ^= 1 << (bit % 8);
        assert!(refused(&changed), "bit {bit}");
    }
}

#[test]
fn unknown_kinds_are_refused() {
    for kind in [0, 5, 6, 255, u32::MAX] {
        let mut record = [0; OPERATOR_BYTES];
        record[..4].copy_from_slice(&kind.to_le_bytes());
        assert_eq!(Operator::decode(&record), Err(OperatorFault::Seal));
        seal_record(&mut record);
        assert_eq!(Operator::decode(&record), Err(OperatorFault::Kind));
    }
}

#[test]
fn rows_lie_where_the_ring_says() {
    let t = Tensor { offset: 100, ring: 3, margin: 2, pitch: 80, ..Tensor::new(Dtype::I16, (10, 5), 4) };
    // 5 + 2 + 2 columns of 4 channels in two planes.
    assert_eq!((t.row_bytes(), t.plane_bytes(), t.size_bytes()), (72, 36, 232));
    let places: Vec<usize> = (0..10).map(|row| t.row_offset(row)).collect();
    assert_eq!(places, [100, 180, 260, 100, 180, 260, 100, 180, 260, 100]);
}
