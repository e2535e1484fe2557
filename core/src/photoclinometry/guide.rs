//! The input of a network with a given light: four or eight maps for the image, and the coarse DTM plus the relief.

use super::{LitTile, Photoclinometry, Relief, Share};
use crate::mask;
use crate::norm::NormError;
use crate::norm::shading::SLOPE_UNIT;
use crate::norm::{ElevationScale, Light, Mirror, Shading};
use crate::part::{head_mut, item};
use crate::tile::Shape;

/// Number of maps for the image: two components of slope, the relief, and its uncertainty.
pub const MAPS: usize = 4;
/// Number of maps for the image with slopes: [`MAPS`], two components of the slope of coarse DTM plus relief, and of the light's direction.
pub const SLOPED_MAPS: usize = 8;
/// Limit of all maps: slopes of 45 degrees, reliefs of ten pixels, and the light of a Sun near the zenith.
pub const LIMIT: f32 = 10.0;

/// The maps that a guide is made from; row-major.
#[derive(Debug, Clone, Copy)]
pub struct GuideInput<'t> {
    /// Relative brightness.
    pub image: &'t [f32],
    /// Coarse DTM on the image's grid, metres.
    pub coarse_m: &'t [f32],
    /// Mask of pixels; a pixel must also be real (see [`mask`]) to be valid. `None`: no mask.
    pub valid: Option<&'t [bool]>,
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
/// let tile = GuideInput { image: &image, coarse_m: &coarse_m, valid: None, mirror: Mirror::default(), coarse_px: 30.0, weight: Weight::Plain };
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
pub struct Guide<'t, 's> {
    tile: GuideInput<'t>,
    shape: Shape,
    scale: ElevationScale,
    shading: Shading,
    direction: [f32; 2],
    kept: f32,
    uncertainty: f32,
    share: Share,
    relief: Relief<'s>,
}

impl<'t, 's> Guide<'t, 's> {
    /// Finds the relief of a tile of the plan's shape. `scale` counts heights in pixels ([`ElevationScale::from_pixel`]), `light` is that
    /// of the mirrored tile.
    ///
    /// # Errors
    /// [`NormError::Length`] if a map or `scratch` has a wrong length; those of [`Shading::new`].
    pub fn new(
        plan: &Photoclinometry,
        tile: GuideInput<'t>,
        scale: &ElevationScale,
        light: Light,
        scratch: &'s mut [f32],
    ) -> Result<Self, NormError> {
        let GuideInput { image, coarse_m, valid, mirror, coarse_px, weight } = tile;
        let expected = plan.tile.pixels();
        for found in [image.len(), coarse_m.len(), valid.map_or(expected, <[bool]>::len)] {
            crate::error::same_length(expected, found)?;
        }
        let shading = Shading::new(image, valid, light)?;
        let shape = plan.tile;
        let brightness = |row: usize, out: &mut [f32]| {
            for (out, pixel) in out.iter_mut().zip(mirror.sources(row * shape.cols, shape)) {
                *out = if mask::counts(image, valid, pixel) { item(image, pixel) } else { f32::NAN };
            }
        };
        let coarse = |row: usize, out: &mut [f32]| {
            for (out, pixel) in out.iter_mut().zip(mirror.sources(row * shape.cols, shape)) {
                *out = scale.normalised(item(coarse_m, pixel));
            }
        };
        let lit = LitTile { brightness, coarse, shading: &shading, light, coarse_px };
        let (share, trust) = match weight {
            Weight::Plain => (Share::WHOLE, 1.0),
            Weight::Trust { trust, long_share } => {
                let contrast = plan.contrast(&lit, scratch)?;
                (contrast.share(light).limited(long_share, coarse_px), trust)
            }
        };
        // Slopes as far as they are likely, and what they leave open.
        let (kept, uncertainty) = match weight {
            Weight::Plain => (1.0, 1.0 / light.strength()),
            Weight::Trust { trust, .. } => (trust * share.mean(), share.open_slope(trust) / SLOPE_UNIT),
        };
        let relief = plan.relief(&lit, &share, trust, scratch)?;
        let direction = Photoclinometry::direction(light);
        Ok(Self { tile, shape, scale: *scale, shading, direction, kept, uncertainty, share, relief })
    }

    /// Returns the share of the contrast that is relief; all of it for [`Weight::Plain`].
    #[must_use]
    pub fn share(&self) -> &Share {
        &self.share
    }

    /// Returns the brightness below which a pixel is dark ([`Shading::dark_below`]).
    #[must_use]
    pub fn dark_below(&self) -> f32 {
        self.shading.dark_below()
    }

    /// Writes the image's maps at pixels of one row of the mirrored tile, from the row-major index `first` on: slopes east and south, relief,
    /// uncertainty. Their units are 0.1 of slope, a pixel of height, and slope per contrast; the uncertainty of weighed maps is the standard
    /// deviation of the slope that the image leaves open, in 0.1 of slope. Slopes are 0 where the image is invalid.
    pub fn image(&self, first: usize, out: &mut [[f32; MAPS]]) {
        let GuideInput { image, valid, mirror, .. } = self.tile;
        let pixels = mirror.sources(first, self.shape).zip(self.relief.part(first, out.len()));
        for (maps, (pixel, &relief)) in out.iter_mut().zip(pixels) {
            let [east, south] =
                if mask::counts(image, valid, pixel) { self.shading.slopes(item(image, pixel)) } else { [0.0; 2] };
            *maps = [self.kept * east, self.kept * south, relief, self.uncertainty].map(|v| v.clamp(-LIMIT, LIMIT));
        }
    }

    /// Writes the coarse DTM plus the relief at pixels of one row of the mirrored tile, from the row-major index `first` on, in pixels
    /// about its mean.
    pub fn coarse(&self, first: usize, out: &mut [f32]) {
        let pixels = self.tile.mirror.sources(first, self.shape).zip(self.relief.part(first, out.len()));
        for (z, (pixel, relief)) in out.iter_mut().zip(pixels) {
            *z = self.scale.normalised(item(self.tile.coarse_m, pixel)) + relief;
        }
    }

    /// Writes the maps of [`Self::image`], then the slopes east and south of coarse DTM plus relief, in 0.1 of slope, and the direction of
    /// the light: a vector of length one. Ground that rises along it is bright.
    pub fn sloped_image(&self, first: usize, out: &mut [[f32; SLOPED_MAPS]]) {
        const TOGETHER: usize = 8;
        let Shape { rows, cols } = self.shape;
        let (row, left) = (first / cols.max(1), first % cols.max(1));
        let last = |n: usize| n.saturating_sub(1);
        let (above, below) = (last(row), (row + 1).min(last(rows)));
        // Differences over two pixels; at the border over one.
        let unit = |from: usize, to: usize| 1.0 / (SLOPE_UNIT * to.saturating_sub(from).max(1) as f32);
        let down = unit(above, below);
        let [x, y] = self.direction;
        for (block, out) in out.chunks_mut(TOGETHER).enumerate() {
            let (mut maps, at) = ([[0.0; MAPS]; TOGETHER], left + block * TOGETHER);
            let maps = head_mut(&mut maps, out.len());
            self.image(row * cols + at, maps);
            for (i, (out, &[a, b, c, d])) in out.iter_mut().zip(&*maps).enumerate() {
                let col = at + i;
                let (before, after) = (last(col), (col + 1).min(last(cols)));
                let east = (self.height(row, after) - self.height(row, before)) * unit(before, after);
                let south = (self.height(below, col) - self.height(above, col)) * down;
                *out = [a, b, c, d, east.clamp(-LIMIT, LIMIT), south.clamp(-LIMIT, LIMIT), x, y];
            }
        }
    }

    /// Returns coarse DTM plus relief at a pixel of the mirrored tile, in pixels about its mean.
    fn height(&self, row: usize, col: usize) -> f32 {
        let index = row * self.shape.cols + col;
        let relief = self.relief.part(index, 1).first().copied().unwrap_or(0.0);
        self.scale.normalised(item(self.tile.coarse_m, self.tile.mirror.source(index, self.shape))) + relief
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
        let cols = self.shape.cols.max(1);
        let lines = image.as_chunks_mut::<N>().0.chunks_mut(cols).zip(coarse.chunks_mut(cols));
        for (row, (maps, heights)) in lines.enumerate() {
            write(self, row * cols, maps);
            self.coarse(row * cols, heights);
        }
        Ok(())
    }
}
