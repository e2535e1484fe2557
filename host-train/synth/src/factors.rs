//! Properties that differ between scenes, apart from ground and camera: roughness, albedo, photometry, tones of the image,
//! stripes, and on which side the Sun stands.

use super::SynthOptions;
use super::camera::Response;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Separates the random stream of these factors from that of everything else.
const SEED: u64 = 0x0fac_7025;

/// Separates the random stream of landforms from these.
const LANDFORM_SEED: u64 = 0x1a_4df0;

/// Separates the random streams of complex craters and of the albedo's features.
const CRATER_SEED: u64 = 0x00c0_97e0;
const ALBEDO_SEED: u64 = 0x0a1b_ed00;

/// Separates the random stream of Suns that stand opposite.
const SUN_SEED: u64 = 0x0050_a180;

/// The factors of one scene. They have a separate random stream, so that other ranges do not change the rest of a scene. New factors are
/// drawn after the older ones, so that an option with a fixed value changes no other factor.
pub(super) struct Factors {
    /// Factor on all relief.
    pub relief: f32,
    /// Factor on the logarithm of the albedo.
    pub albedo_contrast: f32,
    /// Added to the weight of the Lommel–Seeliger law.
    pub lunar_weight_shift: f32,
    /// Relation of DN to radiance.
    pub response: Response,
    /// Standard deviation of the Gaussian that smooths the ground, pixels.
    pub smooth_px: f32,
    /// Random stream of landforms, if the scene has any.
    pub landforms: Option<ChaCha8Rng>,
    /// Random stream of complex craters, if the scene has any.
    pub complex_craters: Option<ChaCha8Rng>,
    /// Random stream of the albedo's features, if the scene has any.
    pub albedo: Option<ChaCha8Rng>,
    /// Added to the azimuth of the Sun: 0 or 180 degrees.
    pub sun_turn_deg: f64,
    /// RMS of the coarse DTM's stripes, metres.
    pub stripes_m: f64,
    /// Random stream of the stripes.
    pub stripes: ChaCha8Rng,
}

impl Factors {
    /// Draws the factors of scene `index` of the Moon of `seed`.
    pub(super) fn draw(seed: u64, index: u64, options: &SynthOptions) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ SEED);
        rng.set_stream(index);
        let relief = within(&mut rng, options.relief) as f32;
        let albedo_contrast = within(&mut rng, options.albedo_contrast) as f32;
        let lunar_weight_shift = within(&mut rng, options.lunar_weight_shift) as f32;
        let exponent = within(&mut rng, options.response_exponent) as f32;
        let pedestal = within(&mut rng, options.pedestal) as f32;
        let stripes_m = within(&mut rng, options.coarse_stripes_m);
        let smooth_px = (options.smooth_ground_px * rng.random::<f64>().powi(4)) as f32;
        let stream_of = |kind: u64, share: f64| {
            let mut stream = ChaCha8Rng::seed_from_u64(seed ^ kind);
            stream.set_stream(index);
            (stream.random::<f64>() < share).then_some(stream)
        };
        Self {
            relief,
            albedo_contrast,
            lunar_weight_shift,
            response: Response { exponent, pedestal },
            smooth_px,
            landforms: stream_of(LANDFORM_SEED, options.landforms),
            complex_craters: stream_of(CRATER_SEED, options.complex_craters),
            albedo: stream_of(ALBEDO_SEED, options.albedo_features),
            sun_turn_deg: stream_of(SUN_SEED, if options.sun_opposite { 0.5 } else { 0.0 }).map_or(0.0, |_| 180.0),
            stripes_m,
            stripes: rng,
        }
    }
}

/// Draws uniformly between the two ends, which may be equal.
pub(super) fn within(rng: &mut ChaCha8Rng, (low, high): (f64, f64)) -> f64 {
    low + (high - low) * rng.random::<f64>()
}
