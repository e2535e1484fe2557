//! The grid of a mosaic. It contains all its DTMs.

use elunar_raster::source::{Info, Source};
use elunar_raster::{Error, GeoRef, GeoTransform, Result};

/// Corners closer than this to a whole pixel count as whole, because writers differ in the last digits of a transform.
const WHOLE_PX: f64 = 1e-3;

/// Largest mosaic, pixels. Its sums take 20 bytes per pixel.
const LARGEST_PX: f64 = 2e9;

/// One DTM of a mosaic.
pub struct Input {
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
}

impl Grid {
    /// Returns the grid that `dem_mosaic` makes. Spacing and reference system are the first DTM's. The extent covers all DTMs, or the part
    /// of the window that a DTM reaches. The corner lies on a whole pixel of the first DTM only if the outer edges do.
    ///
    /// # Errors
    /// [`Error::Input`] if a DTM has no georeference, is rotated, or has another reference system than the first; if the spacing is not
    /// positive, the window is empty or touches no DTM, or the mosaic would exceed the largest size.
    pub fn around(inputs: &[Input], options: GridOptions) -> Result<Self> {
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
        let mut box_of_all = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        for input in inputs {
            let georef = placed(&input.name, input.source.info())?;
            same_system(&first.name, place, &input.name, georef)?;
            let [west, south, east, north] = extent(input.source.info(), &georef.transform);
            let [w, s, e, n] = box_of_all;
            box_of_all = [w.min(west), s.min(south), e.max(east), n.max(north)];
        }
        let [west, south, east, north] = match options.window {
            Some(window) => cut(box_of_all, window)?,
            None => box_of_all,
        };
        // Snapped to whole pixels of the first DTM if almost there.
        let snap = |at: f64, origin: f64, step: f64| {
            let px = (at - origin) / step;
            if (px - px.round()).abs() < WHOLE_PX { origin + px.round() * step } else { at }
        };
        let (x0, y0) = (snap(west, t[0], col_step), snap(north, t[3], row_step));
        let (cols, rows) = (((east - x0) / col_step).round().max(1.0), ((south - y0) / row_step).round().max(1.0));
        if rows * cols > LARGEST_PX {
            return Err(Error::input(format!(
                "mosaic: at most {LARGEST_PX:e} pixels expected, {rows} x {cols} found: are all DTMs of one region? (see --tr, --t_projwin)"
            )));
        }
        let georef = GeoRef { transform: [x0, col_step, 0.0, y0, 0.0, row_step], crs: place.crs.clone() };
        Ok(Self { rows: rows as usize, cols: cols as usize, georef })
    }
}

impl Grid {
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

fn cut(all: [f64; 4], window: [f64; 4]) -> Result<[f64; 4]> {
    let [west, south, east, north] = window;
    if !(west < east && south < north) {
        return Err(Error::usage(format!("--t_projwin: xmin < xmax and ymin < ymax expected, {window:?} found")));
    }
    let cut = [west.max(all[0]), south.max(all[1]), east.min(all[2]), north.min(all[3])];
    if !(cut[0] < cut[2] && cut[1] < cut[3]) {
        return Err(Error::usage(format!("--t_projwin: a part of {all:?} expected, {window:?} found")));
    }
    Ok(cut)
}
