//! Which light a network works under: the one rule, for ground, flight, strips and training.

use super::input::Illumination;
use crate::norm::{Light, LightFit, Mirror};

/// What is known of the Sun, degrees; `None`: unknown.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct KnownSun {
    /// Azimuth, clockwise from the grid's up.
    pub azimuth_deg: Option<f64>,
    /// Elevation above the horizon.
    pub elevation_deg: Option<f64>,
}

/// Where a light comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LightSource {
    /// The network knows any light.
    #[default]
    NotAsked,
    /// The Sun is known as far as the network asks.
    Given,
    /// Fitted to image and coarse DTM, at least in part.
    Fitted,
    /// Neither known nor found.
    Assumed,
}

/// A light, and where it comes from: the one rule, for ground, flight, strips and training.
///
/// [`Self::decide`] goes by what the network knows ([`Illumination`]), by what is known of the Sun ([`KnownSun`]), and by what image and
/// coarse DTM show ([`LightFit`]):
///
/// | network | azimuth | elevation | light | [`LightSource`] |
/// |---|---|---|---|---|
/// | any | | | none is asked for | `NotAsked` |
/// | north-west | known | | the quadrant of the azimuth | `Given` |
/// | north-west | unknown | | the quadrant of the fit | `Fitted` |
/// | given | known | known | the Sun's, its strength drawn to the fit | `Given` |
/// | given | | | what is known is kept, the rest is fitted | `Fitted` |
/// | either | | | [`Light::assumed`], where the fit finds no light | `Assumed` |
///
/// Where no light shows, one is assumed and the caller is told (our choice). The coarse DTM of such ground is nearly level, but craters and rocks
/// that only the image shows may lie on it. A network adds those; to keep the coarse heights would lose them all. If the Sun stands elsewhere
/// than assumed, they come out with wrong signs. So nobody assumes silently: [`LightSource::Assumed`] goes to whoever asked for the heights.
///
/// A scene has one light, and so has a strip. It is decided once, by a fit to as much of the ground as has been seen: a light that changes from
/// tile to tile makes steps at the seams. A tile that stands alone has a light of its own. [`TileLight`] says which of the two a tile is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lighting {
    /// The light of the ground as it lies, not mirrored.
    pub light: Light,
    /// Where it comes from.
    pub source: LightSource,
}

/// Which light a tile has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TileLight {
    /// Its own: what is known of the Sun, the rest fitted to the pixels of the tile that count.
    Own(KnownSun),
    /// That of the scene it is part of, decided before.
    Scene(Lighting),
}

impl Default for TileLight {
    /// The tile's own, under an unknown Sun.
    fn default() -> Self {
        Self::Own(KnownSun::default())
    }
}

impl Lighting {
    /// For networks that know any light.
    pub const NOT_ASKED: Self = Self { light: Light { east: 1.0, south: 1.0 }, source: LightSource::NotAsked };

    /// A light that is known.
    #[must_use]
    pub fn given(light: Light) -> Self {
        Self { light, source: LightSource::Given }
    }

    /// Whether [`Self::decide`] looks at the fit.
    #[must_use]
    pub fn wants_fit(illumination: Illumination, sun: KnownSun) -> bool {
        match illumination {
            Illumination::Any => false,
            Illumination::Northwest => sun.azimuth_deg.is_none(),
            Illumination::Given => true,
        }
    }

    /// The light of a scene for a network, by the rule above.
    #[must_use]
    pub fn decide(illumination: Illumination, sun: KnownSun, fit: &LightFit) -> Self {
        let KnownSun { azimuth_deg, elevation_deg } = sun;
        let found = match (illumination, azimuth_deg) {
            (Illumination::Any, _) => return Self::NOT_ASKED,
            // Only the quadrant matters: at any height of the Sun it is the same.
            (Illumination::Northwest, Some(azimuth_deg)) => Light::from_azimuth_deg(azimuth_deg).map(Self::given),
            (Illumination::Northwest, None) => fit.light().map(Self::fitted),
            (Illumination::Given, _) => fit.with_sun(azimuth_deg, elevation_deg).map(|light| {
                let known = azimuth_deg.is_some() && elevation_deg.is_some();
                if known { Self::given(light) } else { Self::fitted(light) }
            }),
        };
        found.unwrap_or(Self { light: Light::assumed(azimuth_deg), source: LightSource::Assumed })
    }

    fn fitted(light: Light) -> Self {
        Self { light, source: LightSource::Fitted }
    }

    /// How the ground is mirrored so that the Sun stands in the north-west quadrant; not at all for networks that know any light.
    #[must_use]
    pub fn mirror(&self) -> Mirror {
        match self.source {
            LightSource::NotAsked => Mirror::default(),
            _ => Mirror::from_azimuth_deg(self.light.azimuth_deg()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use LightSource::{Assumed, Fitted, Given, NotAsked};

    const COLS: usize = 64;

    /// Hills under a Sun at an azimuth, and what they show of it.
    fn fit(azimuth_deg: f64) -> LightFit {
        let light = Light::from_sun(azimuth_deg, 30.0).unwrap();
        let height = |r: f32, c: f32| 3.0 * (r / 9.0).sin() + 4.0 * ((c + r) / 11.0).cos();
        let at = |i: usize| ((i / COLS) as f32, (i % COLS) as f32);
        let heights: Vec<f32> = (0..COLS * COLS).map(|i| height(at(i).0, at(i).1)).collect();
        let shade = |(r, c): (f32, f32)| {
            let (x, y) = (height(r, c + 1.0) - height(r, c - 1.0), height(r + 1.0, c) - height(r - 1.0, c));
            50.0 + 12.5 * (light.east * x + light.south * y)
        };
        let image: Vec<f32> = (0..COLS * COLS).map(|i| shade(at(i))).collect();
        LightFit::of_tile(&image, &heights, None, COLS, 2.0, 5.0)
    }

    fn sun(azimuth_deg: Option<f64>, elevation_deg: Option<f64>) -> KnownSun {
        KnownSun { azimuth_deg, elevation_deg }
    }

    /// The table of [`Lighting`].
    #[test]
    fn the_source_is_that_of_the_rule() {
        use Illumination as I;
        let (seen, dark) = (fit(120.0), LightFit::default());
        for (illumination, sun, fit, source) in [
            (I::Any, sun(Some(10.0), Some(40.0)), seen, NotAsked),
            (I::Any, sun(None, None), dark, NotAsked),
            (I::Northwest, sun(Some(10.0), None), dark, Given),
            (I::Northwest, sun(None, Some(40.0)), seen, Fitted),
            (I::Northwest, sun(None, Some(40.0)), dark, Assumed),
            (I::Given, sun(Some(120.0), Some(40.0)), seen, Given),
            (I::Given, sun(Some(120.0), Some(40.0)), dark, Given),
            (I::Given, sun(Some(120.0), None), seen, Fitted),
            (I::Given, sun(None, Some(40.0)), seen, Fitted),
            (I::Given, sun(None, None), seen, Fitted),
            (I::Given, sun(Some(120.0), None), dark, Assumed),
            (I::Given, sun(None, Some(40.0)), dark, Assumed),
            (I::Given, sun(None, None), dark, Assumed),
            // From the other side the image shows no light at all.
            (I::Given, sun(Some(300.0), None), seen, Assumed),
            // These are no angles of a Sun that lights the ground.
            (I::Northwest, sun(Some(f64::NAN), None), seen, Assumed),
            (I::Given, sun(Some(120.0), Some(-2.0)), seen, Assumed),
        ] {
            let found = Lighting::decide(illumination, sun, &fit);
            assert_eq!(found.source, source, "{illumination:?} {sun:?}");
            // The fit matters where it is asked for, and only there.
            if !Lighting::wants_fit(illumination, sun) {
                assert_eq!(found, Lighting::decide(illumination, sun, &seen));
                assert_eq!(found, Lighting::decide(illumination, sun, &dark));
            }
            if source == Assumed {
                assert_eq!(found.light, Light::assumed(sun.azimuth_deg));
            }
        }
    }

    #[test]
    fn the_light_is_the_suns_or_the_fits() {
        let seen = fit(120.0);
        let decide = |illumination, azimuth, elevation| Lighting::decide(illumination, sun(azimuth, elevation), &seen);
        let given = decide(Illumination::Given, Some(120.0), Some(40.0));
        assert_eq!(Some(given.light), seen.with_sun(Some(120.0), Some(40.0)));
        assert!((given.light.azimuth_deg() - 120.0).abs() < 1e-3);
        assert_eq!(Some(decide(Illumination::Given, None, None).light), seen.light());
        assert_eq!(Some(decide(Illumination::Northwest, None, Some(40.0)).light), seen.light());
        for (azimuth_deg, rows, cols) in
            [(315.0, false, false), (45.0, false, true), (225.0, true, false), (135.0, true, true)]
        {
            let found = decide(Illumination::Northwest, Some(azimuth_deg), None);
            assert_eq!(found.mirror(), Mirror { rows, cols }, "{azimuth_deg}");
            // Whatever is assumed of the elevation.
            assert_eq!(Lighting::given(Light::from_sun(azimuth_deg, 3.0).unwrap()).mirror(), found.mirror());
            assert!(decide(Illumination::Any, Some(azimuth_deg), None).mirror().is_none());
        }
    }
}
