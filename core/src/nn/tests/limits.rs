//! What [`Model`] accepts up to a limit, and refuses one step beyond it: heads, weights, biases and sums. And a validation that is put away.

use super::draft::Draft;
use crate::nn::file::{Attention, Conv, Dtype, Edge, Operator, OperatorFault, PHASE_TAPS, Tensor};
use crate::nn::{Model, ModelError, Validation};

/// Returns what is wrong with the last operator but the output's, if anything.
fn fault(draft: &Draft) -> Option<OperatorFault> {
    let last = draft.operators.len() as u32 - 2;
    match Model::new(&draft.file()) {
        Ok(_) => None,
        Err(ModelError::Operator { operator, reason }) if operator == last => Some(reason),
        Err(other) => panic!("expected a fault of operator {last}, found {other:?}"),
    }
}

#[test]
fn an_attention_may_have_a_head_for_each_channel() {
    let (size, channels) = ((1, 1), 128);
    let mut draft = Draft::new(size);
    let input = draft.made(Tensor { zero: 128, lo: 1, hi: 255, ..Tensor::new(Dtype::U8, size, 3 * channels) });
    let out = draft.place(Tensor { hi: 255, ..Tensor::new(Dtype::U8, size, channels) });
    let multipliers = draft.words(vec![1; channels]);
    let (pad_codes, position_bias) = (draft.constant(vec![1; 3 * channels]), draft.constant(vec![0; 2 * channels]));
    let exp_table = draft.constant([0, 0x40].repeat(96));
    draft.operator(Operator::Attention(Attention {
        out,
        input,
        heads: channels,
        window: 1,
        shift_rows: 0,
        shift_cols: 0,
        pad_codes,
        logit_multipliers: multipliers,
        logit_shift: 1,
        position_bias,
        exp_table,
        multipliers,
        shift: 1,
    }));
    draft.finish();
    draft.in_order();
    assert_eq!(fault(&draft), None);
}

/// Changes a convolution and the form of its sources.
type Form = fn(&mut Conv, &mut Tensor);

/// A convolution and its file.
struct Case {
    draft: Draft,
    conv: Conv,
}

impl Case {
    /// Makes a convolution of a map of `first` channels, and of another one of `second` channels if there are any, into `out` channels.
    fn new((first, second): (usize, usize), out: usize, change: Form) -> Self {
        let mut conv = Conv { kernel_rows: 2, kernel_cols: 3, ..Conv::default() };
        let mut source = Tensor { hi: 255, ..Tensor::new(Dtype::U8, (4, 5), first) };
        change(&mut conv, &mut source);
        let mut draft = Draft::new((4, 5));
        conv.first = draft.made(source);
        conv.second = (second > 0).then(|| draft.made(Tensor { channels: second, ..source }));
        let size = if conv.fold { (8, 10) } else { (3, 3) };
        conv.out = draft.place(Tensor { hi: 255, ..Tensor::new(Dtype::U8, size, out) });
        conv.multipliers = draft.words(vec![1; out]);
        conv.bias = draft.words(vec![0; out * variants(&conv).len()]);
        // Last, so that nothing follows them.
        let bytes = places(&conv, (first, second), out).len();
        let mut case = Self { draft, conv };
        case.draft.operator(Operator::Conv(conv));
        case.draft.finish();
        case.draft.in_order();
        case.conv.weights = case.draft.constant(vec![0; bytes]);
        case
    }

    fn fault(&mut self) -> Option<OperatorFault> {
        let last = self.draft.operators.len() - 2;
        self.draft.operators[last] = Operator::Conv(self.conv);
        fault(&self.draft)
    }

    fn weight(&mut self, index: usize, value: u8) {
        self.draft.constants[self.conv.weights + index] = value;
    }

    fn bias(&mut self, index: usize, value: i64) {
        let value = i32::try_from(value).unwrap().to_le_bytes();
        self.draft.constants[self.conv.bias + 4 * index..][..4].copy_from_slice(&value);
    }
}

/// Returns rows and columns of each set of filters.
fn variants(conv: &Conv) -> Vec<(usize, usize)> {
    match conv.fold {
        false => vec![(conv.kernel_rows, conv.kernel_cols)],
        true => PHASE_TAPS.iter().flat_map(|&rows| PHASE_TAPS.map(|cols| (rows, cols))).collect(),
    }
}

/// Returns the output channel of each byte of the weights, `None` for filling: the order that [`Conv`] describes.
fn places(conv: &Conv, (first, second): (usize, usize), out: usize) -> Vec<Option<usize>> {
    let panels: &[usize] = match out {
        2 => &[8],
        20 => &[16, 8],
        40 => &[32, 8],
        _ => unreachable!(),
    };
    let (mut places, mut before) = (Vec::new(), 0);
    for &width in panels {
        for (rows, cols) in variants(conv) {
            for samples in [first * cols, second * cols] {
                for group in (0..rows).flat_map(|_| 0..samples.div_ceil(4)) {
                    for channel in before..before + width {
                        let of = |b: usize| (4 * group + b < samples && channel < out).then_some(channel);
                        places.extend((0..4).map(of));
                    }
                }
            }
        }
        before += width;
    }
    places
}

fn folded(conv: &mut Conv, source: &mut Tensor) {
    (conv.fold, conv.kernel_rows, conv.kernel_cols, conv.pad) = (true, 5, 5, 2);
    (source.margin, source.edge) = (2, Edge::Nearest);
}

#[test]
fn weights_and_biases_may_end_where_the_constants_end() {
    let plain: Form = |_, _| ();
    for (sources, out, form) in [((1, 0), 2, plain), ((3, 2), 20, plain), ((5, 0), 40, plain), ((3, 2), 20, folded)] {
        let mut case = Case::new(sources, out, form);
        assert_eq!(case.fault(), None, "{sources:?} into {out} channels");
        case.conv.weights += 1;
        assert_eq!(case.fault(), Some(OperatorFault::Constants), "{sources:?} into {out} channels");
        case.conv.weights -= 1;
        let biases = 4 * out * variants(&case.conv).len();
        let end = case.draft.constant(vec![0; biases]);
        case.conv.bias = end;
        assert_eq!(case.fault(), None, "{sources:?} into {out} channels");
        case.conv.bias += 1;
        assert_eq!(case.fault(), Some(OperatorFault::Constants), "{sources:?} into {out} channels");
    }
}

#[test]
fn every_weight_of_every_panel_is_validated() {
    for (sources, out) in [((3, 2), 20), ((1, 0), 40)] {
        let mut case = Case::new(sources, out, |_, _| ());
        let mut used = 0;
        for (index, place) in places(&case.conv, sources, out).into_iter().enumerate() {
            case.weight(index, 1);
            assert_eq!(case.fault(), place.is_none().then_some(OperatorFault::Constants), "byte {index}: {place:?}");
            case.weight(index, 0x80);
            assert_eq!(case.fault(), Some(OperatorFault::Constants), "byte {index}: -128 is no weight");
            case.weight(index, 0);
            used += place.is_some() as usize;
        }
        assert_eq!(used, out * 2 * 3 * (sources.0 + sources.1));
    }
}

/// The stored bias contains the share of zero codes. What a kernel sums is at most the sum of products and the rest of the bias.
#[test]
fn sums_of_every_channel_stay_within_32_bits() {
    // Largest product of a weight with a code, and the share of the zero code.
    let types: [(Form, i64, i64); 3] = [
        (|_, _| (), 255, 0),
        (|_, t| (t.zero, t.lo) = (10, 3), 245, 10),
        (|_, t| (t.dtype, t.lo, t.hi) = (Dtype::I16, -20_000, 300), 20_000, 32_768),
    ];
    for (form, most, zero) in types {
        let mut case = Case::new((3, 2), 20, form);
        let of_bytes = places(&case.conv, (3, 2), 20);
        for channel in 0..20 {
            // Two weights of the channel: one of each source.
            let of: Vec<usize> = (0..of_bytes.len()).filter(|&index| of_bytes[index] == Some(channel)).collect();
            let (first, last) = (of[0], of[of.len() - 1]);
            case.weight(first, 100);
            case.weight(last, -27i8 as u8);
            let (room, zeros) = (i64::from(i32::MAX) - 127 * most, 73 * zero);
            for (bias, expected) in [
                (room, None),
                (-room, None),
                (room + 1, Some(OperatorFault::Overflow)),
                (-room - 1, Some(OperatorFault::Overflow)),
            ] {
                // As it is stored: without the zero codes, and it may wrap.
                case.bias(channel, i64::from((bias - zeros) as i32));
                assert_eq!(case.fault(), expected, "channel {channel}, bias {bias}");
            }
            case.bias(channel, 0);
            case.weight(first, 0);
            case.weight(last, 0);
        }
    }
}

/// A pixel at a corner adds a set of filters of each of four kinds, with their biases.
#[test]
fn the_four_biases_of_a_corner_are_summed() {
    let mut case = Case::new((1, 0), 2, folded);
    let quarter = i64::from(i32::MAX / 4);
    for variant in 0..36 {
        case.bias(2 * variant + 1, if variant % 2 == 0 { quarter } else { -quarter });
    }
    assert_eq!(case.fault(), None);
    for variant in 0..36 {
        case.bias(2 * variant + 1, quarter + 3);
        assert_eq!(case.fault(), None, "variant {variant}: the largest sum is legal");
        case.bias(2 * variant + 1, quarter + 4);
        assert_eq!(case.fault(), Some(OperatorFault::Overflow), "variant {variant}");
        case.bias(2 * variant + 1, quarter);
    }
}

/// A folded convolution reads four samples along each axis, and doubles both.
#[test]
fn folded_convolutions_have_four_rows_and_columns_or_more() {
    for (size, expected) in [((4, 4), None), ((3, 4), Some(OperatorFault::Shape)), ((4, 3), Some(OperatorFault::Shape))]
    {
        let mut draft = Draft::new(size);
        let input = draft.made(Tensor { hi: 255, margin: 2, edge: Edge::Nearest, ..Tensor::new(Dtype::U8, size, 1) });
        let out = draft.place(Tensor { hi: 255, ..Tensor::new(Dtype::U8, (2 * size.0, 2 * size.1), 1) });
        let conv = draft.silent(input, out, (5, 1, 2));
        let bias = draft.words([0; 36]);
        let weights = draft.constant(vec![0; 36 * 4 * 4 * 8 * 4]);
        draft.operator(Operator::Conv(Conv { fold: true, bias, weights, ..conv }));
        draft.finish();
        draft.in_order();
        assert_eq!(fault(&draft), expected, "{size:?}");
    }
}

/// The words of a validation are all that a caller keeps between two parts of it.
#[test]
fn a_validation_goes_on_from_its_words() {
    let mut case = Case::new((3, 2), 40, |_, _| ());
    assert_eq!(case.fault(), None);
    let file = case.draft.file();
    let whole = Model::new(&file).unwrap().verdict();
    let (mut words, mut calls) = (Validation::default().to_words(), 0);
    loop {
        let mut validation = Validation::from_words(words).unwrap();
        calls += 1;
        if let Some(model) = validation.advance(&file, 1).unwrap() {
            assert_eq!(model.verdict(), whole);
            break;
        }
        assert!(calls < 100 && validation.to_words() != words);
        words = validation.to_words();
    }
    // A chunk, all tensors, the operators (two of one part, five parts, one of the output's), the output, the schedule.
    assert!(calls > 10, "{calls}");
}
