//! One tile of a scene, by the job that flight software runs ([`elunar_core::job`]).

use super::PredictOptions;
use super::neighbourhoods::SceneLight;
use super::network::{TileModel, TileNetwork};
use super::scene::{Band, Scene};
use crate::mosaic::TileWeights;
use elunar_base::{Error, Result};
use elunar_core::job::{InputMap, JobError, Made, Network, TileInput, TileJob, TileRules};
use elunar_core::nn::{InputRules, Progress, TileLight};
use elunar_core::photoclinometry::{Errors, ExpectedErrors};
use elunar_core::samples::{Samples, is_set};
use elunar_core::tile::{Shape, Window};
use elunar_net::job::{InputMaps, JobMemory};

/// Result of a tile.
pub(crate) enum TileOutcome {
    /// Maps, and their weights in the mosaic.
    Predicted { maps: TileResult, weights: Vec<f64> },
    /// The image has no contrast or the coarse DTM has no relief here. The network cannot use such a tile, so the coarse heights are kept.
    Coarse { maps: TileResult, weights: Vec<f64> },
    /// No valid pixel.
    Empty,
}

/// The maps that a tile contributes to the scene: heights, metres; and if wanted the parts of [`Errors`].
pub(crate) struct TileResult(pub(crate) Vec<Vec<f32>>);

impl TileResult {
    /// Number of maps with expected errors.
    pub(crate) const LAYERS: usize = 5;

    /// Returns heights with their expected errors under an image; NaN where nothing is known.
    fn expecting(heights_m: Vec<f32>, image: impl Samples, errors: &ExpectedErrors) -> Self {
        let at = |part: fn(Errors) -> f32| (0..image.len()).map(|i| part(errors.at(image.at(i)))).collect();
        Self(vec![heights_m, at(|e| e.height_m), at(|e| e.slope), at(|e| e.explained), at(|e| e.dark)])
    }
}

impl From<Vec<f32>> for TileResult {
    fn from(heights_m: Vec<f32>) -> Self {
        Self(vec![heights_m])
    }
}

/// Settings that all tiles of a job share.
#[derive(Debug, Clone)]
pub(super) struct Rules {
    pub(super) input: InputRules,
    /// Rows and columns of the scene.
    pub(super) scene: Shape,
    /// The light of the scene.
    pub(super) light: SceneLight,
    /// How heights are made.
    pub(super) tile: TileRules,
    pub(super) expected_errors: bool,
    /// What messages call the model.
    pub(super) model: String,
}

impl Rules {
    /// Makes the rules for a model, a scene and its light.
    pub(super) fn new(model: &dyn TileModel, light: SceneLight, scene: &Scene, options: &PredictOptions) -> Self {
        let (input, model) = (model.input_rules(), model.description());
        let (pixel_m, coarse_px) = (scene.pixel_m, scene.coarse_px);
        Self {
            input,
            scene: Shape::new(scene.rows, scene.cols),
            light,
            tile: TileRules { pixel_m, coarse_px, anchor: options.anchor, checked: false },
            expected_errors: options.expected_errors,
            model,
        }
    }
}

/// A thread's network and its buffers.
pub(super) struct TileWorker<'a> {
    network: Loaded<'a>,
    rules: Rules,
    tile: Shape,
    memory: JobMemory,
    weights: TileWeights,
}

impl<'a> TileWorker<'a> {
    pub(super) fn new(network: Box<dyn TileNetwork + 'a>, tile: Shape, rules: Rules) -> Self {
        let weights = TileWeights::new(rules.scene);
        let network = Loaded::new(network, &rules.input, tile);
        Self { network, rules, tile, memory: JobMemory::default(), weights }
    }

    /// Predicts `window` of the scene. `band` holds the window's rows.
    ///
    /// # Errors
    /// If the network fails, or returns a height that is not finite or far outside the coarse heights.
    pub(super) fn run(&mut self, band: &Band, window: Window) -> Result<TileOutcome> {
        let Self { network, rules, tile: shape, memory, .. } = self;
        let [image, coarse_m] = band.tile(window);
        let light = TileLight::Scene(rules.light.of(window));
        let tile = TileInput { image, coarse_m, inside: band.inside(window), light };
        let mut job = TileJob::new(rules.tile, rules.input, *shape);
        let mut memory = memory.lend(&rules.input, *shape);
        let model = &rules.model;
        let fault = |error: JobError<Error>| match error {
            JobError::Network(error) => error,
            JobError::Height { found, low, high } => {
                let place = format!("in the tile at row {}, column {}", window.row, window.col);
                Error::input(format!("{model}: heights of {low} to {high} m expected {place}, {found} found"))
            }
            error => Error::input(error.to_string()),
        };
        while job.prepare(network, &tile, &mut memory, u64::MAX).map_err(fault)? == Progress::Running {}
        if job.made() == Some(Made::Empty) {
            return Ok(TileOutcome::Empty);
        }
        while job.run(network, &mut memory, u64::MAX).map_err(fault)? == Progress::Running {}
        let heights_m = job.heights_m(&memory).to_vec();
        let maps = if rules.expected_errors {
            let errors = job.expected().unwrap_or(ExpectedErrors::UNKNOWN);
            TileResult::expecting(heights_m, image, &errors)
        } else {
            heights_m.into()
        };
        let valid = job.valid(&memory);
        let mut weights = self.weights.of(window).to_vec();
        // Eight pixels have a byte; few tiles have voids.
        for (byte, weights) in valid.iter().zip(weights.chunks_mut(8)).filter(|(byte, _)| **byte != u8::MAX) {
            let of_byte = std::slice::from_ref(byte);
            weights.iter_mut().enumerate().filter(|(i, _)| !is_set(of_byte, *i)).for_each(|(_, weight)| *weight = 0.0);
        }
        Ok(match job.made() {
            Some(Made::Coarse) => TileOutcome::Coarse { maps, weights },
            _ => TileOutcome::Predicted { maps, weights },
        })
    }
}

/// A network with its input and output.
pub(super) struct Loaded<'a> {
    network: Box<dyn TileNetwork + 'a>,
    maps: InputMaps,
    output: Vec<f32>,
}

impl<'a> Loaded<'a> {
    pub(super) fn new(network: Box<dyn TileNetwork + 'a>, rules: &InputRules, tile: Shape) -> Self {
        Self { network, maps: InputMaps::new(rules, tile), output: vec![0.0; tile.pixels()] }
    }
}

impl Network for Loaded<'_> {
    type Fault = Error;

    fn begin(&mut self, _checked: bool) -> Result<()> {
        Ok(())
    }

    fn load_row(&mut self, map: InputMap, row: usize, samples: impl Fn(usize, &mut [f32])) -> Result<()> {
        self.maps.take(map, row, samples);
        Ok(())
    }

    fn start(&mut self) -> Result<()> {
        Ok(())
    }

    fn step(&mut self, _: u64) -> Result<Progress> {
        self.network.predict(&self.maps.image, &self.maps.coarse, &mut self.output)?;
        Ok(Progress::Done)
    }

    fn output(&self, out: &mut [f32]) -> Result<()> {
        out.copy_from_slice(&self.output);
        Ok(())
    }
}
