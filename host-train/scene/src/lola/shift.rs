//! The shift at which a track fits a DTM best, and the fit's error.

use super::track::Point;
use elunar_core::tile::Window;
use elunar_raster::source::Source;
use elunar_raster::{Error, GeoRef, Projection, Result};

/// Steps per pixel of the search. The paper moves by half a pixel.
const STEPS_PER_PX: usize = 2;

/// Greatest shift along one axis, either way, in steps. It is enough for 20 m at 0.2 m per pixel.
const MOST_STEPS: usize = 200;

/// A DTM prepared for the comparison with tracks.
pub struct Ground<'a> {
    dtm: &'a dyn Source,
    georef: GeoRef,
    projection: Projection,
    /// Greatest shifts along rows and columns, either way, in steps.
    reach: (usize, usize),
    /// Metres along x and y per map unit, at the DTM's centre.
    metres: (f64, f64),
}

/// The fit of a track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// Points compared: those with a valid height under every shift, so that all shifts are compared on the same points.
    pub points: usize,
    /// Standard deviation of DTM minus track as Eq. 18 has it (no mean removed, divided by points − 1), metres, at the best shift.
    pub std_m: f64,
    /// The same standard deviation without a shift, metres.
    pub std_unshifted_m: f64,
    /// Best shift of the track along the map's x, metres.
    pub x_m: f64,
    /// Best shift of the track along the map's y, metres.
    pub y_m: f64,
    /// Median of DTM minus track at the best shift, metres.
    pub median_m: f64,
    /// Standard deviation at the best shift after the median is subtracted, metres.
    pub std_median_removed_m: f64,
    /// True if the best shift lies at the limit of the search. A better shift may lie beyond.
    pub at_edge: bool,
}

impl<'a> Ground<'a> {
    /// Prepares a DTM. `name` is its name in messages. The search goes up to `search_m` metres along either axis, in steps of half a pixel.
    ///
    /// # Errors
    /// [`Error::Input`] if the DTM has no georeference, its projection is not supported, or the search has too many steps.
    pub fn new(dtm: &'a dyn Source, name: &str, search_m: f64) -> Result<Self> {
        let info = dtm.info();
        let missing = |what: &str| Error::input(format!("{name}: a DTM with {what} expected, none found"));
        let georef = info.georef.clone().ok_or_else(|| missing("a geotransform"))?;
        if georef.crs.is_empty() {
            return Err(missing("a coordinate reference system"));
        }
        let projection = Projection::of(&georef.crs).ok_or_else(|| {
            Error::input(format!("{name}: a known map projection expected, found {}", georef.crs.summary()))
        })?;
        let size = georef.pixel_m(info.rows, info.cols).filter(|size| size.0 > 0.0 && size.1 > 0.0);
        let (row_m, col_m) = size.ok_or_else(|| missing("a pixel size"))?;
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
        Ok(Self { dtm, georef, projection, reach: (rows as usize, cols as usize), metres })
    }

    /// Returns the radius of the DTM's sphere, metres.
    #[must_use]
    pub fn sphere_m(&self) -> f64 {
        self.projection.radius_m()
    }

    /// Finds the best shift of a track. Returns `None` with fewer than `least` comparable points.
    ///
    /// # Errors
    /// If the DTM cannot be read.
    pub fn fit(&self, track: &[Point], least: usize) -> Result<Option<Fit>> {
        let mut squares = vec![0.0; self.shifts()];
        let mut used = Vec::new();
        for point in track {
            let Some((window, row, col)) = self.patch(point) else { continue };
            let patch = self.dtm.read(window)?;
            if let Some(errors) = self.errors(&patch, window, row, col, point.height_m) {
                squares.iter_mut().zip(&errors).for_each(|(sum, e)| *sum += e * e);
                used.push(*point);
            }
        }
        if used.len() < least.max(2) {
            return Ok(None);
        }
        let Some(best) = self.best(&squares) else { return Ok(None) };
        let mut errors = Vec::with_capacity(used.len());
        for point in &used {
            let Some((window, row, col)) = self.patch(point) else { continue };
            errors.extend(self.errors(&self.dtm.read(window)?, window, row, col, point.height_m).map(|all| all[best]));
        }
        Ok(Some(self.fitted(&squares, best, errors)))
    }

    fn fitted(&self, squares: &[f64], best: usize, mut errors: Vec<f64>) -> Fit {
        let points = errors.len();
        let degrees = points as f64 - 1.0;
        errors.sort_by(f64::total_cmp);
        let median_m = 0.5 * (errors[(points - 1) / 2] + errors[points / 2]);
        let about_median: f64 = errors.iter().map(|e| (e - median_m).powi(2)).sum();
        let (down, right) = self.steps(best);
        let (rows, cols) = (down as f64 / STEPS_PER_PX as f64, right as f64 / STEPS_PER_PX as f64);
        let t = &self.georef.transform;
        let at_limit = |steps: isize, reach: usize| reach > 0 && steps.unsigned_abs() == reach;
        Fit {
            points,
            std_m: (squares[best] / degrees).sqrt(),
            std_unshifted_m: (squares[squares.len() / 2] / degrees).sqrt(),
            x_m: (cols * t[1] + rows * t[2]) * self.metres.0,
            y_m: (cols * t[4] + rows * t[5]) * self.metres.1,
            median_m,
            std_median_removed_m: (about_median / degrees).sqrt(),
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

    /// Returns the shift with the smallest sum. Among equal sums, the shortest shift is returned.
    fn best(&self, squares: &[f64]) -> Option<usize> {
        let length = |index: usize| {
            let (down, right) = self.steps(index);
            down * down + right * right
        };
        (0..squares.len()).min_by(|&a, &b| squares[a].total_cmp(&squares[b]).then(length(a).cmp(&length(b))))
    }

    /// Returns the window of the DTM that all shifts of a point reach, and the point's row and column in it; `None` beyond the edge.
    fn patch(&self, point: &Point) -> Option<(Window, f64, f64)> {
        let info = self.dtm.info();
        let reach = [self.reach.0, self.reach.1].map(|steps| steps as f64 / STEPS_PER_PX as f64);
        // Geographic maps keep their longitudes. Longitudes of tracks and maps may differ by 360 degrees.
        let turns = if self.georef.crs.is_projected() { &[0.0][..] } else { &[0.0, 360.0, -360.0] };
        turns.iter().find_map(|turn| {
            let (x, y) = self.projection.forward(point.lon_deg + turn, point.lat_deg);
            let (row, col) = pixel(&self.georef.transform, x, y)?;
            let (top, left) = ((row - reach[0]).floor(), (col - reach[1]).floor());
            let (bottom, right) = ((row + reach[0]).ceil(), (col + reach[1]).ceil());
            let inside = top >= 0.0 && left >= 0.0 && bottom < info.rows as f64 && right < info.cols as f64;
            inside.then(|| {
                let (rows, cols) = ((bottom - top) as usize + 1, (right - left) as usize + 1);
                (Window { row: top as usize, col: left as usize, rows, cols }, row - top, col - left)
            })
        })
    }

    /// Returns DTM minus height under every shift, metres; `None` if the DTM has a gap under any of them.
    fn errors(&self, patch: &[f32], window: Window, row: f64, col: f64, height_m: f64) -> Option<Vec<f64>> {
        let shifts = self.shifts();
        let mut errors = Vec::with_capacity(shifts);
        for index in 0..shifts {
            let (down, right) = self.steps(index);
            let (r, c) = (row + down as f64 / STEPS_PER_PX as f64, col + right as f64 / STEPS_PER_PX as f64);
            let error = bilinear(patch, window, r, c) - height_m;
            if !error.is_finite() {
                return None;
            }
            errors.push(error);
        }
        Some(errors)
    }
}

/// Returns row and column of a map point. (0, 0) is the centre of the first pixel.
fn pixel(t: &[f64; 6], x: f64, y: f64) -> Option<(f64, f64)> {
    let determinant = t[1] * t[5] - t[2] * t[4];
    let (dx, dy) = (x - t[0], y - t[3]);
    let (col, row) = ((dx * t[5] - dy * t[2]) / determinant, (dy * t[1] - dx * t[4]) / determinant);
    (row.is_finite() && col.is_finite()).then_some((row - 0.5, col - 0.5))
}

/// Interpolates bilinearly. The result is NaN if a sample with weight is NaN.
fn bilinear(patch: &[f32], window: Window, row: f64, col: f64) -> f64 {
    let (top, left) = (row.floor().max(0.0), col.floor().max(0.0));
    let (down, right) = (row - top, col - left);
    let (top, left) = (top as usize, left as usize);
    let mut sum = 0.0;
    for (weight, r, c) in [
        ((1.0 - down) * (1.0 - right), top, left),
        ((1.0 - down) * right, top, left + 1),
        (down * (1.0 - right), top + 1, left),
        (down * right, top + 1, left + 1),
    ] {
        if weight.abs() > 1e-9 {
            sum += if r < window.rows && c < window.cols {
                weight * f64::from(patch[r * window.cols + c])
            } else {
                f64::NAN
            };
        }
    }
    sum
}
