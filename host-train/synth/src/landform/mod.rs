//! Landforms that simple craters and random fields lack: blocks and mesas, terraces, ridges and rilles, dunes, knobs, complex craters (our
//! choice).
//!
//! A network that has seen craters alone takes every cliff for noise and flattens it. These forms are no model of a place. Sizes and slopes
//! are drawn from wide ranges, in pixels, because a network sees pixels.

mod blocks;
mod complex_craters;
mod dunes;
mod knobs;
mod levels;
mod noise;

use super::factors::within;
use super::smooth::smooth;
use noise::Noise;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// Share of the scenes with landforms that have two kinds of them.
const TWO_KINDS: f64 = 0.3;
/// Share of the scenes with landforms whose other relief is lower than usual, as between mesas on a plain.
const ON_A_PLAIN: f64 = 0.5;
/// Share of the scenes with landforms whose brightness follows their height.
const TONED: f64 = 0.5;
/// Share of the scenes with landforms that have patches of other brightness with sharp borders.
const PATCHED: f64 = 0.3;
/// Greatest change of the logarithm of the albedo by either, before the factor on the albedo's contrast.
const TONE: f64 = 0.12;

/// A grid on which forms are drawn, and their random stream.
pub(super) struct Canvas<'r> {
    pub rng: &'r mut ChaCha8Rng,
    pub rows: usize,
    pub cols: usize,
}

impl Canvas<'_> {
    pub(crate) fn within(&mut self, low: f64, high: f64) -> f32 {
        within(self.rng, (low, high)) as f32
    }

    /// Draws a length between two, all magnitudes alike.
    pub(crate) fn length(&mut self, low: f64, high: f64) -> f32 {
        libm::exp(within(self.rng, (libm::log(low), libm::log(high)))) as f32
    }

    pub(crate) fn noise(&mut self, wave_px: f32) -> Noise {
        Noise::draw(self.rng, [self.rows, self.cols], wave_px)
    }

    /// Draws waves that are `stretch` times as long in the direction `angle`, radians from the columns' to the rows'.
    pub(crate) fn stretched_noise(&mut self, wave_px: f32, stretch: f32, angle: f32) -> Noise {
        Noise::draw_stretched(self.rng, [self.rows, self.cols], wave_px, (stretch, angle))
    }

    /// Draws a mask of patches: 0 to 1, with borders as wide as `border`, in standard deviations of the noise beneath. They cover
    /// between a quarter and nine tenths of the ground in the mean.
    pub(crate) fn patches(&mut self, border: f32) -> Vec<f32> {
        let (wave_px, above) = (self.length(60.0, 400.0), self.within(-1.2, 0.6));
        self.noise(wave_px).values().map(|n| smooth_step((n - above) / border)).collect()
    }
}

/// Rises from 0 at 0 to 1 at 1, level at both.
fn smooth_step(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// Adds landforms to heights (metres) and to the logarithm of the albedo, both of `rows` x `cols` pixels of `pixel_m`. `rng` determines them.
pub(super) fn add(
    rng: &mut ChaCha8Rng,
    heights_m: &mut [f32],
    log_albedo: &mut [f32],
    [rows, cols]: [usize; 2],
    pixel_m: f64,
) {
    let mut canvas = Canvas { rng, rows, cols };
    let mut form = vec![0.0; heights_m.len()];
    let kinds = 1 + usize::from(canvas.rng.random_bool(TWO_KINDS));
    for _ in 0..kinds {
        let drawn = match canvas.rng.random_range(0..5) {
            0 | 1 => blocks::draw(&mut canvas),
            2 => levels::draw(&mut canvas),
            3 => dunes::draw(&mut canvas),
            _ => knobs::draw(&mut canvas),
        };
        form.iter_mut().zip(drawn).for_each(|(sum, height)| *sum += height);
    }
    let rounded = canvas.within(0.2, 1.2);
    let form = smooth(form, [rows, cols], rounded);
    if canvas.rng.random_bool(ON_A_PLAIN) {
        let lowered = canvas.within(0.1, 1.0);
        heights_m.iter_mut().for_each(|height| *height *= lowered);
    }
    heights_m.iter_mut().zip(&form).for_each(|(height, form)| *height += form * pixel_m as f32);
    if canvas.rng.random_bool(TONED) {
        let greatest = form.iter().fold(f32::MIN_POSITIVE, |most, v| most.max(v.abs()));
        let tone = canvas.within(-TONE, TONE) / greatest;
        log_albedo.iter_mut().zip(&form).for_each(|(log, form)| *log += tone * form);
    }
    if canvas.rng.random_bool(PATCHED) {
        let tone = canvas.within(-TONE, TONE);
        let patches = canvas.patches(0.1);
        log_albedo.iter_mut().zip(patches).for_each(|(log, patch)| *log += tone * patch);
    }
}

/// Adds complex craters to heights, metres, of pixels of `pixel_m`. `rng` determines them.
pub(super) fn add_complex_craters(
    rng: &mut ChaCha8Rng,
    heights_m: &mut Vec<f32>,
    [rows, cols]: [usize; 2],
    pixel_m: f64,
) {
    let mut canvas = Canvas { rng, rows, cols };
    let pixel_m = pixel_m as f32;
    heights_m.iter_mut().for_each(|height| *height /= pixel_m);
    complex_craters::strike(&mut canvas, heights_m);
    // Old craters are worn: most a little, some much.
    let worn = 0.5 + 4.0 * canvas.within(0.0, 1.0).powi(3);
    *heights_m = smooth(std::mem::take(heights_m), [rows, cols], worn);
    heights_m.iter_mut().for_each(|height| *height *= pixel_m);
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    const SIZE: [usize; 2] = [200, 240];

    /// Returns forms of a seed on level ground, metres, and the change of brightness.
    fn drawn(seed: u64, pixel_m: f64) -> (Vec<f32>, Vec<f32>) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (mut heights, mut tones) = (vec![0.0; SIZE[0] * SIZE[1]], vec![0.0; SIZE[0] * SIZE[1]]);
        add(&mut rng, &mut heights, &mut tones, SIZE, pixel_m);
        (heights, tones)
    }

    #[test]
    fn forms_have_slopes_of_loose_ground_and_sizes_in_pixels() {
        let (mut steep, mut toned) = (0, 0);
        for seed in 0..60 {
            let (heights, tones) = drawn(seed, 2.0);
            assert!(heights.iter().chain(&tones).all(|v| v.is_finite()));
            let rises = heights.windows(2).enumerate().filter(|(i, _)| (i + 1) % SIZE[1] != 0);
            let steepest = rises.map(|(_, w)| (w[1] - w[0]).abs() / 2.0).fold(0.0, f32::max);
            assert!(steepest < 3.0, "seed {seed}: {steepest}");
            steep += usize::from(steepest > 0.1);
            toned += usize::from(tones.iter().any(|tone| tone.abs() > 0.01));
            assert!(tones.iter().all(|tone| tone.abs() < 0.3), "seed {seed}");
            // The same form on pixels of another size has the same slopes.
            let (doubled, _) = drawn(seed, 4.0);
            let apart = heights.iter().zip(&doubled).map(|(a, b)| (2.0 * a - b).abs()).fold(0.0, f32::max);
            assert!(apart < 1e-3, "seed {seed}: {apart}");
        }
        assert!(steep > 45 && toned > 20, "{steep} steep, {toned} toned");
    }

    #[test]
    fn complex_craters_change_the_ground_and_keep_its_size() {
        let mut deepest: f32 = 0.0;
        for seed in 0..40 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let mut heights = vec![100.0; SIZE[0] * SIZE[1]];
            add_complex_craters(&mut rng, &mut heights, SIZE, 2.0);
            assert!(heights.len() == SIZE[0] * SIZE[1] && heights.iter().all(|v| v.is_finite()));
            let rises = heights.windows(2).enumerate().filter(|(i, _)| (i + 1) % SIZE[1] != 0);
            // Walls where craters overlap are the only cliffs.
            let cliffs = rises.filter(|(_, w)| (w[1] - w[0]).abs() > 2.0).count();
            assert!(cliffs * 100 < heights.len(), "seed {seed}: {cliffs} pixels steeper than 45 degrees");
            deepest = deepest.max(100.0 - heights.iter().copied().fold(f32::INFINITY, f32::min));
        }
        assert!((10.0..100.0).contains(&deepest), "{deepest}");
    }

    #[test]
    fn smooth_steps_are_level_at_both_ends() {
        assert_eq!([-1.0, 0.0, 0.5, 1.0, 2.0].map(smooth_step), [0.0, 0.0, 0.5, 1.0, 1.0]);
    }
}
