//! The tour: a demonstration of all functions of this program, on a scene that no network was trained on, with a report at the end.
//!
//! [`scene`] makes the scene. [`tune`] fine-tunes the network for its light and ground. [`shrink`] exports the int8 model. [`infer`]
//! predicts with both. [`compare`] compares them with the truth and with the coarse DTM. [`report`] writes the report. Each step does the
//! same as the command for this purpose. [`console`] prints and times them.

mod compare;
mod console;
mod folder;
mod infer;
mod report;
mod scene;
mod shrink;
mod tune;

use console::Console;
use elunar_base::{Error, Result, interrupt};
use elunar_learn::train::recipe::Recipe;
use elunar_net::config::{NetConfig, Preset, trained_network};
use folder::Folder;
use std::path::PathBuf;

/// The network that is shipped with this program.
pub const SHIPPED_MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/models/nano.safetensors");

/// Initial weights of the training.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "a tour has one of them")]
pub enum InitialWeights {
    /// Float weights with their configuration.
    Weights(PathBuf),
    /// Random weights of a network.
    Scratch(NetConfig),
}

/// Settings of the tour. Users get [`TourSettings::new`]; tests use smaller values.
#[derive(Debug, Clone, PartialEq)]
pub struct TourSettings {
    /// Folder to write into; created if absent.
    pub out: PathBuf,
    /// Initial weights of the training.
    pub start: InitialWeights,
    /// Seed of the tour. Each seed has another scene, other training tiles and other calibration tiles. Below [`TourSettings::SEEDS`].
    pub seed: u64,
    /// Rows and columns of the scene.
    pub scene_px: (usize, usize),
    /// Recipe of the training.
    pub recipe: Recipe,
    /// Number of tiles for measuring the ranges of the network's maps before quantisation.
    pub calibration_tiles: u64,
    /// Number of tiles for comparing int8 with float.
    pub comparison_tiles: u64,
    /// Number of threads of the prediction; 0 takes as many as the machine offers.
    pub threads: usize,
}

impl TourSettings {
    /// One more than the greatest seed of a tour.
    pub const SEEDS: u64 = 1_000_000_000;

    /// Number of steps of fine-tuning (our choice: they show what training does and takes, in some twenty seconds on two cores. The shipped
    /// network has learned from such ground, so that more of them gain little).
    pub const STEPS: usize = 24;
    /// Number of steps of training from random weights (our choice: as many as fit into the ten minutes of a tour).
    pub const SCRATCH_STEPS: usize = 300;

    /// Returns the settings that a user gets.
    #[must_use]
    pub fn new(out: PathBuf, start: InitialWeights, seed: u64, steps: Option<usize>) -> Self {
        let preset = Recipe::preset(Preset::Nano);
        let (usual, learning_rate) = match start {
            // A thirtieth of the preset's learning rate, because the network is already trained (our choice).
            InitialWeights::Weights(_) => (Self::STEPS, preset.learning_rate / 30.0),
            InitialWeights::Scratch(_) => (Self::SCRATCH_STEPS, preset.learning_rate),
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

    /// Returns the network that is trained from random weights.
    #[must_use]
    pub fn scratch() -> InitialWeights {
        InitialWeights::Scratch(trained_network(Preset::Nano))
    }
}

/// The Moons of a tour. Their seeds are far from the default seeds of `train` (small numbers, and
/// [`elunar_data::source::VALIDATION_SEED`] above them), so that no network was trained on them before.
#[derive(Debug, Clone, Copy)]
struct Seeds {
    scene: u64,
    training: u64,
    validation: u64,
    calibration: u64,
}

impl Seeds {
    fn of(seed: u64) -> Self {
        let moon = |number: u64| number * TourSettings::SEEDS + seed;
        Self { scene: moon(4), training: moon(5), validation: moon(6), calibration: moon(7) }
    }
}

/// Runs the tour. Returns the report's path. Files of an earlier tour in the folder are replaced; other files are not changed.
///
/// # Errors
/// [`Error::Usage`] if a setting is out of range, the user stopped the tour, or the folder holds a training run of another origin. Errors
/// of the steps are passed on.
pub fn run(settings: &TourSettings) -> Result<PathBuf> {
    if settings.seed >= TourSettings::SEEDS {
        let (limit, found) = (TourSettings::SEEDS, settings.seed);
        return Err(Error::usage(format!("seed: expected a number below {limit}, found {found}")));
    }
    settings.recipe.check().map_err(Error::usage)?;
    interrupt::listen();
    let weights = tune::start(settings)?;
    let folder = Folder::open(&settings.out, &settings.start)?;
    let seeds = Seeds::of(settings.seed);
    let mut console = Console::new(6);
    println!("ELunarDTM: one orbiter image and a coarse DTM become a DTM at the image's resolution.");
    println!("All terrain here is synthetic. Ctrl-C stops the tour; {} is what it writes.\n", folder.show());
    let scene =
        console.step("A scene that was not trained on", || scene::make(&folder, seeds.scene, settings.scene_px))?;
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
