//! Craters: their number, their ages, and their shapes at these ages.
//!
//! *Shape.* A fresh simple crater (Fassett & Thomson 2014, d/D = 0.22) decays by topographic diffusion, the effect of micrometeorites:
//! `∂h/∂t = κ ∇²h`. In units of the radius the age is one number, `τ = κt/R²`, so one radial solution serves all craters ([`Profiles`]).
//! *Number.* Small craters are in equilibrium, `N(>r) = 0.0084 r^-2` per m². Each new one erases an old one, so their ages are uniform.
//! Craters that are too old to be counted are also made, up to [`TAU_ERASED`]. Above the saturation diameter the production function
//! applies, `N ∝ r^-3.2`, and ages are uniform over the age of the surface.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Poisson, StandardNormal};
use std::f64::consts::TAU;

/// Equilibrium: craters per m² with a radius above 1 m, extrapolated (336 per km² wider than 10 m).
const EQUILIBRIUM_PER_M2: f64 = 0.0084;
/// Exponent of the equilibrium distribution.
const EQUILIBRIUM_EXPONENT: f64 = 2.0;
/// Exponent of the production function of small craters.
const PRODUCTION_EXPONENT: f64 = 3.2;
/// Largest radius, metres (our choice). Wider craters are regional slope within a tile.
const LARGEST_RADIUS_M: f64 = 600.0;
/// Diffusivity times age of the surface, m²: 5.5 m²/Myr for 3 Gyr (Fassett & Thomson 2014).
const SURFACE_KAPPA_T_M2: f64 = 5.5 * 3000.0;
/// Greatest age of a counted crater, in κt/R². At this age a fifth of the depth remains. The equilibrium number refers to these craters
/// (our reading).
const TAU_COUNTED: f64 = 0.3;
/// Age at which a crater is left out, in κt/R². About a tenth of its depth remains.
const TAU_ERASED: f64 = 0.6;
/// Depth over diameter of the profile below.
const PROFILE_DEPTH: f64 = 0.218;

/// One crater, in pixels of the domain.
#[derive(Debug, Clone, Copy)]
pub(super) struct Crater {
    /// Row of the centre.
    pub row: f64,
    /// Column of the centre.
    pub col: f64,
    /// Radius, metres.
    pub radius_m: f64,
    /// Age as κt/R².
    pub tau: f64,
    /// Depth over diameter when fresh.
    pub depth_ratio: f64,
    /// Elongation: long axis over mean axis, and its direction in radians.
    pub stretch: (f64, f64),
}

/// Returns the height of a fresh crater over its diameter, at `x` radii from the centre.
fn fresh(x: f64) -> f64 {
    if x < 0.2 {
        -0.181
    } else if x < 0.98 {
        -0.229 + 0.228 * x + 0.083 * x * x - 0.039 * x * x * x
    } else if x < 1.5 {
        0.188 - 0.187 * x + 0.018 * x * x + 0.015 * x * x * x
    } else {
        0.0
    }
}

/// Radial profiles of a decaying crater.
pub(super) struct Profiles {
    levels: Vec<Profile>,
}

/// Heights over diameter at one age, [`PER_RADIUS`] samples per radius.
struct Profile {
    tau: f64,
    heights: Vec<f32>,
    reach: f64,
}

/// Samples per radius in the tables.
const PER_RADIUS: usize = 40;
/// Number of radii over which the diffusion is solved.
const RADII: usize = 8;

impl Profiles {
    /// Solves the radial diffusion equation once, explicitly, and stores the profile at ages 0 to [`TAU_ERASED`].
    pub(super) fn new() -> Self {
        let n = RADII * PER_RADIUS;
        let dx = 1.0 / PER_RADIUS as f64;
        let mut heights: Vec<f64> = (0..=n).map(|k| fresh(k as f64 * dx)).collect();
        let mut levels = vec![Profile::new(0.0, &heights)];
        let (mut tau, mut next) = (0.0, 4e-4);
        let dtau = 0.2 * dx * dx;
        while next < 1.3 * TAU_ERASED {
            while tau < next {
                let old = heights.clone();
                heights[0] += 4.0 * dtau * (old[1] - old[0]) / (dx * dx);
                for k in 1..n {
                    let curvature = (old[k + 1] - 2.0 * old[k] + old[k - 1]) / (dx * dx);
                    let spread = (old[k + 1] - old[k - 1]) / (2.0 * dx) / (k as f64 * dx);
                    heights[k] += dtau * (curvature + spread);
                }
                tau += dtau;
            }
            levels.push(Profile::new(tau, &heights));
            next *= 1.35;
        }
        Self { levels }
    }

    /// Returns the profile with the nearest age.
    fn at(&self, tau: f64) -> &Profile {
        let after = self.levels.partition_point(|level| level.tau < tau).clamp(1, self.levels.len() - 1);
        let (young, old) = (&self.levels[after - 1], &self.levels[after]);
        if tau - young.tau < old.tau - tau { young } else { old }
    }
}

impl Profile {
    fn new(tau: f64, heights: &[f64]) -> Self {
        // The profile ends where heights fall below a thousandth of the diameter. The remaining height is faded out.
        let last = heights.iter().rposition(|h| h.abs() > 1e-3).unwrap_or(0);
        let len = (last + PER_RADIUS / 2).min(heights.len() - 1);
        let fade = |k: usize| (((len - k) as f64) / (PER_RADIUS / 2) as f64).min(1.0);
        let heights = (0..=len).map(|k| (heights[k] * fade(k)) as f32).collect();
        Self { tau, heights, reach: len as f64 / PER_RADIUS as f64 }
    }

    /// Returns height over diameter at `x` radii; zero beyond the reach.
    fn height(&self, x: f32) -> f32 {
        let position = x * PER_RADIUS as f32;
        let k = position as usize;
        match self.heights.get(k..k + 2) {
            Some(pair) => pair[0] + (pair[1] - pair[0]) * (position - k as f32),
            None => 0.0,
        }
    }
}

/// Draws the craters that reach into a domain of `rows` × `cols` pixels, with radii from 1.5 pixels on.
pub(super) fn population(
    rng: &mut ChaCha8Rng,
    rows: usize,
    cols: usize,
    pixel_m: f64,
    saturation_diameter_m: f64,
) -> Vec<Crater> {
    let saturation = saturation_diameter_m / 2.0;
    let mut craters = Vec::new();
    let mut low = 1.5 * pixel_m;
    while low < LARGEST_RADIUS_M {
        let high = (low * 1.3).min(LARGEST_RADIUS_M);
        // Craters with centres up to three radii outside are still visible inside.
        let border = 3.0 * high / pixel_m;
        let (height, width) = (rows as f64 + 2.0 * border, cols as f64 + 2.0 * border);
        let density = density_above(low, saturation) - density_above(high, saturation);
        let exponent = if low < saturation { EQUILIBRIUM_EXPONENT } else { PRODUCTION_EXPONENT };
        let uncounted = (oldest(low) / TAU_COUNTED).max(1.0);
        for _ in 0..count(rng, uncounted * density * height * width * pixel_m * pixel_m) {
            let share = 1.0 - rng.random::<f64>() * (1.0 - libm::pow(high / low, -exponent));
            let radius_m = low * libm::pow(share, -1.0 / exponent);
            let oldest = oldest(radius_m);
            let noise: f64 = StandardNormal.sample(rng);
            craters.push(Crater {
                row: rng.random::<f64>() * height - border,
                col: rng.random::<f64>() * width - border,
                radius_m,
                tau: rng.random::<f64>() * oldest,
                depth_ratio: (fresh_depth_ratio(radius_m) * (1.0 + 0.15 * noise)).clamp(0.06, 0.22),
                stretch: (1.0 + 0.12 * rng.random::<f64>(), rng.random::<f64>() * TAU),
            });
        }
        low = high;
    }
    craters
}

/// Returns the greatest age of a crater of this radius, in κt/R².
fn oldest(radius_m: f64) -> f64 {
    (SURFACE_KAPPA_T_M2 / (radius_m * radius_m)).min(TAU_ERASED)
}

/// Returns the number of craters per m² with a radius above `r` metres.
fn density_above(r: f64, saturation: f64) -> f64 {
    let equilibrium = |r: f64| EQUILIBRIUM_PER_M2 * libm::pow(r, -EQUILIBRIUM_EXPONENT);
    if r < saturation {
        equilibrium(r)
    } else {
        equilibrium(saturation) * libm::pow(r / saturation, -PRODUCTION_EXPONENT)
    }
}

/// Draws a Poisson count with the given mean.
fn count(rng: &mut ChaCha8Rng, mean: f64) -> usize {
    Poisson::new(mean).map_or(0, |poisson| poisson.sample(rng) as usize)
}

/// Returns depth over diameter of a fresh crater: 0.12 up to 20 m, rising to 0.2 from 400 m on (Sun et al. 2018; Pike).
fn fresh_depth_ratio(radius_m: f64) -> f64 {
    let share = (libm::log(2.0 * radius_m / 20.0) / libm::log(20.0)).clamp(0.0, 1.0);
    0.12 + 0.08 * share
}

/// Adds a crater's relief to `heights_m` and, if it is young, its bright ejecta to `log_albedo`.
pub(super) fn stamp(
    crater: &Crater,
    profiles: &Profiles,
    pixel_m: f64,
    heights_m: &mut [f32],
    log_albedo: &mut [f32],
    cols: usize,
) {
    let profile = profiles.at(crater.tau);
    let size_m = (2.0 * crater.radius_m * crater.depth_ratio / PROFILE_DEPTH) as f32;
    each_pixel(crater, profile.reach, pixel_m, heights_m, cols, |u, v, height| {
        *height += size_m * profile.height((u * u + v * v).sqrt());
    });
    let glow = (0.35 * libm::exp(-crater.tau / 0.006)) as f32;
    if glow > 0.05 && crater.radius_m > 3.0 * pixel_m {
        // Ejecta brightness falls with the square of the distance (our choice: slower than their thickness). Rays have more ejecta.
        let lobes = libm::cos(crater.stretch.1 * 7.0) as f32 * 3.0;
        each_pixel(crater, 5.0, pixel_m, log_albedo, cols, |u, v, albedo| {
            let (x, angle) = ((u * u + v * v).sqrt(), libm::atan2f(v, u));
            let ray = 0.5 + 0.5 * libm::sinf(5.0 * angle + lobes) * libm::cosf(8.0 * angle - lobes);
            let fall = x.max(1.0).powi(-2) * ((5.0 - x) / 4.0).min(1.0);
            *albedo += glow * fall * if x > 1.0 { ray } else { 0.7 };
        });
    }
}

/// Calls `change(u, v, value)` for each pixel within `reach` radii. (u, v) is the pixel's position relative to the centre, in radii.
fn each_pixel(
    crater: &Crater,
    reach: f64,
    pixel_m: f64,
    values: &mut [f32],
    cols: usize,
    change: impl Fn(f32, f32, &mut f32),
) {
    let rows = values.len() / cols;
    let radius = crater.radius_m / pixel_m;
    let extent = reach * radius * crater.stretch.0;
    let clip = |from: f64, to: f64, n: usize| {
        (from.ceil().max(0.0) as usize, (to.floor() + 1.0).clamp(0.0, n as f64) as usize)
    };
    let (first_row, end_row) = clip(crater.row - extent, crater.row + extent, rows);
    let (sin, cos) = libm::sincos(crater.stretch.1);
    let (along, across) = (1.0 / (radius * crater.stretch.0), crater.stretch.0 / radius);
    for row in first_row..end_row {
        let dr = row as f64 - crater.row;
        let half = (extent * extent - dr * dr).max(0.0).sqrt();
        let (first, end) = clip(crater.col - half, crater.col + half, cols);
        if first >= end {
            continue;
        }
        for (k, value) in values[row * cols + first..row * cols + end].iter_mut().enumerate() {
            let dc = (first + k) as f64 - crater.col;
            let (u, v) = (((dc * cos + dr * sin) * along) as f32, ((dr * cos - dc * sin) * across) as f32);
            change(u, v, value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn craters_keep_the_published_share_of_their_depth_after_three_billion_years() {
        let profiles = Profiles::new();
        let depth = |tau: f64| {
            let heights = &profiles.at(tau).heights;
            heights.iter().copied().fold(f32::MIN, f32::max) - heights[0]
        };
        // Fassett & Thomson 2014, abstract: a crater 1 km wide keeps 52 %, one 300 m wide 7 %.
        for (diameter_m, share) in [(1000.0f64, 0.52), (300.0, 0.07)] {
            let kept = depth(SURFACE_KAPPA_T_M2 / (diameter_m / 2.0).powi(2)) / depth(0.0);
            assert!((kept - share).abs() < 0.05, "{diameter_m} m keeps {kept}, published {share}");
        }
    }

    #[test]
    fn diffusion_keeps_the_volume() {
        let profiles = Profiles::new();
        let volume =
            |level: &Profile| level.heights.iter().enumerate().map(|(k, h)| k as f64 * f64::from(*h)).sum::<f64>();
        let fresh = volume(&profiles.levels[0]);
        for level in &profiles.levels {
            let change = volume(level) / fresh - 1.0;
            assert!(change.abs() < 0.1, "volume changed by {change} at age {}", level.tau);
        }
    }

    #[test]
    fn counted_craters_are_in_equilibrium() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        // Only centres inside 2 km x 2 km count.
        let craters = population(&mut rng, 1000, 1000, 2.0, 200.0);
        let inside = |c: &&Crater| (0.0..1000.0).contains(&c.row) && (0.0..1000.0).contains(&c.col);
        let counted = craters.iter().filter(inside).filter(|c| c.radius_m > 5.0 && c.tau < TAU_COUNTED).count();
        let per_km2 = counted as f64 / 4.0;
        assert!((per_km2 / 336.0 - 1.0).abs() < 0.1, "{per_km2} craters wider than 10 m per km², published 336");
    }

    #[test]
    fn a_fresh_crater_is_as_deep_as_it_should_be() {
        let crater = Crater { row: 50.0, col: 60.0, radius_m: 40.0, tau: 0.0, depth_ratio: 0.2, stretch: (1.0, 0.0) };
        let (mut heights_m, mut albedo) = (vec![0.0f32; 100 * 120], vec![0.0f32; 100 * 120]);
        stamp(&crater, &Profiles::new(), 2.0, &mut heights_m, &mut albedo, 120);
        let rim = heights_m.iter().copied().fold(f32::MIN, f32::max);
        let depth = rim - heights_m[50 * 120 + 60];
        assert!((depth - 0.2 * 80.0).abs() < 0.3, "{depth} m");
        assert!((heights_m[50 * 120 + 80] - rim).abs() < 0.3, "the rim is one radius from the centre");
        assert!(albedo[50 * 120 + 85] >= 0.0 && albedo[50 * 120 + 60] > 0.1);
    }
}
