//! One tile from samples to heights: the order of all steps, for every caller.
//!
//! ```text
//! prepare   take samples, fit the light, fill voids, make the maps of the guide, load them into the network
//! run       the network; then, twice, heights in metres, anchored to the coarse DTM, weighed, settled on it
//! ```
//!
//! A [`TileJob`] is plain numbers. The caller lends memory ([`TileMemory`]) and a [`Network`], and says with every call how much work may be
//! done: so the ground's threads, a strip and flight software between two duties make the same heights of the same samples, bit for bit.
//!
//! ```
//! use elunar_core::job::{Made, TileInput, TileJob, TileMemory, TileRules};
//! use elunar_core::nn::{KnownSun, Model, Progress, Runner, TileLight, required};
//!
//! # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../host-train/models/nano.eld");
//! # let model_file = std::fs::read(path)?;
//! let model = Model::new(&model_file)?;
//! let (shape, rules) = (model.tile(), model.input_rules());
//! // In flight these are arrays of the flight software.
//! let (mut arena, mut coarse) = (vec![0; required(&model)], vec![0.0; shape.pixels()]);
//! let mut valid = vec![0; TileMemory::valid_len(shape)];
//! let mut scratch = vec![0.0; TileMemory::scratch_len(&rules, shape)];
//! let mut lines = vec![0.0; TileMemory::lines_len(shape)];
//! let mut memory = TileMemory { coarse_m: &mut coarse, valid: &mut valid, scratch: &mut scratch, lines: &mut lines };
//!
//! // Rough ground, and a coarse DTM that rises to the east.
//! let image: Vec<f32> = (0..shape.pixels()).map(|i| 100.0 + (i * 7919 % 31) as f32).collect();
//! let coarse_m: Vec<f32> = (0..shape.pixels()).map(|i| -1900.0 + 0.1 * (i % shape.cols) as f32).collect();
//! let sun = KnownSun { azimuth_deg: Some(315.0), elevation_deg: Some(35.0) };
//! let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: shape, light: TileLight::Own(sun) };
//!
//! let mut runner = Runner::new(model, &mut arena)?;
//! let mut job = TileJob::new(TileRules { pixel_m: 2.0, coarse_px: 30.0, anchor: true, checked: false }, rules, shape);
//! while job.prepare(&mut runner, &tile, &mut memory, 5_000_000)? == Progress::Running {}
//! while job.run(&mut runner, &mut memory, 5_000_000)? == Progress::Running {}
//! assert_eq!(job.made(), Some(Made::Predicted));
//! assert!(job.heights_m(&memory).iter().all(|z| (-1950.0..-1800.0).contains(z)));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod error;
mod finish;
mod guard;
mod memory;
mod network;
mod prepare;
mod scale;
mod survey;
mod words;

pub use error::JobError;
pub use guard::TilePart;
pub use memory::TileMemory;
pub use network::{InputMap, Network};
pub use scale::TileScale;
pub use survey::LightSurvey;

use crate::error::same_length;
use crate::fill::Fill;
use crate::mask::{Extent, Mean};
use crate::nn::{InputRules, Lighting, Progress, TileLight};
use crate::norm::shading::Brightness;
use crate::norm::{ElevationScale, FineWaves, LightFit, Mirror};
use crate::part::head;
use crate::photoclinometry::{ExpectedErrors, FieldWork, GuideForm};
use crate::samples::{Samples, set};
use crate::tile::Shape;

/// How heights are made, the same for all tiles of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TileRules {
    /// Ground size of a pixel, metres.
    pub pixel_m: f32,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub coarse_px: f32,
    /// Whether the long waves are drawn to the coarse DTM's ([`crate::norm::Anchor`]), and of the short ones is kept what the image shows
    /// ([`FineWaves`]; our choice). Otherwise they are the network's (the paper).
    pub anchor: bool,
    /// Whether the processor may err: the network's products are compared with sums found in a second way ([`Runner::check_products`]), and the
    /// heights are made from its output twice.
    ///
    /// [`Runner::check_products`]: crate::nn::Runner::check_products
    pub checked: bool,
}

/// A tile in physical units; maps are row-major rows * cols of the network's tile.
#[derive(Debug, Clone, Copy)]
pub struct TileInput<S, C> {
    /// Relative brightness.
    pub image: S,
    /// Coarse DTM on the image's grid, metres above the sphere.
    pub coarse_m: C,
    /// Rows and columns of the tile that belong to the scene, from its first corner on. Beyond them samples repeat those of the scene, and no height
    /// is valid.
    pub inside: Shape,
    /// The light, which relates brightness to slope. Networks that know any light do not use it.
    pub light: TileLight,
}

/// How a tile was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Made {
    /// By the network.
    Predicted,
    /// The image has no contrast or the coarse DTM has no relief: a network cannot use such a tile, so its heights are those of the coarse DTM.
    Coarse,
    /// No pixel is valid: there are no heights.
    Empty,
}

/// A part of the work, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd)]
enum Pass {
    Take,
    /// The fit of the light, to samples that are not filled, as that of a scene.
    FitMeasure,
    FitLit,
    Fit,
    Axis,
    FillCoarse,
    FillImage,
    Measure,
    Lit,
    Decide,
    Weigh,
    Relief,
    LoadImage,
    LoadCoarse,
    /// Prepared: the network works.
    Network,
    Output,
    Check,
    Anchor,
    Fine,
    Settle,
    /// Prepared: the coarse heights are kept.
    Keep,
    Finished,
}

/// A tile in progress, or finished. See [the module](self).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TileJob {
    rules: TileRules,
    input: InputRules,
    tile: Shape,
    pass: Pass,
    unit: u32,
    made: Made,
    valid_px: usize,
    has_gaps: bool,
    has_image_gaps: bool,
    fill: Fill,
    coarse: Extent,
    coarse_mean: Mean,
    brightness: Brightness,
    fit: LightFit,
    field: FieldWork,
    lighting: Lighting,
    elevation: Option<ElevationScale>,
    form: Option<GuideForm>,
    expected: Option<ExpectedErrors>,
    fine: FineWaves,
    seals: guard::Seals,
    /// Checksum of the heights of the first of two rounds after the network.
    first_round: Option<u32>,
}

impl TileJob {
    /// Makes a job for a tile of this shape, of which nothing is known yet, and for a network with these rules.
    #[must_use]
    pub fn new(rules: TileRules, input: InputRules, tile: Shape) -> Self {
        Self {
            rules,
            input,
            tile,
            pass: Pass::Take,
            unit: 0,
            made: Made::Predicted,
            valid_px: 0,
            has_gaps: false,
            has_image_gaps: false,
            fill: Fill::default(),
            coarse: Extent::NONE,
            coarse_mean: Mean::default(),
            brightness: Brightness::NONE,
            fit: LightFit::default(),
            field: FieldWork::default(),
            lighting: Lighting::NOT_ASKED,
            elevation: None,
            form: None,
            expected: None,
            fine: FineWaves::WHOLE,
            seals: guard::Seals::default(),
            first_round: None,
        }
    }

    /// Prepares a tile: takes its samples, fits its light, fills voids, normalises it as in the network's training and loads it. Does at least
    /// one unit of work, and further ones until their cost, about that of so many multiply-accumulates, reaches `budget`. `tile` and `memory`
    /// are the same in all calls: each call compares the memory with its checksums, and notes them anew.
    ///
    /// # Errors
    /// [`JobError`]; then the job is over.
    pub fn prepare<N: Network, S: Samples, C: Samples>(
        &mut self,
        network: &mut N,
        tile: &TileInput<S, C>,
        memory: &mut TileMemory<'_>,
        budget: u64,
    ) -> Result<Progress, JobError<N::Fault>> {
        memory.check(&self.input, self.tile).map_err(JobError::Length)?;
        for found in [tile.image.len(), tile.coarse_m.len()] {
            same_length(self.tile.pixels(), found).map_err(JobError::Length)?;
        }
        self.guarded(memory, budget.max(1), |job, memory, mut spent| {
            while !job.is_prepared() && spent < budget.max(1) {
                spent += job.prepare_unit(network, tile, memory)?;
            }
            Ok(if job.is_prepared() { Progress::Done } else { Progress::Running })
        })
    }

    /// Makes the heights of a prepared tile, as much of the work as `budget` allows (see [`Self::prepare`]); all with
    /// `u64::MAX`.
    ///
    /// # Errors
    /// [`JobError`]; then the job is over.
    pub fn run<N: Network>(
        &mut self,
        network: &mut N,
        memory: &mut TileMemory<'_>,
        budget: u64,
    ) -> Result<Progress, JobError<N::Fault>> {
        memory.check(&self.input, self.tile).map_err(JobError::Length)?;
        if !self.is_prepared() {
            return Err(JobError::State);
        }
        if self.pass == Pass::Network {
            if network.step(budget).map_err(JobError::Network)? == Progress::Done {
                self.to(Pass::Output);
            }
            if budget < u64::MAX || self.pass == Pass::Network {
                return Ok(Progress::Running);
            }
        }
        self.guarded(memory, budget.max(1), |job, memory, mut spent| {
            while job.pass != Pass::Finished && spent < budget.max(1) {
                spent += job.finish_unit(network, memory)?;
            }
            Ok(if job.pass == Pass::Finished { Progress::Done } else { Progress::Running })
        })
    }

    /// Returns whether the samples of the tile are not needed any more.
    #[must_use]
    pub fn is_prepared(&self) -> bool {
        self.pass as u8 >= Pass::Network as u8
    }

    /// Returns whether the tile is prepared and its network not done.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.pass == Pass::Network
    }

    /// Returns whether the coarse DTM's samples are still being taken.
    pub(crate) fn takes_samples(&self) -> bool {
        self.pass == Pass::Take
    }

    /// Returns how the tile was made, once it is prepared.
    #[must_use]
    pub fn made(&self) -> Option<Made> {
        self.is_prepared().then_some(self.made)
    }

    /// Returns the heights of a finished tile, metres above the sphere, row-major; nothing before, or if it is empty. Heights of pixels that are
    /// not valid ([`Self::valid`]) are those of filled voids.
    #[must_use]
    pub fn heights_m<'m>(&self, memory: &'m TileMemory<'_>) -> &'m [f32] {
        match (self.pass, self.made) {
            (Pass::Finished, Made::Predicted | Made::Coarse) => head(memory.scratch, self.tile.pixels()),
            _ => &[],
        }
    }

    /// Returns the bits of valid heights, once the tile is prepared ([`crate::samples::is_set`]).
    #[must_use]
    pub fn valid<'m>(&self, memory: &'m TileMemory<'_>) -> &'m [u8] {
        memory.valid
    }

    /// Number of valid heights, once the tile is prepared.
    #[must_use]
    pub fn valid_px(&self) -> usize {
        self.valid_px
    }

    /// Returns the light that the tile was prepared with. [`crate::nn::LightSource::Assumed`] should be reported to the user of the heights.
    #[must_use]
    pub fn lighting(&self) -> Lighting {
        self.lighting
    }

    /// Returns the errors that heights and slopes are expected to have, once the tile is finished; `None` unless the network's maps are weighed.
    #[must_use]
    pub fn expected(&self) -> Option<ExpectedErrors> {
        self.expected
    }

    /// Writes a bit for every pixel, 1 where it is dark ([`ExpectedErrors::is_dark`]), once the tile is prepared: without the image, this is
    /// what remains of it in the expected errors. `image` is that of the tile, `dark` as long as [`TileMemory::valid`].
    pub fn mark_dark(&self, image: impl Samples, dark: &mut [u8]) {
        dark.fill(0);
        let Some(expected) = self.expected.filter(|_| self.made() == Some(Made::Predicted)) else { return };
        for row in 0..self.tile.rows {
            prepare::each(&image, row * self.tile.cols, self.tile.cols, |pixel, v| {
                if expected.is_dark(v) {
                    set(dark, pixel);
                }
            });
        }
    }

    /// Returns the way from the network's output to metres; `None` if the network does not run.
    #[must_use]
    pub fn scale(&self) -> Option<TileScale> {
        Some(TileScale { elevation: self.elevation?, mirror: self.mirror() })
    }

    fn mirror(&self) -> Mirror {
        self.lighting.mirror()
    }

    fn to(&mut self, pass: Pass) {
        (self.pass, self.unit) = (pass, 0);
    }

    /// Goes to the next unit of a pass that has `units`, or to the pass behind it.
    fn next(&mut self, units: usize, then: Pass) {
        self.unit += 1;
        if self.unit as usize >= units {
            self.to(then);
        }
    }

    /// Keeps the coarse heights.
    fn keep_coarse(&mut self) {
        self.made = Made::Coarse;
        self.to(Pass::Keep);
    }
}

#[cfg(test)]
pub(crate) mod tests;
