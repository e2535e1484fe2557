//! Buffers for the network's input, shared by prediction, training and calibration.

use elunar_core::nn::{InputRules, TileError, TileInput, TileMaps, TileScale};
use elunar_core::photoclinometry::ExpectedErrors;
use elunar_core::tile::Shape;

/// The network's input for one tile ([`TileMaps`]) and its scale recovery. Maps are row-major and mirrored as `scale` says.
pub struct InputMaps {
    /// The image's maps, side by side in every pixel.
    pub image: Vec<f32>,
    /// The coarse DTM, normalised.
    pub coarse: Vec<f32>,
    /// Turns the network's output into metres.
    pub scale: TileScale,
    /// The expected errors; `None` unless the maps are weighed.
    pub expected: Option<ExpectedErrors>,
}

impl InputMaps {
    /// Makes the maps of a tile of this shape. `scratch` grows as needed and can be used again.
    ///
    /// # Errors
    /// As [`TileMaps::new`].
    pub fn new(
        rules: &InputRules,
        shape: Shape,
        tile: &TileInput<'_>,
        scratch: &mut Vec<f32>,
    ) -> Result<Self, TileError> {
        scratch.resize(rules.scratch_len(shape), 0.0);
        let made = TileMaps::new(rules, shape, tile, scratch)?;
        let pixels = tile.image.len();
        let (mut image, mut coarse) = (vec![0.0; rules.illumination.image_maps() * pixels], vec![0.0; pixels]);
        made.fill(&mut image, &mut coarse)?;
        Ok(Self { image, coarse, scale: made.scale(), expected: made.expected() })
    }
}
