//! A built-in tile from samples to heights, as `predict` makes the tiles of a scene: for measurements.

use super::network::TileModel;
use super::tile::Loaded;
use elunar_base::{Error, Result};
use elunar_core::job::{JobError, Made, TileInput, TileJob, TileRules};
use elunar_core::nn::{InputRules, Lighting, Progress, TileLight};
use elunar_core::norm::light::Light;
use elunar_core::tile::Shape;
use elunar_net::job::JobMemory;

/// Ground size of a pixel of the tile, metres; side of a coarse DTM's pixel, pixels.
const RULES: TileRules = TileRules { pixel_m: 2.0, coarse_px: 30.0, anchor: true, checked: false };
/// Azimuth and elevation of the Sun, degrees.
const SUN_DEG: (f64, f64) = (315.0, 35.0);

/// The tile, with the memory to make it.
pub struct WholeTile<'a> {
    network: Loaded<'a>,
    input: InputRules,
    shape: Shape,
    image: Vec<f32>,
    coarse_m: Vec<f32>,
    memory: JobMemory,
}

impl<'a> WholeTile<'a> {
    /// Makes the samples: waves of ground of 11 to 97 pixels under a Sun in the north-west.
    ///
    /// # Errors
    /// If the network cannot be loaded.
    pub fn new(model: &'a dyn TileModel) -> Result<Self> {
        let (shape, input) = (model.tile(), model.input_rules());
        let place = |i: usize| ((i / shape.cols) as f32, (i % shape.cols) as f32);
        // Wave number, as radians per pixel, and amplitude, metres.
        let waves = [(0.065f32, 9.0f32), (0.21, 3.0), (0.57, 0.5)];
        let rise = |(row, col): (f32, f32)| {
            waves
                .iter()
                .map(|(k, a)| a * k * ((k * (row + 2.0 * col)).cos() + (k * (row + 2.0 * col)).sin()))
                .sum::<f32>()
        };
        let height =
            |(row, col): (f32, f32)| waves.iter().take(2).map(|(k, a)| a * (k * (row + 2.0 * col)).sin()).sum();
        let image = (0..shape.pixels()).map(|i| 100.0 + 20.0 * rise(place(i))).collect();
        let coarse_m = (0..shape.pixels()).map(|i| height(place(i))).collect();
        let network = Loaded::new(model.worker()?, &input, shape);
        Ok(Self { network, input, shape, image, coarse_m, memory: JobMemory::default() })
    }

    /// Makes the heights.
    ///
    /// # Errors
    /// If the network fails, or returns heights that no ground has.
    pub fn make(&mut self) -> Result<()> {
        let light = Light::from_sun(SUN_DEG.0, SUN_DEG.1).map_or(Lighting::NOT_ASKED, Lighting::given);
        let (image, coarse_m) = (&self.image[..], &self.coarse_m[..]);
        let tile = TileInput { image, coarse_m, inside: self.shape, light: TileLight::Scene(light) };
        let mut job = TileJob::new(RULES, self.input, self.shape);
        let mut memory = self.memory.lend(&self.input, self.shape);
        let fault = |error: JobError<Error>| match error {
            JobError::Network(error) => error,
            error => Error::input(error.to_string()),
        };
        while job.prepare(&mut self.network, &tile, &mut memory, u64::MAX).map_err(fault)? == Progress::Running {}
        while job.run(&mut self.network, &mut memory, u64::MAX).map_err(fault)? == Progress::Running {}
        match job.made() {
            Some(Made::Predicted) => Ok(()),
            made => Err(Error::input(format!("the built-in tile: heights of the network expected, {made:?} found"))),
        }
    }
}
