//! A coarse DTM on the image's grid, a band of rows at a time.

use super::scene::Input;
use crate::raster::resample::{PixelMap, resample_bicubic};
use crate::raster::source::{Info, read_all};
use crate::raster::{GeoRef, Raster};
use crate::{Error, Result};
use elunar_core::tile::Window;

/// The place of `input`, which must be complete.
pub(super) fn place(input: &Input) -> Result<&GeoRef> {
    let missing = |what: &str| Error::usage(format!("{}: a raster with {what} expected, none found", input.name));
    let georef = input.source.info().georef.as_ref().ok_or_else(|| missing("a geotransform"))?;
    if georef.crs.is_empty() { Err(missing("a coordinate reference system")) } else { Ok(georef) }
}

/// The coarse DTM and how it lies under the image.
pub(super) struct Placed {
    coarse: Raster,
    map: PixelMap,
}

impl Placed {
    pub(super) fn new(coarse: &Input, image: &Input) -> Result<Self> {
        let (from, to) = (place(coarse)?, place(image)?);
        if !from.crs.same_as(&to.crs) {
            let (a, b) = (from.crs.summary(), to.crs.summary());
            return Err(Error::usage(format!(
                "{}: the reference system of {} ({b}) expected, {a} found",
                coarse.name, image.name
            )));
        }
        let map = PixelMap::between(&to.transform, &from.transform)
            .ok_or_else(|| Error::usage(format!("{}: transform {:?} has no inverse", coarse.name, from.transform)))?;
        Ok(Self { coarse: read_all(coarse.source.as_ref())?, map })
    }

    pub(super) fn read(&self, window: Window) -> Vec<f32> {
        let Raster { rows, cols, samples, .. } = &self.coarse;
        resample_bicubic(samples, *rows, *cols, &self.map.window(window.row, window.col), window.rows, window.cols)
    }
}

/// Side of a pixel of `coarse` in pixels of `image`: about 30 for SLDEM2015 under an image of 2 m.
///
/// # Errors
/// [`Error::Usage`] if a pixel size in metres is unknown.
pub(super) fn spacing_ratio(coarse: &Input, image: &Input) -> Result<f32> {
    let side_m = |input: &Input| {
        let Info { rows, cols, .. } = *input.source.info();
        let size = place(input)?.pixel_m(rows, cols).map(|(row_m, col_m)| (row_m * col_m).sqrt());
        size.ok_or_else(|| Error::usage(format!("{}: a pixel size in metres expected, none found", input.name)))
    };
    Ok((side_m(coarse)? / side_m(image)?) as f32)
}
