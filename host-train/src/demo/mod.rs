//! The tour: everything this program does, once, on a scene nobody trained on, with a report at the end.
//!
//! [`scene`] makes the scene, [`tune`] fine-tunes the network for its light and ground, [`shrink`] exports the int8 model,
//! [`infer`] predicts with both, [`compare`] compares them with the truth and with the coarse DTM, [`report`] writes it all down.
//! Each is what the command of the same purpose does; [`console`] announces and times them.

mod compare;
mod console;
mod folder;
mod infer;
mod report;
mod scene;
mod shrink;
mod tune;

use console::Console;
use elunar_learn::train::recipe::Recipe;
use elunar_net::config::{NetConfig, Preset, trained_network};
use elunar_raster::{Error, Result};
use elunar_scene::interrupt;
use folder::Folder;
use std::path::PathBuf;

/// The network that comes with this program.
pub const SHIPPED_MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/models/nano.safetensors");

/// What training starts from.
#[derive(Debug, Clone, PartialEq)]
pub enum Start {
    /// Float weights with their configuration.
    Weights(PathBuf),
    /// Random weights of a network.
    Scratch(NetConfig),
}

/// What the tour does. [`Settings::new`] is what a user gets; tests make it smaller.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Folder to write into; made if absent.
    pub out: PathBuf,
    /// What training starts from.
    pub start: Start,
    /// Number of the tour: another one has another scene, other training tiles and other calibration tiles. Below
    /// [`Settings::SEEDS`].
    pub seed: u64,
    /// Rows and columns of the scene.
    pub scene_px: (usize, usize),
    /// How the network is trained.
    pub recipe: Recipe,
    /// Tiles that measure the ranges of the network's maps before quantisation.
    pub calibration_tiles: u64,
    /// Tiles on which int8 is compared with float.
    pub comparison_tiles: u64,
    /// Threads of the prediction; 0 takes as many as the machine offers.
    pub threads: usize,
}

impl Settings {
    /// One more than the greatest seed of a tour.
    pub const SEEDS: u64 = 1_000_000_000;

    /// Steps of fine-tuning (our choice: one to two minutes on two cores).
    pub const STEPS: usize = 120;
    /// Steps of training from random weights (our choice: as many as the ten minutes of a tour allow).
    pub const SCRATCH_STEPS: usize = 300;

    /// The tour a user gets.
    #[must_use]
    pub fn new(out: PathBuf, start: Start, seed: u64, steps: Option<usize>) -> Self {
        let preset = Recipe::preset(Preset::Nano);
        let (usual, learning_rate) = match start {
            // A thirtieth of the preset's rate, for a network that is already good (our choice).
            Start::Weights(_) => (Self::STEPS, preset.learning_rate / 30.0),
            Start::Scratch(_) => (Self::SCRATCH_STEPS, preset.learning_rate),
        };
        let steps = steps.unwrap_or(usual);
        let recipe = Recipe {
            steps,
            learning_rate,
            warm_up: preset.warm_up.min(steps / 6),
            validate_every: steps.div_ceil(4).max(1),
            validation_tiles: 8,
            checkpoint_every: steps.max(1),
            ..preset
        };
        let scene_px = (512, 640);
        Self { out, start, seed, scene_px, recipe, calibration_tiles: 8, comparison_tiles: 2, threads: 2 }
    }

    /// The network that is trained from random weights.
    #[must_use]
    pub fn scratch() -> Start {
        Start::Scratch(trained_network(Preset::Nano))
    }
}

/// The Moons of a tour. Their seeds lie far from those `train` uses by default (small numbers, and
/// [`elunar_scene::data::source::VALIDATION_SEED`] above them), so that nothing in a tour has been trained on before it.
#[derive(Debug, Clone, Copy)]
struct Seeds {
    scene: u64,
    training: u64,
    validation: u64,
    calibration: u64,
}

impl Seeds {
    fn of(seed: u64) -> Self {
        let moon = |number: u64| number * Settings::SEEDS + seed;
        Self { scene: moon(4), training: moon(5), validation: moon(6), calibration: moon(7) }
    }
}

/// Runs the tour and returns the report's path. An earlier tour's files in the folder are replaced; other files are left alone.
///
/// # Errors
/// [`Error::Usage`] if a setting is out of range, the user stopped the tour, or the folder holds a training run that is not a
/// tour's; the errors of the steps.
pub fn run(settings: &Settings) -> Result<PathBuf> {
    if settings.seed >= Settings::SEEDS {
        let (limit, found) = (Settings::SEEDS, settings.seed);
        return Err(Error::usage(format!("seed: expected a number below {limit}, found {found}")));
    }
    settings.recipe.check().map_err(Error::usage)?;
    interrupt::listen();
    let weights = tune::start(settings)?;
    let folder = Folder::open(&settings.out)?;
    let seeds = Seeds::of(settings.seed);
    let mut console = Console::new(6);
    println!("ELunarDTM: one orbiter image and a coarse DTM become a DTM at the image's resolution.");
    println!("All terrain here is synthetic. Ctrl-C stops the tour; {} is what it writes.\n", folder.show());
    let scene = console.step("A scene nobody trained on", || scene::make(&folder, seeds.scene, settings.scene_px))?;
    let tuned = console.step(tune::title(settings), || tune::run(settings, &folder, seeds, &scene.about, weights))?;
    let shrunk = console.step("From float to int8", || shrink::run(settings, &folder, seeds, &scene.about))?;
    let predicted = console.step("Predicting the scene", || infer::run(settings, &folder, &scene))?;
    let verdict = console.step("Against the truth", || compare::run(&folder, &scene, &predicted))?;
    let times = console.times().to_vec();
    let story = report::Story { settings, seeds, scene, tuned, shrunk, predicted, verdict, times };
    let report = console.step("The report", || report::write(&folder, &story))?;
    println!("Done in {}. Open {}", console::minutes(console.total_s()), report.display());
    Ok(report)
}
