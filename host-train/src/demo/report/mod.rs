//! Step 6: writes one page with all results and pictures, and the same figures as JSON.

mod figures;
mod page;

use super::compare::TourVerdict;
use super::console::{StepTime, say};
use super::folder::{COARSE_SHADE, FIGURES, Folder, IMAGE, NAMES, OVERVIEW, REPORT, RUN, TRUTH_SHADE, error_file};
use super::infer::Predicted;
use super::scene::DemoScene;
use super::shrink::Shrunk;
use super::tune::{Tuned, curves};
use super::{Seeds, TourSettings};
use crate::report::html::{LayerRole, Picture, ReliefLayer, ReliefScene, relief};
use elunar_base::{Error, Result, atomic_write};
use elunar_core::terrain::PixelSize;
use elunar_picture::{Panel, sheet, write_png};
use std::path::PathBuf;

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
    errors: Vec<Picture>,
    curves: Picture,
}

impl Story<'_> {
    fn pictures(&self, folder: &Folder) -> Pictures {
        let rmse = |k: usize| self.verdict.against_truth.scored.get(k).map_or(f64::NAN, |j| j.scores.rmse_m);
        let error = |(k, name): (usize, &&str)| Picture {
            file: folder.file(&error_file(name)),
            caption: format!("{name} minus truth, RMSE {:.2} m", rmse(k)),
        };
        Pictures {
            errors: NAMES.iter().enumerate().map(error).collect(),
            curves: Picture {
                file: curves(&folder.file(RUN)),
                caption: "Training; validation at step 0 is before the first step".into(),
            },
        }
    }

    /// Returns the scene with all its maps.
    fn relief(&self) -> Result<ReliefScene> {
        let scene = &self.scene;
        let [untrained, float, int8] = &self.predicted;
        let image = scene.input.band(0, scene.truth.rows)?.image;
        let layer = |name: &str, role, samples| ReliefLayer { name: name.into(), role, samples };
        Ok(ReliefScene {
            title: scene.about.name.clone(),
            rows: scene.truth.rows,
            cols: scene.truth.cols,
            pixel: PixelSize::square(scene.pixel_m),
            azimuth_deg: scene.about.sun_azimuth_deg,
            layers: vec![
                layer("image", LayerRole::Image, image),
                layer(NAMES[0], LayerRole::Coarse, scene.interpolated.samples.clone()),
                layer("result (int8)", LayerRole::Result, int8.made.dtm.samples.clone()),
                layer("truth", LayerRole::Truth, scene.truth.samples.clone()),
                layer("float", LayerRole::Other, float.made.dtm.samples.clone()),
                layer(NAMES[1], LayerRole::Other, untrained.made.dtm.samples.clone()),
            ],
            sigma_m: None,
        })
    }
}

/// Writes overview, figures and report. Returns the report's path.
///
/// # Errors
/// If a picture cannot be read or a file cannot be written.
pub(super) fn write(folder: &Folder, story: &Story) -> Result<PathBuf> {
    let pictures = story.pictures(folder);
    overview(folder, story)?;
    let figures = format!("{:#}\n", figures::figures(story));
    atomic_write(&folder.file(FIGURES), figures.as_bytes())?;
    let path = folder.file(REPORT);
    atomic_write(&path, page::page(story, &pictures, &relief(&[story.relief()?])?)?.as_bytes())?;
    say(format!("{REPORT}, {OVERVIEW} and {FIGURES} beside the GeoTIFFs in {}", folder.show()));
    Ok(path)
}

/// Writes all views of the scene on one sheet.
fn overview(folder: &Folder, story: &Story) -> Result<()> {
    let sun = &story.scene.about;
    let [untrained, float, int8] = &story.predicted;
    let of_image = format!("Image, Sun {:.0}° high from azimuth {:.0}°", sun.sun_elevation_deg, sun.sun_azimuth_deg);
    let views = [
        (IMAGE.into(), of_image.as_str()),
        (COARSE_SHADE.into(), "Coarse DTM (59 m), interpolated"),
        (untrained.shade(), "Without training: coarse DTM plus photoclinometry"),
        (float.shade(), "DTM of the float network"),
        (int8.shade(), "DTM of the int8 network"),
        (TRUTH_SHADE.into(), "Truth"),
    ];
    let panel = |(name, caption): (String, &str)| -> Result<Panel> {
        let path = folder.file(&name);
        let broken = |e: image::ImageError| Error::broken(&path, format!("expected a PNG: {e}"));
        Ok(Panel::new(caption, image::open(&path).map_err(broken)?))
    };
    let panels: Result<Vec<Panel>> = views.into_iter().map(panel).collect();
    write_png(&folder.file(OVERVIEW), sheet(&panels?, 3, 480))
}
