//! Scenes and tiles of a synthetic Moon.

use super::camera::Exposure;
use super::coarse::{self, COARSE_PIXEL_M, CoarseGrid, Flaws, Ground};
use super::crater::{self, Profiles};
use super::factors::{Factors, within};
use super::field::{Amplitudes, FieldPlan, Spectrum};
use super::light::{Sun, reflectance};
use super::smooth::smooth;
use super::{SynthOptions, TerrainKind, albedo, boulder, landform};
use elunar_base::Result;
use elunar_raster::resample::{PixelMap, resample_bicubic};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Albedo between the craters. The standard deviation of its logarithm is about 2 %; it is rougher than terrain (our choice).
const ALBEDO: Spectrum = Spectrum { corner_rms_m: 0.008, corner_m: 100.0, hurst_long: 0.2, hurst_short: 0.5 };
/// Standard deviation of the logarithm of a scene's roughness, which varies between places (our choice).
const ROUGHNESS_SPREAD: f64 = 0.25;
/// Height of scenes above the 1737.4 km sphere, metres: mean and standard deviation of maria, then of highlands (our choice).
const BASE_HEIGHT_M: [(f64, f64); 2] = [(-2000.0, 600.0), (300.0, 1200.0)];

/// A Moon: an unlimited, repeatable source of tiles and scenes.
///
/// `tile(index)` and `scene(index, …)` depend only on the seed, the options and their arguments. They can be called from any thread.
///
/// ```
/// use elunar_synth::{Moon, SynthOptions};
/// let moon = Moon::new(7, SynthOptions { rows: 64, cols: 80, ..Default::default() })?;
/// let tile = moon.tile(0);
/// assert_eq!(tile.image.len(), 64 * 80);
/// assert_eq!(tile.truth_m, moon.tile(0).truth_m);
/// # Ok::<(), elunar_base::Error>(())
/// ```
pub struct Moon {
    seed: u64,
    options: SynthOptions,
    profiles: Profiles,
    tile_shop: Workshop,
    /// The same Moon with the further pixel sizes of the options.
    others: Vec<Moon>,
}

/// A training sample: image, coarse DTM and truth on one grid, all row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct SynthTile {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Pixel, metres.
    pub pixel_m: f64,
    /// Image, relative DN, 0–4095.
    pub image: Vec<f32>,
    /// Coarse DTM interpolated onto the tile's grid (as in `predict`), metres above the 1737.4 km sphere.
    pub coarse_m: Vec<f32>,
    /// True DTM, metres above the 1737.4 km sphere.
    pub truth_m: Vec<f32>,
    /// Sun azimuth, degrees clockwise from north (up).
    pub sun_azimuth_deg: f64,
    /// Sun elevation, degrees above the horizon.
    pub sun_elevation_deg: f64,
    /// Terrain.
    pub kind: TerrainKind,
}

/// An image and its truth on one grid, with the coarse DTM on its own.
#[derive(Debug, Clone, PartialEq)]
pub struct SynthScene {
    /// Number of the scene on its Moon.
    pub index: u64,
    /// Rows of image and truth.
    pub rows: usize,
    /// Columns of image and truth.
    pub cols: usize,
    /// Pixel of image and truth, metres.
    pub pixel_m: f64,
    /// Image, relative DN, 0–4095.
    pub image: Vec<f32>,
    /// True DTM, metres above the 1737.4 km sphere.
    pub truth_m: Vec<f32>,
    /// Coarse DTM.
    pub coarse: CoarseGrid,
    /// Sun azimuth, degrees clockwise from north (up).
    pub sun_azimuth_deg: f64,
    /// Sun elevation, degrees above the horizon.
    pub sun_elevation_deg: f64,
    /// Terrain.
    pub kind: TerrainKind,
}

impl SynthScene {
    /// Returns the coarse DTM interpolated onto the image's grid, metres.
    pub fn coarse_on_image_m(&self) -> Vec<f32> {
        let step = self.pixel_m / COARSE_PIXEL_M;
        let map = PixelMap {
            row0: -self.coarse.south_m / COARSE_PIXEL_M + 0.5 * step - 0.5,
            row_per_row: step,
            row_per_col: 0.0,
            col0: -self.coarse.east_m / COARSE_PIXEL_M + 0.5 * step - 0.5,
            col_per_row: 0.0,
            col_per_col: step,
        };
        resample_bicubic(&self.coarse.heights_m, self.coarse.rows, self.coarse.cols, &map, self.rows, self.cols)
    }
}

/// Data that all scenes of one size share.
struct Workshop {
    rows: usize,
    cols: usize,
    margin_px: usize,
    plan: FieldPlan,
    mare: Amplitudes,
    highland: Amplitudes,
    albedo: Amplitudes,
}

impl Workshop {
    fn new(rows: usize, cols: usize, options: &SynthOptions) -> Self {
        let margin_px = (coarse::margin_m(options.misregistration_m) / options.pixel_m).ceil() as usize + 1;
        let plan = FieldPlan::new(rows + 2 * margin_px, cols + 2 * margin_px, options.pixel_m);
        let amplitudes = |kind: TerrainKind| plan.amplitudes(&kind.recipe().spectrum);
        let (mare, highland) = (amplitudes(TerrainKind::Mare), amplitudes(TerrainKind::Highland));
        let albedo = plan.amplitudes(&ALBEDO);
        Self { rows, cols, margin_px, plan, mare, highland, albedo }
    }
}

impl Moon {
    /// Makes the Moon of one seed.
    ///
    /// # Errors
    /// [`elunar_base::Error::Usage`] if an option is out of range.
    pub fn new(seed: u64, options: SynthOptions) -> Result<Self> {
        options.validate()?;
        let tile_shop = Workshop::new(options.rows, options.cols, &options);
        let other =
            |&pixel_m: &f64| Self::new(seed, SynthOptions { pixel_m, also_pixel_m: Vec::new(), ..options.clone() });
        let others = options.also_pixel_m.iter().map(other).collect::<Result<_>>()?;
        Ok(Self { seed, options, profiles: Profiles::new(), tile_shop, others })
    }

    /// Returns the options of this Moon.
    pub fn options(&self) -> &SynthOptions {
        &self.options
    }

    /// Returns tile number `index`, of the options' size.
    pub fn tile(&self, index: u64) -> SynthTile {
        let turn = (index % (1 + self.others.len() as u64)) as usize;
        if let Some(other) = turn.checked_sub(1).and_then(|k| self.others.get(k)) {
            return other.tile(index);
        }
        let scene = self.make(index, &self.tile_shop);
        SynthTile {
            coarse_m: scene.coarse_on_image_m(),
            rows: scene.rows,
            cols: scene.cols,
            pixel_m: scene.pixel_m,
            image: scene.image,
            truth_m: scene.truth_m,
            sun_azimuth_deg: scene.sun_azimuth_deg,
            sun_elevation_deg: scene.sun_elevation_deg,
            kind: scene.kind,
        }
    }

    /// Returns scene number `index`, `rows` × `cols` pixels. Its terrain differs from that of the tile with the same index, unless their
    /// sizes are equal.
    ///
    /// # Errors
    /// [`elunar_base::Error::Usage`] if the size is out of range.
    pub fn scene(&self, index: u64, rows: usize, cols: usize) -> Result<SynthScene> {
        SynthOptions { rows, cols, ..self.options.clone() }.validate()?;
        Ok(self.make(index, &Workshop::new(rows, cols, &self.options)))
    }

    fn make(&self, index: u64, shop: &Workshop) -> SynthScene {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(index);
        let rng = &mut rng;
        let options = &self.options;
        let drawn = if rng.random() { TerrainKind::Mare } else { TerrainKind::Highland };
        let kind = options.kind.unwrap_or(drawn);
        let mut factors = Factors::draw(self.seed, index, options);
        let sun = Sun {
            azimuth_deg: (within(rng, options.sun_azimuth_deg) + factors.sun_turn_deg) % 360.0,
            elevation_deg: within(rng, options.sun_elevation_deg),
        };
        let flaws =
            Flaws { error_m: within(rng, options.coarse_error_m), misregistration_m: options.misregistration_m };
        let (mut heights_m, mut log_albedo) = self.terrain(rng, kind, factors.relief, shop);
        let (rows, cols) = shop.plan.shape();
        if let Some(stream) = &mut factors.landforms {
            landform::add(stream, &mut heights_m, &mut log_albedo, [rows, cols], options.pixel_m);
        }
        if let Some(stream) = &mut factors.complex_craters {
            landform::add_complex_craters(stream, &mut heights_m, [rows, cols], options.pixel_m);
        }
        if let Some(stream) = &mut factors.albedo {
            albedo::add(stream, &heights_m, &mut log_albedo, [rows, cols], options.pixel_m);
        }
        log_albedo.iter_mut().for_each(|log| *log *= factors.albedo_contrast);
        let heights_m = smooth(heights_m, [rows, cols], factors.smooth_px);
        let ground = Ground { heights_m: &heights_m, cols, margin_px: shop.margin_px, pixel_m: options.pixel_m };
        let mut coarse = coarse::observe(rng, &ground, shop.rows, shop.cols, &flaws);
        coarse::add_stripes(&mut factors.stripes, &mut coarse.heights_m, coarse.cols, factors.stripes_m);
        let mut image = self.image(rng, &heights_m, &log_albedo, (&sun, factors.lunar_weight_shift), shop);
        factors.response.apply(&mut image);
        SynthScene {
            index,
            rows: shop.rows,
            cols: shop.cols,
            pixel_m: options.pixel_m,
            image,
            truth_m: crop(&heights_m, cols, shop),
            coarse,
            sun_azimuth_deg: sun.azimuth_deg,
            sun_elevation_deg: sun.elevation_deg,
            kind,
        }
    }

    /// Returns heights, metres, and the logarithm of the albedo over the whole domain.
    fn terrain(&self, rng: &mut ChaCha8Rng, kind: TerrainKind, relief: f32, shop: &Workshop) -> (Vec<f32>, Vec<f32>) {
        let (rows, cols) = shop.plan.shape();
        let pixel_m = self.options.pixel_m;
        let recipe = kind.recipe();
        let amplitudes = match kind {
            TerrainKind::Mare => &shop.mare,
            TerrainKind::Highland => &shop.highland,
        };
        let (mut heights_m, mut log_albedo) = shop.plan.draw(rng, amplitudes, &shop.albedo);
        // Log-normal with a mean square of one, so that the average over scenes keeps the fitted structure function.
        let deviate: f64 = StandardNormal.sample(rng);
        let roughness = libm::exp(ROUGHNESS_SPREAD * deviate - ROUGHNESS_SPREAD * ROUGHNESS_SPREAD);
        let (mean_m, spread_m) = BASE_HEIGHT_M[kind as usize];
        let base: f64 = StandardNormal.sample(rng);
        let base_m = (mean_m + spread_m * base) as f32;
        heights_m.iter_mut().for_each(|height| *height *= roughness as f32);
        shop.plan.long_waves(rng, &recipe.spectrum).add_to(&mut heights_m, cols, roughness);
        for crater in crater::population(rng, rows, cols, pixel_m, recipe.saturation_diameter_m) {
            crater::stamp(&crater, &self.profiles, pixel_m, &mut heights_m, &mut log_albedo, cols);
            if self.options.boulders {
                boulder::strew(rng, &crater, pixel_m, &mut heights_m, cols);
            }
        }
        heights_m.iter_mut().for_each(|height| *height = *height * relief + base_m);
        (heights_m, log_albedo)
    }

    fn image(
        &self,
        rng: &mut ChaCha8Rng,
        heights_m: &[f32],
        log_albedo: &[f32],
        (sun, weight_shift): (&Sun, f32),
        shop: &Workshop,
    ) -> Vec<f32> {
        let (rows, cols) = shop.plan.shape();
        let reflected = reflectance(heights_m, [rows, cols], self.options.pixel_m, sun, weight_shift);
        let mut radiance = crop(&reflected, cols, shop);
        for (value, log_albedo) in radiance.iter_mut().zip(crop(log_albedo, cols, shop)) {
            *value *= libm::expf(log_albedo);
        }
        Exposure::draw(rng, self.options.blur_px).take(rng, &radiance, shop.rows, shop.cols)
    }
}

/// Returns the scene's part of a domain of `cols` columns.
fn crop(field: &[f32], cols: usize, shop: &Workshop) -> Vec<f32> {
    let lines = field.chunks_exact(cols).skip(shop.margin_px).take(shop.rows);
    lines.flat_map(|line| &line[shop.margin_px..][..shop.cols]).copied().collect()
}
