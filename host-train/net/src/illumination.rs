//! From where the Sun shines, and how a scene is mirrored so that it shines from where the network expects it.
//!
//! One image does not tell a bump lit from the left from a hollow lit from the right. The paper's network must find the Sun
//! within every tile; ours may be trained with the Sun in the north-west quadrant of the grid only, and a scene is mirrored
//! left–right and up–down to make that so (our choice: the shading of small relief then has one sign per axis, and training is
//! shorter by far). Mirroring turns light and shape together, so nothing is lost, and the result is mirrored back. With
//! [`Illumination::Given`] the network is also told how brightness answers to slope ([`Light`]), known from the Sun or fitted.

use crate::config::Illumination;
use elunar_core::norm::LightFit;
pub use elunar_core::norm::{Light, Turn};
use elunar_core::terrain::PixelSize;

/// What is known of the Sun, degrees: azimuth clockwise from the grid's up, elevation above the horizon.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct KnownSun {
    /// Azimuth.
    pub azimuth_deg: Option<f64>,
    /// Elevation.
    pub elevation_deg: Option<f64>,
}

/// How a scene is mirrored for a network that knows `illumination`, and its light then (which means nothing to one that knows any).
pub fn light_for(illumination: Illumination, sun: KnownSun, fit: &LightFit) -> (Turn, Light) {
    let light = match illumination {
        Illumination::Any => return (Turn::default(), Light::assumed(None)),
        Illumination::Northwest => fit.with_sun(sun.azimuth_deg, None),
        Illumination::Given => fit.with_sun(sun.azimuth_deg, sun.elevation_deg),
    };
    let light = light.unwrap_or_else(|| Light::assumed(sun.azimuth_deg));
    let turn = Turn::from_azimuth_deg(light.azimuth_deg());
    (turn, light.mirrored(turn))
}

/// A row-major map of `cols` pixels a row, mirrored.
pub fn turned<T: Copy>(turn: Turn, map: &[T], cols: usize) -> Vec<T> {
    let shape = (map.len() / cols.max(1), cols);
    (0..map.len()).map(|i| map[turn.source(i, shape)]).collect()
}

/// What a tile of `cols` columns shows of its light.
pub fn fit_of(image: &[f32], coarse_m: &[f32], cols: usize, pixel_m: f64, coarse_px: f32) -> LightFit {
    let mut fit = LightFit::default();
    fit.add(image, coarse_m, cols, PixelSize::square(pixel_m), LightFit::cell_px(coarse_px));
    fit
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_synth::{COARSE_PIXEL_M, Moon, SynthOptions};

    #[test]
    fn maps_are_mirrored_and_back() {
        let map = [1, 2, 3, 4, 5, 6];
        let turn = Turn { rows: true, cols: true };
        assert_eq!(turned(turn, &map, 3), [6, 5, 4, 3, 2, 1]);
        assert_eq!(turned(turn, &turned(turn, &map, 3), 3), map);
        assert_eq!(turned(Turn { rows: false, cols: true }, &map, 3), [3, 2, 1, 6, 5, 4]);
    }

    #[test]
    fn the_light_is_found_in_synthetic_scenes() {
        let options = SynthOptions { rows: 512, cols: 640, ..SynthOptions::default() };
        let moon = Moon::new(11, options).unwrap();
        let (mut azimuths, mut strengths) = (vec![], vec![]);
        for index in 0..24 {
            let tile = moon.tile(index);
            let coarse_px = (COARSE_PIXEL_M / tile.pixel_m) as f32;
            let fit = fit_of(&tile.image, &tile.coarse_m, tile.cols, tile.pixel_m, coarse_px);
            let found = fit.light().unwrap();
            let truth = Light::from_sun(tile.sun_azimuth_deg, tile.sun_elevation_deg).unwrap();
            azimuths.push(((found.azimuth_deg() - tile.sun_azimuth_deg + 180.0).rem_euclid(360.0) - 180.0).abs());
            strengths.push(f64::from(found.strength() / truth.strength()));
        }
        eprintln!("azimuth errors, degrees: {azimuths:.0?}; strength, found over true: {strengths:.2?}");
        let good = azimuths.iter().filter(|e| **e < 20.0).count();
        assert!(good >= 20, "{good} of 24 within 20 degrees: {azimuths:.0?}");
        let good = strengths.iter().filter(|s| (0.7..1.4).contains(*s)).count();
        assert!(good >= 20, "{good} of 24 within 0.7 to 1.4: {strengths:.2?}");
    }

    #[test]
    fn scenes_without_light_are_taken_as_lit_from_the_north_west() {
        let none = (Turn::default(), Light::assumed(None));
        let nothing = LightFit::default();
        for illumination in [Illumination::Any, Illumination::Northwest, Illumination::Given] {
            assert_eq!(light_for(illumination, KnownSun::default(), &nothing), none);
        }
        let sun = KnownSun { azimuth_deg: Some(100.0), elevation_deg: Some(25.0) };
        let (turn, light) = light_for(Illumination::Given, sun, &nothing);
        assert_eq!(turn, Turn { rows: true, cols: true });
        assert!((light.azimuth_deg() - 280.0).abs() < 1e-3);
        assert_eq!(light.strength(), Light::from_sun(100.0, 25.0).unwrap().strength());
        let azimuth_alone = KnownSun { elevation_deg: None, ..sun };
        assert_eq!(light_for(Illumination::Northwest, azimuth_alone, &nothing).0, turn);
    }
}
