//! The weighted mean of whole DTMs on different grids.

use super::grid::{Grid, MosaicInput, ON_GRID_PX};
use super::weights::{WeightRules, grassfire};
use elunar_base::{Error, Result};
use elunar_core::tile::Window;
use elunar_raster::GeoTransform;
use elunar_raster::resample::PixelMap;
use rayon::prelude::*;

/// Positions closer than this, in pixels, to a row or column of pixel centres lie on it. Then no neighbour beyond it is read.
const ON_CENTRE_PX: f64 = 1e-3;

/// A DTM reaches so far beyond the centres of its outermost pixels: half a pixel, and what rounding of corners leaves between two tiles. So
/// neighbours join without a gap. There the outermost height holds.
const EDGE_PX: f64 = 0.55;

/// Rules for joining DTMs.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JoinRules {
    /// Weight by distance from edges and gaps.
    pub weights: WeightRules,
    /// If positive, an earlier DTM is kept unchanged, except in a band this wide, in pixels, along its edges and gaps. In the band the next
    /// DTM is blended in (`--priority-blending-length`).
    pub priority_px: u32,
}

/// Joins the DTMs on `grid`, earlier ones first. Heights are row-major, NaN where no DTM has one. A part of a mosaic's grid
/// ([`Grid::rows`]) gives the same values as the whole mosaic there, so that a large mosaic can be made band by band.
///
/// Each DTM is weighted on its own grid and sampled at the mosaic's pixel centres. Where its own pixels nearly coincide, samples are taken
/// unchanged, otherwise bilinearly. If one of the four neighbours has no weight, the pixel gets nothing (`dem_mosaic`). Up to its edges a
/// DTM has its outermost heights (our choice), so that neighbours leave no gap.
///
/// # Errors
/// [`Error::Input`] if a DTM's transform has no inverse. Errors of reading the DTMs are passed on.
pub fn join(inputs: &[MosaicInput], grid: &Grid, rules: &JoinRules) -> Result<Vec<f32>> {
    // With priorities, pixels around the grid influence the weights within it.
    let frame = if rules.priority_px > 0 { Frame::around(inputs, grid, rules) } else { Frame::of(grid) };
    let mut sums = Sums::new(frame.rows * frame.cols);
    let mut room = vec![f64::INFINITY; if rules.priority_px > 0 { frame.rows * frame.cols } else { 0 }];
    for (input, place) in
        inputs.iter().flat_map(|input| grid.places(input.source.info()).into_iter().map(move |p| (input, p)))
    {
        if let Some(part) = Part::read((input, place), grid, &frame, rules)? {
            if rules.priority_px > 0 {
                part.add_with_priority(&frame, rules, &mut room, &mut sums);
            } else {
                part.add(&frame, &mut sums);
            }
        }
    }
    Ok(frame.crop(&sums.mean(), grid))
}

/// The pixels that are computed: the grid's, or more around it.
struct Frame {
    /// Number of rows above the grid.
    above: usize,
    /// Number of columns left of the grid.
    left: usize,
    rows: usize,
    cols: usize,
}

impl Frame {
    fn of(grid: &Grid) -> Self {
        Self { above: 0, left: 0, rows: grid.rows, cols: grid.cols }
    }

    /// Returns the grid and a margin: twice the reach of a weight, since weights are computed twice.
    fn around(inputs: &[MosaicInput], grid: &Grid, rules: &JoinRules) -> Self {
        let reach = f64::from(2 * rules.reach_px() + rules.priority_px);
        let (mut low, mut high) = ([0.0_f64; 2], [grid.rows as f64, grid.cols as f64]);
        let t = grid.georef.transform;
        let places = inputs.iter().map(|input| input.source.info());
        for (info, from) in places.flat_map(|info| grid.places(info).into_iter().map(move |from| (info, from))) {
            let corners =
                [(from[3], from[0]), (from[3] + info.rows as f64 * from[5], from[0] + info.cols as f64 * from[1])];
            for (y, x) in corners {
                let at = [(y - t[3]) / t[5], (x - t[0]) / t[1]];
                low = std::array::from_fn(|k| low[k].min(at[k].floor()));
                high = std::array::from_fn(|k| high[k].max(at[k].ceil()));
            }
        }
        let [above, left] = low.map(|v| (-v).min(reach) as usize);
        let [rows, cols] = [(high[0], grid.rows), (high[1], grid.cols)].map(|(v, n)| v.min(n as f64 + reach) as usize);
        Self { above, left, rows: above + rows, cols: left + cols }
    }

    fn crop(&self, samples: &[f32], grid: &Grid) -> Vec<f32> {
        let line = |row: usize| &samples[(row + self.above) * self.cols + self.left..][..grid.cols];
        (0..grid.rows).flat_map(|row| line(row).iter().copied()).collect()
    }
}

impl JoinRules {
    /// Returns the greatest distance at which a gap or edge changes a weight, pixels.
    fn reach_px(&self) -> u32 {
        self.weights.farthest_px() + self.weights.taps() as u32
    }
}

/// Returns the map of a DTM of `rows` x `cols` that lies nearly on the mosaic's grid as if it lay on it: along each axis alone.
fn on_grid(map: PixelMap, rows: usize, cols: usize) -> PixelMap {
    let axis = |start: f64, step: f64, count: usize| {
        let last = count as f64 - 1.0;
        let ends = [-start / step, (last - start) / step];
        let whole = ends.iter().all(|at| (at - at.round()).abs() < ON_GRID_PX);
        if whole && ends[1].round() - ends[0].round() == last { (-ends[0].round(), 1.0) } else { (start, step) }
    };
    let (row0, row_per_row) = axis(map.row0, map.row_per_row, rows);
    let (col0, col_per_col) = axis(map.col0, map.col_per_col, cols);
    PixelMap { row0, row_per_row, col0, col_per_col, ..map }
}

struct Sums {
    weighted_m: Vec<f64>,
    weight: Vec<f64>,
}

impl Sums {
    fn new(count: usize) -> Self {
        Self { weighted_m: vec![0.0; count], weight: vec![0.0; count] }
    }

    /// Returns the mean. A pixel without any DTM becomes 0 / 0 = NaN.
    fn mean(&self) -> Vec<f32> {
        self.weighted_m.par_iter().zip(&self.weight).map(|(z, w)| (z / w) as f32).collect()
    }
}

/// The part of one DTM that the frame needs: heights and weights on the DTM's own grid.
struct Part {
    heights_m: Vec<f32>,
    weights: Vec<f64>,
    rows: usize,
    cols: usize,
    /// Map from the frame's pixels to this part's pixels.
    map: PixelMap,
}

impl Part {
    /// Returns `None` if the DTM, at this place, does not reach the frame.
    fn read(
        (input, place): (&MosaicInput, GeoTransform),
        grid: &Grid,
        frame: &Frame,
        rules: &JoinRules,
    ) -> Result<Option<Self>> {
        let info = input.source.info();
        let map = PixelMap::between(&grid.georef.transform, &place);
        let map = map.ok_or_else(|| Error::input(format!("{}: an invertible geotransform expected", input.name)))?;
        let map = on_grid(map, info.rows, info.cols);
        let map = PixelMap {
            row0: map.row0 - frame.above as f64 * map.row_per_row,
            col0: map.col0 - frame.left as f64 * map.col_per_col,
            ..map
        };
        let margin = f64::from(rules.reach_px().max(rules.priority_px)) + 2.0;
        let span = |start: f64, step: f64, count: usize, all: usize| {
            let first = (start - margin).floor().max(0.0);
            let end = (start + step * (count - 1) as f64 + margin).ceil() + 1.0;
            (first < end && first < all as f64).then(|| first as usize..(end as usize).min(all))
        };
        let rows = span(map.row0, map.row_per_row, frame.rows, info.rows);
        let cols = span(map.col0, map.col_per_col, frame.cols, info.cols);
        let (Some(rows), Some(cols)) = (rows, cols) else { return Ok(None) };
        let window = Window { row: rows.start, col: cols.start, rows: rows.len(), cols: cols.len() };
        let heights_m = input.source.read(window)?;
        let valid: Vec<bool> = heights_m.iter().map(|z| z.is_finite()).collect();
        let weights = if rules.priority_px > 0 {
            // The distance matters here only where it falls below the priority length.
            let eroded = |d: u32| f64::from(d.saturating_sub(rules.weights.erode_px));
            grassfire(&valid, window.rows, window.cols).into_iter().map(eroded).collect()
        } else {
            rules.weights.weights(&valid, window.rows, window.cols)
        };
        let map = PixelMap { row0: map.row0 - rows.start as f64, col0: map.col0 - cols.start as f64, ..map };
        Ok(Some(Self { heights_m, weights, rows: window.rows, cols: window.cols, map }))
    }

    /// Returns height and weight at a pixel of the frame; `None` off the DTM and where a neighbour has no weight.
    fn at(&self, row: usize, col: usize) -> Option<(f64, f64)> {
        let (r, c) = self.map.apply(row as f64, col as f64);
        let snap = |v: f64| if (v - v.round()).abs() < ON_CENTRE_PX { v.round() } else { v };
        let within = |v: f64, count: usize| {
            let last = count as f64 - 1.0;
            (v >= -EDGE_PX && v <= last + EDGE_PX).then(|| snap(v).clamp(0.0, last))
        };
        let (r, c) = (within(r, self.rows)?, within(c, self.cols)?);
        let index = |r: f64, c: f64| r as usize * self.cols + c as usize;
        let (fr, fc) = (r.fract(), c.fract());
        let corners = [
            (index(r.floor(), c.floor()), (1.0 - fr) * (1.0 - fc)),
            (index(r.floor(), c.ceil()), (1.0 - fr) * fc),
            (index(r.ceil(), c.floor()), fr * (1.0 - fc)),
            (index(r.ceil(), c.ceil()), fr * fc),
        ];
        if corners.iter().any(|&(i, _)| self.weights[i] <= 0.0) {
            return None;
        }
        let sum = |value: &dyn Fn(usize) -> f64| corners.iter().map(|&(i, share)| share * value(i)).sum::<f64>();
        Some((sum(&|i| f64::from(self.heights_m[i])), sum(&|i| self.weights[i])))
    }

    fn add(&self, frame: &Frame, sums: &mut Sums) {
        let lines = sums.weighted_m.par_chunks_mut(frame.cols).zip(sums.weight.par_chunks_mut(frame.cols));
        lines.enumerate().for_each(|(row, (weighted_m, weight))| {
            for (col, (weighted_m, weight)) in weighted_m.iter_mut().zip(weight).enumerate() {
                if let Some((z, w)) = self.at(row, col).filter(|&(_, w)| w > 0.0) {
                    *weighted_m += w * z;
                    *weight += w;
                }
            }
        });
    }

    /// Removes the pixels that earlier DTMs keep, and computes the weights of the remaining pixels again, on the mosaic's grid. `room` is
    /// the remaining weight at each pixel.
    fn add_with_priority(&self, frame: &Frame, rules: &JoinRules, room: &mut [f64], sums: &mut Sums) {
        let length = f64::from(rules.priority_px);
        let mut heights_m = vec![f64::NAN; room.len()];
        let lines = heights_m.par_chunks_mut(frame.cols).zip(room.par_chunks_mut(frame.cols));
        lines.enumerate().for_each(|(row, (heights_m, room))| {
            for (col, (height_m, room)) in heights_m.iter_mut().zip(room).enumerate() {
                let Some((z, w)) = self.at(row, col) else { continue };
                let w = w.min(*room);
                *room = room.min((length - w).max(0.0));
                if w > 0.0 {
                    *height_m = z;
                }
            }
        });
        let valid: Vec<bool> = heights_m.iter().map(|z| z.is_finite()).collect();
        // Erosion was done on the DTM's own grid. Here it only contributes to the largest distance.
        let weights = rules.weights.weights_of_eroded(&valid, frame.rows, frame.cols);
        for (i, (z, w)) in heights_m.into_iter().zip(weights).enumerate() {
            if w > 0.0 {
                sums.weighted_m[i] += w * z;
                sums.weight[i] += w;
            }
        }
    }
}

#[cfg(test)]
mod seam_tests;
#[cfg(test)]
mod tests;
