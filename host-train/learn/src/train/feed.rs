//! Batches of training samples from a source of tiles. Cropping and mirroring depend only on the seed and the step. Batches are made in
//! advance.

use super::kept::Kept;
use super::recipe::Recipe;
use super::sample::Sample;
use super::source::TileSource;
use burn::tensor::{Device, Tensor, TensorData};
use elunar_base::{Error, Result};
use elunar_net::config::{Illumination, NetConfig};
use elunar_net::illumination::{KnownSun, Mirror};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};

/// The samples of one step.
pub type Batch = Vec<Sample>;

/// Batches by step. The seed determines them.
#[derive(Clone)]
pub struct Feed {
    source: Arc<dyn TileSource>,
    config: NetConfig,
    recipe: Recipe,
    seed: u64,
    /// Tiles in use.
    tiles: Arc<Kept>,
}

/// Separates the random choice of tiles without a known Sun from the choice of crops.
const SUN_STREAM: u64 = 0x5u64 << 60;

/// Number of tries before a step fails because tiles cannot be normalised (flat or blank).
const TRIES: u64 = 8;

impl Feed {
    /// Makes a feed of batches from `source`; `recipe` gives their size.
    pub fn new(source: Arc<dyn TileSource>, config: NetConfig, recipe: Recipe, seed: u64) -> Self {
        Self { source, config, recipe, seed, tiles: Arc::default() }
    }

    /// Returns the batch of a step.
    ///
    /// # Errors
    /// If tiles cannot be made, are smaller than the crop, or cannot be normalised.
    pub fn batch(&self, step: usize) -> Result<Batch> {
        let Recipe { batch, crop: [rows, cols], crops_per_tile, pool, transpose, .. } = self.recipe;
        let per_tile = crops_per_tile.min(batch);
        let new = batch.div_ceil(per_tile);
        let end = (step + 1) * new;
        let first = if pool > 0 { end.saturating_sub(pool.max(new)) } else { end - new };
        // Other threads may be a few steps behind. A forgotten tile is made again.
        self.tiles.forget_before(first.saturating_sub(pool) as u64);
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(step as u64);
        // One after the other. The thread pool belongs to the network, and its short tasks must not wait for whole tiles.
        (0..batch)
            .map(|i| {
                let index = if pool > 0 { rng.random_range(first..end) } else { first + i / per_tile };
                let sample = self.tiles.get(index as u64, || self.sample(index as u64))?;
                let turned = transpose && rng.random();
                let [rows, cols] = if turned { [cols, rows] } else { [rows, cols] };
                if sample.rows < rows || sample.cols < cols {
                    let turned = if turned { " (a turned crop; transpose = false has none)" } else { "" };
                    return Err(Error::input(format!(
                        "training tiles: expected at least {rows}x{cols} pixels{turned}, found {}x{}",
                        sample.rows, sample.cols
                    )));
                }
                let corner = [rng.random_range(0..=sample.rows - rows), rng.random_range(0..=sample.cols - cols)];
                // Mirrored at random, unless the light must stay in the quadrant that the network expects.
                let random = Mirror { rows: rng.random(), cols: rng.random() };
                let mirror = if self.config.illumination == Illumination::Any { random } else { Mirror::default() };
                let crop = sample.window(corner, [rows, cols], mirror);
                Ok(if turned { crop.transposed() } else { crop })
            })
            .collect()
    }

    /// Returns whether the known Sun of this tile is withheld from the network. Only seed and index decide.
    fn hides_sun(&self, index: u64) -> bool {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed ^ SUN_STREAM);
        rng.set_stream(index);
        rng.random::<f64>() >= self.recipe.known_sun
    }

    /// Returns the sample of a tile index. A tile that cannot be normalised is replaced by one of a distant index.
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
        Err(last.unwrap_or_else(|| Error::input("no usable tile")))
    }

    /// Returns batches from `first` on, in order. Each of `makers` threads makes every `makers`-th one, up to two of its own in advance.
    ///
    /// # Panics
    /// If `makers` is 0.
    pub fn ahead(&self, first: usize, makers: usize) -> Ahead {
        assert!(makers > 0, "somebody must make the batches");
        let maker = |maker: usize| {
            let (send, receive) = sync_channel(2);
            let feed = self.clone();
            std::thread::spawn(move || {
                for step in (first + maker..feed.recipe.steps).step_by(makers) {
                    if send.send(feed.batch(step)).is_err() {
                        return;
                    }
                }
            });
            receive
        };
        Ahead { makers: (0..makers).map(maker).collect(), next: 0 }
    }
}

/// Batches that other threads make in advance.
pub struct Ahead {
    makers: Vec<Receiver<Result<Batch>>>,
    /// Maker of the next batch.
    next: usize,
}

impl Iterator for Ahead {
    type Item = Result<Batch>;

    /// Waits for the next batch; `None` after the recipe's last step.
    fn next(&mut self) -> Option<Result<Batch>> {
        let maker = self.next;
        self.next = (maker + 1) % self.makers.len();
        self.makers[maker].recv().ok()
    }
}

/// Returns image, coarse DTM and truth of a batch as `[B, maps, H, W]` tensors. Coarse DTM and truth have one map.
pub fn tensors(batch: &[Sample], device: &Device) -> [Tensor<4>; 3] {
    let pick: [fn(&Sample) -> &Vec<f32>; 3] = [|s| &s.image, |s| &s.coarse, |s| &s.truth];
    pick.map(|field| {
        let data: Vec<f32> = batch.iter().flat_map(|s| field(s).iter().copied()).collect();
        side_by_side(data, [batch.len(), batch[0].rows, batch[0].cols], device)
    })
}

/// Converts maps that are side by side in every pixel, `[B, H, W, maps]`, to a `[B, maps, H, W]` tensor.
pub fn side_by_side(data: Vec<f32>, [batch, rows, cols]: [usize; 3], device: &Device) -> Tensor<4> {
    let maps = data.len() / (batch * rows * cols);
    let tensor: Tensor<4> = Tensor::from_data(TensorData::new(data, [batch, rows, cols, maps]), device);
    if maps == 1 { tensor.reshape([batch, 1, rows, cols]) } else { tensor.permute([0, 3, 1, 2]) }
}
