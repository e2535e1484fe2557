//! The codes of every map: type, zero, limits and steps.

use super::calibrate::Range;
use super::graph::{Activation, Graph, NodeId, Operation};
use elunar_core::nn::file::Dtype;
use elunar_core::photoclinometry::LIMIT;

/// Limit of accumulators. The rest of the range is for the bias and for the rounding of weights.
const ACCUMULATOR_LIMIT: f64 = 0.9 * i32::MAX as f64;
/// The smallest value of GELU.
pub(super) const GELU_MINIMUM: f64 = -0.170;
/// Range of 16-bit maps, as a multiple of the calibrated range. 8-bit maps have no such reserve.
const HEADROOM_16: f64 = 1.25;
/// Least range of a channel, as a share of the widest channel's range. Calibration uses few tiles, so a narrow range may be chance.
const RANGE_FLOOR: f64 = 1.0 / 32.0;

/// Bits of the maps. These always have 8 bits: weights, the input of attention, and the image of networks with given light. These always
/// have 16 bits: the residual stream of the transformer, and the other inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum MapBits {
    /// 8 bits wherever possible: least memory.
    Int8,
    /// 16 bits where 8 would be visible in the DTM: for the head's input and the sums in the decoder.
    Mixed,
    /// 16 bits everywhere except behind GELU and before attention (fewer where sums would overflow).
    Int16,
}

/// Codes of a map: value = (code - zero) * scale of its channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Codes {
    /// Sample type.
    pub dtype: Dtype,
    /// Code of 0.
    pub zero: i32,
    /// Smallest code.
    pub lo: i32,
    /// Largest code.
    pub hi: i32,
    /// Real value of one step, per channel.
    pub scales: Vec<f64>,
}

/// Scales that a map can have.
#[derive(Clone, Copy, PartialEq)]
enum Freedom {
    Channel,
    Group(usize),
    Tensor,
}

fn freedom(graph: &Graph, id: NodeId) -> Freedom {
    let node = &graph.nodes[id];
    if matches!(&node.operation, Operation::Conv { activation: Activation::Gelu, .. }) {
        return Freedom::Tensor; // one table for all channels
    }
    let mut freedom = match &node.operation {
        Operation::Attention { heads, .. } => Freedom::Group(node.channels / heads),
        _ => Freedom::Channel,
    };
    for user in graph.users(id) {
        match &user.operation {
            Operation::LayerNorm { .. } => return Freedom::Tensor,
            Operation::Attention { heads, .. } => freedom = Freedom::Group(node.channels / (3 * heads)),
            _ => {}
        }
    }
    freedom
}

/// Returns the largest code that keeps the sums of every user within 32 bits.
fn largest_code(graph: &Graph, id: NodeId) -> i32 {
    let limits = graph.users(id).map(|user| match &user.operation {
        Operation::Conv { sources, kernel, .. } if sources.iter().any(|s| s.node == id) => {
            ACCUMULATOR_LIMIT / (127 * kernel.side * kernel.side * kernel.input) as f64
        }
        _ => i16::MAX as f64,
    });
    limits.fold(i16::MAX as f64, f64::min) as i32
}

/// Returns which maps keep 16 bits by a rule without data: the residual stream always, others by the given precision.
pub fn wide_by_rule(graph: &Graph, precision: MapBits) -> Vec<bool> {
    let of = |id: NodeId| {
        let feeds_norm = graph.users(id).any(|user| matches!(user.operation, Operation::LayerNorm { .. }));
        match precision {
            MapBits::Int8 => feeds_norm,
            MapBits::Mixed => feeds_norm || graph.nodes[id].precise,
            MapBits::Int16 => true,
        }
    };
    (0..graph.nodes.len()).map(of).collect()
}

/// Returns whether the runner can keep a map in 16 bits as well as in 8. Inputs and output have fixed types. The input of attention and the
/// output of GELU have 8 bits. Sums of 16-bit codes must not exceed 32 bits.
pub fn can_widen(graph: &Graph, id: NodeId) -> bool {
    let fixed = match &graph.nodes[id].operation {
        Operation::Image | Operation::Coarse | Operation::Conv { activation: Activation::Gelu, .. } => true,
        _ => id == graph.output(),
    };
    let feeds_attention = graph.users(id).any(|user| matches!(user.operation, Operation::Attention { .. }));
    !fixed && !feeds_attention && largest_code(graph, id) > 255
}

/// Returns the codes of a node's map. Codes of inputs and output are fixed, whatever `wide` says.
pub(crate) fn codes_of(graph: &Graph, id: NodeId, range: &Range, coarse_limit: f32, wide: bool) -> Codes {
    let node = &graph.nodes[id];
    let full = i16::MAX as i32;
    match &node.operation {
        Operation::Image if node.channels == 1 => {
            return Codes { dtype: Dtype::I16, zero: 0, lo: 0, hi: full, scales: vec![1.0 / full as f64] };
        }
        Operation::Image => {
            // The maps of a tile are most of the arena, so they have 8 bits, with steps of 0.45 degrees of slope. Finer slopes come from
            // the coarse DTM.
            let scale = (LIMIT as f64 / 127.0) as f32 as f64;
            return Codes { dtype: Dtype::U8, zero: 128, lo: 1, hi: 255, scales: vec![scale; node.channels] };
        }
        Operation::Coarse => {
            let scales = vec![(coarse_limit as f64 / full as f64) as f32 as f64];
            return Codes { dtype: Dtype::I16, zero: 0, lo: -full, hi: full, scales };
        }
        _ => {}
    }
    if id == graph.output() {
        return Codes { dtype: Dtype::F32, zero: 0, lo: 0, hi: 0, scales: vec![1.0] };
    }
    let activation = match &node.operation {
        Operation::Conv { activation, .. } => *activation,
        _ => Activation::None,
    };
    let magnitude = channel_magnitudes(range, freedom(graph, id));
    if activation == Activation::Gelu {
        let top = magnitude[0].max(-2.0 * GELU_MINIMUM);
        let scale = (top - GELU_MINIMUM) / 255.0;
        let zero = (-GELU_MINIMUM / scale).ceil() as i32;
        return Codes { dtype: Dtype::U8, zero, lo: 0, hi: 255, scales: vec![scale; node.channels] };
    }
    let limit = largest_code(graph, id);
    let relu = activation == Activation::Relu;
    if wide && can_widen(graph, id) {
        let scales = magnitude.iter().map(|m| m * HEADROOM_16 / limit as f64).collect();
        return Codes { dtype: Dtype::I16, zero: 0, lo: if relu { 0 } else { -limit }, hi: limit, scales };
    }
    // The steps on both sides of 0 are equal. -128 is not a valid weight, and attention reads keys as weights.
    let (zero, lo, steps) = if relu { (0, 0, 255.0) } else { (128, 1, 127.0) };
    Codes { dtype: Dtype::U8, zero, lo, hi: 255, scales: magnitude.iter().map(|m| m / steps).collect() }
}

/// Returns the largest absolute value that each channel's scale must reach.
fn channel_magnitudes(range: &Range, freedom: Freedom) -> Vec<f64> {
    let mut magnitude = range.magnitude();
    let widest = magnitude.iter().copied().fold(0.0, f64::max);
    let widest = if widest > 0.0 { widest } else { 1.0 };
    let group = match freedom {
        Freedom::Channel => 1,
        Freedom::Group(size) => size,
        Freedom::Tensor => magnitude.len(),
    };
    for channels in magnitude.chunks_mut(group) {
        let largest = channels.iter().copied().fold(widest * RANGE_FLOOR, f64::max);
        channels.fill(largest);
    }
    magnitude
}
