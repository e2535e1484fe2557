//! One tile as input of the network: normalised image, coarse DTM and truth.

use elunar_base::{Error, Result};
use elunar_core::job::{JobError, TileInput, TileRules, TileScale};
use elunar_core::nn::TileLight;
use elunar_core::norm::Anchor;
use elunar_core::tile::Shape;
use elunar_net::config::{NetConfig, Preset, trained_network};
use elunar_net::illumination::{KnownSun, Mirror, mirrored};
use elunar_net::job::InputMaps;

/// A tile in metres and relative brightness. A [`Sample`] is made from it.
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
    /// The known parts of the Sun's direction.
    pub sun: KnownSun,
}

impl RawTile {
    /// Replaces the truth by one that a network can reach. At the wavelengths that the coarse DTM resolves, the new truth has the coarse
    /// heights with their errors, because no image shows these waves ([`Anchor`]).
    ///
    /// # Errors
    /// [`Error::Input`] if the maps differ in size.
    pub fn anchored(mut self) -> Result<Self> {
        let (mut difference, mut sums) =
            (vec![0.0; self.truth_m.len()], vec![0.0; Anchor::sums_len(self.rows, self.cols)]);
        Anchor::whole(self.coarse_px)
            .apply(&mut self.truth_m, &self.coarse_m, self.cols, &mut difference, &mut sums)
            .map_err(|e| Error::input(format!("tile: {e}")))?;
        Ok(self)
    }
}

/// Returns the heights of a tile without training, metres: its coarse DTM plus linear photoclinometry, as the untrained model of
/// `elunar-scene` makes them. A tile that cannot be normalised keeps its coarse heights, as in a prediction.
#[must_use]
pub fn untrained_m(tile: &RawTile) -> Vec<f32> {
    match Sample::new(&trained_network(Preset::Nano), tile) {
        Ok(Sample { coarse: mut heights_m, scale, rows, cols, .. }) => {
            scale.recover(Shape::new(rows, cols), &mut heights_m);
            heights_m
        }
        Err(_) => tile.coarse_m.clone(),
    }
}

/// A normalised tile, mirrored so that its Sun shines from the north-west.
#[derive(Debug, Clone)]
pub struct Sample {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// The image's maps as the network reads them, side by side in every pixel ([`NetConfig::image_maps`]).
    pub image: Vec<f32>,
    /// Coarse DTM, in [0, NR] or in pixels.
    pub coarse: Vec<f32>,
    /// Truth, in the unit of the coarse DTM. In [0, NR] for the own range, about that for the reference range, or in pixels.
    pub truth: Vec<f32>,
    /// The mirror and the coarse DTM's normalisation of the whole tile. They turn the network's output into metres (Eq. 8).
    pub scale: TileScale,
}

impl Sample {
    /// Normalises a tile and its truth as `config` says (Eq. 2, Sec. III-A2). The tile has its own light ([`TileLight::Own`]).
    ///
    /// # Errors
    /// [`Error::Input`] if the tile has no relief or a constant image.
    pub fn new(config: &NetConfig, tile: &RawTile) -> Result<Self> {
        let bad = |e: &dyn std::fmt::Display| Error::input(format!("tile cannot be normalised: {e}"));
        let RawTile { rows, cols, pixel_m, coarse_px, ref image, ref coarse_m, ref truth_m, sun } = *tile;
        let (rules, shape, light) = (config.input_rules(), Shape::new(rows, cols), TileLight::Own(sun));
        let input = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: shape, light };
        let how = TileRules { pixel_m, coarse_px, anchor: false, checked: false };
        let (InputMaps { image, coarse, .. }, job) = InputMaps::of(how, rules, shape, &input).map_err(|e| match e {
            JobError::State => bad(&"it has no relief, or a constant image"),
            e => bad(&e),
        })?;
        let scale = job.scale().ok_or_else(|| bad(&"it has no scale"))?;
        let mut truth = vec![0.0; coarse.len()];
        let truth_scale = rules.truth_scale(&scale, truth_m).map_err(|e| bad(&e))?;
        truth_scale.normalise(shape, truth_m, &mut truth).map_err(|e| bad(&e))?;
        Ok(Self { rows, cols, image, coarse, truth, scale })
    }

    /// Returns a window of the normalised tile, with `mirror` applied. Image and heights are mirrored alike, so that light and shape agree.
    pub fn window(&self, [top, left]: [usize; 2], [rows, cols]: [usize; 2], mirror: Mirror) -> Self {
        let cut = |map: &[f32]| -> Vec<f32> {
            let maps = map.len() / (self.rows * self.cols);
            let mut out = Vec::with_capacity(maps * rows * cols);
            for i in 0..rows {
                out.extend_from_slice(&map[maps * ((top + i) * self.cols + left)..][..maps * cols]);
            }
            // A mirror would reverse the direction of slopes. Networks with slopes as input are never mirrored.
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

    /// Returns the sample with rows and columns exchanged, and so the two components of every vector among a guide's maps. The light stays in
    /// the north-west. `scale` does not take part: heights cannot be brought back to the ground any more.
    pub fn transposed(&self) -> Self {
        let Self { rows, cols, .. } = *self;
        let turn = |map: &[f32]| -> Vec<f32> {
            let maps = map.len() / (rows * cols);
            let mut out = Vec::with_capacity(map.len());
            for i in 0..rows * cols {
                let (row, col) = (i % rows, i / rows);
                let pixel = &map[maps * (row * cols + col)..][..maps];
                out.extend_from_slice(pixel);
                for [east, south] in VECTORS.into_iter().filter(|[_, south]| *south < maps) {
                    let at = out.len() - maps;
                    out.swap(at + east, at + south);
                }
            }
            out
        };
        Self {
            rows: cols,
            cols: rows,
            image: turn(&self.image),
            coarse: turn(&self.coarse),
            truth: turn(&self.truth),
            scale: self.scale,
        }
    }
}

/// Components east and south of the vectors among a guide's maps.
const VECTORS: [[usize; 2]; 3] = [[0, 1], [4, 5], [6, 7]];
