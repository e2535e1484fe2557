//! The page of a finished prediction: image, coarse DTM and DTM as a relief, and what was taken and found.

use super::request::Request;
use super::words::file_name;
use crate::html::{Cell, LONGEST_PX, LayerRole, ReliefLayer, ReliefScene, document, escaped, relief, table};
use elunar_base::quantile::nearest_rank;
use elunar_base::{Result, atomic_write};
use elunar_core::terrain::PixelSize;
use elunar_core::tile::Window;
use elunar_raster::{geotiff, source};
use elunar_scene::predict::record::{LightRecord, PredictionRecord};
use elunar_scene::predict::{Preview, Scene};
use std::path::Path;

/// Rows that are read at once.
const BAND_ROWS: usize = 256;

/// Writes the page of a prediction whose files are written.
///
/// # Errors
/// If an input or the DTM cannot be read, or the page cannot be written.
pub(super) fn write(path: &Path, args: &Request, scene: &Scene, record: &PredictionRecord) -> Result<()> {
    let mut shown = maps(args, scene)?;
    shown.azimuth_deg = record.light.as_ref().map_or(315.0, |light| light.azimuth_deg);
    let body = [
        opening(args, record, &shown),
        relief(std::slice::from_ref(&shown))?,
        found(record),
        format!(
            "<details><summary>All that was taken and found</summary><pre>{}</pre></details>\n",
            escaped(&record.json())
        ),
        format!("<p class=\"faint\">elunar {}</p>\n", env!("CARGO_PKG_VERSION")),
    ];
    let title = format!("{}: a DTM from one image", file_name(&args.output));
    atomic_write(path, document(&title, &body.concat()).as_bytes())
}

/// Reads all maps, as means over so many pixels that they fit a page.
fn maps(args: &Request, scene: &Scene) -> Result<ReliefScene> {
    let dtm = source::open(&args.output)?;
    let errors = args.uncertainty.as_deref().map(|path| geotiff::open_band(path, 0)).transpose()?;
    let preview = || Preview::new(scene.rows, scene.cols, scene.georef.clone(), LONGEST_PX);
    let mut all = [preview(), preview(), preview(), preview()];
    let [image, coarse, heights, sigma] = &mut all;
    for row in (0..scene.rows).step_by(BAND_ROWS) {
        let rows = BAND_ROWS.min(scene.rows - row);
        let window = Window { row, col: 0, rows, cols: scene.cols };
        let band = scene.band(row, rows)?;
        image.add(&band.image);
        coarse.add(&band.coarse_m);
        heights.add(&dtm.read(window)?);
        if let Some(errors) = &errors {
            sigma.add(&errors.read(window)?);
        }
    }
    let [image, coarse, heights, sigma] = all.map(Preview::finish);
    let (row_m, col_m) = heights.pixel_m().unwrap_or_default();
    let layer = |name: &str, role, samples| ReliefLayer { name: name.into(), role, samples };
    Ok(ReliefScene {
        title: file_name(&args.output),
        rows: heights.rows,
        cols: heights.cols,
        pixel: PixelSize { row_m, col_m },
        azimuth_deg: 0.0,
        layers: vec![
            layer("image", LayerRole::Image, image.samples),
            layer("coarse DTM", LayerRole::Coarse, coarse.samples),
            layer("result", LayerRole::Result, heights.samples),
        ],
        sigma_m: errors.is_some().then_some(sigma.samples),
    })
}

/// What went in, what came out, how good it is.
fn opening(args: &Request, record: &PredictionRecord, shown: &ReliefScene) -> String {
    let PredictionRecord { rows, cols, pixel_m, coarse_px, lowest_m, highest_m, .. } = record;
    let expected = shown.sigma_m.as_ref().and_then(|sigma| {
        let mut known: Vec<f32> = sigma.iter().copied().filter(|v| v.is_finite()).collect();
        nearest_rank(&mut known, 0.5)
    });
    let how_good = match expected {
        Some(sigma_m) => {
            format!("Their errors are expected to have a standard deviation of {sigma_m:.2} m in the median.")
        }
        None => "The errors to expect were not asked for (<code>--uncertainty</code>).".into(),
    };
    let reduced = if shown.rows < *rows {
        format!(" Shown here: means over pixels of {:.1} m.", shown.pixel.col_m)
    } else {
        String::new()
    };
    let warnings: String = record.warnings.iter().map(|warning| format!("<li>{}</li>\n", escaped(warning))).collect();
    let warnings = if warnings.is_empty() { warnings } else { format!("<ul class=\"warn\">\n{warnings}</ul>\n") };
    format!(
        "<h1>{}: a DTM from one image</h1>\n<p>The image <b>{}</b> ({rows} × {cols} pixels of {pixel_m:.2} m) and the coarse DTM <b>{}</b> \
         (pixels of {:.0} m) became heights from {lowest_m:.1} to {highest_m:.1} m. {how_good}{reduced}</p>\n{warnings}",
        escaped(&file_name(&args.output)),
        escaped(&file_name(&args.inputs.image)),
        escaped(&file_name(&args.inputs.coarse)),
        pixel_m * coarse_px,
    )
}

fn found(record: &PredictionRecord) -> String {
    let light = record.light.as_ref().map_or_else(|| "not used by the model".into(), of_light);
    let relief = record.share_of_relief.map_or_else(|| "unknown".into(), |share| format!("{:.0} %", 100.0 * share));
    let rows = [
        ("Model", record.model.clone()),
        ("Light", light),
        ("Share of the image's contrast that is relief", relief),
        ("Pixels with and without a height", format!("{} and {}", record.pixels_valid, record.pixels_void)),
        ("Tiles; of them without contrast or relief", format!("{}; {}", record.tiles.all, record.tiles.coarse)),
        ("Time", format!("{:.1} s", record.seconds)),
    ];
    let rows: Vec<Vec<Cell>> =
        rows.into_iter().map(|(name, text)| vec![Cell::plain(name), Cell::plain(text)]).collect();
    format!("<h2>What was found</h2>\n{}", table(&["", ""], &rows))
}

fn of_light(light: &LightRecord) -> String {
    let spread = if light.azimuth_sd_deg > 0.0 { format!(" ± {:.0}", light.azimuth_sd_deg) } else { String::new() };
    format!("{}: azimuth {:.0}{spread}°, elevation {:.0}°", light.source, light.azimuth_deg, light.elevation_deg)
}

#[cfg(test)]
mod tests {
    use crate::job::{self, Request};
    use clap::Parser;
    use elunar_synth::{Moon, SynthOptions};

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        request: Request,
    }

    #[test]
    fn the_page_of_a_prediction_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name).display().to_string();
        Moon::new(3, SynthOptions::default()).unwrap().scene(0, 60, 700).unwrap().write(folder.path()).unwrap();
        let [image, coarse, dtm, errors, page] =
            ["scene_0000_image.tif", "scene_0000_coarse.tif", "dtm.tif", "e.tif", "page.html"].map(at);
        let mut words = vec!["x", "--image", &image, "--coarse", &coarse, "--model", "ground", "-o", &dtm];
        words.extend(["--uncertainty", &errors, "--report", &page]);
        let run = |words: &[&str]| job::run(&Line::parse_from(words).request, None, job::open);
        assert!(run(&words).unwrap().text.contains("page.html: a page"));
        let text = std::fs::read_to_string(&page).unwrap();
        // 700 columns are shown as 350.
        for expected in
            ["\"rows\":30,\"cols\":350", "\"slots\":[0,1,2]", "means over pixels of", "standard deviation of"]
        {
            assert!(text.contains(expected), "{expected}");
        }
        assert!(!text.contains("src=\"") && !text.contains("href="), "the page loads nothing");
        assert!(run(&words).unwrap().text.contains("finished before"));
        std::fs::remove_file(&page).unwrap();
        assert!(!run(&words).unwrap().text.contains("finished before"));
        *words.last_mut().unwrap() = &dtm;
        assert!(run(&words).is_err());
    }
}
