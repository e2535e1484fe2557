//! The units of work before the network.

use super::error::nothing_to_see;
use super::{InputMap, JobError, Made, Network, Pass, TileInput, TileJob, TileMemory};
use crate::error::LengthError;
use crate::mask;
use crate::nn::{Illumination, KnownSun, LightSource, Lighting, QUANTISED, TileLight, TruthRange};
use crate::norm::intensity::IntensityRange;
use crate::norm::light_fit::FitPart;
use crate::norm::shading::Brightness;
use crate::norm::{ElevationScale, FineWaves, LightFit, NormError};
use crate::part::{head, head_mut, part, part_mut, put};
use crate::photoclinometry::{
    Contrast, ExpectedErrors, FieldWork, Guide, GuideForm, GuideInput, MAPS, Photoclinometry, SLOPED_MAPS, Task, Weight,
};
use crate::samples::{Masked, Samples, set};
use crate::terrain::PixelSize;

/// Number of samples that a unit of filling looks at.
const FILLED_TOGETHER: usize = 2048;
/// Number of samples that are taken together.
const TAKEN_TOGETHER: usize = 64;

impl TileJob {
    /// Does a unit of the preparation; returns its cost, about that of so many multiply-accumulates.
    pub(super) fn prepare_unit<N: Network, S: Samples, C: Samples>(
        &mut self,
        network: &mut N,
        tile: &TileInput<S, C>,
        memory: &mut TileMemory<'_>,
    ) -> Result<u64, JobError<N::Fault>> {
        match self.pass {
            Pass::Take => Ok(self.take(tile, memory)),
            Pass::FitMeasure | Pass::FitLit | Pass::Fit | Pass::Axis => {
                self.fit_unit(tile.image, memory).map_err(JobError::Length)
            }
            Pass::FillCoarse | Pass::FillImage => Ok(self.fill(memory)),
            _ if self.input.illumination.is_guided() => {
                let TileMemory { coarse_m, valid, scratch, .. } = memory;
                self.maps_unit(network, tile.light, Masked { samples: tile.image, bits: valid }, coarse_m, scratch)
            }
            _ => {
                // The image was copied, so that its voids could be filled.
                let TileMemory { coarse_m, scratch, .. } = memory;
                let (image, scratch) = scratch.split_at_mut_checked(self.tile.pixels()).unwrap_or_default();
                self.maps_unit(network, tile.light, &*image, coarse_m, scratch)
            }
        }
    }

    /// Takes a row of samples.
    pub(super) fn take<S: Samples, C: Samples>(&mut self, tile: &TileInput<S, C>, memory: &mut TileMemory<'_>) -> u64 {
        let (row, cols, copies) = (self.unit as usize, self.tile.cols, !self.input.illumination.is_guided());
        if row == 0 {
            memory.valid.fill(0);
        }
        let seen = if row < tile.inside.rows { tile.inside.cols } else { 0 };
        let mut room = [[0.0; TAKEN_TOGETHER]; 2];
        for from in (0..cols).step_by(TAKEN_TOGETHER) {
            let [image, coarse_m] = room.each_mut().map(|room| head_mut(room, TAKEN_TOGETHER.min(cols - from)));
            tile.image.read(row * cols + from, image);
            tile.coarse_m.read(row * cols + from, coarse_m);
            for (col, (v, z)) in (from..).zip(image.iter().zip(&*coarse_m)) {
                let (pixel, v, z) = (row * cols + col, mask::real(*v), mask::real(*z));
                put(memory.coarse_m, pixel, z);
                self.has_gaps |= z.is_nan();
                if copies {
                    put(memory.scratch, pixel, v);
                    self.has_image_gaps |= v.is_nan();
                }
                if col < seen && !v.is_nan() && !z.is_nan() {
                    set(memory.valid, pixel);
                    self.valid_px += 1;
                }
            }
        }
        self.next(self.tile.rows, Pass::FillCoarse);
        let wants_fit = !is_decided(tile.light) && Lighting::wants_fit(self.input.illumination, known(tile.light));
        if self.pass == Pass::FillCoarse && self.valid_px == 0 {
            self.made = Made::Empty;
            self.to(Pass::Finished);
        } else if self.pass == Pass::FillCoarse && wants_fit && self.made != Made::Coarse {
            self.to(Pass::FitMeasure);
        }
        (80 + tile.coarse_m.work()) * cols as u64
    }

    /// Fills voids of the coarse heights, then of the image's copy.
    fn fill(&mut self, memory: &mut TileMemory<'_>) -> u64 {
        let (pixels, cols) = (self.tile.pixels(), self.tile.cols);
        let (first, rest) = memory.scratch.split_at_mut_checked(pixels).unwrap_or_default();
        let queue = part_mut(rest, 0, pixels);
        let (has_gaps, map) = match self.pass {
            Pass::FillCoarse => (self.has_gaps, part_mut(memory.coarse_m, 0, pixels)),
            _ => (self.has_image_gaps, first),
        };
        if !has_gaps || self.fill.advance(map, cols, queue, FILLED_TOGETHER) {
            self.fill = Default::default();
            match (self.pass, self.made) {
                (Pass::FillCoarse, _) => self.to(Pass::FillImage),
                (_, Made::Coarse) => self.keep_coarse(),
                _ => self.to(Pass::Measure),
            }
        }
        if has_gaps { 24 * FILLED_TOGETHER as u64 } else { 1 }
    }

    /// Finds light and maps of an image, and loads them.
    fn maps_unit<N: Network, S: Samples>(
        &mut self,
        network: &mut N,
        light: TileLight,
        image: S,
        coarse_m: &[f32],
        scratch: &mut [f32],
    ) -> Result<u64, JobError<N::Fault>> {
        let seen = match self.pass {
            Pass::Measure => self.measure(image, coarse_m),
            Pass::Lit => Ok(self.measure_lit(image, Pass::Decide)),
            Pass::Decide => self.decide(light),
            Pass::Weigh | Pass::Relief => self.guide(image, coarse_m, scratch),
            _ => return self.load(network, image, coarse_m, scratch).map_err(JobError::Network),
        };
        match seen {
            Err(error) if nothing_to_see(&error) => {
                self.keep_coarse();
                Ok(1)
            }
            Err(NormError::Length(error)) => Err(JobError::Length(error)),
            seen => seen.map_err(JobError::Rules),
        }
    }

    /// Measures heights and brightness of a row.
    fn measure(&mut self, image: impl Samples, coarse_m: &[f32]) -> Result<u64, NormError> {
        let cols = self.tile.cols;
        let first = self.unit as usize * cols;
        for z in part(coarse_m, first, cols) {
            self.coarse.add(*z);
            self.coarse_mean.add(*z, f32::NEG_INFINITY);
        }
        each(&image, first, cols, |_, v| self.brightness.add(v));
        self.next(self.tile.rows, Pass::Lit);
        if self.pass == Pass::Lit {
            self.elevation = Some(match self.input.truth_range {
                TruthRange::Pixel => ElevationScale::of_mean(self.coarse_mean, self.rules.pixel_m, self.input.nr)?,
                TruthRange::Own | TruthRange::Reference => {
                    ElevationScale::of_extent(self.coarse, self.input.nr)?.with_margin(self.input.range_margin)?
                }
            });
        }
        Ok(80 * cols as u64)
    }

    /// Measures the brightness of a row's lit pixels.
    fn measure_lit(&mut self, image: impl Samples, then: Pass) -> u64 {
        let cols = self.tile.cols;
        let (first, dark_below) = (self.unit as usize * cols, self.brightness.dark_below());
        each(&image, first, cols, |_, v| self.brightness.lit.add(v, dark_below));
        self.next(self.tile.rows, then);
        60 * cols as u64
    }

    /// Fits the light to samples that are not filled yet.
    pub(super) fn fit_unit(&mut self, image: impl Samples, memory: &mut TileMemory<'_>) -> Result<u64, LengthError> {
        let cols = self.tile.cols;
        Ok(match self.pass {
            Pass::FitMeasure => {
                each(&image, self.unit as usize * cols, cols, |_, v| self.brightness.add(v));
                self.next(self.tile.rows, Pass::FitLit);
                60 * cols as u64
            }
            Pass::FitLit => self.measure_lit(image, Pass::Fit),
            Pass::Fit => self.fit(image, memory.coarse_m),
            _ => match self.axis(image, memory)? {
                Some(cost) => cost,
                None => {
                    self.fit = self.shown().fit();
                    self.end_fit();
                    1
                }
            },
        })
    }

    /// Fits the light to a column of squares of cells.
    fn fit(&mut self, image: impl Samples, coarse_m: &[f32]) -> u64 {
        let cell_px = LightFit::cell_px(self.rules.coarse_px);
        let pixel = PixelSize::square(f64::from(self.rules.pixel_m));
        let coarse_m = head(coarse_m, self.tile.pixels());
        let part = FitPart { image, coarse_m, cols: self.tile.cols, pixel, cell_px };
        let columns = part.columns();
        if columns > 0 {
            part.add_to(&mut self.fit, &self.brightness, self.unit as usize);
        }
        self.next(columns, Pass::Axis);
        (self.tile.rows * (6800 + 190 * cell_px)) as u64
    }

    /// Measures the contrast of the image alone, which shows the line along which the Sun shines; `None` if it is measured, or there is none.
    pub(super) fn axis(
        &mut self,
        image: impl Samples,
        memory: &mut TileMemory<'_>,
    ) -> Result<Option<u64>, LengthError> {
        // The copy of the image is in the first part, if there is one.
        let first = if self.input.illumination.is_guided() { 0 } else { self.tile.pixels() };
        let scratch = memory.scratch.get_mut(first..).unwrap_or_default();
        let plan = Photoclinometry::new(self.tile);
        // Darkness and sameness have no contrast. Only a guide has the memory for it.
        let shading =
            self.brightness.shading(Contrast::ALONG_ROWS).ok().filter(|_| scratch.len() >= plan.scratch_len());
        let Some(shading) = shading else { return Ok(None) };
        let level = Contrast::level(&image, self.tile, self.rules.coarse_px, &shading);
        plan.advance(&mut self.field, &Task::Contrast, &level, scratch)
    }

    /// Ends the fit.
    fn end_fit(&mut self) {
        (self.brightness, self.field) = (Brightness::NONE, FieldWork::default());
        self.to(Pass::FillCoarse);
    }

    /// Decides the light.
    fn decide(&mut self, light: TileLight) -> Result<u64, NormError> {
        self.lighting = match light {
            TileLight::Scene(lighting) if is_decided(light) => lighting,
            // Decided for a network that does not ask: no angle is known.
            _ => Lighting::decide(self.input.illumination, known(light), &self.fit),
        };
        let weight = match self.input.illumination {
            Illumination::Any | Illumination::Northwest => {
                self.lighting =
                    if self.input.illumination == Illumination::Any { Lighting::NOT_ASKED } else { self.lighting };
                IntensityRange::of_extent(self.brightness.extent)?;
                self.to(Pass::LoadImage);
                return Ok(1);
            }
            Illumination::Given => Weight::Plain,
            Illumination::Weighed | Illumination::Sloped => {
                Weight::Trust { trust: self.lighting.trust, long_share: self.lighting.long_share }
            }
        };
        let light = self.lighting.light.mirrored(self.mirror());
        let shading = self.brightness.shading(light)?;
        self.form = self.elevation.map(|scale| GuideForm::new(scale, shading, light, weight));
        self.to(Pass::Weigh);
        Ok(500)
    }

    /// Measures what share of the contrast is relief, and then finds the relief.
    fn guide(&mut self, image: impl Samples, coarse_m: &[f32], scratch: &mut [f32]) -> Result<u64, NormError> {
        let (plan, coarse_px) = (Photoclinometry::new(self.tile), self.rules.coarse_px);
        let Some(form) = self.form else { return Err(NormError::ConstantImage) };
        let tile = GuideInput { image, coarse_m, mirror: self.mirror(), coarse_px, weight: form.weight };
        if self.pass == Pass::Weigh && form.is_weighed() {
            let cost = plan.advance(&mut self.field, &Task::Contrast, &form.lit(&tile, self.tile), scratch)?;
            if let Some(cost) = cost {
                return Ok(cost);
            }
            let form = form.measured(&plan.measured(&self.field), coarse_px);
            if self.input.illumination.is_weighed() {
                let (light, dark_below) = (self.lighting.estimate(), form.shading.dark_below());
                let pixel_m = self.rules.pixel_m;
                self.expected = Some(ExpectedErrors::of_share(&form.share, &light, pixel_m, coarse_px, dark_below));
                self.fine = FineWaves::of_share(&form.share);
            }
            self.form = Some(form);
        }
        if self.pass == Pass::Weigh {
            self.field = FieldWork::default();
            self.to(Pass::Relief);
            return Ok(2000);
        }
        let cost = plan.advance(&mut self.field, &form.relief(), &form.lit(&tile, self.tile), scratch)?;
        if cost.is_none() {
            self.to(Pass::LoadImage);
        }
        Ok(cost.unwrap_or(1))
    }

    /// Loads a row of the network's input.
    fn load<N: Network>(
        &mut self,
        network: &mut N,
        image: impl Samples,
        coarse_m: &[f32],
        scratch: &[f32],
    ) -> Result<u64, N::Fault> {
        let (row, map) =
            (self.unit as usize, if self.pass == Pass::LoadImage { InputMap::Image } else { InputMap::Coarse });
        if (row, map) == (0, InputMap::Image) {
            network.begin(self.rules.checked)?;
        }
        if let Some(form) = self.form {
            let tile = GuideInput {
                image,
                coarse_m,
                mirror: self.mirror(),
                coarse_px: self.rules.coarse_px,
                weight: form.weight,
            };
            let guide = Guide::found(&Photoclinometry::new(self.tile), tile, form, scratch);
            match (map, self.input.illumination) {
                (InputMap::Coarse, _) => network.load_row(map, row, |first, out| guide.coarse(first, out))?,
                (_, Illumination::Sloped) => network.load_row(map, row, |first, out| {
                    guide.sloped_image(first / SLOPED_MAPS, out.as_chunks_mut::<SLOPED_MAPS>().0);
                })?,
                _ => network.load_row(map, row, |first, out| {
                    guide.image(first / MAPS, out.as_chunks_mut::<MAPS>().0);
                })?,
            }
        } else if let (Some(scale), Ok(range)) = (self.scale(), IntensityRange::of_extent(self.brightness.extent)) {
            let shape = self.tile;
            match map {
                InputMap::Coarse => network.load_row(map, row, |first, out| scale.row(coarse_m, first, shape, out))?,
                InputMap::Image => network.load_row(map, row, |first, out| {
                    for (v, pixel) in out.iter_mut().zip(scale.mirror.sources(first, shape)) {
                        let found = image.at(pixel);
                        *v = if mask::is_real(found) { range.normalised(found) } else { 0.0 };
                    }
                })?,
            }
        }
        let then = if map == InputMap::Image { Pass::LoadCoarse } else { Pass::Network };
        self.next(self.tile.rows, then);
        if self.pass == Pass::Network {
            network.start()?;
        }
        let samples = if map == InputMap::Image { self.input.illumination.image_maps() } else { 1 };
        Ok(QUANTISED * (samples * self.tile.cols) as u64)
    }
}

/// Calls `add` for samples of a row, with their indices.
pub(super) fn each(image: &impl Samples, first: usize, count: usize, mut add: impl FnMut(usize, f32)) {
    let mut room = [0.0; TAKEN_TOGETHER];
    for from in (0..count).step_by(TAKEN_TOGETHER) {
        let room = head_mut(&mut room, TAKEN_TOGETHER.min(count - from));
        (first + from..).zip(image.line(first + from, room)).for_each(|(index, v)| add(index, *v));
    }
}

/// Returns whether a light was decided before.
fn is_decided(light: TileLight) -> bool {
    matches!(light, TileLight::Scene(lighting) if lighting.source != LightSource::NotAsked)
}

/// Returns the known angles of a tile's own light.
fn known(light: TileLight) -> KnownSun {
    match light {
        TileLight::Own(sun) => sun,
        TileLight::Scene(_) => KnownSun::default(),
    }
}
