//! Step 4: predicts the scene without training and with both networks.

use super::TourSettings;
use super::console::{minutes, say};
use super::folder::{FLOAT_MODEL, Folder, INT8_MODEL, dtm_file, shade_file};
use super::scene::DemoScene;
use elunar_base::progress::bar;
use elunar_base::{Result, interrupt};
use elunar_learn::float::open_any;
use elunar_learn::model::backend::Backend;
use elunar_net::illumination::KnownSun;
use elunar_scene::predict::job::light_text;
use elunar_scene::predict::network::TileModel;
use elunar_scene::predict::untrained::Untrained;
use elunar_scene::predict::{DtmWriter, PredictOptions, Prediction, Provenance, predict};
use std::ops::ControlFlow;
use std::time::Instant;

/// One DTM of the scene.
pub(super) struct Predicted {
    /// `untrained`, `float` or `int8`.
    pub name: &'static str,
    /// The DTM, and the number of its tiles by result.
    pub made: Prediction,
    /// The model, with the SHA-256 of its file.
    pub model: String,
    /// Time from the first tile to the last, seconds.
    pub seconds: f64,
}

impl Predicted {
    /// Returns the name of the DTM's file.
    pub(super) fn file(&self) -> String {
        dtm_file(self.name)
    }

    /// Returns the name of its hillshade.
    pub(super) fn shade(&self) -> String {
        shade_file(self.name)
    }
}

/// Predicts without training, with float and with int8, and writes the DTMs with their hillshades.
///
/// # Errors
/// If a model cannot be opened, or predicting or writing fails.
pub(super) fn run(settings: &TourSettings, folder: &Folder, scene: &DemoScene) -> Result<[Predicted; 3]> {
    let open = |file: &str| open_any(&folder.file(file), Backend::Flex);
    let untrained = one(settings, folder, scene, "untrained", &Untrained)?;
    let float = one(settings, folder, scene, "float", open(FLOAT_MODEL)?.as_ref())?;
    Ok([untrained, float, one(settings, folder, scene, "int8", open(INT8_MODEL)?.as_ref())?])
}

fn one(
    settings: &TourSettings,
    folder: &Folder,
    scene: &DemoScene,
    name: &'static str,
    model: &dyn TileModel,
) -> Result<Predicted> {
    let overlap_px = PredictOptions::overlap_for(model.tile());
    // Archives state the Sun's direction for every image.
    let (azimuth_deg, elevation_deg) = (scene.about.sun_azimuth_deg, scene.about.sun_elevation_deg);
    let sun = KnownSun { azimuth_deg: Some(azimuth_deg), elevation_deg: Some(elevation_deg) };
    let options = PredictOptions { overlap_px, threads: settings.threads, sun, ..PredictOptions::default() };
    let bar = bar(name, 0, "tiles");
    let start = Instant::now();
    let made = predict(&scene.input, model, &options, &mut |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
        if interrupt::requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    bar.finish_and_clear();
    let (made, seconds) = (made?, start.elapsed().as_secs_f64());
    let predicted = Predicted { name, made, model: model.description(), seconds };
    let (image, coarse) = (scene.file("image"), scene.file("coarse"));
    let light = light_text(&predicted.made.tally.light);
    let from = Provenance { model: &predicted.model, light: &light, image: &image, coarse: &coarse, identity: None };
    let Prediction { dtm, tally } = &predicted.made;
    let place = &scene.input.georef;
    let mut writer = DtmWriter::create(&folder.file(&predicted.file()), dtm.rows, dtm.cols, place, &from)?;
    writer.add(&dtm.samples)?;
    writer.finish(&|| Ok(()))?;
    say(format!("{}: {} overlapping tiles in {}", predicted.file(), tally.tiles, minutes(seconds)));
    Ok(predicted)
}
