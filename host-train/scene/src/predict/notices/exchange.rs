//! Image and coarse DTM in each other's place.

use super::super::{NamedRaster, Scene};
use elunar_base::{Error, Result};
use std::path::Path;

/// Pixels of a coarse DTM so many image pixels wide are as fine as the image's. Finer ones are refused in any case ([`Scene::new`]).
const AS_FINE_PX: std::ops::Range<f64> = 1.0..1.5;

/// Refuses one file as image and coarse DTM, and an image as coarse DTM: integers without sign and without a unit, in pixels as fine as the
/// image's. `unit_stated` says that the user has stated the unit of the heights.
///
/// # Errors
/// [`Error::Input`] with the reason.
pub fn check_exchange(image: &NamedRaster, coarse: &NamedRaster, unit_stated: bool) -> Result<()> {
    let same =
        |a: &str, b: &str| Path::new(a).canonicalize().is_ok_and(|a| Path::new(b).canonicalize().is_ok_and(|b| a == b));
    if same(&image.name, &coarse.name) {
        return Err(Error::input(format!(
            "{}: an image and a coarse DTM expected, found one file for both",
            coarse.name
        )));
    }
    let (fine, info) = (image.source.info(), coarse.source.info());
    let widths = info.side_m(&coarse.name).and_then(|side_m| Ok(side_m / fine.side_m(&image.name)?));
    let as_fine = widths.is_ok_and(|width_px| AS_FINE_PX.contains(&width_px));
    if as_fine && info.is_unsigned() && info.unit.is_none() && !unit_stated {
        let what = format!("{}: heights coarser than {} expected", coarse.name, image.name);
        let found = format!("found {} in pixels as fine, as in an image", info.format);
        return Err(Error::input(format!("{what}, {found}; say --coarse-unit if these are heights")));
    }
    Ok(())
}

/// Warns of an image in metres, and of a coarse DTM that may be an image.
pub(super) fn suspected(scene: &Scene, unit_stated: bool) -> Vec<String> {
    let (image, coarse) = (scene.image.source.info(), scene.coarse.source().info());
    let mut found = vec![];
    if image.unit.as_deref() == Some("m") {
        found.push(format!("{}: its file says metres: a DTM in the image's place?", scene.image.name));
    }
    if coarse.is_unsigned() && coarse.unit.is_none() && !unit_stated {
        let (name, format) = (&scene.coarse_name, &coarse.format);
        found.push(format!("{name}: {format}, without a unit: an image in the coarse DTM's place? Say --coarse-unit if these are heights"));
    }
    found
}
