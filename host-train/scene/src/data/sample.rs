//! One tile as the network sees it: normalised image, coarse DTM and truth.

use crate::maps::Maps;
use elunar_core::nn::{TileInput, TileLight, TileScale};
use elunar_core::norm::Anchor;
use elunar_core::tile::Shape;
use elunar_net::config::NetConfig;
use elunar_net::illumination::{KnownSun, Mirror, mirrored};
use elunar_raster::{Error, Result};

/// A tile in metres and relative brightness; the source of a [`Sample`].
#[derive(Debug, Clone)]
pub struct RawTile {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Ground size of a pixel, metres.
    pub pixel_m: f32,
    /// Relative brightness.
    pub image: Vec<f32>,
    /// Coarse DTM on the image's grid, metres.
    pub coarse_m: Vec<f32>,
    /// True DTM, metres.
    pub truth_m: Vec<f32>,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub coarse_px: f32,
    /// What is known of the Sun.
    pub sun: KnownSun,
}

impl RawTile {
    /// The tile with a truth that a network can reach: at the wavelengths the coarse DTM resolves it has the coarse heights,
    /// errors included, since no image shows those ([`Anchor`]).
    ///
    /// # Errors
    /// [`Error::Usage`] if the maps differ in size.
    pub fn anchored(mut self) -> Result<Self> {
        let (mut difference, mut sums) =
            (vec![0.0; self.truth_m.len()], vec![0.0; Anchor::sums_len(self.rows, self.cols)]);
        Anchor::new(self.coarse_px)
            .apply(&mut self.truth_m, &self.coarse_m, self.cols, &mut difference, &mut sums)
            .map_err(|e| Error::usage(format!("tile: {e}")))?;
        Ok(self)
    }
}

/// A normalised tile, mirrored so that the Sun shines from where the network expects it.
#[derive(Debug, Clone)]
pub struct Sample {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// What the network sees of the image, its maps side by side in every pixel ([`NetConfig::image_maps`]).
    pub image: Vec<f32>,
    /// Coarse DTM in [0, NR], or in pixels.
    pub coarse: Vec<f32>,
    /// Truth in the same unit: in [0, NR] (own range), about that (reference range), or in pixels.
    pub truth: Vec<f32>,
    /// How the whole tile was mirrored, and its coarse DTM normalised: turns the network's output into metres (Eq. 8).
    pub scale: TileScale,
}

impl Sample {
    /// Normalises a tile as `config` wants it (Eq. 2, Sec. III-A2), and its truth; the tile has a light of its own ([`TileLight::Own`]).
    ///
    /// # Errors
    /// [`Error::Usage`] if the tile has no relief or a constant image.
    pub fn new(config: &NetConfig, tile: &RawTile) -> Result<Self> {
        let bad = |e: &dyn std::fmt::Display| Error::usage(format!("tile cannot be normalised: {e}"));
        let RawTile { rows, cols, pixel_m, coarse_px, ref image, ref coarse_m, ref truth_m, sun } = *tile;
        let (rules, shape, light) = (config.input_rules(), Shape::new(rows, cols), TileLight::Own(sun));
        let input = TileInput { image, coarse_m, valid: None, pixel_m, coarse_px, light };
        let Maps { image, coarse, scale } = Maps::new(&rules, shape, &input, &mut vec![]).map_err(|e| bad(&e))?;
        let mut truth = vec![0.0; coarse.len()];
        let truth_scale = rules.truth_scale(&scale, truth_m).map_err(|e| bad(&e))?;
        truth_scale.normalise(shape, truth_m, &mut truth).map_err(|e| bad(&e))?;
        Ok(Self { rows, cols, image, coarse, truth, scale })
    }

    /// A window of the normalised tile, mirrored as asked; image and heights are mirrored alike, so that light and shape agree.
    pub fn window(&self, [top, left]: [usize; 2], [rows, cols]: [usize; 2], mirror: Mirror) -> Self {
        let cut = |map: &[f32]| -> Vec<f32> {
            let maps = map.len() / (self.rows * self.cols);
            let mut out = Vec::with_capacity(maps * rows * cols);
            for i in 0..rows {
                out.extend_from_slice(&map[maps * ((top + i) * self.cols + left)..][..maps * cols]);
            }
            // Slopes have a direction; networks that are given them are never mirrored.
            if mirror.is_none() { out } else { mirrored(mirror, &out, cols) }
        };
        Self {
            rows,
            cols,
            image: cut(&self.image),
            coarse: cut(&self.coarse),
            truth: cut(&self.truth),
            scale: self.scale,
        }
    }
}
