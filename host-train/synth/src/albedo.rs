//! Albedo that random fields and craters lack: bright slopes, dark floors, units with sharp borders, rays and streaks, mottles (our choice).
//!
//! Steep ground on the Moon is fresh and bright; on Mars sand is dark and lies low. A network that knows only soft albedo takes all of it for
//! slopes. Strengths are drawn from wide ranges, in the logarithm of the albedo, before the factor on its contrast.

use super::landform::Canvas;
use super::smooth::smooth;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// Weakest and strongest change of the logarithm of the albedo.
const TONE: (f64, f64) = (0.02, 0.25);
/// Mottles are weaker: they cover everything.
const MOTTLE: (f64, f64) = (0.01, 0.08);

/// Adds one or two features to the logarithm of the albedo of ground with these heights, metres. `rng` determines them.
pub(super) fn add(
    rng: &mut ChaCha8Rng,
    heights_m: &[f32],
    log_albedo: &mut [f32],
    [rows, cols]: [usize; 2],
    pixel_m: f64,
) {
    let mut canvas = Canvas { rng, rows, cols };
    for _ in 0..canvas.rng.random_range(1..=2) {
        let feature = match canvas.rng.random_range(0..5) {
            0 => bright_slopes(&mut canvas, heights_m, pixel_m as f32),
            1 => toned_heights(&mut canvas, heights_m),
            2 => units(&mut canvas),
            3 => streaks(&mut canvas),
            _ => mottles(&mut canvas),
        };
        log_albedo.iter_mut().zip(feature).for_each(|(log, change)| *log += change);
    }
}

/// Draws a tone, bright with probability `bright`.
fn tone(canvas: &mut Canvas, bright: f64) -> f32 {
    let size = canvas.length(TONE.0, TONE.1);
    if canvas.rng.random_bool(bright) { size } else { -size }
}

/// Ground steeper than some slope has another tone.
fn bright_slopes(canvas: &mut Canvas, heights_m: &[f32], pixel_m: f32) -> Vec<f32> {
    let (tone, blur) = (tone(canvas, 0.8), canvas.length(0.7, 5.0));
    let (from, width) = (canvas.within(0.0, 1.5), canvas.within(0.5, 2.0));
    let (rows, cols) = (canvas.rows, canvas.cols);
    let smoothed = smooth(heights_m.to_vec(), [rows, cols], blur);
    let slope = |at: usize| {
        let (row, col) = (at / cols, at % cols);
        let (above, below) = (row.saturating_sub(1), (row + 1).min(rows - 1));
        let (left, right) = (col.saturating_sub(1), (col + 1).min(cols - 1));
        let down = smoothed[below * cols + col] - smoothed[above * cols + col];
        let across = smoothed[row * cols + right] - smoothed[row * cols + left];
        0.5 * libm::hypotf(down, across) / pixel_m
    };
    let slopes: Vec<f32> = (0..heights_m.len()).map(slope).collect();
    // In units of the scene's own slopes: so every scene has some of them.
    let mean = slopes.iter().sum::<f32>() / slopes.len() as f32;
    let unit = mean.max(f32::MIN_POSITIVE);
    slopes.iter().map(|s| tone * ((s / unit - from) / width).clamp(0.0, 1.0)).collect()
}

/// Low ground is darker or brighter than high ground.
fn toned_heights(canvas: &mut Canvas, heights_m: &[f32]) -> Vec<f32> {
    let (tone, blur) = (tone(canvas, 0.5), canvas.length(0.7, 8.0));
    let smoothed = smooth(heights_m.to_vec(), [canvas.rows, canvas.cols], blur);
    let mean = smoothed.iter().map(|h| f64::from(*h)).sum::<f64>() / smoothed.len() as f64;
    let square = smoothed.iter().map(|h| (f64::from(*h) - mean).powi(2)).sum::<f64>() / smoothed.len() as f64;
    let (mean, spread) = (mean as f32, (square.sqrt() as f32).max(f32::MIN_POSITIVE));
    // In half of the scenes the border is up to as sharp as that of a lake of sand; in the others it is smooth.
    let sharp = if canvas.rng.random() { canvas.length(1.0, 12.0) } else { 1.0 };
    let level = canvas.within(-1.0, 1.0);
    smoothed.iter().map(|h| tone * libm::tanhf(0.5 * sharp * ((h - mean) / spread - level))).collect()
}

/// Patches with sharp borders, as of another rock.
fn units(canvas: &mut Canvas) -> Vec<f32> {
    let (tone, border) = (tone(canvas, 0.5), canvas.length(0.02, 0.5));
    canvas.patches(border).into_iter().map(|patch| tone * patch).collect()
}

/// Rays and wind streaks: waves that are much longer in one direction.
fn streaks(canvas: &mut Canvas) -> Vec<f32> {
    let (tone, wave_px, stretch) = (tone(canvas, 0.5), canvas.length(8.0, 60.0), canvas.within(3.0, 12.0));
    let angle = canvas.within(0.0, 1.0) * std::f32::consts::PI;
    let (noise, mask) = (canvas.stretched_noise(wave_px, stretch, angle), canvas.patches(0.6));
    noise.values().zip(mask).map(|(n, mask)| tone * mask * n.clamp(-1.0, 2.0)).collect()
}

/// Mottles of one wavelength.
fn mottles(canvas: &mut Canvas) -> Vec<f32> {
    let (size, wave_px) = (canvas.length(MOTTLE.0, MOTTLE.1), canvas.length(5.0, 60.0));
    canvas.noise(wave_px).values().map(|n| size * n).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    const SIZE: [usize; 2] = [120, 160];

    /// A ridge across the columns, 40 pixels wide.
    fn ridge() -> Vec<f32> {
        let [rows, cols] = SIZE;
        (0..rows * cols).map(|k| 30.0 * (-(((k % cols) as f32 - 80.0) / 20.0).powi(2)).exp()).collect()
    }

    #[test]
    fn features_are_bounded_and_repeatable() {
        let mut toned = 0;
        for seed in 0..80 {
            let draw = || {
                let mut log = vec![0.0; SIZE[0] * SIZE[1]];
                add(&mut ChaCha8Rng::seed_from_u64(seed), &ridge(), &mut log, SIZE, 2.0);
                log
            };
            let log = draw();
            assert!(log.iter().all(|v| v.is_finite() && v.abs() < 1.1), "seed {seed}");
            assert_eq!(log, draw());
            toned += usize::from(log.iter().any(|v| v.abs() > 0.02));
        }
        assert!(toned > 60, "{toned} of 80");
    }

    #[test]
    fn slopes_and_heights_have_their_tones() {
        let [_, cols] = SIZE;
        for seed in 0..20 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let mut canvas = Canvas { rng: &mut rng, rows: SIZE[0], cols };
            let slopes = bright_slopes(&mut canvas, &ridge(), 2.0);
            let at = |map: &[f32], col: usize| map[60 * cols + col].abs();
            assert!(
                at(&slopes, 66) > 0.01 && at(&slopes, 66) >= at(&slopes, 80) && at(&slopes, 5) < 1e-3,
                "seed {seed}"
            );
            let heights = toned_heights(&mut canvas, &ridge());
            assert!((heights[60 * cols + 80] - heights[60 * cols + 5]).abs() > 0.003, "seed {seed}");
        }
    }
}
