//! Single steps of quantisation within the float network: the rounding of one map to its codes, or of one layer's weights.

use super::calibrate::Range;
use super::codes::{Codes, codes_of};
use super::float::{self, NodeMaps};
use super::fold::fold;
use super::graph::{Activation, ConvInput, Graph, LayerWeights, Node, NodeId, Operation};
use super::pack::Filter;
use super::quantise::{folds, gelu_table, quantise_weights};
use elunar_core::nn::file::{PHASE_TAPS, PHASES, Phase};
use rayon::prelude::*;

/// Data of the network for rounding.
pub(crate) struct Rounder<'a> {
    /// The network.
    pub graph: &'a Graph,
    /// Ranges of its maps.
    pub ranges: &'a [Range],
    /// Upper end of the normalised elevation range.
    pub coarse_limit: f32,
    /// Whether each map keeps 16 bits. The scales of a layer's inputs are part of its weights.
    pub wide: &'a [bool],
}

impl Rounder<'_> {
    /// Computes the map of node `id`, rounded to codes of 8 or 16 bits (`wide`). Also returns the number of samples beyond the codes.
    pub(crate) fn map(&self, id: NodeId, wide: bool, maps: NodeMaps<'_, '_>) -> (Vec<f32>, usize) {
        let node = &self.graph.nodes[id];
        let codes = codes_of(self.graph, id, &self.ranges[id], self.coarse_limit, wide);
        if let Operation::Conv { sources, kernel, stride, pad, add, activation: Activation::Gelu } = &node.operation {
            // The runner's table also reads codes.
            let (sources, kernel, activation) = (sources.clone(), kernel.clone(), Activation::None);
            let plain = Operation::Conv { sources, kernel, stride: *stride, pad: *pad, add: *add, activation };
            let mut map = float::compute(self.graph, &Node { operation: plain, ..node.clone() }, maps);
            let (table, step, zero) = gelu_table(&codes);
            let highest = (codes.hi as f64 - codes.zero as f64 + 0.5) * codes.scales[0];
            let cut = map.iter().filter(|v| **v as f64 > highest).count();
            map.iter_mut().for_each(|v| {
                let code = ((*v as f64 / step).round() as i32).saturating_add(zero).clamp(0, table.len() as i32 - 1);
                *v = ((table[code as usize] as i32 - codes.zero) as f64 * codes.scales[0]) as f32;
            });
            return (map, cut);
        }
        let mut map = maps(id).to_vec();
        let cut = round(&mut map, &codes);
        (map, cut)
    }

    /// Computes the map of node `id` with weights of 8 bits; `None` if none of its weights are rounded.
    pub(crate) fn weights(&self, id: NodeId, maps: NodeMaps<'_, '_>) -> Option<Vec<f32>> {
        let node = &self.graph.nodes[id];
        let Operation::Conv { sources, kernel, stride, pad, add, activation } = &node.operation else { return None };
        let codes =
            |s: &ConvInput| codes_of(self.graph, s.node, &self.ranges[s.node], self.coarse_limit, self.wide[s.node]);
        let scales: Vec<f64> = sources.iter().flat_map(|s| codes(s).scales).collect();
        let means: Vec<f64> = sources.iter().flat_map(|s| self.ranges[s.node].mean.iter().copied()).collect();
        let folded = folds(self.graph, node);
        let filters = if folded { fold(kernel) } else { vec![Filter::whole(kernel)] };
        let integers = quantise_weights(kernel, &filters, &scales, &means);
        let rounded: Vec<LayerWeights> = integers
            .filters
            .iter()
            .map(|filter| {
                let taps = filter.weights.len() / kernel.output;
                let weight = |(i, w): (usize, &i8)| {
                    (*w as f64 * integers.scales[i / taps] / scales[i % taps % kernel.input]) as f32
                };
                let bias = filter.bias.iter().zip(&integers.scales).map(|(b, s)| (*b as f64 * s) as f32).collect();
                LayerWeights {
                    weights: filter.weights.iter().enumerate().map(weight).collect(),
                    bias,
                    ..kernel.clone()
                }
            })
            .collect();
        if folded {
            let mut map = self.folded(node, sources, &rounded, maps);
            float::finish(&mut map, add.map(maps), *activation);
            return Some(map);
        }
        let kernel = rounded.into_iter().next()?;
        let (sources, activation) = (sources.clone(), *activation);
        let operation = Operation::Conv { sources, kernel, stride: *stride, pad: *pad, add: *add, activation };
        Some(float::compute(self.graph, &Node { operation, ..node.clone() }, maps))
    }

    /// Computes a convolution that contains the upsampling, without its activation. Every output phase has its own filters, and borders
    /// have corrections.
    fn folded(&self, node: &Node, sources: &[ConvInput], filters: &[LayerWeights], maps: NodeMaps<'_, '_>) -> Vec<f32> {
        let (rows, cols) = (node.rows / 2, node.cols / 2);
        let mut map = vec![0.0; node.len()];
        map.par_chunks_exact_mut(node.cols * node.channels).enumerate().for_each(|(row, line)| {
            let downs = parts(row, rows);
            let mut patch = Vec::new();
            for (col, sums) in line.chunks_exact_mut(node.channels).enumerate() {
                let across = parts(col, cols);
                let pairs = downs.iter().flatten().flat_map(|down| across.iter().flatten().map(move |a| (down, a)));
                for ((row_phase, down), (col_phase, across)) in pairs {
                    let kernel = &filters[row_phase * PHASES + col_phase];
                    patch.clear();
                    for (r, c) in down.clone().flat_map(|r| across.clone().map(move |c| (r, c))) {
                        let r = r.clamp(0, rows as isize - 1) as usize;
                        let c = c.clamp(0, cols as isize - 1) as usize;
                        for source in sources {
                            let channels = self.graph.nodes[source.node].channels;
                            patch.extend_from_slice(&maps(source.node)[(r * cols + c) * channels..][..channels]);
                        }
                    }
                    let weights = kernel.weights.chunks_exact(patch.len());
                    for ((sum, bias), weights) in sums.iter_mut().zip(&kernel.bias).zip(weights) {
                        *sum += bias + weights.iter().zip(&patch).map(|(w, x)| w * x).sum::<f32>();
                    }
                }
            }
        });
        map
    }
}

/// Returns what an output reads along an axis of `len` small samples: number of the filter or correction, and samples.
fn parts(index: usize, len: usize) -> [Option<(usize, std::ops::Range<isize>)>; 2] {
    let phase = Phase::of(index, len);
    let taps = PHASE_TAPS[phase.filter] as isize;
    let correction = phase.correction.map(|(number, at)| (number, at as isize..at as isize + 1));
    [Some((phase.filter, phase.first..phase.first + taps)), correction]
}

/// Rounds samples to the nearest code. Returns the number of samples beyond the codes.
fn round(map: &mut [f32], codes: &Codes) -> usize {
    let (low, high) = ((codes.lo - codes.zero) as f64, (codes.hi - codes.zero) as f64);
    let mut cut = 0;
    for pixel in map.chunks_exact_mut(codes.scales.len()) {
        for (v, &scale) in pixel.iter_mut().zip(&codes.scales) {
            let code = (*v as f64 / scale).round();
            cut += !(low..=high).contains(&code) as usize;
            *v = (code.clamp(low, high) * scale) as f32;
        }
    }
    cut
}
