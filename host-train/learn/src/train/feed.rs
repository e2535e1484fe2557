//! Where batches come from: any source of tiles, cropped and mirrored by the seed and the step alone, made ahead of the device.

use super::recipe::Recipe;
use super::sample::Sample;
use super::source::TileSource;
use burn::tensor::{Device, Tensor, TensorData};
use elunar_net::config::{Illumination, NetConfig};
use elunar_net::illumination::{KnownSun, Mirror};
use elunar_raster::{Error, Result};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};

/// The samples of one step.
pub type Batch = Vec<Sample>;

/// Batches by step, deterministic from the seed.
#[derive(Clone)]
pub struct Feed {
    source: Arc<dyn TileSource>,
    config: NetConfig,
    recipe: Recipe,
    seed: u64,
}

/// Keeps the choice of tiles without a known Sun apart from the choice of crops.
const SUN_STREAM: u64 = 0x5u64 << 60;

/// Tries before a step gives up on tiles that cannot be normalised (flat or blank).
const TRIES: u64 = 8;

impl Feed {
    /// A feed of `recipe`-sized batches from `source`.
    pub fn new(source: Arc<dyn TileSource>, config: NetConfig, recipe: Recipe, seed: u64) -> Self {
        Self { source, config, recipe, seed }
    }

    /// The batch of a step.
    ///
    /// # Errors
    /// If tiles cannot be made, are smaller than the crop, or cannot be normalised.
    pub fn batch(&self, step: usize) -> Result<Batch> {
        let per_tile = self.recipe.crops_per_tile.min(self.recipe.batch);
        let tiles = self.recipe.batch.div_ceil(per_tile);
        // One after the other: the thread pool belongs to the network, whose short tasks must not queue behind whole tiles.
        let made: Result<Vec<Sample>> = (0..tiles).map(|slot| self.sample((step * tiles + slot) as u64)).collect();
        let made = made?;
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(step as u64);
        let [rows, cols] = self.recipe.crop;
        (0..self.recipe.batch)
            .map(|i| {
                let sample = &made[i / per_tile];
                if sample.rows < rows || sample.cols < cols {
                    return Err(Error::usage(format!(
                        "training tiles: expected at least {rows}x{cols} pixels, found {}x{}",
                        sample.rows, sample.cols
                    )));
                }
                let corner = [rng.random_range(0..=sample.rows - rows), rng.random_range(0..=sample.cols - cols)];
                // Mirrored at random, unless the light must stay where the network expects it.
                let random = Mirror { rows: rng.random(), cols: rng.random() };
                let mirror = if self.config.illumination == Illumination::Any { random } else { Mirror::default() };
                Ok(sample.window(corner, [rows, cols], mirror))
            })
            .collect()
    }

    /// Whether the network must do without what is known of the Sun over this tile: decided by seed and index alone.
    fn hides_sun(&self, index: u64) -> bool {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed ^ SUN_STREAM);
        rng.set_stream(index);
        rng.random::<f64>() >= self.recipe.known_sun
    }

    /// The sample of a tile index; tiles that cannot be normalised are replaced by the next far-off index.
    fn sample(&self, index: u64) -> Result<Sample> {
        let mut last = None;
        for attempt in 0..TRIES {
            let index = index + (attempt << 40);
            let mut tile = self.recipe.target.of(self.source.tile(index)?)?;
            if self.hides_sun(index) {
                tile.sun = KnownSun::default();
            }
            match Sample::new(&self.config, &tile) {
                Ok(sample) => return Ok(sample),
                Err(error) => last = Some(error),
            }
        }
        Err(last.unwrap_or_else(|| Error::usage("no usable tile")))
    }

    /// Batches from `first` on, made by a thread that stays two steps ahead.
    pub fn ahead(&self, first: usize) -> Receiver<Result<Batch>> {
        let (send, receive) = sync_channel(2);
        let feed = self.clone();
        std::thread::spawn(move || {
            for step in first..feed.recipe.steps {
                if send.send(feed.batch(step)).is_err() {
                    return;
                }
            }
        });
        receive
    }
}

/// Image, coarse DTM and truth of a batch as `[B, maps, H, W]` tensors; of the last two there is one map.
pub fn tensors(batch: &[Sample], device: &Device) -> [Tensor<4>; 3] {
    let pick: [fn(&Sample) -> &Vec<f32>; 3] = [|s| &s.image, |s| &s.coarse, |s| &s.truth];
    pick.map(|field| {
        let data: Vec<f32> = batch.iter().flat_map(|s| field(s).iter().copied()).collect();
        side_by_side(data, [batch.len(), batch[0].rows, batch[0].cols], device)
    })
}

/// Maps that lie side by side in every pixel, `[B, H, W, maps]`, as a `[B, maps, H, W]` tensor.
pub fn side_by_side(data: Vec<f32>, [batch, rows, cols]: [usize; 3], device: &Device) -> Tensor<4> {
    let maps = data.len() / (batch * rows * cols);
    let tensor: Tensor<4> = Tensor::from_data(TensorData::new(data, [batch, rows, cols, maps]), device);
    if maps == 1 { tensor.reshape([batch, 1, rows, cols]) } else { tensor.permute([0, 3, 1, 2]) }
}
