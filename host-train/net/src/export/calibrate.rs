//! Ranges of every map over some tiles. The quantised codes must represent them.

use super::float;
use super::graph::Graph;
use elunar_base::{Error, Result};

/// One normalised tile, as input of the network.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationTile {
    /// Image: [0, 1], or a guide's four maps in every pixel; row-major rows * cols.
    pub image: Vec<f32>,
    /// Normalised coarse DTM, [0, NR], row-major.
    pub coarse: Vec<f32>,
    /// Data for the conversion of normalised units into metres; `None` for a tile that is not terrain.
    pub ground: Option<TileTruth>,
}

/// Scale and truth of a tile.
#[derive(Debug, Clone, PartialEq)]
pub struct TileTruth {
    /// Metres per normalised unit (the coarse tile's relief over NR).
    pub metres_per_unit: f32,
    /// Ground size of a pixel, metres.
    pub pixel_m: f32,
    /// True elevation, normalised by the coarse tile's range, row-major.
    pub truth: Vec<f32>,
}

/// Smallest, largest and mean value of one map, per channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Range {
    /// Smallest value per channel.
    pub min: Vec<f32>,
    /// Largest value per channel.
    pub max: Vec<f32>,
    /// Mean over all pixels of all tiles, per channel.
    pub mean: Vec<f64>,
}

impl Range {
    fn empty(channels: usize) -> Self {
        Self { min: vec![f32::INFINITY; channels], max: vec![f32::NEG_INFINITY; channels], mean: vec![0.0; channels] }
    }

    /// Includes a map in the range. `share` is the weight of one of its pixels in the mean.
    fn take(&mut self, map: &[f32], share: f64) {
        for pixel in map.chunks_exact(self.min.len()) {
            for (mean, &v) in self.mean.iter_mut().zip(pixel) {
                *mean += v as f64 * share;
            }
        }
        for pixel in map.chunks_exact(self.min.len()) {
            for ((low, high), &v) in self.min.iter_mut().zip(&mut self.max).zip(pixel) {
                (*low, *high) = (low.min(v), high.max(v));
            }
        }
    }

    /// Returns the largest absolute value per channel.
    pub fn magnitude(&self) -> Vec<f64> {
        self.min.iter().zip(&self.max).map(|(low, high)| low.abs().max(high.abs()) as f64).collect()
    }
}

/// Runs the graph on every tile. Returns a range per node. Calls `progress` after each tile.
///
/// # Errors
/// [`Error::Input`] without tiles, or if a map is not finite on one of them.
pub fn calibrate(graph: &Graph, tiles: &[CalibrationTile], progress: impl Fn(usize)) -> Result<Vec<Range>> {
    if tiles.is_empty() {
        return Err(Error::input("calibration: expected at least one tile, found none"));
    }
    let mut ranges: Vec<Range> = graph.nodes.iter().map(|node| Range::empty(node.channels)).collect();
    for (index, tile) in tiles.iter().enumerate() {
        let expected = (graph.nodes[0].len(), graph.nodes[0].rows * graph.nodes[0].cols);
        let found = (tile.image.len(), tile.coarse.len());
        if found != expected {
            return Err(Error::input(format!(
                "calibration tile {index}: expected {expected:?} samples of image and coarse DTM, found {found:?}"
            )));
        }
        for ((map, range), node) in
            float::run(graph, &tile.image, &tile.coarse).iter().zip(&mut ranges).zip(&graph.nodes)
        {
            if let Some(bad) = map.iter().find(|v| !v.is_finite()) {
                let what = format!("calibration tile {index}: map {}: expected finite numbers, found {bad}", node.name);
                return Err(Error::input(what));
            }
            range.take(map, 1.0 / (tiles.len() * node.rows * node.cols) as f64);
        }
        progress(index + 1);
    }
    Ok(ranges)
}
