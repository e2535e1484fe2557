//! The sums that each channel of a model can have, through every kernel, against the specification.

use super::*;
use crate::nn::Model;
use crate::nn::file::{Edge, Operator, VARIANT_KINDS};
use crate::nn::kernels::requantise::Target;
use crate::nn::kernels::{ACCUMULATORS, Accumulators, pixels_at_once};
use crate::nn::panels::{groups, panels};
use crate::nn::tests::kernels;
use crate::quant::round_shift;
use std::path::Path;

/// Offset of the added map, behind the output; number of bytes of both.
const ADDED: usize = 2048;
const BYTES: usize = 4096;

/// A name and the function that turns sums into codes.
type Form = (&'static str, fn(&Requantise<'_>, &mut [u8], &Accumulators, &Target) -> u64);

/// Returns the kernels of this machine, and the form that processors without vectors run.
fn forms() -> Vec<Form> {
    let kernels = kernels().into_iter().map(|kernel| (kernel.name(), kernel.requantise));
    let by_channels: Form = ("scalar-by-channels", |r, bytes, acc, target| r.by_channels(bytes, acc, target));
    kernels.chain([by_channels]).collect()
}

/// Smallest and largest number.
type Range = (i64, i64);

/// Returns the finished sums that each channel can have: from the weights, the codes that the inputs can have, and the biases.
fn ranges(model: &Model<'_>, conv: &Conv) -> Vec<Range> {
    let (channels, constants) = (model.tensor(conv.out).channels, model.constants());
    // A pixel at a border may add one variant of each other kind.
    let mut kinds = vec![[(0, 0); VARIANT_KINDS]; channels];
    kinds.iter_mut().for_each(|kinds| kinds[0] = (i64::MAX, i64::MIN));
    let mut at = conv.weights;
    for (first, width) in panels(channels) {
        for variant in 0..conv.variants() {
            let (rows, cols) = conv.extent(variant);
            let (mut sums, mut zeros) = ([(0i64, 0i64); PANEL], [0i64; PANEL]);
            for source in conv.sources().map(|source| model.tensor(source)) {
                let zero = if source.dtype == Dtype::I16 { 1 << 15 } else { source.zero as i64 };
                let ends = [source.lo, source.hi].map(|code| (code - source.zero) as i64);
                let bytes = 4 * width * rows * groups(cols * source.channels);
                for (i, w) in constants.slice(at, bytes).iter().enumerate() {
                    let (channel, w) = (i / 4 % width, *w as i8 as i64);
                    let products = ends.map(|end| w * end);
                    sums[channel].0 += products[0].min(products[1]).min(0);
                    sums[channel].1 += products[0].max(products[1]).max(0);
                    zeros[channel] += w * zero;
                }
                at += bytes;
            }
            for c in first..channels.min(first + width) {
                let bias = constants.i32_at(conv.bias, variant * channels + c) as i64;
                let bias = (bias + zeros[c - first]) as i32 as i64;
                let (sum, kind) = (sums[c - first], &mut kinds[c][conv.variant_kind(variant)]);
                *kind = (kind.0.min(bias + sum.0), kind.1.max(bias + sum.1));
            }
        }
    }
    kinds.iter().map(|kinds| kinds.iter().fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1))).collect()
}

/// The specification: the code and whether it counts as cut, before the table.
fn specified(r: &Requantise<'_>, c: usize, sum: i64, added: i64) -> (i64, bool) {
    let product = sum * r.multiplier[c] as i64 + (added << r.add_shift) * r.add_multiplier[c] as i64;
    let v = round_shift(product, r.shift) + r.zero;
    (v.max(r.lo).min(r.hi), v > r.ceiling || v < r.floor)
}

/// What was tried.
#[derive(Default)]
struct Tried {
    channels: usize,
    sums: u64,
    /// Blocks of sums in which a kernel differs.
    differences: Vec<u64>,
    /// Largest absolute sum.
    largest: u64,
}

/// Gives the sums of a panel, every `step`th from the smallest on, to every kernel. `added` is the code of the added map.
fn sweep(forms: &[Form], r: &Requantise<'_>, ranges: &[Range], added: i32, step: u64, tried: &mut Tried) {
    let pixels = pixels_at_once(r.width);
    let target = Target { row: 0, col: 0, col_step: 1, pixels };
    let mut before = vec![0u8; BYTES];
    let mut value = 0;
    if let Some(add) = &r.add {
        let samples = pixels * r.channels;
        let bytes = [added as u8, ((added >> 8) + 128) as u8];
        for (plane, byte) in bytes.iter().enumerate().take(add.dtype.bytes()) {
            before[ADDED + plane * samples..][..samples].fill(*byte);
        }
        value = (added - add.zero) as i64;
    }
    let (mut found, samples) = (before.clone(), pixels * r.channels);
    let mut expected = before;
    let longest = ranges.iter().map(|(lo, hi)| (hi - lo) as u64 / step + 1).max().unwrap_or(0);
    for first in (0..longest).step_by(pixels) {
        let mut acc: Accumulators = [0; ACCUMULATORS];
        let mut cut = 0;
        for p in 0..pixels {
            let offset = ((first + p as u64) * step) as i64;
            for (c, (lo, hi)) in ranges.iter().enumerate() {
                let sum = (lo + offset).min(*hi);
                acc[p * r.width + c] = (sum as i32).wrapping_sub(r.bias[c]);
                let (code, is_cut) = specified(r, c, sum, value);
                cut += is_cut as u64;
                let code = r.table.map_or(code, |table| table[code as usize] as i64);
                expected[p * r.channels + c] = code as u8;
                if r.out.dtype == Dtype::I16 {
                    expected[samples + p * r.channels + c] = ((code >> 8) + 128) as u8;
                }
            }
        }
        for ((_, form), differences) in forms.iter().zip(&mut tried.differences) {
            let counted = form(r, &mut found, &acc, &target);
            *differences += (counted != cut || found != expected) as u64;
        }
    }
    tried.sums += ranges.iter().map(|(lo, hi)| (hi - lo) as u64 / step + 1).sum::<u64>();
}

/// Gives a model's sums, every `step`th of each channel, to every kernel.
fn try_model(model: &Model<'_>, step: u64) -> Tried {
    let forms = forms();
    let mut tried = Tried { differences: vec![0; forms.len()], ..Tried::default() };
    for index in 0..model.operator_count() {
        let Some(Operator::Conv(conv)) = model.operator(index) else { continue };
        let ranges = ranges(model, &conv);
        for (lo, hi) in &ranges {
            // The bound on accumulators: no finished sum overflows.
            assert!(*lo >= -(i32::MAX as i64) && *hi <= i32::MAX as i64, "operator {index}: {lo}..{hi}");
            tried.largest = tried.largest.max(lo.unsigned_abs()).max(hi.unsigned_abs());
        }
        let real = model.tensor(conv.out);
        if real.dtype == Dtype::F32 {
            continue;
        }
        tried.channels += ranges.len();
        for (first, width) in panels(real.channels) {
            let channels = width.min(real.channels - first);
            let small = |t: Tensor, offset: usize| {
                let t = Tensor { offset, margin: 0, ring: 1, rows: 1, cols: pixels_at_once(width), channels, ..t };
                Tensor { pitch: t.row_bytes(), edge: Edge::Zero, ..t }
            };
            let (out, add) = (small(real, 0), conv.add.map(|add| small(model.tensor(add), ADDED)));
            // The constants are those of the real channels.
            let of_real = requantise(model.constants(), &conv, &real, add, first, width, [Some(0), None]);
            let panel = Requantise { out: &out, first: 0, ..of_real };
            let codes = add.map_or(vec![0], |add| vec![add.lo, add.zero, add.hi]);
            for added in codes {
                sweep(&forms, &panel, &ranges[first..first + channels], added, step, &mut tried);
            }
        }
    }
    tried
}

/// Returns the models of the repository with these names, as far as they are there: this crate may be alone.
fn models(names: &[&str]) -> Vec<(String, Vec<u8>)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    names.iter().filter_map(|name| Some((name.to_string(), std::fs::read(root.join(name)).ok()?))).collect()
}

#[test]
fn many_sums_of_every_channel_give_the_specified_codes() {
    let names = ["fixtures/tile-v4.eld", "../host-train/models/nano.eld", "../tests/golden/provoked/mixed.eld"];
    for (name, file) in models(&names) {
        // A prime: all remainders occur.
        let tried = try_model(&Model::new(&file).unwrap(), 65_521);
        assert!(tried.differences.iter().all(|count| *count == 0), "{name}: {:?}", tried.differences);
        assert!(tried.channels > 0 && tried.sums > tried.channels as u64, "{name}");
    }
}

/// `ELUNAR_SUMS_STEP=1000` tries every thousandth sum, `ELUNAR_SUMS_MODEL=nano` one model.
#[test]
#[ignore = "takes minutes; prints the lines of tests/campaigns/roundings.csv"]
fn every_sum_of_every_channel_gives_the_specified_code() {
    let step = std::env::var("ELUNAR_SUMS_STEP").ok().map_or(1, |text| text.parse().expect("a number"));
    println!("model,kernel,step,channels,sums,largest,differences");
    let only = std::env::var("ELUNAR_SUMS_MODEL").unwrap_or_default();
    for (name, file) in models(&["../host-train/models/nano.eld", "../host-train/models/ground.eld"]) {
        if !name.contains(&only) {
            continue;
        }
        let tried = try_model(&Model::new(&file).unwrap(), step);
        let name = name.rsplit('/').next().unwrap_or_default();
        for ((form, _), differences) in forms().iter().zip(&tried.differences) {
            println!("{name},{form},{step},{},{},{},{differences}", tried.channels, tried.sums, tried.largest);
        }
        assert!(tried.differences.iter().all(|count| *count == 0), "{name}: {:?}", tried.differences);
    }
}
