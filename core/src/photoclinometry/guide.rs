//! The input of a network with a given light: four or eight maps for the image, and the coarse DTM plus the relief.

use super::{Contrast, FieldWork, LitTile, Photoclinometry, Relief, Rows, Share, Task};
use crate::mask;
use crate::norm::NormError;
use crate::norm::shading::SLOPE_UNIT;
use crate::norm::{ElevationScale, Light, Mirror, Shading};
use crate::part::{head_mut, item, part};
use crate::samples::{Samples, read_mirrored};
use crate::tile::Shape;
use crate::words::Words;

/// Number of maps for the image: two components of slope, the relief, and its uncertainty.
pub const MAPS: usize = 4;
/// Number of maps for the image with slopes: [`MAPS`], two components of the slope of coarse DTM plus relief, and of the light's direction.
pub const SLOPED_MAPS: usize = 8;
/// Limit of all maps: slopes of 45 degrees, reliefs of ten pixels, and the light of a Sun near the zenith.
pub const LIMIT: f32 = 10.0;

/// The maps that a guide is made from; row-major.
#[derive(Debug, Clone, Copy)]
pub struct GuideInput<'t, S> {
    /// Relative brightness; voids are not real ([`mask`]).
    pub image: S,
    /// Coarse DTM on the image's grid, metres.
    pub coarse_m: &'t [f32],
    /// The mirroring of the maps, applied before all other steps.
    pub mirror: Mirror,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub coarse_px: f32,
    /// How much of the relief is kept.
    pub weight: Weight,
}

/// How much of the relief that the image shows is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Weight {
    /// All of it.
    Plain,
    /// This share, 0 to 1, which is the trust in the light; and of each octave what is relief ([`Share`]), in long waves no more than
    /// `long_share` ([`Share::limited`]).
    Trust {
        /// [`crate::norm::LightEstimate::trust`].
        trust: f32,
        /// [`crate::norm::LightEstimate::long_share`].
        long_share: Option<f32>,
    },
}

/// A tile's image and coarse DTM in the network's form, computed pixel by pixel.
///
/// ```
/// use elunar_core::norm::{ElevationScale, Light, Mirror};
/// use elunar_core::photoclinometry::{Guide, GuideInput, Photoclinometry, Weight};
/// use elunar_core::tile::Shape;
///
/// // A single row of bright pixels faces a Sun in the west, 40 degrees high.
/// let image: Vec<f32> = (0..32 * 32).map(|i| if i % 32 == 16 { 120.0 } else { 100.0 }).collect();
/// let coarse_m = vec![-1900.0; 32 * 32];
/// let scale = ElevationScale::from_pixel(&coarse_m, None, 2.0, 50.0)?;
/// let plan = Photoclinometry::new(Shape::new(32, 32));
/// let mut scratch = vec![0.0; plan.scratch_len()];
/// let light = Light::from_sun(270.0, 40.0).expect("above the horizon");
/// let tile = GuideInput { image: &image[..], coarse_m: &coarse_m, mirror: Mirror::default(), coarse_px: 30.0, weight: Weight::Plain };
/// let guide = Guide::new(&plan, tile, &scale, light, &mut scratch)?;
/// let (mut maps, mut coarse) = ([[0.0; 4]; 32], [0.0; 32]);
/// guide.image(16 * 32, &mut maps);
/// guide.coarse(16 * 32, &mut coarse);
/// // There the ground rises to the east, and so it is higher behind than before.
/// assert!(maps[16][0] > 1.0);
/// assert!(coarse[18] > coarse[14]);
/// # Ok::<(), elunar_core::norm::NormError>(())
/// ```
#[derive(Debug)]
pub struct Guide<'t, 's, S> {
    tile: GuideInput<'t, S>,
    form: GuideForm,
    /// Part of the slopes that is kept, and the uncertainty of the slope.
    kept: (f32, f32),
    relief: Relief<'s>,
}

/// What turns the samples of a tile into the maps of a guide, beside its relief: plain numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct GuideForm {
    pub(crate) scale: ElevationScale,
    pub(crate) shading: Shading,
    /// The light of the mirrored tile.
    pub(crate) light: Light,
    pub(crate) share: Share,
    pub(crate) weight: Weight,
}

impl GuideForm {
    /// The form of nothing, for words of an absent one.
    pub(crate) const NONE: Self = Self {
        scale: ElevationScale::NONE,
        shading: Shading::NONE,
        light: Contrast::ALONG_ROWS,
        share: Share::WHOLE,
        weight: Weight::Plain,
    };

    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        self.scale.visit(words);
        self.shading.visit(words);
        self.light.visit(words);
        self.share.visit(words);
        let mut weight = match self.weight {
            Weight::Plain => None,
            Weight::Trust { trust, long_share } => Some((trust, long_share)),
        };
        words.option(&mut weight, (0.0, None), |(trust, long_share), words| {
            words.f32(trust);
            words.option(long_share, 0.0, |v, words| words.f32(v));
        });
        self.weight = weight.map_or(Weight::Plain, |(trust, long_share)| Weight::Trust { trust, long_share });
    }

    /// Makes the form of a tile of which all contrast is relief.
    pub(crate) fn new(scale: ElevationScale, shading: Shading, light: Light, weight: Weight) -> Self {
        Self { scale, shading, light, share: Share::WHOLE, weight }
    }

    /// Returns whether the share of relief must be measured ([`Self::measured`]).
    pub(crate) fn is_weighed(&self) -> bool {
        matches!(self.weight, Weight::Trust { .. })
    }

    /// Returns the form with the share of relief in the contrast of its tile.
    pub(crate) fn measured(self, contrast: &Contrast, coarse_px: f32) -> Self {
        match self.weight {
            Weight::Plain => self,
            Weight::Trust { long_share, .. } => {
                Self { share: contrast.share(self.light).limited(long_share, coarse_px), ..self }
            }
        }
    }

    /// Returns the work that finds the relief.
    pub(crate) fn relief(&self) -> Task<'_> {
        let trust = match self.weight {
            Weight::Plain => 1.0,
            Weight::Trust { trust, .. } => trust,
        };
        Task::Relief { share: &self.share, trust }
    }

    /// Returns the part of the slopes that is kept, and the uncertainty: slopes as far as they are likely, and what they leave open.
    fn kept(&self) -> (f32, f32) {
        match self.weight {
            Weight::Plain => (1.0, 1.0 / self.light.strength()),
            Weight::Trust { trust, .. } => (trust * self.share.mean(), self.share.open_slope(trust) / SLOPE_UNIT),
        }
    }

    /// Returns a tile of this shape under its light.
    pub(crate) fn lit<'a, S: Samples>(
        &'a self,
        tile: &'a GuideInput<'_, S>,
        shape: Shape,
    ) -> LitTile<'a, impl Rows, impl Rows> {
        let brightness = move |row: usize, out: &mut [f32]| {
            read_mirrored(&tile.image, tile.mirror, row * shape.cols, shape, out);
            out.iter_mut().for_each(|v| *v = mask::real(*v));
        };
        let coarse = move |row: usize, out: &mut [f32]| {
            for (out, pixel) in out.iter_mut().zip(tile.mirror.sources(row * shape.cols, shape)) {
                *out = self.scale.normalised(item(tile.coarse_m, pixel));
            }
        };
        LitTile { brightness, coarse, shading: &self.shading, light: self.light, coarse_px: tile.coarse_px }
    }
}

impl<'t, 's, S: Samples> Guide<'t, 's, S> {
    /// Finds the relief of a tile of the plan's shape. `scale` counts heights in pixels ([`ElevationScale::from_pixel`]), `light` is that
    /// of the mirrored tile.
    ///
    /// # Errors
    /// [`NormError::Length`] if a map or `scratch` has a wrong length; those of [`Shading::new`].
    pub fn new(
        plan: &Photoclinometry,
        tile: GuideInput<'t, S>,
        scale: &ElevationScale,
        light: Light,
        scratch: &'s mut [f32],
    ) -> Result<Self, NormError> {
        for found in [tile.image.len(), tile.coarse_m.len()] {
            crate::error::same_length(plan.tile.pixels(), found)?;
        }
        let mut form = GuideForm::new(*scale, Shading::new(tile.image, light)?, light, tile.weight);
        if form.is_weighed() {
            let contrast = plan.contrast(&form.lit(&tile, plan.tile), scratch)?;
            form = form.measured(&contrast, tile.coarse_px);
        }
        let mut work = FieldWork::default();
        while plan.advance(&mut work, &form.relief(), &form.lit(&tile, plan.tile), scratch)?.is_some() {}
        Ok(Self::found(plan, tile, form, scratch))
    }

    /// Makes the guide of a tile whose relief is in `scratch`.
    pub(crate) fn found(plan: &Photoclinometry, tile: GuideInput<'t, S>, form: GuideForm, scratch: &'s [f32]) -> Self {
        Self { tile, form, kept: form.kept(), relief: plan.found(scratch) }
    }

    fn shape(&self) -> Shape {
        self.relief.tile
    }

    /// Returns the share of the contrast that is relief; all of it for [`Weight::Plain`].
    #[must_use]
    pub fn share(&self) -> &Share {
        &self.form.share
    }

    /// Returns the brightness below which a pixel is dark ([`Shading::dark_below`]).
    #[must_use]
    pub fn dark_below(&self) -> f32 {
        self.form.shading.dark_below()
    }

    /// Writes the image's maps at pixels of one row of the mirrored tile, from the row-major index `first` on: slopes east and south, relief,
    /// uncertainty. Their units are 0.1 of slope, a pixel of height, and slope per contrast; the uncertainty of weighed maps is the standard
    /// deviation of the slope that the image leaves open, in 0.1 of slope. Slopes are 0 where the image is invalid.
    pub fn image(&self, first: usize, out: &mut [[f32; MAPS]]) {
        const TOGETHER: usize = 16;
        let ((kept, uncertainty), shading) = (self.kept, &self.form.shading);
        for (out, first) in out.chunks_mut(TOGETHER).zip((first..).step_by(TOGETHER)) {
            let mut room = [0.0; TOGETHER];
            let image = head_mut(&mut room, out.len());
            read_mirrored(&self.tile.image, self.tile.mirror, first, self.shape(), image);
            for ((maps, &v), &relief) in out.iter_mut().zip(&*image).zip(self.relief.part(first, image.len())) {
                let [east, south] = if mask::is_real(v) { shading.slopes(v) } else { [0.0; 2] };
                *maps = [kept * east, kept * south, relief, uncertainty].map(|v| v.clamp(-LIMIT, LIMIT));
            }
        }
    }

    /// Writes the coarse DTM plus the relief at pixels of one row of the mirrored tile, from the row-major index `first` on, in pixels
    /// about its mean.
    pub fn coarse(&self, first: usize, out: &mut [f32]) {
        let cols = self.shape().cols.max(1);
        self.heights(first / cols, first % cols, out);
    }

    /// Writes the maps of [`Self::image`], then the slopes east and south of coarse DTM plus relief, in 0.1 of slope, and the direction of
    /// the light: a vector of length one. Ground that rises along it is bright.
    pub fn sloped_image(&self, first: usize, out: &mut [[f32; SLOPED_MAPS]]) {
        const TOGETHER: usize = 16;
        const WITH_SIDES: usize = TOGETHER + 2;
        let Shape { rows, cols } = self.shape();
        let (row, left) = (first / cols.max(1), first % cols.max(1));
        let last = |n: usize| n.saturating_sub(1);
        let (above, below) = (last(row), (row + 1).min(last(rows)));
        // Differences over two pixels; at the border over one.
        let unit = |from: usize, to: usize| 1.0 / (SLOPE_UNIT * to.saturating_sub(from).max(1) as f32);
        let down = unit(above, below);
        let [x, y] = Photoclinometry::direction(self.form.light);
        for (block, out) in out.chunks_mut(TOGETHER).enumerate() {
            let (mut maps, at, count) = ([[0.0; MAPS]; TOGETHER], left + block * TOGETHER, out.len());
            let maps = head_mut(&mut maps, count);
            self.image(row * cols + at, maps);
            let (mut higher, mut lower, mut beside) = ([0.0; TOGETHER], [0.0; TOGETHER], [0.0; WITH_SIDES]);
            self.heights(above, at, head_mut(&mut higher, count));
            self.heights(below, at, head_mut(&mut lower, count));
            // From the pixel before the first to that behind the last, within the row.
            let (from, to) = (last(at), (at + count + 1).min(cols));
            self.heights(row, from, head_mut(&mut beside, to.saturating_sub(from)));
            for (i, (out, &[a, b, c, d])) in out.iter_mut().zip(&*maps).enumerate() {
                let col = at + i;
                let (before, after) = (last(col), (col + 1).min(last(cols)));
                let east = (item(&beside, after - from) - item(&beside, before - from)) * unit(before, after);
                let south = (item(&lower, i) - item(&higher, i)) * down;
                *out = [a, b, c, d, east.clamp(-LIMIT, LIMIT), south.clamp(-LIMIT, LIMIT), x, y];
            }
        }
    }

    /// Writes coarse DTM plus relief at pixels of a row of the mirrored tile, in pixels about its mean.
    fn heights(&self, row: usize, col: usize, out: &mut [f32]) {
        let (shape, mirror, scale) = (self.shape(), self.tile.mirror, &self.form.scale);
        let (index, len) = (row * shape.cols + col, out.len());
        let (source, relief) = (mirror.source(index, shape), self.relief.part(index, len));
        if mirror.cols {
            let coarse_m = part(self.tile.coarse_m, source.saturating_sub(len.saturating_sub(1)), len);
            for ((out, z), relief) in out.iter_mut().zip(coarse_m.iter().rev()).zip(relief) {
                *out = scale.normalised(*z) + relief;
            }
        } else {
            for ((out, z), relief) in out.iter_mut().zip(part(self.tile.coarse_m, source, len)).zip(relief) {
                *out = scale.normalised(*z) + relief;
            }
        }
    }

    /// Writes all maps of [`Self::image`], side by side in every pixel, and the coarse DTM plus the relief.
    ///
    /// # Errors
    /// [`NormError::Length`] if a buffer has another length.
    pub fn fill(&self, image: &mut [f32], coarse: &mut [f32]) -> Result<(), NormError> {
        self.fill_with(image, coarse, Self::image)
    }

    /// Writes all maps of [`Self::sloped_image`], side by side in every pixel, and the coarse DTM plus the relief.
    ///
    /// # Errors
    /// [`NormError::Length`] if a buffer has another length.
    pub fn fill_sloped(&self, image: &mut [f32], coarse: &mut [f32]) -> Result<(), NormError> {
        self.fill_with(image, coarse, Self::sloped_image)
    }

    fn fill_with<const N: usize>(
        &self,
        image: &mut [f32],
        coarse: &mut [f32],
        write: impl Fn(&Self, usize, &mut [[f32; N]]),
    ) -> Result<(), NormError> {
        crate::error::same_length(self.tile.image.len(), coarse.len())?;
        crate::error::same_length(N * coarse.len(), image.len())?;
        let cols = self.shape().cols.max(1);
        let lines = image.as_chunks_mut::<N>().0.chunks_mut(cols).zip(coarse.chunks_mut(cols));
        for (row, (maps, heights)) in lines.enumerate() {
            write(self, row * cols, maps);
            self.coarse(row * cols, heights);
        }
        Ok(())
    }
}
