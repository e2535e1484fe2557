//! Complex craters: flat floors, terraced walls, uneven rims, central peaks. Bowls of the Moon's own scale are in [`crate::crater`].
//!
//! Where a pixel is tens of metres wide or more, an image is full of them. No model of a place: sizes are in pixels, and shapes are drawn from wide
//! ranges (our choice).

use super::{Canvas, smooth_step};
use rand::Rng;
use std::f32::consts::TAU;

/// Fewest and most craters of a scene; all magnitudes alike.
const NUMBER: (f64, f64) = (1.5, 45.0);
/// Smallest and greatest radius, pixels. Numbers fall with the radius.
const RADIUS: (f32, f32) = (6.0, 160.0);
/// Height of the rim over the ground around it, of the depth from rim to floor: a fifth on the Moon (Pike 1977), here a range.
const RIM: (f64, f64) = (0.05, 0.35);
/// Greatest slope of a wall before smoothing: loose rock stands at some 35 degrees.
const STEEPEST: f32 = 0.75;
/// Greatest slope of a terrace's riser over the mean slope of its wall.
const RISER: f32 = 3.0;
/// Harmonics of the outline.
const HARMONICS: usize = 5;

/// One crater. Lengths in pixels, radii as shares of the rim's.
struct Crater {
    row: f32,
    col: f32,
    radius: f32,
    depth: f32,
    floor: f32,
    rim: f32,
    /// Steps of the wall; 0: none.
    terraces: f32,
    /// Height over depth, and width, of the central peak; 0: none.
    peak: (f32, f32),
    /// How much of the older ground the crater wipes out inside.
    wiped: f32,
    /// Amplitude and phase of the outline's waves, from two lobes on.
    outline: [(f32, f32); HARMONICS],
}

impl Crater {
    fn draw(canvas: &mut Canvas) -> Self {
        let share = canvas.within(0.0, 1.0) * (1.0 - RADIUS.0 / RADIUS.1);
        let radius = RADIUS.0 / (1.0 - share);
        let floor = canvas.within(0.0, 0.75);
        let deep = canvas.length(0.03, 0.22) * 2.0 * radius;
        let terraced = canvas.rng.random_bool(0.4);
        let steepest = STEEPEST * (1.0 - floor) * radius / if terraced { RISER } else { 1.0 };
        let peaked = canvas.rng.random_bool(0.35);
        let uneven = canvas.within(0.0, 0.12);
        Self {
            row: canvas.within(-0.3, 1.3) * canvas.rows as f32,
            col: canvas.within(-0.3, 1.3) * canvas.cols as f32,
            radius,
            depth: deep.min(steepest),
            floor,
            rim: canvas.within(RIM.0, RIM.1),
            terraces: if terraced { canvas.within(1.5, 5.0) } else { 0.0 },
            peak: (if peaked { canvas.within(0.1, 0.6) } else { 0.0 }, canvas.within(0.06, 0.2)),
            wiped: canvas.within(0.0, 1.0),
            outline: std::array::from_fn(|n| {
                (uneven * canvas.within(-1.0, 1.0) / (1.0 + 0.5 * n as f32), canvas.within(0.0, 1.0) * TAU)
            }),
        }
    }

    /// Returns the height, and the share of older ground that is kept, at `x` radii from the centre.
    fn height(&self, x: f32) -> (f32, f32) {
        let rim = self.rim * self.depth;
        if x >= 1.0 {
            // Ejecta thin out with the cube of the distance (McGetchin et al. 1973), and end at three radii.
            return (rim * x.powi(-3) * smooth_step((3.0 - x) / 1.5), 1.0);
        }
        let mut up = ((x - self.floor) / (1.0 - self.floor)).max(0.0);
        if self.terraces > 0.0 {
            let (step, part) = ((up * self.terraces).floor(), (up * self.terraces).fract());
            up = (step + smooth_step(2.0 * part - 0.6)) / self.terraces;
        }
        let peak = self.peak.0 * libm::expf(-(x / self.peak.1).powi(2));
        let kept = 1.0 - self.wiped * smooth_step((1.0 - x) / 0.2);
        (rim + self.depth * (up.min(1.0) - 1.0 + peak), kept)
    }

    /// Returns the pixel's distance from the centre over that of the rim in its direction. `rough` is the local error of the outline.
    fn distance(&self, row: f32, col: f32, rough: f32) -> f32 {
        let (down, across) = (row - self.row, col - self.col);
        let angle = libm::atan2f(down, across);
        let waves =
            self.outline.iter().enumerate().map(|(n, (size, phase))| size * libm::cosf((n + 2) as f32 * angle + phase));
        libm::hypotf(down, across) / self.radius * (1.0 + waves.sum::<f32>() + rough)
    }
}

/// Adds craters to heights in pixels. Later ones wipe out earlier ones.
pub(super) fn strike(canvas: &mut Canvas, heights: &mut [f32]) {
    let number = canvas.length(NUMBER.0, NUMBER.1) as usize;
    let (rough, noises) = (canvas.within(0.0, 0.05), [24.0, 80.0].map(|wave_px| canvas.noise(wave_px)));
    for _ in 0..number {
        let crater = Crater::draw(canvas);
        let noise = &noises[usize::from(crater.radius > 40.0)];
        let reach = 3.2 * crater.radius;
        let span = |centre: f32, n: usize| {
            ((centre - reach).max(0.0) as usize).min(n)..((centre + reach).max(0.0) as usize + 1).min(n)
        };
        // What is wiped out becomes as high as the ground around is on average.
        let within =
            span(crater.row, canvas.rows).flat_map(|row| span(crater.col, canvas.cols).map(move |col| (row, col)));
        let places: Vec<(usize, f32)> = within
            .map(|(row, col)| {
                let at = row * canvas.cols + col;
                (at, crater.distance(row as f32, col as f32, rough * noise.at(at)))
            })
            .filter(|(_, x)| *x < 3.0)
            .collect();
        let mean = places.iter().map(|(at, _)| heights[*at]).sum::<f32>() / places.len().max(1) as f32;
        for (at, x) in places {
            let (height, kept) = crater.height(x);
            heights[at] = mean + kept * (heights[at] - mean) + height;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crater_has_floor_wall_rim_and_ejecta() {
        let crater = Crater {
            row: 0.0,
            col: 0.0,
            radius: 50.0,
            depth: 10.0,
            floor: 0.5,
            rim: 0.2,
            terraces: 0.0,
            peak: (0.0, 0.1),
            wiped: 1.0,
            outline: [(0.0, 0.0); HARMONICS],
        };
        let at = |x: f32| crater.height(x).0;
        assert!((at(0.0) + 8.0).abs() < 1e-4 && at(0.4) == at(0.0), "a level floor, rim to floor is the depth");
        assert!(at(0.6) < at(0.8) && (at(1.0) - 2.0).abs() < 1e-4 && (at(0.999_9) - 2.0).abs() < 1e-2);
        assert!(at(1.5) < 0.4 * at(1.0) && at(3.0) == 0.0);
        assert_eq!((crater.height(0.1).1, crater.height(1.1).1), (0.0, 1.0), "older ground goes inside alone");
        assert!((crater.distance(30.0, 40.0, 0.0) - 1.0).abs() < 1e-6);
        let peaked = Crater { peak: (0.5, 0.1), terraces: 3.0, ..crater };
        assert!((peaked.height(0.0).0 + 3.0).abs() < 1e-3);
        let walls: Vec<f32> = (50..100).map(|x| peaked.height(x as f32 / 100.0).0).collect();
        assert!(walls.windows(2).all(|w| w[1] >= w[0] - 1e-3), "terraces never fall");
        assert!(walls.windows(2).filter(|w| w[1] - w[0] < 1e-3).count() > 8, "and have level parts");
    }
}
