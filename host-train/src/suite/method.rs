//! Methods to be scored: networks with their usage, and existing DTMs.

use super::coarse_to_fine::ImageAndCoarse;
use super::linear::{self, Teacher};
use super::list::is_plain;
use super::results::{LINEAR_BOUND, LINEAR_OWN, MethodInfo, UNTRAINED};
use super::scene::TestScene;
use elunar_base::{Error, Result, interrupt};
use elunar_evaluate::CoAlignment;
use elunar_learn::float::open_any;
use elunar_learn::model::backend::Backend;
use elunar_net::illumination::{KnownSun, LightSource};
use elunar_raster::align::{Interpolation, Named, onto};
use elunar_raster::{Raster, heights};
use elunar_scene::predict::network::TileModel;
use elunar_scene::predict::untrained::Untrained;
use elunar_scene::predict::{PredictOptions, Prediction, Scene, predict};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A method with its name.
pub struct Method {
    /// Name in tables and file names.
    pub name: String,
    /// Model with hash, or folder.
    pub description: String,
    /// Source of its DTMs.
    pub source: DtmSource,
}

/// Source of DTMs.
pub enum DtmSource {
    /// A network.
    Network {
        /// The network.
        model: Box<dyn TileModel>,
        /// Usage of the network.
        usage: Usage,
    },
    /// The best linear filter that truths teach ([`linear`]).
    Linear(Teacher, Usage),
    /// Files `SCENE.tif` or `SCENE_dtm.tif` of a folder.
    Folder(PathBuf),
}

/// Usage of a network.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Usage {
    /// Whether the long waves of every tile are drawn to the coarse DTM's ([`Options::anchor`]).
    pub anchor: bool,
    /// Co-alignment of the finished DTM.
    pub co_alignment: CoAlignment,
    /// Whether the Sun's direction is given to the network. Otherwise it is estimated.
    pub tell_sun: bool,
    /// Number of threads; 0 takes as many as the machine offers.
    pub threads: usize,
    /// Number of coarser scales that are predicted first, each with pixels twice as wide as the next ([`ImageAndCoarse::refined`]); 0 for none.
    pub coarser_scales: u32,
}

impl Default for Usage {
    fn default() -> Self {
        Self { anchor: true, co_alignment: CoAlignment::None, tell_sun: true, threads: 0, coarser_scales: 0 }
    }
}

impl Method {
    /// Makes a method from a network file.
    ///
    /// # Errors
    /// If the file cannot be read, or the name cannot be part of a file name.
    pub fn network(name: &str, path: &Path, usage: Usage) -> Result<Self> {
        check(name)?;
        let model = open_any(path, Backend::Flex)?;
        Ok(Self { name: name.into(), description: model.description(), source: DtmSource::Network { model, usage } })
    }

    /// Makes the baseline of all learning: the pipeline with a network that corrects nothing ([`Untrained`]).
    #[must_use]
    pub fn untrained(usage: Usage) -> Self {
        let source = DtmSource::Network { model: Box::new(Untrained), usage };
        Self { name: UNTRAINED.into(), description: Untrained::DESCRIPTION.into(), source }
    }

    /// Makes a bound for linear methods. Of the usage, only the anchor counts.
    #[must_use]
    pub fn linear(teacher: Teacher, usage: Usage) -> Self {
        let (name, truths) = match teacher {
            Teacher::OtherGrounds => (LINEAR_BOUND, "the truths of other grounds under the same Sun"),
            Teacher::OwnTruth => (LINEAR_OWN, "the scene's own truth"),
        };
        let description = format!("best linear filter of contrast and coarse DTM, from {truths}: a bound");
        Self { name: name.into(), description, source: DtmSource::Linear(teacher, usage) }
    }

    /// Makes a method from DTMs of another program, files `SCENE.tif` or `SCENE_dtm.tif`.
    ///
    /// # Errors
    /// If the folder does not exist, or the name cannot be part of a file name.
    pub fn folder(name: &str, path: &Path) -> Result<Self> {
        check(name)?;
        if !path.is_dir() {
            return Err(Error::input(format!("{}: expected a folder of DTMs, found none", path.display())));
        }
        let description = format!("DTMs of {}", path.display());
        Ok(Self { name: name.into(), description, source: DtmSource::Folder(path.into()) })
    }

    /// Returns the DTM of a scene on the truth's grid, and the seconds of its prediction.
    ///
    /// # Errors
    /// If predicting or reading fails, or the folder lacks the scene.
    pub fn dtm(&self, scene: &TestScene) -> Result<(Raster, Option<f64>)> {
        let truth_name = format!("{}: truth", scene.entry.name);
        let truth = Named::new(&truth_name, &scene.truth);
        match &self.source {
            DtmSource::Folder(folder) => {
                let path = ["", "_dtm"].map(|end| folder.join(format!("{}{end}.tif", scene.entry.name)));
                let path = path.iter().find(|path| path.exists()).ok_or_else(|| {
                    Error::input(format!("{}: expected {}, found no such file", self.name, path[0].display()))
                })?;
                let dtm = heights::read(path)?;
                Ok((onto(Named::new(&path.display().to_string(), &dtm), truth, Interpolation::Bilinear)?, None))
            }
            DtmSource::Linear(teacher, usage) => {
                let dtm = linear::dtm(scene, *teacher, usage.anchor)?;
                Ok((onto(Named::new(&self.name, &dtm), truth, Interpolation::Bilinear)?, None))
            }
            DtmSource::Network { model, usage } => {
                let overlap_px = PredictOptions::overlap_for(model.tile());
                let (azimuth_deg, elevation_deg) = if usage.tell_sun { scene.sun_deg } else { (None, None) };
                let sun = KnownSun { azimuth_deg, elevation_deg };
                let Usage { anchor, threads, coarser_scales, .. } = *usage;
                let options = PredictOptions { overlap_px, anchor, threads, sun, ..PredictOptions::default() };
                let start = Instant::now();
                let progress =
                    |_, _| if interrupt::requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
                let at = |scene: &Scene| predict(scene, model.as_ref(), &options, &mut { progress });
                let aligned = |dtm: Raster, scene: &Scene, coarse_m: f64| match usage.co_alignment {
                    CoAlignment::None => Ok(dtm),
                    how => {
                        let pixel_m = f64::from(scene.pixel_m);
                        let image_m = dtm.pixel_m().unwrap_or((pixel_m, pixel_m));
                        how.apply(&dtm, &scene.coarse_raster()?, image_m, coarse_m)
                    }
                };
                let Prediction { dtm, tally } = if coarser_scales == 0 {
                    at(&scene.input)?
                } else {
                    let pair =
                        ImageAndCoarse { name: &scene.entry.name, image: &scene.raw_image, coarse: &scene.coarse };
                    let mut predict = |scene: &Scene| {
                        let coarse_m = f64::from(scene.coarse_px * scene.pixel_m);
                        aligned(at(scene)?.dtm, scene, coarse_m)
                    };
                    at(&pair.refined(coarser_scales, &mut predict)?)?
                };
                if tally.light.source == LightSource::Assumed {
                    let (method, name) = (&self.name, &scene.entry.name);
                    elunar_base::say::note(&format!(
                        "{name}, {method}: the light is assumed, as neither the Sun is known nor the scene shows it"
                    ));
                }
                let seconds = start.elapsed().as_secs_f64();
                let aligned = aligned(dtm, &scene.input, scene.coarse_m)?;
                Ok((onto(Named::new(&self.name, &aligned), truth, Interpolation::Bilinear)?, Some(seconds)))
            }
        }
    }

    /// Returns the description of the method for the results.
    #[must_use]
    pub fn info(&self) -> MethodInfo {
        let (anchor, co_alignment, sun_told) = match &self.source {
            DtmSource::Network { usage, .. } => (usage.anchor, usage.co_alignment, usage.tell_sun),
            DtmSource::Linear(_, usage) => (usage.anchor, CoAlignment::None, true),
            DtmSource::Folder(_) => (false, CoAlignment::None, false),
        };
        let scales = match &self.source {
            DtmSource::Network { usage, .. } => usage.coarser_scales,
            _ => 0,
        };
        let description = match scales {
            0 => self.description.clone(),
            _ => format!("{}, from pixels {} times as wide to fine", self.description, 1u32 << scales),
        };
        MethodInfo { name: self.name.clone(), description, anchor, co_alignment, sun_told }
    }
}

fn check(name: &str) -> Result<()> {
    if is_plain(name) {
        return Ok(());
    }
    Err(Error::input(format!("method {name:?}: expected a name of letters, digits, '-', '_' and '.'")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::suite::list::{SuiteScene, SynthEntry};
    use elunar_learn::model::init::initial_weights;
    use elunar_net::config::{Preset, trained_network};
    use elunar_synth::SynthOptions;

    /// The baseline is exactly what a network of the `nano` preset gives before its first step.
    #[test]
    fn the_untrained_row_is_an_untrained_network() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("w.safetensors");
        initial_weights(&trained_network(Preset::Nano), 3).write(&path).unwrap();
        let options = SynthOptions { rows: 256, cols: 330, ..SynthOptions::default() };
        let synth = Some(SynthEntry { seed: 500_001, index: 0, options });
        let scene = TestScene::make(&SuiteScene { synth, ..SuiteScene::named("a".into()) }).unwrap();
        let coarse = scene.input.coarse_raster().unwrap();
        for usage in [Usage::default(), Usage { tell_sun: false, anchor: false, ..Usage::default() }] {
            let (expected, _) = Method::network("net", &path, usage).unwrap().dtm(&scene).unwrap();
            let (found, seconds) = Method::untrained(usage).dtm(&scene).unwrap();
            assert!(found.samples == expected.samples && seconds.is_some());
            assert!(found.samples != coarse.samples, "photoclinometry adds nothing");
        }
    }
}
