//! Putting one raster on another's grid, through map coordinates and never by index.

use super::resample::{PixelMap, resample_bicubic};
use super::{GeoRef, Raster};
use crate::{Error, Result};
use rayon::prelude::*;

/// How samples between pixel centres are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interpolation {
    /// [`resample_bicubic`]: for making a fine grid from a coarse one.
    Bicubic,
    /// Bilinear, invalid where any sample that counts is invalid: for comparing grids of about equal spacing.
    Bilinear,
}

/// Grids closer than this, in pixels, are taken as one: a transform's last digits differ between writers.
const SAME_GRID_PX: f64 = 1e-3;

/// A raster with the name messages call it by.
#[derive(Debug, Clone, Copy)]
pub struct Named<'a> {
    /// File name, or what the raster is.
    pub name: &'a str,
    /// The raster.
    pub raster: &'a Raster,
}

impl<'a> Named<'a> {
    /// Pairs them.
    #[must_use]
    pub fn new(name: &'a str, raster: &'a Raster) -> Self {
        Self { name, raster }
    }

    /// The place, which must be complete.
    fn place(&self) -> Result<&'a GeoRef> {
        let missing = |what: &str| Error::usage(format!("{}: a raster with {what} expected, none found", self.name));
        let georef = self.raster.georef.as_ref().ok_or_else(|| missing("a geotransform"))?;
        if georef.crs.is_empty() { Err(missing("a coordinate reference system")) } else { Ok(georef) }
    }
}

/// Side of a pixel of `source` in pixels of `target`: about 30 for SLDEM2015 under an image of 2 m.
///
/// # Errors
/// [`Error::Usage`] if the pixel size of either in metres is unknown.
pub fn spacing_ratio(source: Named, target: Named) -> Result<f32> {
    let side_m = |named: Named| {
        let size = named.raster.pixel_m().map(|(row_m, col_m)| (row_m * col_m).sqrt());
        size.ok_or_else(|| Error::usage(format!("{}: a pixel size in metres expected, none found", named.name)))
    };
    Ok((side_m(source)? / side_m(target)?) as f32)
}

/// `source` on the grid of `target`; NaN where `source` has nothing. On the same grid the samples are copied, not interpolated.
///
/// # Errors
/// [`Error::Usage`] if either has no place, their reference systems differ, they do not overlap, or no valid sample of `source`
/// falls on `target`.
pub fn onto(source: Named, target: Named, interpolation: Interpolation) -> Result<Raster> {
    let (from, to) = (source.place()?, target.place()?);
    if !from.crs.same_as(&to.crs) {
        let (a, b) = (from.crs.summary(), to.crs.summary());
        return Err(Error::usage(format!(
            "{}: the reference system of {} ({b}) expected, {a} found",
            source.name, target.name
        )));
    }
    let map = PixelMap::between(&to.transform, &from.transform)
        .ok_or_else(|| Error::usage(format!("{}: transform {:?} has no inverse", source.name, from.transform)))?;
    let (rows, cols) = (target.raster.rows, target.raster.cols);
    let grid = source.raster;
    let samples = if (grid.rows, grid.cols) == (rows, cols) && is_identity(&map, rows, cols) {
        grid.samples.clone()
    } else {
        match interpolation {
            Interpolation::Bicubic => resample_bicubic(&grid.samples, grid.rows, grid.cols, &map, rows, cols),
            Interpolation::Bilinear => bilinear(grid, &map, rows, cols),
        }
    };
    let placed = Raster { rows, cols, samples, georef: Some(to.clone()) };
    if placed.valid_count() == 0 {
        let (a, b) = (bounds(from, grid), bounds(to, target.raster));
        let what = if grid.valid_count() == 0 {
            "it holds no valid sample".into()
        } else {
            format!("it covers {a}, {} covers {b}", target.name)
        };
        return Err(Error::usage(format!(
            "{}: valid samples overlapping {} expected, none found: {what}",
            source.name, target.name
        )));
    }
    Ok(placed)
}

/// An affine map is furthest from the identity at a corner.
fn is_identity(map: &PixelMap, rows: usize, cols: usize) -> bool {
    let (last_row, last_col) = (rows.saturating_sub(1) as f64, cols.saturating_sub(1) as f64);
    [(0.0, 0.0), (0.0, last_col), (last_row, 0.0), (last_row, last_col)].into_iter().all(|(row, col)| {
        let (r, c) = map.apply(row, col);
        (r - row).abs() <= SAME_GRID_PX && (c - col).abs() <= SAME_GRID_PX
    })
}

fn bounds(georef: &GeoRef, raster: &Raster) -> String {
    let corner = |row: usize, col: usize| georef.centre(row as f64 - 0.5, col as f64 - 0.5);
    let corners = [corner(0, 0), corner(0, raster.cols), corner(raster.rows, 0), corner(raster.rows, raster.cols)];
    let span = |of: fn(&(f64, f64)) -> f64| {
        let values = corners.iter().map(of);
        (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
    };
    let ((x0, x1), (y0, y1)) = (span(|c| c.0), span(|c| c.1));
    format!("x {x0:.1} to {x1:.1}, y {y0:.1} to {y1:.1}")
}

fn bilinear(source: &Raster, map: &PixelMap, rows: usize, cols: usize) -> Vec<f32> {
    let mut out = vec![f32::NAN; rows * cols];
    out.par_chunks_mut(cols.max(1)).enumerate().for_each(|(row, line)| {
        for (col, value) in line.iter_mut().enumerate() {
            let (r, c) = map.apply(row as f64, col as f64);
            *value = bilinear_at(source, r, c);
        }
    });
    out
}

/// NaN outside the outermost pixel centres (rounding apart), and where a sample with any weight is invalid.
fn bilinear_at(source: &Raster, r: f64, c: f64) -> f32 {
    // On-grid positions take their sample exactly, so that a shift by whole pixels loses no edge to rounding.
    let snap = |v: f64| if (v - v.round()).abs() <= SAME_GRID_PX { v.round() } else { v };
    let (r, c) = (snap(r), snap(c));
    if !(r >= 0.0 && c >= 0.0 && r <= source.rows as f64 - 1.0 && c <= source.cols as f64 - 1.0) {
        return f32::NAN;
    }
    let (row, col) = (r.floor(), c.floor());
    let (fr, fc) = (r - row, c - col);
    let (row, col) = (row as usize, col as usize);
    let corners = [((1.0 - fr) * (1.0 - fc), 0, 0), ((1.0 - fr) * fc, 0, 1), (fr * (1.0 - fc), 1, 0), (fr * fc, 1, 1)];
    let used = corners.into_iter().filter(|&(weight, ..)| weight > 0.0);
    used.map(|(weight, dr, dc)| weight * f64::from(source.samples[(row + dr) * source.cols + col + dc])).sum::<f64>()
        as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Crs;

    fn plane(rows: usize, cols: usize, transform: [f64; 6]) -> Raster {
        let georef = GeoRef { transform, crs: Crs::moon_equirectangular(0.0, 0.0) };
        let height = |i: usize| {
            let (x, y) = georef.centre((i / cols) as f64, (i % cols) as f64);
            (0.01 * x - 0.02 * y) as f32
        };
        Raster { rows, cols, samples: (0..rows * cols).map(height).collect(), georef: Some(georef) }
    }

    fn largest_difference(a: &Raster, b: &Raster) -> f32 {
        a.samples.iter().zip(&b.samples).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    #[test]
    fn a_plane_is_the_same_on_every_grid() {
        let coarse = plane(12, 14, [-60.0, 60.0, 0.0, 90.0, 0.0, -60.0]);
        let fine = plane(200, 260, [30.0, 2.0, 0.0, 40.0, 0.0, -2.0]);
        for interpolation in [Interpolation::Bicubic, Interpolation::Bilinear] {
            let placed = onto(Named::new("coarse", &coarse), Named::new("image", &fine), interpolation).unwrap();
            assert_eq!(placed.valid_count(), 200 * 260);
            assert!(largest_difference(&placed, &fine) < 1e-4, "{interpolation:?}");
            assert_eq!(placed.georef, fine.georef);
        }
        // A rotated grid, too.
        let turned = plane(50, 50, [100.0, 1.5, 0.5, 0.0, 0.4, -1.8]);
        let placed =
            onto(Named::new("coarse", &coarse), Named::new("image", &turned), Interpolation::Bilinear).unwrap();
        assert!(largest_difference(&placed, &turned) < 1e-4);
    }

    #[test]
    fn the_same_grid_is_copied_and_whole_pixel_shifts_are_exact() {
        let mut a = plane(20, 30, [10.0, 2.0, 0.0, 50.0, 0.0, -2.0]);
        a.samples[33] = f32::NAN;
        let copy = onto(Named::new("a", &a), Named::new("b", &a.clone()), Interpolation::Bicubic).unwrap();
        assert_eq!(
            (copy.samples[32], copy.samples[33].is_nan(), copy.samples[34]),
            (a.samples[32], true, a.samples[34])
        );
        let shifted = plane(10, 10, [14.0, 2.0, 0.0, 44.0, 0.0, -2.0]);
        let placed = onto(Named::new("a", &a), Named::new("b", &shifted), Interpolation::Bilinear).unwrap();
        for (i, value) in placed.samples.iter().enumerate() {
            assert_eq!(*value, a.samples[(i / 10 + 3) * 30 + i % 10 + 2]);
        }
    }

    #[test]
    fn gaps_stay_gaps_under_bilinear() {
        let mut a = plane(8, 8, [0.0, 2.0, 0.0, 0.0, 0.0, -2.0]);
        a.samples[3 * 8 + 3] = f32::NAN;
        let half = plane(7, 7, [1.0, 2.0, 0.0, -1.0, 0.0, -2.0]);
        let placed = onto(Named::new("a", &a), Named::new("b", &half), Interpolation::Bilinear).unwrap();
        let gaps: Vec<usize> = (0..49).filter(|&i| placed.samples[i].is_nan()).collect();
        assert_eq!(gaps, [2 * 7 + 2, 2 * 7 + 3, 3 * 7 + 2, 3 * 7 + 3]);
    }

    #[test]
    fn misfits_are_named() {
        let a = plane(8, 8, [0.0, 2.0, 0.0, 0.0, 0.0, -2.0]);
        let mut b = a.clone();
        let refused = |b: &Raster| {
            onto(Named::new("c.tif", b), Named::new("i.tif", &a), Interpolation::Bicubic).unwrap_err().to_string()
        };
        b.georef.as_mut().unwrap().crs = Crs::moon_equirectangular(0.0, 180.0);
        let text = refused(&b);
        assert!(
            text.contains("c.tif") && text.contains("i.tif") && text.contains("lon 180") && text.contains("lon 0 "),
            "{text}"
        );
        b.georef.as_mut().unwrap().crs = Crs::default();
        assert!(refused(&b).contains("reference system expected, none found"));
        b.georef = None;
        assert!(refused(&b).contains("geotransform expected, none found"));
        let far = plane(8, 8, [1000.0, 2.0, 0.0, 0.0, 0.0, -2.0]);
        assert!(refused(&far).contains("covers x 1000.0 to 1016.0, y -16.0 to 0.0"), "{}", refused(&far));
        let empty = Raster { samples: vec![f32::NAN; 64], ..a.clone() };
        assert!(refused(&empty).contains("no valid sample"));
    }
}
