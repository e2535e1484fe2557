//! The effect of each layer's precision in metres and slope. The float network with one map rounded to its codes, or with the weights of
//! one layer rounded, is compared with the unchanged float network.
//!
//! Each rounding is measured separately. For all together, roundings count as independent: their squares are added. The sum is too large if
//! tiles exceed the calibrated ranges: the first map that cannot represent an outlier clamps it, and later maps are not affected any more.
//! [`report`](super::report) measures the runner itself, with all roundings at once.

use super::calibrate::CalibrationTile;
use super::codes::can_widen;
use super::float;
use super::graph::NodeId;
use super::report::Sums;
use super::rounding::Rounder;
use crate::export::{calibrate::Range, graph::Graph};
use elunar_base::{Error, Result};
use elunar_core::tile::Shape;
use rayon::prelude::*;
use serde::Serialize;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Effect of one rounding on the DTM.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Effect {
    /// Root mean square difference to the float network, metres.
    pub rmse_m: f64,
    /// Root mean square difference of Horn slopes, degrees.
    pub slope_rmse_deg: f64,
    /// Growth of the error against the truth, percent.
    pub error_growth_percent: f64,
    /// Growth of the slope error, percent.
    pub slope_error_growth_percent: f64,
    /// Samples of a map beyond its codes, per million. They exceed the calibrated range; their effect is not rounding.
    pub cut_ppm: f64,
}

/// Effects on one node of the network.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Layer {
    /// Name of the node.
    pub name: String,
    /// Rows, columns, channels of its map.
    pub shape: [usize; 3],
    /// Bits of its map in the export; `None` for the output, which is float.
    pub bits: Option<u8>,
    /// Effect of its map with 8 bits; `None` for inputs, whose types are fixed, and for the output.
    pub map8: Option<Effect>,
    /// Effect of its map with 16 bits; `None` if the runner cannot use 16.
    pub map16: Option<Effect>,
    /// Effect of its weights with 8 bits, as in the runner.
    pub weights8: Option<Effect>,
}

impl Layer {
    /// Returns the effect of its map with the export's bits.
    pub fn kept(&self) -> Option<Effect> {
        if self.bits == Some(8) { self.map8 } else { self.map16 }
    }

    /// Returns the larger of two effects, degrees of slope: of its map with 8 bits (with 16 if it cannot have 8), and of its weights.
    fn weight_deg(&self) -> f64 {
        let of = |effect: Option<Effect>| effect.map_or(0.0, |e| e.slope_rmse_deg);
        of(self.map8.or(self.map16)).max(of(self.weights8))
    }
}

/// The whole measurement.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sensitivity {
    /// Number of tiles measured.
    pub tiles: usize,
    /// Error of the float network against the truth, metres.
    pub float_error_m: f64,
    /// Slope error of the float network, degrees.
    pub float_slope_error_deg: f64,
    /// Expected effect of all roundings together, if they are independent of each other and of the network's error.
    pub predicted: Effect,
    /// The layers in the order of the network.
    pub layers: Vec<Layer>,
}

/// One rounding.
#[derive(Debug, Clone, Copy)]
enum Change {
    Map { id: NodeId, wide: bool },
    Weights(NodeId),
}

/// The roundings to be measured.
pub struct SensitivityPlan<'a> {
    rounder: Rounder<'a>,
    changes: Vec<Change>,
}

impl<'a> SensitivityPlan<'a> {
    /// Plans all roundings of a network. Its maps have `ranges`, and keep 16 bits where `wide` is true.
    pub fn new(graph: &'a Graph, ranges: &'a [Range], coarse_limit: f32, wide: &'a [bool]) -> Self {
        let mut changes = Vec::new();
        for id in (0..graph.nodes.len()).filter(|id| *id != graph.output()) {
            let input = graph.nodes[id].inputs().is_empty();
            if !input {
                changes.push(Change::Map { id, wide: false });
            }
            if input || can_widen(graph, id) {
                changes.push(Change::Map { id, wide: true });
            }
        }
        let weighted = |id: &NodeId| matches!(graph.nodes[*id].operation, super::graph::Operation::Conv { .. });
        changes.extend((0..graph.nodes.len()).filter(weighted).map(Change::Weights));
        Self { rounder: Rounder { graph, ranges, coarse_limit, wide }, changes }
    }

    /// Returns the number of roundings per tile.
    pub fn roundings(&self) -> usize {
        self.changes.len()
    }

    /// Measures on tiles of terrain. Calls `progress` with the number of roundings done, from several threads.
    ///
    /// # Errors
    /// [`Error::Input`] without tiles, or if one has no truth.
    pub fn measure(&self, tiles: &[CalibrationTile], progress: impl Fn(usize) + Sync) -> Result<Sensitivity> {
        if tiles.is_empty() || tiles.iter().any(|tile| tile.ground.is_none()) {
            return Err(Error::input("sensitivity: expected tiles with truth to compare on, found none"));
        }
        let graph = self.rounder.graph;
        let size = Shape::new(graph.nodes[graph.output()].rows, graph.nodes[graph.output()].cols);
        let mut sums: Vec<(Sums, usize)> = self.changes.iter().map(|_| Default::default()).collect();
        let done = AtomicUsize::new(0);
        for tile in tiles {
            let base = float::run(graph, &tile.image, &tile.coarse);
            self.changes.par_iter().zip(&mut sums).for_each(|(change, sums)| {
                let (changed, cut) = self.output(*change, &base);
                sums.1 += cut;
                sums.0.take(&base[graph.output()], &changed, tile, size);
                progress(done.fetch_add(1, Ordering::Relaxed) + 1);
            });
        }
        Ok(self.gather(&sums, tiles.len()))
    }

    /// Returns the output with one rounding, and the number of samples beyond the codes. Only maps that depend on the rounded map are
    /// computed again.
    fn output(&self, change: Change, base: &[Vec<f32>]) -> (Vec<f32>, usize) {
        let graph = self.rounder.graph;
        let mut maps: Vec<Option<Vec<f32>>> = vec![None; graph.nodes.len()];
        let read = |id: NodeId| base[id].as_slice();
        let (first, map, cut) = match change {
            Change::Map { id, wide } => {
                let (map, cut) = self.rounder.map(id, wide, &read);
                (id, Some(map), cut)
            }
            Change::Weights(id) => (id, self.rounder.weights(id, &read), 0),
        };
        maps[first] = map;
        for (id, node) in graph.nodes.iter().enumerate().skip(first + 1) {
            if node.inputs().iter().any(|input| maps[*input].is_some()) {
                maps[id] = Some(float::compute(graph, node, &|id| maps[id].as_deref().unwrap_or(&base[id])));
            }
        }
        (maps.pop().flatten().unwrap_or_else(|| base[graph.output()].clone()), cut)
    }

    fn gather(&self, sums: &[(Sums, usize)], tiles: usize) -> Sensitivity {
        let Rounder { graph, wide, .. } = self.rounder;
        let grounds: Vec<_> = sums.iter().map(|(s, _)| s.comparison(tiles).ground.unwrap_or_default()).collect();
        let mut layers: Vec<Layer> = graph
            .nodes
            .iter()
            .enumerate()
            .map(|(id, node)| {
                let input = node.inputs().is_empty();
                let sixteen = input || (wide[id] && can_widen(graph, id));
                let bits = (id != graph.output()).then_some(if sixteen { 16 } else { 8 });
                let shape = [node.rows, node.cols, node.channels];
                Layer { name: node.name.clone(), shape, bits, map8: None, map16: None, weights8: None }
            })
            .collect();
        for ((change, g), (_, cut)) in self.changes.iter().zip(&grounds).zip(sums) {
            let (Change::Map { id, .. } | Change::Weights(id)) = *change;
            let effect = Some(Effect {
                rmse_m: g.rmse_m,
                slope_rmse_deg: g.slope_rmse_deg,
                error_growth_percent: g.error_growth_percent,
                slope_error_growth_percent: g.slope_error_growth_percent,
                cut_ppm: 1e6 * *cut as f64 / (graph.nodes[id].len() * tiles) as f64,
            });
            match *change {
                Change::Map { id, wide: false } => layers[id].map8 = effect,
                Change::Map { id, wide: true } => layers[id].map16 = effect,
                Change::Weights(id) => layers[id].weights8 = effect,
            }
        }
        let first = grounds.first().copied().unwrap_or_default();
        let (float_error_m, float_slope_error_deg) = (first.float_error_m, first.float_slope_error_deg);
        let mut made =
            Sensitivity { tiles, float_error_m, float_slope_error_deg, predicted: Effect::default(), layers };
        made.predicted = made.predict();
        made
    }
}

impl Sensitivity {
    /// Returns the expected effect of all roundings together, with the layers' bits.
    pub fn predict(&self) -> Effect {
        let all = || self.layers.iter().flat_map(|l| [l.kept(), l.weights8]).flatten();
        let square = |of: fn(&Effect) -> f64| all().map(|e| of(&e).powi(2)).sum::<f64>();
        let (metres, degrees) = (square(|e| e.rmse_m), square(|e| e.slope_rmse_deg));
        let growth = |error: f64, added: f64| 100.0 * ((1.0 + added / error.powi(2).max(1e-12)).sqrt() - 1.0);
        Effect {
            rmse_m: metres.sqrt(),
            slope_rmse_deg: degrees.sqrt(),
            error_growth_percent: growth(self.float_error_m, metres),
            slope_error_growth_percent: growth(self.float_slope_error_deg, degrees),
            cut_ppm: 0.0,
        }
    }

    /// Returns the nodes whose maps can have 8 bits or 16. Those with the largest gain from 16 come first.
    pub fn by_gain(&self) -> Vec<NodeId> {
        let gain = |layer: &Layer| {
            let (eight, sixteen) = (layer.map8?, layer.map16?);
            Some(eight.slope_rmse_deg.powi(2) - sixteen.slope_rmse_deg.powi(2))
        };
        let gains = self.layers.iter().enumerate().filter_map(|(id, layer)| Some((id, gain(layer)?)));
        let mut gains: Vec<(NodeId, f64)> = gains.collect();
        gains.sort_by(|a, b| b.1.total_cmp(&a.1));
        gains.into_iter().map(|(id, _)| id).collect()
    }

    /// Sets for every map whether it keeps 16 bits, and updates the prediction.
    pub fn set_wide(&mut self, wide: &[bool]) {
        for (layer, &wide) in self.layers.iter_mut().zip(wide).filter(|(l, _)| l.map8.is_some() && l.map16.is_some()) {
            layer.bits = Some(if wide { 16 } else { 8 });
        }
        self.predicted = self.predict();
    }

    /// Returns the layers, with the largest effect on slope first.
    pub fn ranked(&self) -> Vec<&Layer> {
        let mut layers: Vec<&Layer> = self.layers.iter().collect();
        layers.sort_by(|a, b| b.weight_deg().total_cmp(&a.weight_deg()));
        layers
    }
}
