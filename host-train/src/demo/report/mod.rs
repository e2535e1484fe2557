//! Step 6: writes one page with all results and pictures, and the same figures as JSON.

mod figures;
mod page;

use super::compare::TourVerdict;
use super::console::{StepTime, say};
use super::folder::{
    COARSE_SHADE, FIGURES, Folder, IMAGE, NAMES, OVERVIEW, PROFILE, REPORT, RUN, TRUTH_SHADE, error_file,
};
use super::infer::Predicted;
use super::scene::DemoScene;
use super::shrink::Shrunk;
use super::tune::{Tuned, curves};
use super::{Seeds, TourSettings};
use crate::report::html::Picture;
use elunar_base::{Error, Result, atomic_write};
use elunar_picture::{Panel, sheet, write_png};
use std::path::{Path, PathBuf};

/// All results of a tour.
pub(super) struct Story<'a> {
    /// Settings of the tour.
    pub settings: &'a TourSettings,
    /// The Moons of the tour.
    pub seeds: Seeds,
    /// Result of step 1.
    pub scene: DemoScene,
    /// Result of step 2.
    pub tuned: Tuned,
    /// Result of step 3.
    pub shrunk: Shrunk,
    /// Results of step 4: without training, float and int8.
    pub predicted: [Predicted; 3],
    /// Result of step 5.
    pub verdict: TourVerdict,
    /// Times of these steps.
    pub times: Vec<StepTime>,
}

/// Pictures by their section of the report.
struct Pictures {
    scene: Vec<Picture>,
    errors: Vec<Picture>,
    profile: Picture,
    curves: Picture,
}

impl Story<'_> {
    fn pictures(&self, folder: &Folder) -> Pictures {
        let picture = |name: &str, caption: String| Picture { file: folder.file(name), caption };
        let sun = &self.scene.about;
        let [untrained, float, int8] = &self.predicted;
        let about_image =
            format!("Image, Sun {:.0}° high from azimuth {:.0}°", sun.sun_elevation_deg, sun.sun_azimuth_deg);
        let rmse = |k: usize| self.verdict.against_truth.scored.get(k).map_or(f64::NAN, |j| j.scores.rmse_m);
        let error = |(k, name): (usize, &&str)| {
            picture(&error_file(name), format!("{name} minus truth, RMSE {:.2} m", rmse(k)))
        };
        Pictures {
            scene: vec![
                picture(IMAGE, about_image),
                picture(COARSE_SHADE, "Coarse DTM (59 m), interpolated".into()),
                picture(&untrained.shade(), "Without training: coarse DTM plus photoclinometry".into()),
                picture(&float.shade(), "DTM of the float network".into()),
                picture(&int8.shade(), "DTM of the int8 network".into()),
                picture(TRUTH_SHADE, "Truth".into()),
            ],
            errors: NAMES.iter().enumerate().map(error).collect(),
            profile: picture(PROFILE, "Heights along the middle row, middle half".into()),
            curves: Picture {
                file: curves(&folder.file(RUN)),
                caption: "Training; validation at step 0 is before the first step".into(),
            },
        }
    }
}

/// Writes overview, figures and report. Returns the report's path.
///
/// # Errors
/// If a picture cannot be read or a file cannot be written.
pub(super) fn write(folder: &Folder, story: &Story) -> Result<PathBuf> {
    let pictures = story.pictures(folder);
    overview(&folder.file(OVERVIEW), &pictures.scene)?;
    let figures = format!("{:#}\n", figures::figures(story));
    atomic_write(&folder.file(FIGURES), figures.as_bytes())?;
    let path = folder.file(REPORT);
    atomic_write(&path, page::page(story, &pictures)?.as_bytes())?;
    say(format!("{REPORT}, {OVERVIEW} and {FIGURES} beside the GeoTIFFs in {}", folder.show()));
    Ok(path)
}

/// Writes all views of the scene on one sheet.
fn overview(path: &Path, pictures: &[Picture]) -> Result<()> {
    let panel = |picture: &Picture| -> Result<Panel> {
        let broken = |e: image::ImageError| Error::broken(&picture.file, format!("expected a PNG: {e}"));
        Ok(Panel::new(&picture.caption, image::open(&picture.file).map_err(broken)?))
    };
    let panels: Result<Vec<Panel>> = pictures.iter().map(panel).collect();
    write_png(path, sheet(&panels?, 3, 480))
}
