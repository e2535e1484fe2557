//! Positions of one grid's pixels on another grid.

use crate::resample::PixelMap;
use crate::{GeoRef, GeoTransform, Projection};
use elunar_core::tile::Window;

/// Map from pixel centres of a target grid to positions on a source grid, in source pixels. (0, 0) is the centre of the first pixel.
#[derive(Debug, Clone)]
pub(super) enum Map {
    /// Both grids lie on one map.
    Affine(PixelMap),
    /// Through longitude and latitude.
    Through(Box<Through>),
}

/// Two maps of one sphere.
#[derive(Debug, Clone)]
pub(super) struct Through {
    target: (Projection, GeoTransform),
    source: (Projection, GeoTransform),
    /// Map x of the source's middle, and the period of x.
    around: Option<(f64, f64)>,
}

/// A grid: its georeference, and its rows and columns.
pub(super) type Grid<'a> = (&'a GeoRef, (usize, usize));

impl Map {
    /// Returns `None` if the source's transform cannot be inverted, or the systems differ and one of them is not supported.
    pub(super) fn between((target, target_size): Grid, (source, source_size): Grid) -> Option<Self> {
        let (to, from) = (Projection::of(&target.crs), Projection::of(&source.crs));
        let mut place = source.transform;
        if target.crs.same_as(&source.crs) {
            if let Some(period) = from.as_ref().and_then(Projection::period) {
                // A meridian has several values of x. The value of the source nearest to the target's is taken.
                let apart = middle(target, target_size).0 - middle(source, source_size).0;
                place[0] += period * (apart / period).round();
            }
            return Some(Self::Affine(PixelMap::between(&target.transform, &place)?));
        }
        let (to, from) = (to?, from?);
        let around = from.period().map(|period| (middle(source, source_size).0, period));
        let det = place[1] * place[5] - place[2] * place[4];
        let through = Through { target: (to, target.transform), source: (from, place), around };
        (det.is_finite() && det != 0.0).then(|| Self::Through(Box::new(through)))
    }

    /// Returns the position of the centre of target pixel (`row`, `col`); NaN where the source's map does not have the point.
    pub(super) fn apply(&self, row: f64, col: f64) -> (f64, f64) {
        match self {
            Self::Affine(map) => map.apply(row, col),
            Self::Through(through) => through.apply(row, col),
        }
    }

    /// Returns the rows and columns on the source grid of a window's rows and columns, if each has only one there.
    pub(super) fn straight(&self, window: Window) -> Option<(Vec<f64>, Vec<f64>)> {
        let Self::Affine(map) = self else { return None };
        let rows = (window.row..window.row + window.rows).map(|row| map.apply(row as f64, 0.0).0).collect();
        let cols = (window.col..window.col + window.cols).map(|col| map.apply(0.0, col as f64).1).collect();
        (map.row_per_col == 0.0 && map.col_per_row == 0.0).then_some((rows, cols))
    }
}

impl Through {
    fn apply(&self, row: f64, col: f64) -> (f64, f64) {
        let (projection, t) = &self.target;
        let (row, col) = (row + 0.5, col + 0.5);
        let (lon_deg, lat_deg) = projection.inverse(t[0] + col * t[1] + row * t[2], t[3] + col * t[4] + row * t[5]);
        let (projection, t) = &self.source;
        let (mut x, y) = projection.forward(lon_deg, lat_deg);
        if let Some((middle, period)) = self.around {
            x -= period * ((x - middle) / period).round();
        }
        let det = t[1] * t[5] - t[2] * t[4];
        let (dx, dy) = (x - t[0], y - t[3]);
        ((dy * t[1] - dx * t[4]) / det - 0.5, (dx * t[5] - dy * t[2]) / det - 0.5)
    }
}

/// Returns the map coordinates of a grid's middle.
fn middle(georef: &GeoRef, (rows, cols): (usize, usize)) -> (f64, f64) {
    georef.centre(rows as f64 / 2.0 - 0.5, cols as f64 / 2.0 - 0.5)
}

/// Returns whether the grid goes once around the sphere, so that its last column is a neighbour of its first.
pub(super) fn is_cyclic((georef, (_, cols)): Grid) -> bool {
    let t = &georef.transform;
    let period = Projection::of(&georef.crs).and_then(|p| p.period());
    t[2] == 0.0
        && t[4] == 0.0
        && period.is_some_and(|period| (t[1].abs() * cols as f64 - period).abs() < 0.01 * t[1].abs())
}
