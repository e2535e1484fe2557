//! What differs from scene to scene beyond ground, Sun and camera: roughness, albedo, photometry, the picture's tones, stripes.

use super::SynthOptions;
use super::camera::Response;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What parts the numbers that draw these factors from those that draw all else.
const SEED: u64 = 0x0fac_7025;

/// The factors of one scene. They come from numbers of their own: with other ranges the rest of a scene stays as it is. What is new is
/// drawn after what is old, so that an option which stays at one value changes none of the others.
pub(super) struct Factors {
    /// On all relief.
    pub relief: f32,
    /// On the logarithm of the albedo.
    pub albedo_contrast: f32,
    /// Added to the weight of the Lommel–Seeliger law.
    pub lunar_weight_shift: f32,
    /// From radiance to numbers.
    pub response: Response,
    /// RMS of the coarse DTM's stripes, metres.
    pub stripes_m: f64,
    /// What the stripes are drawn with.
    pub stripes: ChaCha8Rng,
}

impl Factors {
    /// Those of scene `index` of the Moon of `seed`.
    pub(super) fn draw(seed: u64, index: u64, options: &SynthOptions) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ SEED);
        rng.set_stream(index);
        let relief = within(&mut rng, options.relief) as f32;
        let albedo_contrast = within(&mut rng, options.albedo_contrast) as f32;
        let lunar_weight_shift = within(&mut rng, options.lunar_weight_shift) as f32;
        let exponent = within(&mut rng, options.response_exponent) as f32;
        let pedestal = within(&mut rng, options.pedestal) as f32;
        let stripes_m = within(&mut rng, options.coarse_stripes_m);
        let response = Response { exponent, pedestal };
        Self { relief, albedo_contrast, lunar_weight_shift, response, stripes_m, stripes: rng }
    }
}

/// Uniform between the two ends, which may coincide.
pub(super) fn within(rng: &mut ChaCha8Rng, (low, high): (f64, f64)) -> f64 {
    low + (high - low) * rng.random::<f64>()
}
