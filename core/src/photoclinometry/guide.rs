//! What a network that is given the light sees of a tile: four maps for the image, and the coarse DTM with the relief added.

use super::{Photoclinometry, Relief};
use crate::error::NormError;
use crate::mask;
use crate::norm::{ElevationScale, Light, Shading, Turn};
use crate::part::{item, part};

/// Maps of which the image consists: two components of slope, the relief, and how uncertain they are.
pub const MAPS: usize = 4;
/// No map leaves this range: slopes of 45 degrees, reliefs of ten pixels, and the light of a Sun near the zenith.
pub const LIMIT: f32 = 10.0;

/// What a guide is made of; maps are row-major.
#[derive(Debug, Clone, Copy)]
pub struct GuideInput<'t> {
    /// Relative brightness.
    pub image: &'t [f32],
    /// Coarse DTM on the image's grid, metres.
    pub coarse_m: &'t [f32],
    /// Which pixels count beside those that are real (see [`mask`]); `None`: all.
    pub valid: Option<&'t [bool]>,
    /// How the maps are mirrored before anything else.
    pub turn: Turn,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub coarse_px: f32,
}

/// A tile's image and coarse DTM, made ready for the network pixel by pixel.
///
/// ```
/// use elunar_core::norm::{ElevationScale, Light, Turn};
/// use elunar_core::photoclinometry::{Guide, GuideInput, Photoclinometry};
///
/// // A single row of bright pixels faces a Sun in the west, 40 degrees high.
/// let image: Vec<f32> = (0..32 * 32).map(|i| if i % 32 == 16 { 120.0 } else { 100.0 }).collect();
/// let coarse_m = vec![-1900.0; 32 * 32];
/// let scale = ElevationScale::from_pixel(&coarse_m, None, 2.0, 50.0)?;
/// let plan = Photoclinometry::new((32, 32));
/// let mut scratch = vec![0.0; plan.scratch_len()];
/// let light = Light::from_sun(270.0, 40.0).expect("above the horizon");
/// let tile = GuideInput { image: &image, coarse_m: &coarse_m, valid: None, turn: Turn::default(), coarse_px: 30.0 };
/// let guide = Guide::new(&plan, tile, &scale, light, &mut scratch)?;
/// // There the ground rises to the east, and so it is higher behind than before.
/// let row = 16 * 32;
/// assert!(guide.image(row + 16)[0] > 1.0);
/// assert!(guide.coarse(row + 18) > guide.coarse(row + 14));
/// # Ok::<(), elunar_core::error::NormError>(())
/// ```
#[derive(Debug)]
pub struct Guide<'t, 's> {
    tile: GuideInput<'t>,
    shape: (usize, usize),
    scale: ElevationScale,
    shading: Shading,
    uncertainty: f32,
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
        let GuideInput { image, coarse_m, valid, turn, coarse_px } = tile;
        let expected = plan.tile.0 * plan.tile.1;
        for found in [image.len(), coarse_m.len(), valid.map_or(expected, <[bool]>::len)] {
            crate::error::same_length(expected, found)?;
        }
        let shading = Shading::new(image, valid, light)?;
        let shape = plan.tile;
        let brightness = |i: usize| {
            let pixel = turn.source(i, shape);
            mask::counts(image, valid, pixel).then(|| item(image, pixel))
        };
        let coarse = |i: usize| height(scale, coarse_m, turn.source(i, shape));
        let relief = plan.relief(brightness, coarse, (&shading, light), coarse_px, scratch)?;
        Ok(Self { tile, shape, scale: *scale, shading, uncertainty: 1.0 / light.strength(), relief })
    }

    /// The image's maps at a pixel of the mirrored tile, in units of 0.1 of slope, of a pixel of height, and of slope per contrast; level where the image
    /// does not count.
    #[must_use]
    pub fn image(&self, index: usize) -> [f32; MAPS] {
        let GuideInput { image, valid, turn, .. } = self.tile;
        let pixel = turn.source(index, self.shape);
        let [east, south] =
            if mask::counts(image, valid, pixel) { self.shading.slopes(item(image, pixel)) } else { [0.0; 2] };
        [east, south, self.relief.at(index), self.uncertainty].map(|v| v.clamp(-LIMIT, LIMIT))
    }

    /// The coarse DTM with the relief at a pixel of the mirrored tile, in pixels about its mean.
    #[must_use]
    pub fn coarse(&self, index: usize) -> f32 {
        let pixel = self.tile.turn.source(index, self.shape);
        height(&self.scale, self.tile.coarse_m, pixel) + self.relief.at(index)
    }

    /// All maps of the image, side by side in every pixel, and the coarse DTM.
    ///
    /// # Errors
    /// [`NormError::Length`] if a buffer has another length.
    pub fn fill(&self, image: &mut [f32], coarse: &mut [f32]) -> Result<(), NormError> {
        crate::error::same_length(self.tile.image.len(), coarse.len())?;
        crate::error::same_length(MAPS * coarse.len(), image.len())?;
        for (i, (maps, z)) in image.as_chunks_mut::<MAPS>().0.iter_mut().zip(coarse).enumerate() {
            (*maps, *z) = (self.image(i), self.coarse(i));
        }
        Ok(())
    }
}

/// A height in the scale's unit; 0 where it is not real.
fn height(scale: &ElevationScale, coarse_m: &[f32], index: usize) -> f32 {
    let mut z = [0.0];
    // One sample in, one out: the lengths agree.
    let _ = scale.normalise(part(coarse_m, index, 1), &mut z);
    z[0]
}
