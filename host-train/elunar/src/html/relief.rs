//! The relief of a page: layers of grounds under a light that the reader turns, with a profile. The page holds samples and script; it loads nothing.

use super::packed::PackedMap;
use elunar_base::quantile::nearest_rank;
use elunar_base::{Error, Result};
use elunar_core::terrain::PixelSize;
use serde::Serialize;

/// Longest side of a ground in a page, pixels (our choice: five layers are then below 2 MB).
pub const LONGEST_PX: usize = 640;

/// Heights are stored in steps of this share of a pixel, so that no slope is off by more than 0.3 degrees.
const STEP_PX: f64 = 1.0 / 200.0;

/// Steps of an image, and of expected errors.
const GREYS: f32 = 255.0;

/// The modules of the relief, each after those that it imports. The page of host-train/web loads them as they are.
const MODULES: [&str; 11] = [
    include_str!("colours.js"),
    include_str!("shading.js"),
    include_str!("samples.js"),
    include_str!("chart.js"),
    include_str!("dial.js"),
    include_str!("marks.js"),
    include_str!("profile.js"),
    include_str!("relief-gl.js"),
    include_str!("relief-canvas.js"),
    include_str!("relief.js"),
    include_str!("report.js"),
];

/// What a layer is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayerRole {
    /// The image.
    Image,
    /// Heights of the coarse DTM.
    Coarse,
    /// Heights of the DTM that the page is about.
    Result,
    /// True heights.
    Truth,
    /// Other heights.
    Other,
}

/// One map of a ground.
#[derive(Debug, Clone)]
pub struct ReliefLayer {
    /// Name.
    pub name: String,
    /// What it is.
    pub role: LayerRole,
    /// Samples, row-major; brightness, or heights in metres. Those that are not finite are void.
    pub samples: Vec<f32>,
}

/// A ground with its layers.
#[derive(Debug, Clone)]
pub struct ReliefScene {
    /// Name.
    pub title: String,
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Ground size of a pixel.
    pub pixel: PixelSize,
    /// Azimuth of the light at first, degrees clockwise from the top.
    pub azimuth_deg: f64,
    /// Its layers; one is the result.
    pub layers: Vec<ReliefLayer>,
    /// Standard deviations of the result's heights, metres.
    pub sigma_m: Option<Vec<f32>>,
}

#[derive(Serialize)]
struct StoredLayer<'a> {
    name: &'a str,
    is_image: bool,
    map: PackedMap,
}

#[derive(Serialize)]
struct StoredScene<'a> {
    title: &'a str,
    rows: usize,
    cols: usize,
    row_m: f64,
    col_m: f64,
    azimuth_deg: f64,
    layers: Vec<StoredLayer<'a>>,
    sigma: Option<PackedMap>,
    slots: [usize; 3],
    main: usize,
    coarse: Option<usize>,
    truth: Option<usize>,
}

/// Returns the relief of grounds, of which the reader chooses one; nothing without any. A page has one relief.
///
/// # Errors
/// [`Error::Usage`] if a ground has no result, or a layer another size.
pub fn relief(scenes: &[ReliefScene]) -> Result<String> {
    if scenes.is_empty() {
        return Ok(String::new());
    }
    let stored = scenes.iter().map(stored).collect::<Result<Vec<_>>>()?;
    let data = serde_json::to_string(&stored).map_err(|e| Error::usage(format!("page: {e}")))?;
    Ok(format!(
        "<noscript><p class=\"warn\">The relief needs JavaScript.</p></noscript>\n<div id=\"terrain\"></div>\n\
         <script type=\"application/json\" id=\"relief-data\">{}</script>\n<script>\n{}</script>\n",
        data.replace('<', "\\u003c"),
        script()
    ))
}

/// Returns the modules as one script.
fn script() -> String {
    let lines = MODULES.iter().flat_map(|module| module.lines());
    let body: String = lines
        .filter(|line| !line.starts_with("import "))
        .map(|line| format!("{}\n", line.strip_prefix("export ").unwrap_or(line)))
        .collect();
    format!("(() => {{\n\"use strict\";\n{body}}})();\n")
}

fn stored(scene: &ReliefScene) -> Result<StoredScene<'_>> {
    let ReliefScene { rows, cols, pixel, layers, .. } = scene;
    let find = |role| layers.iter().position(|layer| layer.role == role);
    let wrong = |what: &str| Error::usage(format!("page: {}: {what}", scene.title));
    let main = find(LayerRole::Result).ok_or_else(|| wrong("heights of a result expected, none found"))?;
    if layers.iter().map(|layer| &layer.samples).chain(&scene.sigma_m).any(|samples| samples.len() != rows * cols) {
        return Err(wrong(&format!("maps of {rows} x {cols} samples expected, another found")));
    }
    let (image, coarse, truth) = (find(LayerRole::Image), find(LayerRole::Coarse), find(LayerRole::Truth));
    let sigma = scene.sigma_m.as_ref().map(|sigma| {
        let range = range(sigma, 0.0, 1.0);
        PackedMap::new(sigma, *cols, range, (range.1 - range.0) / GREYS)
    });
    Ok(StoredScene {
        title: &scene.title,
        rows: *rows,
        cols: *cols,
        row_m: pixel.row_m,
        col_m: pixel.col_m,
        azimuth_deg: scene.azimuth_deg,
        layers: layers.iter().map(|layer| packed(layer, *cols, pixel)).collect::<Result<_>>()?,
        sigma: sigma.transpose()?,
        slots: [image.unwrap_or(main), coarse.unwrap_or(main), main],
        main,
        coarse,
        truth,
    })
}

fn packed<'a>(layer: &'a ReliefLayer, cols: usize, pixel: &PixelSize) -> Result<StoredLayer<'a>> {
    let (name, samples, is_image) = (&layer.name, &layer.samples, layer.role == LayerRole::Image);
    let map = if is_image {
        // As many values as a screen shows, between the percentiles that the relief draws.
        let range = range(samples, 0.005, 0.995);
        PackedMap::new(samples, cols, range, (range.1 - range.0) / GREYS)?
    } else {
        PackedMap::new(samples, cols, range(samples, 0.0, 1.0), (pixel.col_m * STEP_PX) as f32)?
    };
    Ok(StoredLayer { name, is_image, map })
}

/// Returns two percentiles, 0 to 1, of the finite samples; 0 without any.
fn range(samples: &[f32], low: f64, high: f64) -> (f32, f32) {
    let mut finite: Vec<f32> = samples.iter().copied().filter(|v| v.is_finite()).collect();
    let mut at = |share| nearest_rank(&mut finite, share).unwrap_or(0.0);
    (at(low), at(high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn scene() -> ReliefScene {
        let layer = |name: &str, role, first: f32| {
            let samples = (0..12).map(|i| first + i as f32).collect();
            ReliefLayer { name: name.into(), role, samples }
        };
        let layers = vec![layer("image", LayerRole::Image, 0.0), layer("</script>", LayerRole::Result, 100.0)];
        let pixel = PixelSize { row_m: 1.0, col_m: 1.0 };
        ReliefScene { title: "one".into(), rows: 3, cols: 4, pixel, azimuth_deg: 90.0, layers, sigma_m: None }
    }

    #[test]
    fn a_relief_is_data_and_one_script() {
        let page = relief(&[scene()]).unwrap();
        assert_eq!((page.matches("<script").count(), page.matches("</script>").count()), (2, 2));
        assert!(page.contains("\"slots\":[0,1,1]") && page.contains("\"coarse\":null") && !page.contains("import "));
        assert_eq!(relief(&[]).unwrap(), "");
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let refused = |change: &dyn Fn(&mut ReliefScene)| {
            let mut scene = scene();
            change(&mut scene);
            relief(&[scene]).unwrap_err().to_string()
        };
        assert!(refused(&|scene| scene.layers[1].role = LayerRole::Truth).contains("one: heights of a result"));
        assert!(refused(&|scene| scene.sigma_m = Some(vec![0.0; 11])).contains("3 x 4 samples expected"));
    }

    /// In one script, a second function of a name would replace the first.
    #[test]
    fn names_of_the_modules_differ() {
        let mut names = BTreeSet::new();
        let script = script();
        let declared = script.lines().filter_map(|line| {
            let line = line.strip_prefix("async ").unwrap_or(line);
            let rest = ["function ", "const ", "let "].iter().find_map(|word| line.strip_prefix(word))?;
            Some(rest.split([' ', '(']).next().unwrap_or_default())
        });
        let mut count = 0;
        for name in declared.filter(|name| !name.starts_with('[')) {
            assert!(names.insert(name), "{name} is declared twice");
            count += 1;
        }
        assert!(count > 20, "{count}");
    }
}
