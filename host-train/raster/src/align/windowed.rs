//! A source on another grid, window by window.

use super::map::{Grid, Map, is_cyclic};
use super::sample::{Piece, Sampler};
use super::{Interpolation, SAME_GRID_PX, bounds};
use crate::GeoRef;
use crate::source::{Info, Source};
use elunar_base::{Error, Result};
use elunar_core::tile::Window;
use rayon::prelude::*;
use std::sync::Arc;

/// Number of positions computed at once. They take 4 MiB, whatever the window.
const POSITIONS: usize = 1 << 18;

/// Reach of any interpolation around a position, in samples, and one more for the rounding of positions.
const MARGIN_PX: f64 = 3.0;

/// Greatest error of a position by rounding, pixels.
const ROUNDING_PX: f64 = 1e-9;

/// Points per side of the lattice that checks whether two grids overlap.
const LATTICE: usize = 65;

/// A raster on another raster's grid. It is read in windows of the target; only the part of the source under a window is read.
pub struct Onto {
    source: Arc<dyn Source>,
    plan: AlignPlan,
}

impl Onto {
    /// Prepares `source` for the grid of `target`. The names are used in messages. The systems may differ if both are supported
    /// ([`crate::Projection`]) and on one sphere. On the same grid, samples are copied, not interpolated.
    ///
    /// # Errors
    /// [`Error::Input`] if either has no georeference, a system is unknown, the spheres differ, or the grids do not overlap.
    pub fn new(
        source: Arc<dyn Source>,
        source_name: &str,
        target: &Info,
        target_name: &str,
        interpolation: Interpolation,
    ) -> Result<Self> {
        let plan = AlignPlan::new((source_name, source.info()), (target_name, target), interpolation)?;
        plan.check_overlap((source_name, source.info()), (target_name, target))?;
        Ok(Self { source, plan })
    }

    /// Lets bilinear interpolation reach up to the source's edges, where the outermost samples hold: then neighbours leave no gap.
    #[must_use]
    pub fn to_edges(mut self) -> Self {
        self.plan.edge_px = EDGE_PX;
        self
    }

    /// Returns the window of the source, on its own grid, under a target of these rows and columns, with a margin of three samples. Parts
    /// beyond the seam of a source around the sphere are left out. `None` if nothing is under it.
    #[must_use]
    pub fn under(&self, rows: usize, cols: usize) -> Option<Window> {
        let mut positions: Vec<(f64, f64)> =
            lattice(rows, cols).map(|(row, col)| self.plan.map.apply(row, col)).collect();
        self.plan.unwind(&mut positions);
        let Under { row, col, rows, cols } = self.plan.under(&positions)?;
        let around = self.plan.size.1;
        let col = col.rem_euclid(around as isize) as usize;
        Some(Window { row, col, rows, cols: cols.min(around - col) })
    }

    /// Returns the source.
    #[must_use]
    pub fn source(&self) -> &dyn Source {
        self.source.as_ref()
    }

    /// Reads the samples of a window of the target, row by row; NaN where the source has none. A value does not depend on the window.
    ///
    /// # Errors
    /// If the source cannot be read there.
    pub fn read(&self, window: Window) -> Result<Vec<f32>> {
        self.plan.read(self.source.as_ref(), window)
    }
}

/// Half a pixel, and what rounding of corners leaves between neighbours.
const EDGE_PX: f64 = 0.55;

/// How a source is resampled on a target.
#[derive(Debug, Clone)]
pub(super) struct AlignPlan {
    map: Map,
    interpolation: Interpolation,
    /// Rows and columns of the source.
    size: (usize, usize),
    cyclic: bool,
    same_grid: bool,
    edge_px: f64,
}

impl AlignPlan {
    pub(super) fn new(
        (source_name, source): (&str, &Info),
        (target_name, target): (&str, &Info),
        interpolation: Interpolation,
    ) -> Result<Self> {
        let (from, to) = (grid(source_name, source)?, grid(target_name, target)?);
        check_systems((source_name, from.0), (target_name, to.0))?;
        let map = Map::between(to, from)
            .ok_or_else(|| Error::input(format!("{source_name}: transform {:?} has no inverse", from.0.transform)))?;
        let same_grid = from.1 == to.1 && is_identity(&map, to.1);
        Ok(Self { map, interpolation, size: from.1, cyclic: is_cyclic(from), same_grid, edge_px: 0.0 })
    }

    /// Reads the samples of `window` of the target.
    pub(super) fn read(&self, source: &dyn Source, window: Window) -> Result<Vec<f32>> {
        if self.same_grid {
            return source.read(window);
        }
        let mut out = vec![f32::NAN; window.rows * window.cols];
        if out.is_empty() {
            return Ok(out);
        }
        let rows_at_once = (POSITIONS / window.cols).max(1);
        for (index, lines) in out.chunks_mut(rows_at_once * window.cols).enumerate() {
            self.fill(source, window.row + index * rows_at_once, window, lines)?;
        }
        Ok(out)
    }

    /// Fills some rows of the window, from `first_row` of the target on.
    fn fill(&self, source: &dyn Source, first_row: usize, window: Window, lines: &mut [f32]) -> Result<()> {
        let rows = lines.len() / window.cols;
        if let Some((rows, cols)) = self.map.straight(Window { row: first_row, rows, ..window }) {
            return self.fill_straight(source, &rows, &cols, lines);
        }
        let mut positions = vec![(f64::NAN, f64::NAN); lines.len()];
        positions.par_chunks_mut(window.cols).enumerate().for_each(|(row, line)| {
            for (col, position) in line.iter_mut().enumerate() {
                *position = self.map.apply((first_row + row) as f64, (window.col + col) as f64);
            }
        });
        self.unwind(&mut positions);
        let Some(piece) = self.under(&positions) else { return Ok(()) };
        let (row0, col0) = (piece.row as f64, piece.col as f64);
        let sampler = Sampler::new(self.cut(source, piece)?, self.interpolation);
        lines.par_chunks_mut(window.cols).zip(positions.par_chunks(window.cols)).for_each(|(line, positions)| {
            for (value, &(r, c)) in line.iter_mut().zip(positions) {
                // The subtraction of whole numbers is exact, so the value is the same as for the whole grid.
                *value = sampler.at(r - row0, c - col0);
            }
        });
        Ok(())
    }

    /// Fills lines whose pixels lie where each of `rows` crosses each of `cols` on the source's grid.
    fn fill_straight(&self, source: &dyn Source, rows: &[f64], cols: &[f64], lines: &mut [f32]) -> Result<()> {
        let mut first: Vec<(f64, f64)> = cols.iter().map(|&c| (rows[0], c)).collect();
        self.unwind(&mut first);
        // The extent of all crossings is that of a row and a column that lie on the grid.
        let inside = |at: &(f64, f64)| self.inside(*at);
        let row = rows.iter().find_map(|&r| first.iter().map(|&(_, c)| (r, c)).find(inside));
        let Some((r, c)) = row else { return Ok(()) };
        let cross = first.iter().map(|&(_, c)| (r, c)).chain(rows.iter().map(|&r| (r, c)));
        let Some(piece) = self.under(&cross.collect::<Vec<_>>()) else { return Ok(()) };
        let (row0, col0) = (piece.row as f64, piece.col as f64);
        let sampler = Sampler::new(self.cut(source, piece)?, self.interpolation);
        let rows: Vec<f64> = rows.iter().map(|r| r - row0).collect();
        let cols: Vec<f64> = first.iter().map(|(_, c)| c - col0).collect();
        sampler.crossings(&rows, &cols, lines);
        Ok(())
    }

    /// Brings columns on a grid around the sphere near to each other. There a column has several numbers, and the number nearest to the
    /// first position's is taken, so that a piece across the seam is contiguous.
    fn unwind(&self, positions: &mut [(f64, f64)]) {
        if !self.cyclic {
            return;
        }
        let around = self.size.1 as f64;
        let Some(first) = positions.iter().map(|p| p.1).find(|c| c.is_finite()) else { return };
        for (_, c) in positions {
            *c -= around * ((*c - first) / around).round();
        }
    }

    /// Returns whether a position lies on the source.
    fn inside(&self, (r, c): (f64, f64)) -> bool {
        let within = |v: f64, count: usize| (-0.6..=count as f64 - 0.4).contains(&v);
        within(r, self.size.0) && (self.cyclic && c.is_finite() || within(c, self.size.1))
    }

    /// Returns the piece of the source that the positions need. Columns may lie beyond the edge only if the grid is cyclic.
    fn under(&self, positions: &[(f64, f64)]) -> Option<Under> {
        let far = (f64::INFINITY, f64::NEG_INFINITY);
        let (rows, cols) = (self.size.0 as f64, self.size.1 as f64);
        let (r, c) = positions
            .iter()
            .filter(|at| self.inside(**at))
            .fold((far, far), |((r0, r1), (c0, c1)), &(r, c)| ((r0.min(r), r1.max(r)), (c0.min(c), c1.max(c))));
        if r.0 > r.1 {
            return None;
        }
        let (mut first_col, mut end_col) = ((c.0 - MARGIN_PX).floor(), (c.1 + MARGIN_PX).ceil() + 1.0);
        if !self.cyclic {
            (first_col, end_col) = (first_col.max(0.0), end_col.min(cols));
        }
        let (row, end) = ((r.0 - MARGIN_PX).floor().max(0.0), ((r.1 + MARGIN_PX).ceil() + 1.0).min(rows));
        Some(Under {
            row: row as usize,
            col: first_col as isize,
            rows: (end - row) as usize,
            cols: (end_col - first_col) as usize,
        })
    }

    /// Reads a piece, across the seam if needed.
    fn cut(&self, source: &dyn Source, under: Under) -> Result<Piece> {
        let Under { row, col, rows, cols } = under;
        let around = self.size.1;
        // With different maps, positions lie on the grid only by chance.
        let snap_px = if matches!(self.map, Map::Affine(_)) { SAME_GRID_PX } else { ROUNDING_PX };
        let first = col.rem_euclid(around as isize) as usize;
        if first + cols <= around {
            let samples = source.read(Window { row, col: first, rows, cols })?;
            return Ok(Piece { samples, rows, cols, snap_px, edge_px: self.edge_px });
        }
        let mut samples = vec![f32::NAN; rows * cols];
        let mut done = 0;
        while done < cols {
            let from = (first + done) % around;
            let width = (around - from).min(cols - done);
            let part = source.read(Window { row, col: from, rows, cols: width })?;
            for (to, line) in samples.chunks_exact_mut(cols).zip(part.chunks_exact(width)) {
                to[done..done + width].copy_from_slice(line);
            }
            done += width;
        }
        Ok(Piece { samples, rows, cols, snap_px, edge_px: self.edge_px })
    }

    /// Refuses grids that share no point, before any other work.
    fn check_overlap(&self, source: (&str, &Info), target: (&str, &Info)) -> Result<()> {
        let (from, to) = (grid(source.0, source.1)?, grid(target.0, target.1)?);
        // Either grid may be the smaller one and fall between the lattice points of the other.
        let back = Map::between(from, to);
        let lies_on = |map: &Map, (rows, cols): (usize, usize), (on_rows, on_cols): (usize, usize), cyclic: bool| {
            lattice(rows, cols).any(|(row, col)| {
                let (r, c) = map.apply(row, col);
                let within = |v: f64, count: usize| v >= -0.5 && v <= count as f64 - 0.5;
                within(r, on_rows) && (within(c, on_cols) || cyclic && c.is_finite())
            })
        };
        let overlap = lies_on(&self.map, to.1, from.1, self.cyclic)
            || back.is_some_and(|map| lies_on(&map, from.1, to.1, is_cyclic(to)));
        if overlap { Ok(()) } else { Err(no_overlap(source, target)) }
    }
}

/// Position of a piece in the source.
#[derive(Debug, Clone, Copy)]
struct Under {
    row: usize,
    col: isize,
    rows: usize,
    cols: usize,
}

/// Returns the error for rasters that share no valid sample.
pub(super) fn no_overlap((source_name, source): (&str, &Info), (target_name, target): (&str, &Info)) -> Error {
    let (Ok(from), Ok(to)) = (grid(source_name, source), grid(target_name, target)) else {
        return Error::input(format!("{source_name}: a place expected, none found"));
    };
    let as_degrees = !from.0.crs.same_as(&to.0.crs);
    let (a, b) = (bounds(from, as_degrees), bounds(to, as_degrees));
    let doubt = |name: &str, (georef, (rows, cols)): Grid| {
        georef.doubt(rows, cols).map(|doubt| format!("; {name}: {doubt}")).unwrap_or_default()
    };
    let doubts = doubt(source_name, from) + &doubt(target_name, to);
    Error::input(format!(
        "{source_name}: valid samples overlapping {target_name} expected, none found: it covers {a}, {target_name} covers {b}{doubts}"
    ))
}

/// Returns georeference and size; both must be complete.
fn grid<'a>(name: &str, info: &'a Info) -> Result<Grid<'a>> {
    Ok((info.place(name)?, (info.rows, info.cols)))
}

fn check_systems((source_name, source): (&str, &GeoRef), (target_name, target): (&str, &GeoRef)) -> Result<()> {
    let (a, b) = (source.crs.summary(), target.crs.summary());
    if let (Some(from_m), Some(to_m)) = (source.crs.sphere_radius_m(), target.crs.sphere_radius_m())
        && (from_m - to_m).abs() > 1e-6 * to_m
    {
        let what = format!("{source_name}: the sphere of {target_name} ({to_m} m) expected, {from_m} m found");
        return Err(Error::input(what));
    }
    let known = |georef: &GeoRef| crate::Projection::of(&georef.crs).is_some();
    if source.crs.same_as(&target.crs) || known(source) && known(target) {
        return Ok(());
    }
    let remedy = match known(source) {
        true => target.crs.remedy(target_name, Some(&source.crs)),
        false => source.crs.remedy(source_name, Some(&target.crs)),
    };
    let what = format!("{source_name}: the reference system of {target_name} ({b}) expected, {a} found");
    Err(Error::input(format!("{what}; {remedy}")))
}

/// Returns whether the map is the identity. An affine map differs most from the identity at a corner. Other maps never count as the
/// identity.
fn is_identity(map: &Map, (rows, cols): (usize, usize)) -> bool {
    let (last_row, last_col) = (rows.saturating_sub(1) as f64, cols.saturating_sub(1) as f64);
    matches!(map, Map::Affine(_))
        && [(0.0, 0.0), (0.0, last_col), (last_row, 0.0), (last_row, last_col)].into_iter().all(|(row, col)| {
            let (r, c) = map.apply(row, col);
            (r - row).abs() <= SAME_GRID_PX && (c - col).abs() <= SAME_GRID_PX
        })
}

/// Returns evenly spread pixels, the outermost included.
pub(super) fn lattice(rows: usize, cols: usize) -> impl Iterator<Item = (f64, f64)> {
    let at = |i: usize, count: usize| i as f64 / (LATTICE - 1) as f64 * (count as f64 - 1.0);
    (0..LATTICE * LATTICE).map(move |i| (at(i / LATTICE, rows), at(i % LATTICE, cols)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Raster;
    use crate::resample::PixelMap;
    use crate::source::InMemory;

    /// Grids of the same directions are read line by line. A map that turns by the least number is read position by position, and gives the same bits.
    #[test]
    fn straight_grids_are_read_as_others_are() {
        let (rows, cols) = (9, 12);
        let mut samples: Vec<f32> = (0..rows * cols).map(|k| ((k * k * 31 + 17 * k) % 97) as f32).collect();
        samples[5 * cols + 4] = f32::NAN;
        let source = InMemory::new(Raster { rows, cols, samples, georef: None }, None, "memory");
        let straight = PixelMap {
            row0: -2.3,
            row_per_row: 0.23,
            row_per_col: 0.0,
            col0: -1.7,
            col_per_row: 0.0,
            col_per_col: 0.31,
        };
        let turned = PixelMap { row_per_col: f64::MIN_POSITIVE, col_per_row: f64::MIN_POSITIVE, ..straight };
        let window = Window { row: 3, col: 2, rows: 50, cols: 44 };
        let beyond = Window { row: 90, ..window };
        for interpolation in [Interpolation::Bicubic, Interpolation::Bilinear, Interpolation::CubicSpline] {
            for cyclic in [false, true] {
                let read = |map: PixelMap, window| {
                    let (map, size) = (Map::Affine(map), (rows, cols));
                    let plan = AlignPlan { map, interpolation, size, cyclic, same_grid: false, edge_px: EDGE_PX };
                    plan.read(&source, window).unwrap().into_iter().map(f32::to_bits).collect::<Vec<_>>()
                };
                assert_eq!(read(straight, window), read(turned, window), "{interpolation:?} {cyclic}");
                assert!(read(straight, window).iter().any(|v| f32::from_bits(*v).is_finite()));
                assert!(read(straight, beyond).iter().all(|v| f32::from_bits(*v).is_nan()));
                // Pixels of a width that is no number lie nowhere.
                let nowhere = PixelMap { col_per_col: f64::NAN, ..straight };
                assert!(read(nowhere, window).iter().all(|v| f32::from_bits(*v).is_nan()));
            }
        }
    }
}
