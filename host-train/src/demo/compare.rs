//! Step 5: compares the coarse DTM, the pipeline without training, float and int8 with the truth, on the same pixels.

use super::console::say;
use super::folder::{Folder, NAMES, error_file};
use super::infer::Predicted;
use super::scene::DemoScene;
use elunar_base::{Error, Result};
use elunar_evaluate::{Candidate, Comparison, Details, Scores, compare, table};
use elunar_picture::{ErrorLimits, error_map, write_png};
use elunar_raster::align::Named;

/// Result of the comparison.
pub(super) struct TourVerdict {
    /// Coarse DTM, the pipeline without training, float and int8 against the truth.
    pub against_truth: Comparison,
    /// Int8 compared with float, on the whole scene.
    pub int8_against_float: Scores,
    /// Limits of the error maps.
    pub limits: ErrorLimits,
}

/// Compares, prints the table, and draws error maps.
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
    let errors: Vec<&[f32]> = against_truth.scored.iter().map(|scored| scored.error_m.samples.as_slice()).collect();
    let limits = ErrorLimits::of(&errors);
    for scored in &against_truth.scored {
        let error = &scored.error_m;
        let map = error_map(&error.samples, error.rows, error.cols, limits)?;
        write_png(&folder.file(&error_file(&scored.name)), map)?;
    }
    for line in table(&against_truth, &Details::default()).lines() {
        say(line);
    }
    Ok(TourVerdict { against_truth, int8_against_float, limits })
}
