//! The grounds of suites, for the relief of a page.

use super::html::{LayerRole, ReliefLayer, ReliefScene};
use crate::suite::files::{dtm_file, map_file};
use crate::suite::results::{SceneResult, SuiteResults};
use crate::suite::{DTMS, SCENES};
use elunar_base::{Result, say};
use elunar_core::sun::Body;
use elunar_core::terrain::PixelSize;
use elunar_core::tile::Window;
use elunar_raster::align::{Interpolation, Onto};
use elunar_raster::source::{self, Source};
use elunar_raster::{GeoRef, Raster};
use elunar_scene::predict::Preview;
use std::path::Path;

/// Longest side of a ground, pixels (our choice: a suite has many).
const LONGEST_PX: usize = 256;

/// Returns the scenes of a suite whose maps lie in its folder, with the DTM of the last method that made one.
///
/// # Errors
/// If a map cannot be read.
pub(super) fn of_suite(folder: &Path, results: &SuiteResults) -> Result<Vec<ReliefScene>> {
    let methods = results.methods.iter().rev().map(|method| method.name.as_str());
    let Some(method) = methods.into_iter().find(|method| folder.join(DTMS).join(method).is_dir()) else {
        say::note(&format!("{}: no DTMs there, so that the page has no relief of them", folder.display()));
        return Ok(vec![]);
    };
    results.scenes.iter().filter_map(|scene| of_scene(folder, scene, method).transpose()).collect()
}

fn of_scene(folder: &Path, scene: &SceneResult, method: &str) -> Result<Option<ReliefScene>> {
    let map = |what: &str| folder.join(SCENES).join(map_file(&scene.name, what));
    let [image, coarse, truth] = ["image", "coarse", "truth"].map(map);
    let dtm = folder.join(dtm_file(method, &scene.name));
    let absent = [&image, &coarse, &truth, &dtm].into_iter().find(|path| !path.is_file());
    if let Some(absent) = absent {
        say::note(&format!("{}: not there, so that the page has no relief of {}", absent.display(), scene.name));
        return Ok(None);
    }
    let grid = source::open(&truth)?;
    let (bilinear, bicubic) = (Interpolation::Bilinear, Interpolation::Bicubic);
    let layers = [
        ("image", LayerRole::Image, &image, bilinear),
        ("coarse DTM", LayerRole::Coarse, &coarse, bicubic),
        (method, LayerRole::Result, &dtm, bilinear),
        ("truth", LayerRole::Truth, &truth, bilinear),
    ];
    let (mut made, mut size) = (vec![], (0, 0));
    for (name, role, path, interpolation) in layers {
        let reduced = reduced(path, interpolation, &*grid, &truth)?;
        size = (reduced.rows, reduced.cols);
        made.push(ReliefLayer { name: name.into(), role, samples: reduced.samples });
    }
    let cell = scene.shape.0.div_ceil(size.0.max(1)) as f64;
    let pixel = PixelSize { row_m: scene.pixel_m.0 * cell, col_m: scene.pixel_m.1 * cell };
    let azimuth_deg = scene.sun_deg.0.unwrap_or(315.0);
    let (rows, cols) = size;
    Ok(Some(ReliefScene { title: scene.name.clone(), rows, cols, pixel, azimuth_deg, layers: made, sigma_m: None }))
}

/// Returns a map on the truth's grid, as means over its pixels.
fn reduced(path: &Path, interpolation: Interpolation, grid: &dyn Source, truth: &Path) -> Result<Raster> {
    let (info, name) = (grid.info(), |path: &Path| path.display().to_string());
    let onto = Onto::new(source::open(path)?.into(), &name(path), info, &name(truth), interpolation)?;
    let samples = onto.read(Window { row: 0, col: 0, rows: info.rows, cols: info.cols })?;
    let place = || GeoRef {
        transform: [0.0, 1.0, 0.0, 0.0, 0.0, -1.0],
        crs: elunar_raster::Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0),
    };
    let mut preview = Preview::new(info.rows, info.cols, info.georef.clone().unwrap_or_else(place), LONGEST_PX);
    preview.add(&samples);
    Ok(preview.finish())
}
