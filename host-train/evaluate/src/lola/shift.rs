//! The shift at which a track fits a DTM best, and the fit's error.

use super::place::{SpotGrid, bilinear};
use super::track::LaserSpot;
use elunar_base::quantile::quantile;
use elunar_base::{Error, Result};
use elunar_core::tile::Window;
use elunar_raster::source::Source;
use std::ops::Range;

/// Steps per pixel of the search. The paper moves by half a pixel.
const STEPS_PER_PX: usize = 2;

/// Greatest shift along one axis, either way, in steps. It is enough for 20 m at 0.2 m per pixel.
const MOST_STEPS: usize = 200;

/// Most differences in memory at once, those of some shifts: 32 MiB.
const MOST_ERRORS: usize = 1 << 22;

/// A DTM prepared for the comparison with tracks.
pub struct TrackDtm<'a> {
    dtm: &'a dyn Source,
    grid: SpotGrid,
    /// Greatest shifts along rows and columns, either way, in steps.
    reach: (usize, usize),
    /// Metres along x and y per map unit, at the DTM's centre.
    metres: (f64, f64),
}

/// The fit of a track, by two measures. A constant offset between DTM and track, a difference of datum, moves the shift of the first
/// measure and not that of the second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// Points compared: those with a valid height under every shift, so that all shifts are compared on the same points.
    pub points: usize,
    /// Without a shift.
    pub unshifted: Shifted,
    /// At the shift with the smallest deviation about the median. This is the answer.
    pub median_removed: Shifted,
    /// At the shift with the smallest deviation of Eq. 18, as in the paper.
    pub eq_18: Shifted,
}

/// A track over a DTM at one shift.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Shifted {
    /// Shift of the track along the map's x, metres.
    pub x_m: f64,
    /// Shift of the track along the map's y, metres.
    pub y_m: f64,
    /// Standard deviation of DTM minus track as Eq. 18 has it (no mean removed, divided by points − 1), metres.
    pub std_m: f64,
    /// Median of DTM minus track, metres.
    pub median_m: f64,
    /// The standard deviation after the median is subtracted, metres.
    pub std_median_removed_m: f64,
    /// True if the shift lies at the limit of the search. A better shift may lie beyond.
    pub at_edge: bool,
}

impl<'a> TrackDtm<'a> {
    /// Prepares a DTM. `name` is its name in messages. The search goes up to `search_m` metres along either axis, in steps of half a pixel.
    ///
    /// # Errors
    /// [`Error::Input`] if the DTM has no georeference, its projection is not supported, or the search has too many steps.
    pub fn new(dtm: &'a dyn Source, name: &str, search_m: f64) -> Result<Self> {
        let info = dtm.info();
        let grid = SpotGrid::new(info.georef.as_ref(), (info.rows, info.cols), name)?;
        let (georef, projection) = (&grid.georef, &grid.projection);
        let size = georef.pixel_m(info.rows, info.cols).filter(|size| size.0 > 0.0 && size.1 > 0.0);
        let missing = || Error::input(format!("{name}: a DTM with a pixel size expected, none found"));
        let (row_m, col_m) = size.ok_or_else(missing)?;
        let steps = |pixel_m: f64| (search_m * STEPS_PER_PX as f64 / pixel_m + 1e-9).floor();
        let (rows, cols) = (steps(row_m), steps(col_m));
        if !(rows <= MOST_STEPS as f64 && cols <= MOST_STEPS as f64 && search_m >= 0.0) {
            let what =
                format!("{name}: a search of at most {MOST_STEPS} half pixels either way expected, found {search_m} m");
            return Err(Error::input(what));
        }
        let metres = if georef.crs.is_projected() {
            let unit = georef.crs.metres_per_unit().unwrap_or(1.0);
            (unit, unit)
        } else {
            let degree_m = projection.radius_m().to_radians();
            let (_, lat_deg) = georef.centre(info.rows as f64 / 2.0, info.cols as f64 / 2.0);
            (degree_m * lat_deg.to_radians().cos(), degree_m)
        };
        Ok(Self { dtm, grid, reach: (rows as usize, cols as usize), metres })
    }

    /// Returns the radius of the DTM's sphere, metres.
    #[must_use]
    pub fn sphere_m(&self) -> f64 {
        self.grid.sphere_m()
    }

    /// Finds the best shifts of a track. Returns `None` with fewer than `least` comparable points.
    ///
    /// # Errors
    /// If the DTM cannot be read.
    pub fn fit(&self, track: &[LaserSpot], least: usize) -> Result<Option<Fit>> {
        let all = 0..self.shifts();
        let mut used = Vec::new();
        for point in track {
            if self.errors(point, all.clone())?.is_some() {
                used.push(*point);
            }
        }
        let points = used.len();
        if points < least.max(2) {
            return Ok(None);
        }
        let mut fit: Option<Fit> = None;
        for first in all.clone().step_by((MOST_ERRORS / points).max(1)) {
            let shifts = first..(first + (MOST_ERRORS / points).max(1)).min(all.end);
            let mut by_point = Vec::with_capacity(points);
            for point in &used {
                by_point.push(self.errors(point, shifts.clone())?.unwrap_or_default());
            }
            for shift in shifts.clone() {
                let errors = by_point.iter().filter_map(|errors| errors.get(shift - shifts.start).copied()).collect();
                let next = self.shifted(shift, errors);
                let fit = fit.get_or_insert(Fit { points, unshifted: next, median_removed: next, eq_18: next });
                if shift == all.end / 2 {
                    fit.unshifted = next;
                }
                keep(&mut fit.median_removed, next, |at| at.std_median_removed_m);
                keep(&mut fit.eq_18, next, |at| at.std_m);
            }
        }
        Ok(fit)
    }

    /// Returns the figures of the differences at a shift.
    fn shifted(&self, shift: usize, mut errors: Vec<f64>) -> Shifted {
        let degrees = errors.len() as f64 - 1.0;
        let median_m = quantile(&mut errors, 0.5).unwrap_or(f64::NAN);
        let deviation = |about: f64| (errors.iter().map(|e| (e - about).powi(2)).sum::<f64>() / degrees).sqrt();
        let (down, right) = self.steps(shift);
        let (rows, cols) = (down as f64 / STEPS_PER_PX as f64, right as f64 / STEPS_PER_PX as f64);
        let t = &self.grid.georef.transform;
        let at_limit = |steps: isize, reach: usize| reach > 0 && steps.unsigned_abs() == reach;
        Shifted {
            x_m: (cols * t[1] + rows * t[2]) * self.metres.0,
            y_m: (cols * t[4] + rows * t[5]) * self.metres.1,
            std_m: deviation(0.0),
            median_m,
            std_median_removed_m: deviation(median_m),
            at_edge: at_limit(down, self.reach.0) || at_limit(right, self.reach.1),
        }
    }

    fn shifts(&self) -> usize {
        (2 * self.reach.0 + 1) * (2 * self.reach.1 + 1)
    }

    /// Returns shift `index` as steps down and right.
    fn steps(&self, index: usize) -> (isize, isize) {
        let across = 2 * self.reach.1 + 1;
        ((index / across) as isize - self.reach.0 as isize, (index % across) as isize - self.reach.1 as isize)
    }

    /// Returns the window of the DTM that all shifts of a point reach, and the point's row and column in it; `None` beyond the edge.
    fn patch(&self, point: &LaserSpot) -> Option<(Window, f64, f64)> {
        let info = self.dtm.info();
        let reach = [self.reach.0, self.reach.1].map(|steps| steps as f64 / STEPS_PER_PX as f64);
        self.grid.places(point).find_map(|(row, col)| {
            let (top, left) = ((row - reach[0]).floor(), (col - reach[1]).floor());
            let (bottom, right) = ((row + reach[0]).ceil(), (col + reach[1]).ceil());
            let inside = top >= 0.0 && left >= 0.0 && bottom < info.rows as f64 && right < info.cols as f64;
            inside.then(|| {
                let (rows, cols) = ((bottom - top) as usize + 1, (right - left) as usize + 1);
                (Window { row: top as usize, col: left as usize, rows, cols }, row - top, col - left)
            })
        })
    }

    /// Returns DTM minus a point's height under some shifts, metres; `None` if the DTM has a gap under any of them, or ends before.
    fn errors(&self, point: &LaserSpot, shifts: Range<usize>) -> Result<Option<Vec<f64>>> {
        let Some((window, row, col)) = self.patch(point) else { return Ok(None) };
        let patch = self.dtm.read(window)?;
        let error = |shift: usize| {
            let (down, right) = self.steps(shift);
            let (r, c) = (row + down as f64 / STEPS_PER_PX as f64, col + right as f64 / STEPS_PER_PX as f64);
            Some(bilinear(&patch, window, r, c) - point.height_m).filter(|error| error.is_finite())
        };
        Ok(shifts.map(error).collect())
    }
}

/// Replaces `best` by a shift of a smaller figure, or of the same figure if it is shorter.
fn keep(best: &mut Shifted, next: Shifted, figure: fn(&Shifted) -> f64) {
    let length = |at: &Shifted| at.x_m.hypot(at.y_m);
    let order = figure(&next).total_cmp(&figure(best)).then(length(&next).total_cmp(&length(best)));
    if order.is_lt() {
        *best = next;
    }
}
