//! Step 5: compares the coarse DTM, the pipeline without training, float and int8 with the truth, on the same pixels.

use super::console::say;
use super::folder::{Folder, NAMES, PROFILE, error_file};
use super::infer::Predicted;
use super::scene::DemoScene;
use elunar_base::{Error, Result};
use elunar_evaluate::{Candidate, Comparison, Details, Scores, compare, table};
use elunar_picture::{Chart, Series, curves, error_map, write_png};
use elunar_raster::Raster;
use elunar_raster::align::Named;

/// Result of the comparison.
pub(super) struct TourVerdict {
    /// Coarse DTM, the pipeline without training, float and int8 against the truth.
    pub against_truth: Comparison,
    /// Int8 compared with float, on the whole scene.
    pub int8_against_float: Scores,
}

/// Compares, prints the table, and draws error maps and a profile.
///
/// # Errors
/// If comparing or writing fails.
pub(super) fn run(
    folder: &Folder,
    scene: &DemoScene,
    [untrained, float, int8]: &[Predicted; 3],
) -> Result<TourVerdict> {
    let truth_name = scene.file("truth");
    let candidates = [
        Candidate::coarse(NAMES[0], &scene.coarse),
        Candidate::fine(NAMES[1], &untrained.made.dtm),
        Candidate::fine(NAMES[2], &float.made.dtm),
        Candidate::fine(NAMES[3], &int8.made.dtm),
    ];
    let against_truth = compare(Named::new(&truth_name, &scene.truth), &candidates, None)?;
    let pair = compare(Named::new("float", &float.made.dtm), &[Candidate::fine("int8", &int8.made.dtm)], None)?;
    let int8_against_float = pair.scored.first().map(|scored| scored.scores);
    let int8_against_float = int8_against_float.ok_or_else(|| Error::input("evaluate: expected scores, found none"))?;
    for scored in &against_truth.scored {
        let error = &scored.error_m;
        let map = error_map(&error.samples, error.rows, error.cols)?;
        write_png(&folder.file(&error_file(&scored.name)), map)?;
    }
    profile(folder, scene, &float.made.dtm, &int8.made.dtm)?;
    for line in table(&against_truth, &Details::default()).lines() {
        say(line);
    }
    Ok(TourVerdict { against_truth, int8_against_float })
}

/// Draws heights along the middle half of the middle row. It is long enough for hills and short enough for craters of a few pixels.
fn profile(folder: &Folder, scene: &DemoScene, float: &Raster, int8: &Raster) -> Result<()> {
    let (row, cols) = (scene.truth.rows / 2, scene.truth.cols);
    let mean_m = {
        let along = &scene.truth.samples[row * cols..][..cols];
        along.iter().map(|z| f64::from(*z)).sum::<f64>() / cols as f64
    };
    let series = |name: &str, heights_m: &[f32]| Series {
        name: name.into(),
        points: (cols / 4..cols - cols / 4)
            .map(|col| (col as f64 * scene.pixel_m, f64::from(heights_m[row * cols + col]) - mean_m))
            .collect(),
    };
    let all = [
        series("float", &float.samples),
        series(NAMES[0], &scene.interpolated.samples),
        series("truth", &scene.truth.samples),
        series("int8", &int8.samples),
    ];
    let title = format!("Heights along row {row}, metres above {mean_m:.0} m");
    let chart = Chart { title: &title, x: "metres from the west edge", y: "height, m", log_y: false };
    curves(&folder.file(PROFILE), &chart, &all)
}
