//! Refusals of [`Model`] for a single operator that mutated files of whole networks do not reach.

use super::draft::Draft;
use crate::nn::file::{Conv, Dtype, Edge, HEADER_BYTES, Operator, OperatorFault, Tensor, seal_file, set_word, word};
use crate::nn::{Model, ModelError, required};

/// image (margin 1) -> map of two channels by a 3x3 convolution -> output. `change` makes the convolution or its tensors illegal.
fn validate(change: impl Fn(&mut Conv, &mut Draft)) -> Result<(), ModelError> {
    let mut draft = Draft::new((8, 8));
    (draft.tensors[0].margin, draft.tensors[0].pitch) = (1, 10);
    let out = draft.place(Tensor { hi: 255, ..Tensor::new(Dtype::U8, (8, 8), 2) });
    let mut conv = draft.silent(0, out, (3, 1, 1));
    let index = draft.operator(Operator::Conv(conv));
    draft.finish();
    draft.in_order();
    change(&mut conv, &mut draft);
    draft.operators[index] = Operator::Conv(conv);
    Model::new(&draft.file()).map(|_| ())
}

fn fault(change: impl Fn(&mut Conv, &mut Draft)) -> OperatorFault {
    match validate(change) {
        Err(ModelError::Operator { operator: 0, reason }) => reason,
        other => panic!("expected a fault of operator 0, found {other:?}"),
    }
}

#[test]
fn every_field_of_a_convolution_is_validated() {
    assert_eq!(validate(|_, _| ()), Ok(()));
    assert_eq!(fault(|c, _| c.out = 9), OperatorFault::TensorIndex);
    assert_eq!(fault(|c, _| c.add = Some(9)), OperatorFault::TensorIndex);
    for change in [
        (|c| c.stride = 0) as fn(&mut Conv),
        |c| c.stride = 16,
        |c| c.stride_cols = 0,
        |c| c.stride_cols = 16,
        |c| c.kernel_rows = 0,
        |c| c.kernel_cols = 16,
        |c| c.pad = 3,
        |c| c.add_shift = 16,
        |c| c.relu = true,
        |c| c.shift = 0,
        |c| c.shift = 61,
        |c| c.fold = true,
    ] {
        assert_eq!(fault(|c, _| change(c)), OperatorFault::Parameter);
    }
    assert_eq!(fault(|c, _| c.stride = 2), OperatorFault::Shape);
    assert_eq!(fault(|c, _| c.stride_cols = 2), OperatorFault::Shape);
    assert_eq!(fault(|c, _| c.kernel_rows = 2), OperatorFault::Shape);
    assert_eq!(fault(|_, d| d.tensors[0].margin = 0), OperatorFault::Shape, "padding beyond the margin");
    assert_eq!(fault(|_, d| d.tensors[0].edge = Edge::Nearest), OperatorFault::Shape, "padding of another kind");
    assert_eq!(fault(|c, _| c.add = Some(0)), OperatorFault::Shape);
    for change in [
        (|c, n| c.weights = n) as fn(&mut Conv, usize),
        |c, n| c.bias = n,
        |c, n| c.multipliers = n - 7,
        |c, n| c.table = Some(n - 255),
        |c, _| c.weights = i32::MAX as usize,
    ] {
        assert_eq!(fault(|c, d| change(c, d.constants.len())), OperatorFault::Constants);
    }
    assert_eq!(
        fault(|_, d| (d.tensors[1].dtype, d.tensors[1].hi, d.tensors[1].pitch) = (Dtype::F32, 0, 64)),
        OperatorFault::Constants,
        "a shift with floats"
    );
}

#[test]
fn weights_are_validated_one_by_one() {
    // Three groups of four per kernel row would have two filling samples in the last group. Here there are three samples and one of
    // filling.
    let weights = 3 * 8 * 4; // kernel rows, channels of the panel, samples with filling
    for byte in 0..weights {
        let (channel, sample) = (byte / 4 % 8, byte % 4);
        let filling = channel >= 2 || sample == 3;
        let of = |value: u8| validate(|c, d| d.constants[c.weights + byte] = value);
        assert_eq!(of(1).is_ok(), !filling, "byte {byte}");
        assert!(of(0x80).is_err(), "byte {byte}: -128 is no weight");
    }
}

#[test]
fn sums_that_leave_32_bits_are_refused_to_the_last_step() {
    // With one weight of 127 and codes up to 255, the bias may use the rest.
    let room = i32::MAX - 127 * 255;
    let with = |bias: i32| {
        validate(|c, d| {
            d.constants[c.weights] = 127;
            d.constants[c.bias..c.bias + 4].copy_from_slice(&bias.to_le_bytes());
        })
    };
    assert_eq!((with(room), with(-room)), (Ok(()), Ok(())));
    assert!(with(room + 1).is_err() && with(-room - 1).is_err() && with(i32::MIN).is_err());
}

#[test]
fn memory_asked_for_is_that_of_tensors_and_one_row_of_padding() {
    let mut draft = Draft::new((8, 8));
    draft.finish();
    draft.in_order();
    let file = draft.file();
    let model = Model::new(&file).unwrap();
    let last = draft.tensors.last().unwrap();
    assert_eq!(model.scratch_offset(), last.offset + last.size_bytes());
    let needed = required(&model);
    let least = model.scratch_offset() + model.scratch_bytes() + 4 * model.sum_count();
    assert!((least..least + 64).contains(&needed), "{needed}");
    assert_eq!(model.sum_count(), 8 + 8, "a checksum for every row kept");
    assert_eq!(model.scratch_bytes(), 0, "without padding there is no such row");
    let mut draft = Draft::new((8, 8));
    (draft.tensors[0].margin, draft.tensors[0].pitch) = (1, 10);
    draft.output = draft.place(Tensor::new(Dtype::F32, (8, 8), 1));
    let conv = draft.silent(0, draft.output, (3, 1, 1));
    draft.operator(Operator::Conv(conv));
    draft.in_order();
    let file = draft.file();
    let scratch = Model::new(&file).unwrap().scratch_bytes();
    assert!((10..32).contains(&scratch), "{scratch}");
}

#[test]
fn an_output_may_hold_columns_as_channels() {
    for (cols, channels, legal) in [(8, 1, true), (4, 2, true), (1, 8, true), (4, 1, false), (8, 2, false)] {
        let mut draft = Draft::new((8, 8));
        draft.output = draft.place(Tensor::new(Dtype::F32, (8, cols), channels));
        let mut conv = draft.silent(0, draft.output, (1, 1, 0));
        conv.stride_cols = 8 / cols;
        draft.operator(Operator::Conv(conv));
        draft.in_order();
        assert_eq!(Model::new(&draft.file()).is_ok(), legal, "{cols} columns of {channels}");
    }
}

/// Returns the fault of an output whose largest sum is 127 * 255 with this scale; its NR is 50.
fn output_scale(scale: f32, added: f32) -> Result<(), ModelError> {
    let mut draft = Draft::new((4, 4));
    draft.finish();
    let Operator::Conv(mut out) = draft.operators[0] else { unreachable!() };
    draft.constants[out.weights] = 127;
    out.multipliers = draft.words([scale.to_bits() as i32]);
    out.add = Some(0);
    draft.tensors[0].scale = added;
    draft.operators[0] = Operator::Conv(out);
    draft.in_order();
    Model::new(&draft.file()).map(|_| ())
}

#[test]
fn scales_that_make_heights_infinite_are_refused() {
    let refused = Err(ModelError::Operator { operator: 0, reason: OperatorFault::Overflow });
    // The largest legal output is 2^32 * 50.
    let most = (4_294_967_296.0 * 50.0) / (127.0 * 255.0);
    for (scale, added, expected) in [
        (0.0, 1.0, Ok(())),
        (1e-6, 1e-3, Ok(())),
        (most * 0.999, 1e-3, Ok(())),
        (-most * 0.999, 1e-3, Ok(())),
        (most * 1.001, 1e-3, refused),
        (-most * 1.001, 1e-3, refused),
        (most * 0.999, 1e7, refused),
        (1e30, 1.0, refused),
        (f32::MAX, 1.0, refused),
        (0.0, f32::MAX, refused),
    ] {
        assert_eq!(output_scale(scale, added), expected, "{scale:e}, {added:e}");
    }
}

#[test]
fn files_that_end_in_or_behind_their_header() {
    let mut draft = Draft::new((8, 8));
    draft.finish();
    draft.in_order();
    let mut file = draft.file();
    let expected = HEADER_BYTES as u64;
    for found in [8, HEADER_BYTES - 1] {
        let refused = Model::new(&file[..found]).map(|_| ());
        assert_eq!(refused, Err(ModelError::Length { expected, found: found as u64 }));
    }
    // A header alone has neither tensors nor chunks.
    file.truncate(HEADER_BYTES);
    set_word(&mut file, word::FILE_BYTES, HEADER_BYTES as u32);
    for index in [word::TENSORS, word::OPERATORS, word::SCHEDULE] {
        set_word(&mut file, index, 0);
        set_word(&mut file, index + 1, 0);
    }
    // What has less than its header says is not sealed.
    let before = file.clone();
    seal_file(&mut file);
    assert_eq!(file, before);
    set_word(&mut file, word::CHUNKS, 0);
    seal_file(&mut file);
    assert_eq!(Model::new(&file).map(|_| ()), Err(ModelError::Header));
}
