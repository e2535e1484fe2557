//! Sheets of a scene's hillshades and errors, and of a ground's two DTMs and their difference.

use super::files::{cross_file, picture_file};
use super::results::COARSE;
use super::scene::TestScene;
use super::score::Seen;
use elunar_base::{Error, Result};
use elunar_core::terrain::PixelSize;
use elunar_core::tile::Window;
use elunar_evaluate::Comparison;
use elunar_picture::{ErrorLimits, Panel, error_map, hillshades, sheet, stretch, write_png};
use elunar_raster::Raster;
use std::path::Path;

/// Width of a panel, pixels, and number of panels per row.
const PANEL: (u32, usize) = (320, 4);

/// Draws a scene: truth and DTMs as they are, errors at the resolution of the comparison. Returns file (relative to `out`) and caption of every
/// sheet.
///
/// # Errors
/// If a file cannot be written.
pub fn scene(out: &Path, scene: &TestScene, comparison: &Comparison) -> Result<Vec<(String, String)>> {
    let name = &scene.entry.name;
    let pixel = comparison.pixel;
    let dtms: Vec<&Raster> = comparison.scored.iter().map(|scored| &scored.as_it_is).collect();
    // All lie on the truth's grid. DTMs that end earlier than the image leave no margin.
    let part = shared(&dtms);
    let cut = |map: &Raster| cut(map, part);
    let maps: Vec<Vec<f32>> = std::iter::once(&scene.truth).chain(dtms).map(cut).collect();
    let shades = hillshades(&maps.iter().map(Vec::as_slice).collect::<Vec<_>>(), part.rows, part.cols, pixel)?;
    let names = std::iter::once("truth").chain(comparison.scored.iter().map(|scored| scored.name.as_str()));
    let mut views = vec![Panel::new("image", stretch(&cut(&scene.image), part.rows, part.cols)?)];
    views.extend(names.zip(shades).map(|(name, shade)| Panel::new(name, shade)));
    let mut errors = vec![];
    let limits = ErrorLimits::of(&comparison.scored.iter().map(|s| s.error_m.samples.as_slice()).collect::<Vec<_>>());
    for scored in &comparison.scored {
        let rmse = format!("{}: RMSE {:.2} m", scored.name, scored.scores.rmse_m);
        errors.push(Panel::new(rmse, error_map(&cut(&scored.error_m), part.rows, part.cols, limits)?));
    }
    let mut made = vec![];
    for (what, panels, caption) in
        [("relief", &views, "image, truth and DTMs, lit from the north-west"), ("errors", &errors, "DTM minus truth")]
    {
        let file = picture_file(name, what);
        write_png(&out.join(&file), sheet(panels, PANEL.1, PANEL.0))?;
        made.push((file, format!("{name}: {caption}")));
    }
    Ok(made)
}

/// Returns the rectangle that holds all pixels which are valid in all maps; they have one size. Without such a pixel it is the whole.
fn shared(maps: &[&Raster]) -> Window {
    let Some(Raster { rows, cols, .. }) = maps.first() else { return Window { row: 0, col: 0, rows: 0, cols: 0 } };
    let valid = |i: usize| maps.iter().all(|map| map.samples[i].is_finite());
    let (mut low, mut high) = ((*rows, *cols), (0, 0));
    for (row, col) in (0..rows * cols).filter(|i| valid(*i)).map(|i| (i / cols, i % cols)) {
        (low, high) = ((low.0.min(row), low.1.min(col)), (high.0.max(row + 1), high.1.max(col + 1)));
    }
    if high == (0, 0) {
        (low, high) = ((0, 0), (*rows, *cols));
    }
    Window { row: low.0, col: low.1, rows: high.0 - low.0, cols: high.1 - low.1 }
}

fn cut(map: &Raster, part: Window) -> Vec<f32> {
    let line = |row: usize| &map.samples[row * map.cols + part.col..][..part.cols];
    (part.row..part.row + part.rows).flat_map(|row| line(row).iter().copied()).collect()
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
        let difference: Vec<f32> = first.samples.iter().zip(&second.samples).map(|(a, b)| a - b).collect();
        let (pixel, both) = (PixelSize { row_m, col_m }, [&first.samples[..], &second.samples]);
        let shades = hillshades(&both, first.rows, first.cols, pixel)?;
        let captions = [&a.name, &b.name].map(|name| format!("{method} from {name}"));
        panels.extend(captions.into_iter().zip(shades).map(|(caption, shade)| Panel::new(caption, shade)));
        panels.push(Panel::new(
            "difference",
            error_map(&difference, first.rows, first.cols, ErrorLimits::of(&[&difference]))?,
        ));
    }
    let file = cross_file(ground, &a.name, &b.name);
    write_png(&out.join(&file), sheet(&panels, 3, PANEL.0))?;
    Ok((file, format!("{ground} under two Suns: DTMs from {} and {}, and their difference", a.name, b.name)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn void_margins_are_cut_off() {
        let map = |valid: &dyn Fn(usize, usize) -> bool| {
            let sample = |i: usize| if valid(i / 5, i % 5) { i as f32 } else { f32::NAN };
            Raster { rows: 4, cols: 5, samples: (0..20).map(sample).collect(), georef: None }
        };
        let (whole, less) = (map(&|_, _| true), map(&|row, col| row < 3 && col > 0 && (row, col) != (1, 2)));
        let part = shared(&[&whole, &less]);
        assert_eq!(part, Window { row: 0, col: 1, rows: 3, cols: 4 });
        assert_eq!(cut(&whole, part), [1.0, 2.0, 3.0, 4.0, 6.0, 7.0, 8.0, 9.0, 11.0, 12.0, 13.0, 14.0]);
        assert_eq!(shared(&[&map(&|_, _| false)]), Window { row: 0, col: 0, rows: 4, cols: 5 });
    }
}
