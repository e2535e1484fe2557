//! The same network in larger steps, for processors with megabytes of cache. A model file is laid out for little memory: many steps make one
//! row, and read all weights for it. On the ground the weights' way through the caches takes longer than their products.
//!
//! The network, its constants and so every byte of its results stay; steps, order, places in the arena and places of the constants change.

use super::plan::plan;
use super::schedule::schedule;
use elunar_base::{Error, Result};
use elunar_core::nn::Model;
use elunar_core::nn::file::{Content, MAX_BLOCK, Operator, Tensor, word};
use std::collections::BTreeMap;

/// Pixels of a step, and the bytes of weights from which on steps are that large.
const PIXELS: usize = 320;
const WEIGHT_BYTES: usize = 16 << 10;
/// Alignment of weights within the constants: a line of the cache.
pub const LINE: usize = 64;

/// Returns a model file that computes the same bytes as `model` in larger steps.
///
/// # Errors
/// [`Error::Input`] if the file would be 4 GiB or larger.
pub fn large_steps(model: &Model<'_>) -> Result<Vec<u8>> {
    let mut tensors: Vec<Tensor> = (0..model.tensor_count()).map(|i| model.tensor(i as u32)).collect();
    let mut operators: Vec<Operator> = (0..model.operator_count()).filter_map(|i| model.operator(i)).collect();
    let constants = model.raw().section(word::CONSTANTS, model.constants_bytes() as u64);
    let constants = align(constants.map_err(|e| Error::input(format!("larger steps: {e}")))?, &mut operators);
    for operator in &mut operators {
        let Operator::Conv(conv) = operator else { continue };
        let (out, first) = (&tensors[conv.out as usize], &tensors[conv.first as usize]);
        let (rows, cols) = if conv.fold { (first.rows, first.cols) } else { (out.rows, out.cols) };
        let channels: usize = conv.sources().map(|source| tensors[source as usize].channels).sum();
        if conv.kernel_rows * conv.kernel_cols * channels * out.channels >= WEIGHT_BYTES {
            conv.block = conv.block.max((PIXELS / cols.max(1)).clamp(1, MAX_BLOCK.min(rows)));
        }
    }
    let roles = [model.image_tensor(), model.coarse_tensor(), model.output_tensor()];
    let schedule = schedule(&tensors, &operators, &[]);
    plan(&mut tensors, &operators, &schedule, &roles[..2], roles[2]);
    let content = Content {
        text: model.text(),
        tensors: &tensors,
        operators: &operators,
        schedule: &schedule,
        constants: &constants,
        tile: (model.tile().rows, model.tile().cols),
        nr: model.nr(),
        range_margin: model.range_margin(),
        truth_range: model.truth_range(),
        illumination: model.illumination(),
        roles,
        self_test: model.self_test(),
        alignment: 8,
    };
    let mut bytes = vec![0; content.file_bytes()];
    let written = content.write(&mut bytes);
    written.ok_or_else(|| Error::input("larger steps: expected a file below 4 GiB, found a larger one"))?;
    Ok(bytes)
}

/// Returns the constants with every convolution's weights at a line's start, and changes the operators' offsets.
fn align(constants: &[u8], operators: &mut [Operator]) -> Vec<u8> {
    // Where each list of constants begins, and its alignment.
    let mut starts = BTreeMap::from([(constants.len(), 1)]);
    for operator in operators.iter_mut() {
        let weights = if let Operator::Conv(conv) = operator { Some(conv.weights) } else { None };
        offsets(operator, |offset| {
            let alignment = starts.entry(*offset).or_insert(8);
            *alignment = (*alignment).max(if weights == Some(*offset) { LINE } else { 8 });
        });
    }
    let (mut aligned, mut moved) = (Vec::with_capacity(constants.len() + LINE * starts.len()), BTreeMap::new());
    let ends = starts.keys().skip(1).copied();
    for ((&start, &alignment), end) in starts.iter().zip(ends) {
        aligned.resize(aligned.len().next_multiple_of(alignment), 0);
        moved.insert(start, aligned.len());
        aligned.extend_from_slice(&constants[start..end]);
    }
    for operator in operators {
        offsets(operator, |offset| *offset = moved[offset]);
    }
    aligned
}

/// Calls `each` with every offset of constants.
fn offsets(operator: &mut Operator, mut each: impl FnMut(&mut usize)) {
    match operator {
        Operator::Conv(c) => {
            [&mut c.weights, &mut c.bias, &mut c.multipliers].into_iter().for_each(&mut each);
            if c.add.is_some() {
                each(&mut c.add_multipliers);
            }
            c.table.iter_mut().for_each(each);
        }
        Operator::LayerNorm(n) => [&mut n.gains, &mut n.biases].into_iter().for_each(each),
        Operator::Attention(a) => {
            [&mut a.pad_codes, &mut a.logit_multipliers, &mut a.position_bias, &mut a.exp_table, &mut a.multipliers]
                .into_iter()
                .for_each(each);
        }
        Operator::Upsample2(_) => {}
    }
}
