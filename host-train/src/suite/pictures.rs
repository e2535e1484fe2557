//! Sheets of a scene's hillshades and errors, and of a ground's two DTMs and their difference.

use super::results::COARSE;
use super::scene::TestScene;
use super::score::Seen;
use elunar_core::terrain::PixelSize;
use elunar_raster::{Error, Raster, Result};
use elunar_scene::evaluate::Comparison;
use elunar_scene::picture::{Panel, error_map, hillshade, sheet, stretch, write_png};
use std::path::Path;

/// Folder of the pictures, within the suite's folder.
pub const PICTURES: &str = "pictures";
/// Width of a panel, pixels, and number of panels per row.
const PANEL: (u32, usize) = (320, 4);

fn scene_file(scene: &str, what: &str) -> String {
    format!("{PICTURES}/{scene}_{what}.png")
}

/// Returns the names of a scene's pictures, within the suite's folder.
pub(super) fn scene_files(scene: &str) -> [String; 2] {
    ["relief", "errors"].map(|what| scene_file(scene, what))
}

/// Returns the name of the picture of a ground's two scenes, within the suite's folder.
pub(super) fn cross_file(ground: &str, a: &str, b: &str) -> String {
    format!("{PICTURES}/ground_{ground}_{a}_{b}.png")
}

/// Draws a scene: truth and DTMs as they are, errors at the resolution of the comparison. Returns file (relative to `out`) and caption of every
/// sheet.
///
/// # Errors
/// If a file cannot be written.
pub fn scene(out: &Path, scene: &TestScene, comparison: &Comparison) -> Result<Vec<(String, String)>> {
    let name = &scene.entry.name;
    let pixel = comparison.pixel;
    let shade = |map: &Raster| hillshade(&map.samples, map.rows, map.cols, pixel);
    let mut views = vec![
        Panel::new("image", stretch(&scene.image.samples, scene.image.rows, scene.image.cols)?),
        Panel::new("truth", shade(&scene.truth)?),
    ];
    let mut errors = vec![];
    for scored in &comparison.scored {
        views.push(Panel::new(&scored.name, shade(&scored.as_it_is)?));
        let rmse = format!("{}: RMSE {:.2} m", scored.name, scored.scores.rmse_m);
        errors.push(Panel::new(rmse, error_map(&scored.error_m.samples, scored.error_m.rows, scored.error_m.cols)?));
    }
    let mut made = vec![];
    for (what, panels, caption) in
        [("relief", &views, "image, truth and DTMs, lit from the north-west"), ("errors", &errors, "DTM minus truth")]
    {
        let file = scene_file(name, what);
        write_png(&out.join(&file), sheet(panels, PANEL.1, PANEL.0))?;
        made.push((file, format!("{name}: {caption}")));
    }
    Ok(made)
}

/// Draws both DTMs of a ground under two Suns, and their difference. Each method has a row.
///
/// # Errors
/// If a file cannot be written.
pub fn cross(out: &Path, ground: &str, a: &Seen, b: &Seen) -> Result<(String, String)> {
    let mut panels = vec![];
    for ((method, first), (_, second)) in a.dtms.iter().zip(&b.dtms).filter(|((name, _), _)| name != COARSE) {
        let unknown = || Error::input(format!("ground {ground}: pixel size in metres unknown"));
        let (row_m, col_m) = first.pixel_m().ok_or_else(unknown)?;
        let shade = |map: &Raster| hillshade(&map.samples, map.rows, map.cols, PixelSize { row_m, col_m });
        let difference: Vec<f32> = first.samples.iter().zip(&second.samples).map(|(a, b)| a - b).collect();
        panels.push(Panel::new(format!("{method} from {}", a.name), shade(first)?));
        panels.push(Panel::new(format!("{method} from {}", b.name), shade(second)?));
        panels.push(Panel::new("difference", error_map(&difference, first.rows, first.cols)?));
    }
    let file = cross_file(ground, &a.name, &b.name);
    write_png(&out.join(&file), sheet(&panels, 3, PANEL.0))?;
    Ok((file, format!("{ground} under two Suns: DTMs from {} and {}, and their difference", a.name, b.name)))
}
