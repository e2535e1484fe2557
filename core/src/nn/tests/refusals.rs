//! Refusals of [`Model`], one condition at a time: a legal file in which a single field is illegal, and the fault that must be named.

use super::draft::Draft;
use crate::nn::file::{
    Attention, Conv, Dtype, ENTRY_BYTES, LayerNorm, MAX_EXTENT, MAX_NORM_CHANNELS, MAX_WINDOW, NONE, OPERATOR_BYTES,
    Operator, OperatorFault, TENSOR_BYTES, Tensor, Upsample2, crc32c, seal_file, seal_record, set_word, word,
};
use crate::nn::{Model, ModelError};

const SIZE: (usize, usize) = (4, 4);

/// Returns a legal file: image -> `operator` -> map 2, and the output from the image.
fn draft(operator: impl FnOnce(&mut Draft) -> Operator) -> Draft {
    let mut draft = Draft::new(SIZE);
    let operator = operator(&mut draft);
    draft.operator(operator);
    draft.finish();
    draft.in_order();
    draft
}

/// Returns the fault of operator 1, if it has one.
fn fault(draft: &Draft) -> Option<OperatorFault> {
    match Model::new(&draft.file()) {
        Ok(_) => None,
        Err(ModelError::Operator { operator: 1, reason }) => Some(reason),
        Err(other) => panic!("expected a fault of operator 1, found {other:?}"),
    }
}

/// Returns the fault after a change of the attention, its input and its output.
fn attention(change: impl FnOnce(&mut Attention, &mut Draft)) -> Option<OperatorFault> {
    let mut draft = draft(|draft| {
        let input = draft.made(Tensor { zero: 128, lo: 1, hi: 255, ..Tensor::new(Dtype::U8, SIZE, 12) });
        let out = draft.place(Tensor { hi: 255, ..Tensor::new(Dtype::U8, SIZE, 4) });
        let (multipliers, exp_table) = (draft.words([1; 2]), draft.constant([0, 0x40].repeat(96)));
        let (pad_codes, position_bias) = (draft.constant([1; 12]), draft.constant([0; 2 * 2 * 9]));
        Operator::Attention(Attention {
            out,
            input,
            heads: 2,
            window: 2,
            shift_rows: 1,
            shift_cols: 1,
            pad_codes,
            logit_multipliers: multipliers,
            logit_shift: 1,
            position_bias,
            exp_table,
            multipliers,
            shift: 1,
        })
    });
    let Operator::Attention(mut a) = draft.operators[1] else { unreachable!() };
    change(&mut a, &mut draft);
    draft.operators[1] = Operator::Attention(a);
    fault(&draft)
}

#[test]
fn every_parameter_of_an_attention_is_validated() {
    assert_eq!(attention(|_, _| ()), None);
    for change in [
        (|a| a.window = 0) as fn(&mut Attention),
        |a| a.window = MAX_WINDOW + 1,
        |a| a.heads = 0,
        |a| a.shift_rows = 2,
        |a| a.shift_cols = 2,
        |a| a.logit_shift = 0,
        |a| a.shift = 61,
    ] {
        assert_eq!(attention(|a, _| change(a)), Some(OperatorFault::Parameter));
    }
    for change in [
        (|d| d.tensors[1].zero = 127) as fn(&mut Draft),
        |d| d.tensors[1].lo = 0,
        |d| (d.tensors[2].dtype, d.tensors[2].hi, d.tensors[2].pitch) = (Dtype::F32, 0, 64),
        |d| {
            let t = &mut d.tensors[1];
            (t.dtype, t.zero, t.pitch) = (Dtype::I16, 0, 96);
        },
    ] {
        // The map's writer has multipliers for codes: only the attention meets another type.
        assert_eq!(attention(|_, d| change(d)), Some(OperatorFault::Type));
    }
}

#[test]
fn maps_of_an_attention_fit_each_other() {
    for change in [
        (|a, _| a.heads = 3) as fn(&mut Attention, &mut Draft),
        |a, _| a.heads = 5,
        |_, d| d.tensors[2].rows = 5,
        |_, d| (d.tensors[2].cols, d.tensors[2].pitch) = (5, 20),
        |_, d| (d.tensors[2].channels, d.tensors[2].pitch) = (3, 12),
        |a, _| (a.window, a.shift_rows) = (8, 4),
        |a, _| (a.window, a.shift_cols) = (8, 4),
    ] {
        assert_eq!(attention(change), Some(OperatorFault::Shape));
    }
}

#[test]
fn constants_of_an_attention_are_validated() {
    fn end(d: &Draft) -> usize {
        d.constants.len()
    }
    for change in [
        (|a, d| a.logit_multipliers = end(d) - 7) as fn(&mut Attention, &mut Draft),
        |a, d| a.multipliers = end(d) - 7,
        |a, d| a.position_bias = end(d) - 35,
        |a, d| a.exp_table = end(d) - 191,
        |a, d| a.pad_codes = end(d) - 11,
        // The first entry of both tables is at least 2^14, no entry is negative, and no code of the padding is 0.
        |a, d| d.constants[a.exp_table + 1] = 0x3f,
        |a, d| d.constants[a.exp_table + 2 * 64 + 1] = 0x3f,
        |a, d| d.constants[a.exp_table + 2 * 95 + 1] = 0x80,
        |a, d| d.constants[a.pad_codes + 11] = 0,
    ] {
        assert_eq!(attention(change), Some(OperatorFault::Constants));
    }
    assert_eq!(attention(|a, d| a.position_bias = end(d) - 36), None, "the last constants");
    let beyond = ((1u32 << 30) + 1).to_le_bytes();
    assert_eq!(
        attention(|a, d| d.constants[a.multipliers + 4..a.multipliers + 8].copy_from_slice(&beyond)),
        Some(OperatorFault::Overflow)
    );
}

/// Returns the fault after a change of a layer norm that gathers 2x2 pixels, its input and its output.
fn layer_norm(change: impl FnOnce(&mut LayerNorm, &mut Draft)) -> Option<OperatorFault> {
    let mut draft = draft(|draft| {
        let input = draft.made(Tensor { hi: 255, ..Tensor::new(Dtype::U8, SIZE, 2) });
        let out = draft.place(Tensor { hi: 255, ..Tensor::new(Dtype::U8, (2, 2), 8) });
        let (gains, biases) = (draft.words([1; 8]), draft.constant([0; 64]));
        Operator::LayerNorm(LayerNorm { out, input, merge: 2, gains, biases, shift: 1, epsilon: 1 })
    });
    let Operator::LayerNorm(mut norm) = draft.operators[1] else { unreachable!() };
    change(&mut norm, &mut draft);
    draft.operators[1] = Operator::LayerNorm(norm);
    fault(&draft)
}

#[test]
fn every_field_of_a_layer_norm_is_validated() {
    assert_eq!(layer_norm(|_, _| ()), None);
    assert_eq!(layer_norm(|n, _| n.epsilon = 1 << 56), None);
    for change in [
        (|n| n.merge = 0) as fn(&mut LayerNorm),
        |n| n.merge = 3,
        |n| n.epsilon = 0,
        |n| n.epsilon = (1 << 56) + 1,
        |n| n.shift = 0,
    ] {
        assert_eq!(layer_norm(|n, _| change(n)), Some(OperatorFault::Parameter));
    }
    let float = |t: &mut Tensor| (t.dtype, t.hi, t.pitch) = (Dtype::F32, 0, 4 * t.pitch);
    assert_eq!(layer_norm(|_, d| float(&mut d.tensors[2])), Some(OperatorFault::Type));
    assert_eq!(layer_norm(|n, _| n.merge = 1), Some(OperatorFault::Shape));
    assert_eq!(layer_norm(|n, d| n.gains = d.constants.len() - 31), Some(OperatorFault::Constants));
    assert_eq!(layer_norm(|n, d| n.biases = d.constants.len() - 63), Some(OperatorFault::Constants));
    let bias =
        |value: i64| layer_norm(|n, d| d.constants[n.biases + 56..n.biases + 64].copy_from_slice(&value.to_le_bytes()));
    assert_eq!((bias(1 << 60), bias(-1 << 60)), (None, None));
    assert_eq!(bias((1 << 60) + 1), Some(OperatorFault::Overflow));
    assert_eq!(bias(i64::MIN), Some(OperatorFault::Overflow));
}

#[test]
fn layer_norms_have_as_many_channels_as_their_sums_allow() {
    for (channels, expected) in [(MAX_NORM_CHANNELS / 4, None), (MAX_NORM_CHANNELS / 4 + 1, Some(OperatorFault::Shape))]
    {
        let draft = draft(|draft| {
            let input = draft.made(Tensor { hi: 255, ..Tensor::new(Dtype::U8, SIZE, channels) });
            let out = draft.place(Tensor { hi: 255, ..Tensor::new(Dtype::U8, (2, 2), 4 * channels) });
            let (gains, biases) = (draft.words(vec![1; 4 * channels]), draft.constant(vec![0; 32 * channels]));
            Operator::LayerNorm(LayerNorm { out, input, merge: 2, gains, biases, shift: 1, epsilon: 1 })
        });
        assert_eq!(fault(&draft), expected, "four times {channels} channels");
    }
}

/// Returns the fault of a convolution of map 1 into map 2, after a change of it and of the draft, whose map 1 has this type.
fn conv(dtype: Dtype, out: Dtype, change: impl FnOnce(&mut Conv, &mut Draft)) -> Option<OperatorFault> {
    let map = |dtype| Tensor { hi: if dtype == Dtype::F32 { 0 } else { 255 }, ..Tensor::new(dtype, SIZE, 2) };
    let mut draft = draft(|draft| {
        let (input, out) = (draft.made(map(dtype)), draft.place(map(out)));
        Operator::Conv(draft.silent(input, out, (1, 1, 0)))
    });
    let Operator::Conv(mut conv) = draft.operators[1] else { unreachable!() };
    change(&mut conv, &mut draft);
    draft.operators[1] = Operator::Conv(conv);
    fault(&draft)
}

#[test]
fn types_and_tables_of_a_convolution_are_validated() {
    use Dtype::{F32, I16, U8};
    assert_eq!(conv(U8, U8, |_, _| ()), None);
    assert_eq!(conv(F32, U8, |_, _| ()), Some(OperatorFault::Type), "a source of floats");
    assert_eq!(conv(U8, U8, |c, _| c.block = 0), Some(OperatorFault::Parameter));
    assert_eq!(conv(U8, U8, |c, _| c.block = 17), Some(OperatorFault::Parameter));
    let second = |size| conv(U8, U8, |c, d| c.second = Some(d.place(Tensor { hi: 255, ..Tensor::new(U8, size, 1) })));
    assert_eq!((second((5, 4)), second((4, 5))), (Some(OperatorFault::Shape), Some(OperatorFault::Shape)));
    let folded = |stride: usize, pad: usize| {
        conv(U8, U8, |c, _| {
            (c.fold, c.kernel_rows, c.kernel_cols, c.stride, c.pad) = (true, 5, 5, stride, pad);
        })
    };
    assert_eq!((folded(2, 2), folded(1, 1)), (Some(OperatorFault::Parameter), Some(OperatorFault::Parameter)));
    assert_eq!(folded(1, 2), Some(OperatorFault::Shape), "the output is not twice as large");
    let table = |out, zero: i32, codes: [u8; 2]| {
        conv(U8, out, |c, d| {
            (c.table, c.table_zero) = (Some(d.constant(codes.repeat(128))), zero);
            (d.tensors[2].lo, d.tensors[2].hi) = (7, 9);
        })
    };
    assert_eq!(table(U8, 255, [7, 9]), None);
    assert_eq!(table(U8, 256, [7, 9]), Some(OperatorFault::Type));
    assert_eq!(table(U8, -1, [7, 9]), Some(OperatorFault::Type));
    assert_eq!(table(I16, 0, [7, 9]), Some(OperatorFault::Type));
    assert_eq!(table(U8, 0, [6, 9]), Some(OperatorFault::Constants));
    assert_eq!(table(U8, 0, [7, 10]), Some(OperatorFault::Constants));
    // Floats have finite scales, and no table.
    assert_eq!(conv(U8, F32, |_, _| ()), None);
    let scale = |v: f32| {
        conv(U8, F32, |c, d| d.constants[c.multipliers + 4..c.multipliers + 8].copy_from_slice(&v.to_le_bytes()))
    };
    assert_eq!(
        (scale(f32::NAN), scale(f32::INFINITY)),
        (Some(OperatorFault::Constants), Some(OperatorFault::Constants))
    );
    assert_eq!(conv(U8, F32, |c, d| c.table = Some(d.constant([8; 256]))), Some(OperatorFault::Constants));
}

#[test]
fn a_sum_adds_codes_of_its_own_shape() {
    let sum = |dtype: Dtype, channels: usize| {
        let mut draft = Draft::new(SIZE);
        let t = Tensor { hi: 255, ..Tensor::new(Dtype::U8, SIZE, 2) };
        let hi = if dtype == Dtype::F32 { 0 } else { 255 };
        let added = draft.made(Tensor { hi, ..Tensor::new(dtype, SIZE, channels) });
        let out = draft.place(t);
        let mut conv = draft.silent(0, out, (1, 1, 0));
        (conv.add, conv.add_multipliers) = (Some(added), conv.multipliers);
        draft.operator(Operator::Conv(conv));
        draft.finish();
        draft.in_order();
        match Model::new(&draft.file()).map(|_| ()) {
            Err(ModelError::Operator { operator: 1, reason }) => Some(reason),
            _ => None,
        }
    };
    assert_eq!(sum(Dtype::U8, 2), None);
    assert_eq!(sum(Dtype::F32, 2), Some(OperatorFault::Type));
    assert_eq!(sum(Dtype::U8, 1), Some(OperatorFault::Shape));
}

/// Only sums take the place of what they read: a layer norm over its own input would read codes that it has overwritten.
#[test]
fn a_layer_norm_does_not_take_the_place_of_its_input() {
    let t = Tensor { hi: 255, ..Tensor::new(Dtype::U8, SIZE, 2) };
    let mut draft = draft(|draft| {
        let (input, out) = (draft.made(t), draft.place(t));
        let (gains, biases) = (draft.words([1; 2]), draft.constant([0; 16]));
        Operator::LayerNorm(LayerNorm { out, input, merge: 1, gains, biases, shift: 1, epsilon: 1 })
    });
    assert_eq!(fault(&draft), None);
    draft.tensors[2].offset = draft.tensors[1].offset;
    assert_eq!(Model::new(&draft.file()).map(|_| ()), Err(ModelError::Schedule { entry: 1 }));
}

#[test]
fn schedules_have_fewer_entries_than_numbers_of_16_bits() {
    let mut draft = draft_of_output();
    let entry = draft.schedule[0];
    for (count, expected) in [(65_534, ModelError::Schedule { entry: 1 }), (65_535, ModelError::Header)] {
        draft.schedule = vec![entry; count];
        assert_eq!(Model::new(&draft.file()).map(|_| ()), Err(expected), "{count} entries");
    }
}

#[test]
fn floats_are_read_by_no_operator() {
    let float = |out: (usize, usize), operator: fn(u32, u32, &mut Draft) -> Operator| {
        let draft = draft(|draft| {
            let input = draft.made(Tensor::new(Dtype::F32, SIZE, 1));
            let out = draft.place(Tensor::new(Dtype::F32, out, 1));
            operator(input, out, draft)
        });
        fault(&draft)
    };
    let norm = |input, out, draft: &mut Draft| {
        let (gains, biases) = (draft.words([1]), draft.constant([0; 8]));
        Operator::LayerNorm(LayerNorm { out, input, merge: 1, gains, biases, shift: 1, epsilon: 1 })
    };
    assert_eq!(float(SIZE, norm), Some(OperatorFault::Type));
    let upsample = |input, out, _: &mut Draft| Operator::Upsample2(Upsample2 { out, input });
    assert_eq!(float((8, 8), upsample), Some(OperatorFault::Type));
}

#[test]
fn upsamplings_double_both_sides_and_keep_the_codes() {
    let upsample = |change: fn(&mut Tensor)| {
        let large = Tensor { hi: 255, ..Tensor::new(Dtype::U8, (8, 8), 2) };
        let mut draft = draft(|draft| {
            let input = draft.made(Tensor { hi: 255, ..Tensor::new(Dtype::U8, SIZE, 2) });
            Operator::Upsample2(Upsample2 { out: draft.place(large), input })
        });
        change(&mut draft.tensors[2]);
        fault(&draft)
    };
    assert_eq!(upsample(|_| ()), None);
    for change in [
        (|t| t.rows = 9) as fn(&mut Tensor),
        |t| t.cols = 7,
        |t| t.channels = 1,
        |t| t.zero = 1,
        |t| t.lo = 1,
        |t| t.hi = 254,
    ] {
        assert_eq!(upsample(change), Some(OperatorFault::Shape));
    }
    assert_eq!(upsample(|t| (t.dtype, t.pitch) = (Dtype::I16, 32)), Some(OperatorFault::Type));
}

/// Makes the checksum of a changed header right; everything else stays as it is.
fn seal_header(file: &mut [u8]) {
    let header = crc32c(&file[..4 * word::HEADER_CRC]);
    set_word(file, word::HEADER_CRC, header);
}

#[test]
fn more_checksums_than_the_file_has_bytes_are_refused() {
    let mut file = draft_of_output().file();
    for chunks in [file.len() as u32 / 8, u32::MAX] {
        set_word(&mut file, word::CHUNKS, chunks);
        seal_header(&mut file);
        assert_eq!(Model::new(&file).map(|_| ()), Err(ModelError::Header), "{chunks} chunks");
    }
}

#[test]
fn the_description_is_text() {
    let draft = draft_of_output();
    let mut file = draft.file();
    let at = u32::from_le_bytes(file[4 * word::TEXT..][..4].try_into().unwrap()) as usize;
    file[at] = 0xff;
    seal_file(&mut file);
    assert_eq!(Model::new(&file).map(|_| ()), Err(ModelError::Header));
}

/// Returns image -> output.
fn draft_of_output() -> Draft {
    let mut draft = Draft::new(SIZE);
    draft.finish();
    draft.in_order();
    draft
}

/// Returns what validation says of a file with image, coarse DTM (tensor 1) and output (tensor 2), after a change of its draft and of words
/// of its header.
fn header(change: impl FnOnce(&mut Draft), words: &[(usize, u32)]) -> Result<(), ModelError> {
    let mut draft = Draft::new(SIZE);
    draft.coarse = draft.place(Tensor { hi: 255, ..Tensor::new(Dtype::U8, SIZE, 1) });
    draft.finish();
    draft.in_order();
    change(&mut draft);
    let mut file = draft.file();
    words.iter().for_each(|&(index, value)| set_word(&mut file, index, value));
    seal_header(&mut file);
    Model::new(&file).map(|_| ())
}

#[test]
fn numbers_and_codes_of_the_header_are_validated() {
    assert_eq!(header(|_| (), &[]), Ok(()));
    for (index, value) in [
        (word::NR, f32::NAN.to_bits()),
        (word::NR, f32::INFINITY.to_bits()),
        (word::NR, 0.0f32.to_bits()),
        (word::NR, (-1.0f32).to_bits()),
        (word::RANGE_MARGIN, f32::NAN.to_bits()),
        (word::RANGE_MARGIN, (-0.1f32).to_bits()),
        (word::TARGET_RANGE, 3),
        (word::ILLUMINATION, 99),
        (word::IMAGE, NONE),
        (word::IMAGE, 1),
        (word::IMAGE, 2),
        (word::IMAGE, 3),
        (word::COARSE, 0),
        (word::COARSE, 2),
        (word::COARSE, 3),
        (word::OUTPUT, 0),
        (word::OUTPUT, 3),
        (word::OPERATORS + 1, 0),
        (word::OPERATORS + 1, 513),
        (word::TENSORS + 1, 513),
        (word::CHUNK_BYTES, 4096),
        (word::CHUNKS, 2),
        (word::TEXT, 128),
        (word::TEXT, u32::MAX),
        (word::TEXT + 1, u32::MAX),
        (word::CONSTANTS + 1, 1 << 20),
    ] {
        assert_eq!(header(|_| (), &[(index, value)]), Err(ModelError::Header), "word {index}: {value:#x}");
    }
}

#[test]
fn inputs_and_output_have_the_tiles_shape() {
    type Change = fn(&mut Tensor);
    let changes: [Change; 6] = [
        |t| (t.rows, t.ring) = (5, 5),
        |t| (t.rows, t.ring) = (3, 3),
        |t| (t.cols, t.pitch) = (5, 5 * t.pitch / 4),
        |t| t.cols = 3,
        |t| (t.channels, t.pitch) = (2, 2 * t.pitch),
        |t| t.ring = 3,
    ];
    for input in [0, 1] {
        for change in changes {
            // Far behind the others, so that no tensor overlaps another.
            let moved = |d: &mut Draft| {
                change(&mut d.tensors[input]);
                d.tensors[input].offset = 10_000;
            };
            assert_eq!(header(moved, &[]), Err(ModelError::Header), "tensor {input}");
        }
        let float = |d: &mut Draft| {
            let t = &mut d.tensors[input];
            (t.dtype, t.hi, t.pitch, t.offset) = (Dtype::F32, 0, 16, 10_000);
        };
        assert_eq!(header(float, &[]), Err(ModelError::Header), "tensor {input} of floats");
    }
    // The output keeps its rows, and has floats. Its operator is legal with both.
    assert_eq!(header(|d| d.tensors[2].ring = 3, &[]), Err(ModelError::Header));
    let codes = |d: &mut Draft| {
        (d.tensors[2].dtype, d.tensors[2].hi) = (Dtype::U8, 255);
        let Operator::Conv(mut conv) = d.operators[0] else { unreachable!() };
        (conv.multipliers, conv.shift) = (d.words([1]), 1);
        d.operators[0] = Operator::Conv(conv);
    };
    assert_eq!(header(codes, &[]), Err(ModelError::Header));
}

#[test]
fn places_and_sizes_of_tensors_are_validated() {
    let refused = Err(ModelError::Tensor { tensor: 1 });
    for change in [
        (|t| t.rows = MAX_EXTENT + 1) as fn(&mut Tensor),
        |t| t.cols = 0,
        |t| t.channels = 0,
        |t| t.channels = MAX_EXTENT + 1,
        |t| t.pitch = t.row_bytes() - 1,
        |t| t.offset = (1 << 30) + 1,
        // 2^28 samples and one row more; the same by margins.
        |t| (t.rows, t.cols, t.channels, t.ring) = (1 << 14, 1 << 14, 2, 1),
        |t| (t.rows, t.cols, t.channels, t.ring, t.margin) = (1 << 14, 1, 1 << 14, 1, 1),
        // Rows far apart: more than 2^30 bytes from the first to the last.
        |t| (t.rows, t.ring, t.pitch) = (1 << 14, 1 << 14, 1 << 20),
    ] {
        let changed = |d: &mut Draft| {
            change(&mut d.tensors[1]);
            let t = &mut d.tensors[1];
            t.pitch = if t.ring == 1 { (1 << 24).min(t.row_bytes().max(1)) } else { t.pitch };
        };
        assert_eq!(header(changed, &[]), refused);
    }
}

/// A limit may be reached, here by a map that no operator uses.
#[test]
fn the_largest_places_and_sizes_are_legal() {
    for change in [
        (|t| t.offset = 1 << 30) as fn(&mut Tensor),
        // A margin counts as a share of the columns.
        |t| (t.rows, t.cols, t.pitch, t.ring, t.margin) = (MAX_EXTENT, MAX_EXTENT / 2, MAX_EXTENT, 1, 1),
        // 2^28 samples, and 2^30 bytes of rows.
        |t| (t.rows, t.cols, t.pitch, t.ring) = (MAX_EXTENT, MAX_EXTENT, MAX_EXTENT, 1),
        |t| (t.rows, t.channels, t.pitch, t.ring) = (MAX_EXTENT, MAX_EXTENT / 4, 1 << 16, MAX_EXTENT),
    ] {
        let mut draft = draft_of_output();
        let mut t = Tensor { hi: 255, pitch: 4, ..Tensor::new(Dtype::U8, SIZE, 1) };
        change(&mut t);
        draft.tensors.push(t);
        assert_eq!(Model::new(&draft.file()).map(|_| ()), Ok(()), "{t:?}");
    }
}

#[test]
fn checksums_of_rows_are_counted_in_the_order_of_tensors() {
    let mut file = draft_of_output().file();
    let start = u32::from_le_bytes(file[4 * word::TENSORS..][..4].try_into().unwrap()) as usize;
    for (found, expected) in
        [(4u8, Ok(())), (3, Err(ModelError::Tensor { tensor: 1 })), (5, Err(ModelError::Tensor { tensor: 1 }))]
    {
        file[start + TENSOR_BYTES + 4 * 13] = found;
        seal_file(&mut file);
        assert_eq!(Model::new(&file).map(|_| ()), expected, "{found} rows before tensor 1");
    }
}

/// The account of a validation: every record and constant that is read, each time it is read. The limit of work rests on these counts.
#[test]
fn work_is_what_is_read() {
    let (tensor, operator, entry) = (TENSOR_BYTES as u64 / 4, OPERATOR_BYTES as u64 / 4, ENTRY_BYTES as u64 / 4);
    let file = draft_of_output().file();
    let mut found = 0;
    Model::new_counted(&file, &mut found).unwrap();
    let checksums = 2 * file.len() as u64;
    let records = 2 * tensor + operator + 20 * tensor;
    // A scale; then the bias and a panel of eight channels with one group of four samples.
    let constants = 4 + 4 + 8 * 4;
    // One pair of tensors, looked at twice. Image and output are in use together.
    let pairs = 2 * (2 + 2 * tensor);
    // Twice the entry; the operator in the lives, in its entry and at the end; tensors: the image, the output with the entry, the image
    // as it is read, the output at the end. Three links.
    let schedule = 2 * entry + 3 * operator + 4 * tensor + 3 * 2;
    assert_eq!(found, checksums + records + constants + pairs + schedule);
}

/// A part of a validation costs about its budget: the smallest budget does one unit in each call, and the model is the same.
#[test]
fn parts_of_a_validation_are_as_small_as_their_budget() {
    let file = draft_of_output().file();
    let calls = |budget: u64| {
        let mut validation = crate::nn::Validation::default();
        (1..100).find(|_| validation.advance(&file, budget).unwrap().is_some())
    };
    // A chunk, all tensors, the operator's one part, the output, the schedule.
    assert_eq!((calls(0), calls(1)), (Some(5), Some(5)));
    assert_eq!(calls(u64::MAX), Some(1));
    // A chunk costs 6 for each byte of 16 KiB: with no more than that, it is a call of its own.
    let chunk = 6 * 16 * 1024;
    assert_eq!(calls(chunk), Some(2));
    assert_eq!(calls(chunk + 1), Some(2));
}

#[test]
fn every_field_of_a_tensor_is_within_its_range() {
    let codes = |dtype, lo, zero, hi| {
        let t = Tensor { lo, zero, hi, ..Tensor::new(dtype, SIZE, 2) };
        Tensor::decode(&t.encode()).is_some()
    };
    assert!(codes(Dtype::U8, 0, 255, 255) && codes(Dtype::I16, -32767, 0, 32767) && codes(Dtype::F32, 0, 0, 0));
    for (dtype, lo, zero, hi) in [
        (Dtype::U8, -1, 0, 255),
        (Dtype::U8, 0, 256, 255),
        (Dtype::U8, 0, 0, 256),
        (Dtype::U8, 2, 0, 1),
        (Dtype::I16, -32768, 0, 0),
        (Dtype::I16, 0, 0, 32768),
        (Dtype::I16, 0, 1, 2),
        (Dtype::F32, 0, 0, 1),
    ] {
        assert!(!codes(dtype, lo, zero, hi), "{dtype:?}: {lo}, {zero}, {hi}");
    }
    let decoded = |change: fn(&mut Tensor)| {
        let mut t = Tensor::new(Dtype::U8, SIZE, 2);
        change(&mut t);
        Tensor::decode(&t.encode())
    };
    assert!(decoded(|t| (t.ring, t.margin, t.pitch) = (1, 15, 1 << 24)).is_some());
    for change in [
        (|t| t.ring = 0) as fn(&mut Tensor),
        |t| t.ring = 5,
        |t| t.margin = 16,
        |t| t.pitch = 0,
        |t| t.pitch = (1 << 24) + 1,
        |t| (t.dtype, t.margin) = (Dtype::F32, 1),
        |t| t.scale = 0.0,
        |t| t.scale = -1.0,
        |t| t.scale = f32::NAN,
        |t| t.scale = f32::INFINITY,
    ] {
        assert!(decoded(change).is_none());
    }
    for (word, code) in [(0, 3u8), (11, 2)] {
        let mut record = Tensor::new(Dtype::U8, SIZE, 2).encode();
        record[4 * word] = code;
        assert!(Tensor::decode(&record).is_none(), "a broken seal");
        seal_record(&mut record);
        assert!(Tensor::decode(&record).is_none(), "no such type, no such edge");
    }
}
