//! Heights of one level: Gauss–Newton steps with Levenberg–Marquardt damping. Conjugate gradients solve each step.

use super::level::{Cost, Level, LevelModel, Objective, dot};
use super::settings::SfsSettings;

/// The equations of a step are solved until their residual has fallen to this share.
const CG_TOLERANCE: f64 = 0.03;
/// Greatest number of conjugate gradient iterations of a step.
const CG_MOST: usize = 300;
/// Number of steps over which the fall of the cost is measured for convergence.
const WINDOW: usize = 3;
/// Damping, as a share of the diagonal: at least the first value after a failed step. Beyond the second value the solver gives up.
const DAMPING: (f64, f64) = (1e-3, 1e6);

/// One step, or the start of a level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    pub(super) cost: Cost,
    /// Number of conjugate gradient iterations, failed attempts included.
    pub(super) gradients: usize,
}

/// Why a level ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    /// The cost no longer falls.
    Converged,
    /// The greatest number of steps was reached.
    Steps,
}

/// Improves `heights_m` until the cost falls by less than the settings' tolerance over [`WINDOW`] steps. Calls `watch` with each step.
pub(super) fn solve(
    level: &Level,
    objective: &Objective,
    settings: &SfsSettings,
    heights_m: &mut Vec<f64>,
    mut watch: impl FnMut(&Step, &[f64]),
) -> End {
    let mut cost = objective.cost(level, heights_m);
    watch(&Step { cost, gradients: 0 }, heights_m);
    let mut totals = vec![cost.total()];
    let (mut damping, mut work) = (0.0, Conjugate::new(heights_m.len()));
    for _ in 0..settings.iterations {
        let model = objective.model(level, heights_m, cost.exposure);
        let mut gradients = 0;
        let improved = loop {
            gradients += work.solve(&model, damping);
            let tried: Vec<f64> = heights_m.iter().zip(&work.step).map(|(z, step)| z + step).collect();
            let found = objective.cost(level, &tried);
            if found.total() < cost.total() {
                damping = if damping < DAMPING.0 { 0.0 } else { 0.1 * damping };
                break Some((found, tried));
            }
            damping = (10.0 * damping).max(DAMPING.0);
            if damping > DAMPING.1 {
                break None;
            }
        };
        // No direction lowers the cost: it is at its minimum, to rounding.
        let Some((found, tried)) = improved else { return End::Converged };
        (cost, *heights_m) = (found, tried);
        watch(&Step { cost, gradients }, heights_m);
        totals.push(cost.total());
        let before = totals.iter().rev().nth(WINDOW).copied();
        if before.is_some_and(|before| before - cost.total() <= settings.tolerance * before) {
            return End::Converged;
        }
    }
    End::Steps
}

/// Conjugate gradients with the diagonal as preconditioner, and scratch memory.
struct Conjugate {
    step: Vec<f64>,
    residual: Vec<f64>,
    direction: Vec<f64>,
    image: Vec<f64>,
    scaled: Vec<f64>,
}

impl Conjugate {
    fn new(count: usize) -> Self {
        let zeros = || vec![0.0; count];
        Self { step: zeros(), residual: zeros(), direction: zeros(), image: zeros(), scaled: zeros() }
    }

    /// Solves (matrix + damping diagonal) step = -gradient from 0. Returns the number of iterations.
    fn solve(&mut self, model: &LevelModel, damping: f64) -> usize {
        self.step.fill(0.0);
        for (r, g) in self.residual.iter_mut().zip(&model.gradient) {
            *r = -g;
        }
        let inverse: Vec<f64> = model.diagonal.iter().map(|d| 1.0 / (d * (1.0 + damping))).collect();
        let scale = |scaled: &mut [f64], residual: &[f64]| {
            for ((s, r), i) in scaled.iter_mut().zip(residual).zip(&inverse) {
                *s = r * i;
            }
        };
        scale(&mut self.scaled, &self.residual);
        self.direction.copy_from_slice(&self.scaled);
        let mut along = dot(&self.residual, &self.scaled);
        let enough = CG_TOLERANCE * CG_TOLERANCE * along;
        for done in 0..CG_MOST {
            if along <= enough || along <= 0.0 {
                return done;
            }
            model.apply(&self.direction, &mut self.image);
            if damping > 0.0 {
                for ((image, p), d) in self.image.iter_mut().zip(&self.direction).zip(&model.diagonal) {
                    *image += damping * d * p;
                }
            }
            let length = along / dot(&self.direction, &self.image);
            for (step, p) in self.step.iter_mut().zip(&self.direction) {
                *step += length * p;
            }
            for (r, image) in self.residual.iter_mut().zip(&self.image) {
                *r -= length * image;
            }
            scale(&mut self.scaled, &self.residual);
            let next = dot(&self.residual, &self.scaled);
            let share = next / along;
            along = next;
            for (p, s) in self.direction.iter_mut().zip(&self.scaled) {
                *p = s + share * *p;
            }
        }
        CG_MOST
    }
}
