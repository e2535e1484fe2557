//! A light that changes across a scene, as in a mosaic of many images or about a pole: a light for every neighbourhood.
//!
//! The scene is divided into parts, each with its own fit. If these fits differ from the light of the whole scene by more than their
//! uncertainty explains (chi squared), a tile is lit by the fit of its neighbourhood: the sum of all parts, weighted by a Gauss curve of
//! their distance. So the light changes smoothly from tile to tile. Otherwise the scene has one light (our choice).

use super::scene::Band;
use elunar_core::nn::Illumination;
use elunar_core::norm::{Light, LightFit};
use elunar_core::photoclinometry::Contrast;
use elunar_core::terrain::PixelSize;
use elunar_core::tile::{TILE_COLS, Window};
use elunar_net::illumination::{KnownSun, LightSource, Lighting};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Side of a part, in coarse pixels and in pixels: enough for a fit.
const SIDE_COARSE_PX: f32 = 16.0;
const SIDE_PX: usize = TILE_COLS;
/// Standard deviation of the Gauss curve, in sides of a part (our choice: with 1, slopes under a Sun that turns by 180 degrees over four
/// parts are 10 % worse).
const REACH: f64 = 0.6;
/// Weight of parts far away. They give the light where the neighbourhood is void.
const FAR: f64 = 1e-3;
/// What the lights of two parts under one Sun differ by beyond their noise, as a share of the strength: 0.2 is 20 % or 11 degrees (our choice,
/// as for the strength of a fit).
const SPREAD: f64 = 0.2;
/// The largest mean chi squared of parts under one light (our choice: 16 synthetic scenes under one Sun have 0.04 to 0.7, under a Sun that turns
/// by 60 degrees 1.2 to 3, by 90 degrees 2.9 to 7.4).
const CHI_SQUARED_MAX: f64 = 1.5;

/// A part of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Part {
    /// Row and column of its centre.
    centre_px: [f64; 2],
    light: LightFit,
    contrast: Contrast,
}

/// The parts of a scene, and what each shows of the light.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Parts {
    side_px: usize,
    coarse_px: f32,
    parts: Vec<Part>,
}

impl Parts {
    /// Makes the parts of a scene, of which none is read yet. `coarse_px` is the side of a coarse pixel, in pixels of the image.
    pub(super) fn new(coarse_px: f32) -> Self {
        Self { side_px: SIDE_PX.max((SIDE_COARSE_PX * coarse_px) as usize), coarse_px, parts: vec![] }
    }

    /// Adds the parts of a band.
    pub(super) fn add(&mut self, band: &Band, pixel: PixelSize) {
        let count = |n: usize| (n / self.side_px).max(1);
        let (down, across) = (count(band.rows), count(band.cols));
        let of = |i: usize| {
            let (i, j) = (i / across, i % across);
            let (top, bottom) = (band.rows * i / down, band.rows * (i + 1) / down);
            let (left, right) = (band.cols * j / across, band.cols * (j + 1) / across);
            let part = band.part(top..bottom, left..right);
            let (mut light, mut contrast) = (LightFit::default(), Contrast::default());
            light.add(&part.image[..], &part.coarse_m, part.cols, pixel, LightFit::cell_px(self.coarse_px));
            part.add_contrast(&mut contrast, self.coarse_px);
            let centre_px = [band.first as f64 + 0.5 * (top + bottom) as f64, 0.5 * (left + right) as f64];
            Part { centre_px, light, contrast }
        };
        self.parts.par_extend((0..down * across).into_par_iter().map(of));
    }

    /// Returns the mean chi squared of the parts under one light, and their number.
    fn chi_squared(&self, light: Light) -> (f64, usize) {
        let of = |part: &Part| part.light.with_axis(part.contrast.axis()).chi_squared(light, SPREAD);
        let (sum, count) = self.parts.iter().filter_map(of).fold((0.0, 0), |(sum, count), v| (sum + v, count + 1));
        (sum / f64::from(count.max(1)), count as usize)
    }

    /// Returns the fit about a row and column.
    fn about(&self, [row, col]: [f64; 2]) -> LightFit {
        let (mut light, mut contrast) = (LightFit::default(), Contrast::default());
        for part in &self.parts {
            let apart = (row - part.centre_px[0]).hypot(col - part.centre_px[1]) / (REACH * self.side_px as f64);
            let weight = (-0.5 * apart * apart).exp() + FAR;
            light.add_fit(&part.light, weight);
            contrast.add_weighted(&part.contrast, weight);
        }
        light.with_axis(contrast.axis())
    }
}

/// The light of every place of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneLight {
    /// The light of the whole scene.
    pub whole: Lighting,
    /// What the parts show, if the light changes.
    parts: Option<(Illumination, KnownSun, Parts)>,
}

impl SceneLight {
    /// Decides whether the light changes: the azimuth is unknown, the network is guided, and the parts differ.
    pub(super) fn new(whole: Lighting, illumination: Illumination, sun: KnownSun, parts: Parts) -> Self {
        let may = illumination.is_guided() && sun.azimuth_deg.is_none() && whole.source != LightSource::Assumed;
        let (chi_squared, count) = parts.chi_squared(whole.light);
        let changes = may && count > 1 && chi_squared > CHI_SQUARED_MAX;
        Self { whole, parts: changes.then_some((illumination, sun, parts)) }
    }

    /// Returns the light of a tile.
    #[must_use]
    pub fn of(&self, window: Window) -> Lighting {
        let Some((illumination, sun, parts)) = &self.parts else { return self.whole };
        let centre = [window.row as f64 + 0.5 * window.rows as f64, window.col as f64 + 0.5 * window.cols as f64];
        Lighting::decide(*illumination, *sun, &parts.about(centre))
    }

    /// Returns how the light changes across the scene; `None` if it does not.
    #[must_use]
    pub fn change(&self) -> Option<Change> {
        let (illumination, sun, parts) = self.parts.as_ref()?;
        let mut change = Change { turn_deg: [0.0; 2], strength: [1.0; 2] };
        for part in &parts.parts {
            let here = Lighting::decide(*illumination, *sun, &parts.about(part.centre_px)).light;
            let turn = (here.azimuth_deg() - self.whole.light.azimuth_deg() + 180.0).rem_euclid(360.0) - 180.0;
            change.turn_deg = widened(change.turn_deg, turn);
            change.strength = widened(change.strength, f64::from(here.strength() / self.whole.light.strength()));
        }
        Some(change)
    }
}

fn widened([low, high]: [f64; 2], value: f64) -> [f64; 2] {
    [low.min(value), high.max(value)]
}

/// How the light changes across a scene, relative to the light of the whole scene.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Change {
    /// Turn of the azimuth, degrees, least and greatest.
    pub turn_deg: [f64; 2],
    /// Factor on the strength, least and greatest.
    pub strength: [f64; 2],
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { turn_deg: [low, high], strength: [weak, strong] } = self;
        write!(
            f,
            "it changes across the scene, so every tile has that of its neighbourhood: azimuth {low:+.0} to {high:+.0} deg, "
        )?;
        write!(f, "strength {weak:.2} to {strong:.2} times this")
    }
}

#[cfg(test)]
mod tests;
