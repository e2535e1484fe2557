//! The grid of a mosaic. It contains all its DTMs.

use super::meridian::{Range, narrowest, period, turns};
use elunar_base::{Error, Result};
use elunar_raster::source::{Info, Source};
use elunar_raster::{GeoRef, GeoTransform};

/// Pixels closer than this to those of a grid lie on it: writers round the corners of tiles, to five decimals of a degree and fewer (our
/// choice).
pub(super) const ON_GRID_PX: f64 = 0.1;

/// Largest mosaic, pixels. Its sums take 20 bytes per pixel.
const LARGEST_PX: f64 = 2e9;

/// One DTM of a mosaic.
pub struct MosaicInput {
    /// Name of the DTM in messages.
    pub name: String,
    /// The heights.
    pub source: Box<dyn Source>,
}

/// Changes to the grid of the first DTM.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GridOptions {
    /// Side of a pixel, map units (`--tr`); `None` takes the first DTM's.
    pub spacing: Option<f64>,
    /// West, south, east and north limits of the region, map units (`--t_projwin`).
    pub window: Option<[f64; 4]>,
}

/// Size and georeference of a mosaic.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Georeference; the transform is north-up.
    pub georef: GeoRef,
    /// Period of x, map units, if DTMs are moved by whole periods to meet the grid.
    period: Option<f64>,
}

impl Grid {
    /// Returns the grid that `dem_mosaic` makes. Spacing and reference system are the first DTM's. The extent covers all DTMs, or the part
    /// of the window that a DTM reaches. The corner lies on a whole pixel of the first DTM only if the outer edges nearly do.
    ///
    /// Maps around the body have several values of x for a meridian. If DTMs lie on both sides of such a seam, the mosaic is the narrowest
    /// that contains all, and never wider than once around.
    ///
    /// # Errors
    /// [`Error::Input`] if a DTM has no georeference, is rotated, or has another reference system than the first; if the spacing is not
    /// positive, the window is empty or touches no DTM, or the mosaic would exceed the largest size.
    pub fn around(inputs: &[MosaicInput], options: GridOptions) -> Result<Self> {
        let first = inputs.first().ok_or_else(|| Error::input("mosaic: at least one DTM expected, none found"))?;
        let place = placed(&first.name, first.source.info())?;
        let t = place.transform;
        let (col_step, row_step) = match options.spacing {
            Some(step) if !(step.is_finite() && step > 0.0) => {
                return Err(Error::usage(format!("--tr: a positive spacing expected, {step} found")));
            }
            Some(step) => (step, -step),
            None => (t[1], t[5]),
        };
        let mut extents = Vec::with_capacity(inputs.len());
        for input in inputs {
            let georef = placed(&input.name, input.source.info())?;
            same_system(&first.name, place, &input.name, georef)?;
            extents.push(extent(input.source.info(), &georef.transform));
        }
        let Reach { bounds: [west, south, east, north], period } = Reach::of(&extents, place, options.window)?;
        // Snapped to whole pixels of the first DTM if almost there.
        let snap = |at: f64, origin: f64, step: f64| {
            let px = (at - origin) / step;
            if (px - px.round()).abs() < ON_GRID_PX { origin + px.round() * step } else { at }
        };
        let turn = turns([t[0], extents[0][2]], [west, east], period).first().copied().unwrap_or(0.0);
        let origin = t[0] + turn * period.unwrap_or(0.0);
        let (x0, y0) = (snap(west, origin, col_step), snap(north, t[3], row_step));
        let (cols, rows) = (((east - x0) / col_step).round().max(1.0), ((south - y0) / row_step).round().max(1.0));
        if rows * cols > LARGEST_PX {
            return Err(Error::input(format!(
                "mosaic: at most {LARGEST_PX:e} pixels expected, {rows} x {cols} found: are all DTMs of one region? (see --tr, --t_projwin)"
            )));
        }
        let georef = GeoRef { transform: [x0, col_step, 0.0, y0, 0.0, row_step], crs: place.crs.clone() };
        Ok(Self { rows: rows as usize, cols: cols as usize, georef, period })
    }

    /// Returns the transforms under which a DTM meets this grid: its own, or moved by whole periods of x.
    pub(super) fn places(&self, info: &Info) -> Vec<GeoTransform> {
        let Some(own) = info.georef.as_ref().map(|georef| georef.transform) else { return vec![] };
        let [west, _, east, _] = extent(info, &own);
        let t = &self.georef.transform;
        let within = [t[0], t[0] + self.cols as f64 * t[1]];
        let moved = |turn: f64| {
            let mut place = own;
            place[0] += turn * self.period.unwrap_or(0.0);
            place
        };
        turns([west, east], within, self.period).into_iter().map(moved).collect()
    }

    /// Returns the grid of these rows alone.
    #[must_use]
    pub fn rows(&self, rows: std::ops::Range<usize>) -> Self {
        let mut part = Self { rows: rows.len(), ..self.clone() };
        part.georef.transform[3] += rows.start as f64 * part.georef.transform[5];
        part
    }
}

fn placed<'a>(name: &str, info: &'a Info) -> Result<&'a GeoRef> {
    let georef = info.place(name)?;
    let t = georef.transform;
    if !(t[1] > 0.0 && t[5] < 0.0 && t[2] == 0.0 && t[4] == 0.0) {
        return Err(Error::input(format!("{name}: a north-up transform expected, {t:?} found")));
    }
    Ok(georef)
}

fn same_system(first_name: &str, first: &GeoRef, name: &str, georef: &GeoRef) -> Result<()> {
    if georef.crs.same_as(&first.crs) {
        return Ok(());
    }
    let (expected, found) = (first.crs.summary(), georef.crs.summary());
    Err(Error::input(format!("{name}: the reference system of {first_name} ({expected}) expected, {found} found")))
}

/// Returns west, south, east and north limits.
fn extent(info: &Info, t: &GeoTransform) -> [f64; 4] {
    [t[0], t[3] + info.rows as f64 * t[5], t[0] + info.cols as f64 * t[1], t[3]]
}

/// The region of a mosaic.
struct Reach {
    /// West, south, east and north limits.
    bounds: [f64; 4],
    /// Period of x, if DTMs are to be moved by whole periods.
    period: Option<f64>,
}

impl Reach {
    /// Returns the region that holds DTMs of these extents, or its part within a window.
    fn of(extents: &[[f64; 4]], place: &GeoRef, window: Option<[f64; 4]>) -> Result<Self> {
        let all = extents.iter().fold([f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY], |a, b| {
            [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
        });
        let ranges: Vec<Range> = extents.iter().map(|e| [e[0], e[2]]).collect();
        let around = period(&place.crs);
        if let Some(window) = window {
            // The places of a meridian are those within the window, unless that holds some twice.
            let period = around.filter(|period| window[2] - window[0] <= *period);
            return Ok(Self { bounds: cut(all, &ranges, period, window)?, period });
        }
        let slack = 0.5 * place.transform[1];
        if let Some(period) = around
            && let Some([west, east]) = narrowest(&ranges, period, slack)
            && east - west < all[2] - all[0] - slack
        {
            return Ok(Self { bounds: [west, all[1], east, all[3]], period: Some(period) });
        }
        Ok(Self { bounds: all, period: None })
    }
}

fn cut(all: [f64; 4], ranges: &[Range], period: Option<f64>, window: [f64; 4]) -> Result<[f64; 4]> {
    let [west, south, east, north] = window;
    if !(west < east && south < north) {
        return Err(Error::usage(format!("--t_projwin: xmin < xmax and ymin < ymax expected, {window:?} found")));
    }
    let places = ranges.iter().flat_map(|range| {
        let moved = |turn: f64| range.map(|x| x + turn * period.unwrap_or(0.0));
        turns(*range, [west, east], period).into_iter().map(moved)
    });
    let within = places.map(|[low, high]| [low.max(west), high.min(east)]).filter(|[low, high]| low < high);
    let [low, high] = within.fold([f64::INFINITY, f64::NEG_INFINITY], |a, b| [a[0].min(b[0]), a[1].max(b[1])]);
    let cut = [low, south.max(all[1]), high, north.min(all[3])];
    if !(cut[0] < cut[2] && cut[1] < cut[3]) {
        return Err(Error::usage(format!("--t_projwin: a part of {all:?} expected, {window:?} found")));
    }
    Ok(cut)
}
