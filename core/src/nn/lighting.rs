//! The light for a network: one rule for ground, flight, strips and training.

use super::input::Illumination;
use crate::norm::{Light, LightEstimate, LightFit, Mirror};
use crate::words::Words;

/// Standard deviation of the logarithm of an assumed strength (our choice: as wide as that of Suns between 8 and 50 degrees).
const ASSUMED_SPREAD: f32 = 0.9;

/// The known angles of the Sun, degrees; `None` if unknown.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct KnownSun {
    /// Azimuth, clockwise from the grid's up.
    pub azimuth_deg: Option<f64>,
    /// Elevation above the horizon.
    pub elevation_deg: Option<f64>,
}

/// The origin of a light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LightSource {
    /// The network works with any light and takes none.
    #[default]
    NotAsked,
    /// The caller has stated every angle of the Sun that the network needs.
    Given,
    /// Fitted to image and coarse DTM, at least in part.
    Fitted,
    /// Neither known nor found by the fit.
    Assumed,
}

impl LightSource {
    const ALL: [Self; 4] = [Self::NotAsked, Self::Given, Self::Fitted, Self::Assumed];
}

/// A light and its origin: one rule for ground, flight, strips and training.
///
/// [`Self::decide`] depends on the light that the network knows ([`Illumination`]), on the known angles of the Sun ([`KnownSun`]), and on
/// the fit to image and coarse DTM ([`LightFit`]):
///
/// | network | azimuth | elevation | light | [`LightSource`] |
/// |---|---|---|---|---|
/// | any | | | none | `NotAsked` |
/// | north-west | known | | the quadrant of the azimuth | `Given` |
/// | north-west | unknown | | the quadrant of the fit | `Fitted` |
/// | given | known | known | that of the Sun, its strength drawn to the fit | `Given` |
/// | given | | | known angles are kept, the rest is fitted | `Fitted` |
/// | either | | | [`Light::assumed`], if the fit finds no light | `Assumed` |
///
/// A known azimuth is kept whatever the image shows, but the probability that the image shows the ground of the coarse DTM under it is not
/// ([`Self::related`]): where brightness falls towards the Sun it is near 0.
///
/// "given" stands for every guided [`Illumination`].
///
/// Where the fit finds no light, one is assumed and the caller learns it ([`LightSource::Assumed`]; our choice). The coarse DTM of such
/// ground is nearly level, but it may have craters and rocks that only the image shows. If the true Sun is elsewhere than assumed, the
/// heights of these have wrong signs. So an assumed light of unknown azimuth has no [`Self::trust`]: a network of weighed maps keeps the
/// coarse heights under it.
///
/// A scene has one light, and so has a strip. It is decided once, by a fit to all ground seen so far, because a light that jumps from
/// tile to tile makes steps at the seams. (On the ground, a scene whose Sun turns has a light that changes smoothly.) A single tile has a
/// light of its own. [`TileLight`] distinguishes the two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lighting {
    /// The light on the ground, not mirrored.
    pub light: Light,
    /// The origin of the light.
    pub source: LightSource,
    /// Share of the relief found under this light that is kept, 0 to 1 ([`LightEstimate::trust`]). Only networks of weighed maps use it.
    pub trust: f32,
    /// Probability that brightness follows the slopes of the coarse DTM at all ([`LightEstimate::related`]); 0 for an assumed light of unknown
    /// azimuth. [`Self::settle`] uses it, after networks of weighed maps.
    pub related: f32,
    /// Share of the contrast of long waves that is relief ([`LightEstimate::long_share`]). Only networks of weighed maps use it.
    pub long_share: Option<f32>,
    /// Standard deviation of the logarithm of the light's strength.
    pub log_strength_sd: f32,
    /// Standard deviation of the light's azimuth, degrees; 0 for a known azimuth, 180 for an assumed one.
    pub azimuth_sd_deg: f32,
}

/// The light of a tile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TileLight {
    /// The tile's own: known angles of the Sun are kept, the rest is fitted to the tile's valid pixels.
    Own(KnownSun),
    /// The light of the scene that the tile belongs to, decided before.
    Scene(Lighting),
}

impl Default for TileLight {
    /// Returns the tile's own light under an unknown Sun.
    fn default() -> Self {
        Self::Own(KnownSun::default())
    }
}

impl Default for Lighting {
    /// Returns the value for networks that know any light.
    fn default() -> Self {
        Self::NOT_ASKED
    }
}

impl Lighting {
    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        self.light.visit(words);
        words.choice(&mut self.source, &LightSource::ALL);
        let Self { trust, related, long_share, log_strength_sd, azimuth_sd_deg, .. } = self;
        [trust, related, log_strength_sd, azimuth_sd_deg].into_iter().for_each(|v| words.f32(v));
        words.option(long_share, 0.0, |v, words| words.f32(v));
    }

    /// The value for networks that know any light.
    pub const NOT_ASKED: Self = Self {
        light: Light { east: 1.0, south: 1.0 },
        source: LightSource::NotAsked,
        trust: 0.0,
        related: 1.0,
        long_share: None,
        log_strength_sd: 0.0,
        azimuth_sd_deg: 180.0,
    };

    /// Makes a given light, without uncertainty.
    #[must_use]
    pub fn given(light: Light) -> Self {
        Self {
            light,
            source: LightSource::Given,
            trust: 1.0,
            related: 1.0,
            long_share: None,
            log_strength_sd: 0.0,
            azimuth_sd_deg: 0.0,
        }
    }

    /// Returns whether [`Self::decide`] reads the fit.
    #[must_use]
    pub fn wants_fit(illumination: Illumination, sun: KnownSun) -> bool {
        match illumination {
            Illumination::Any => false,
            Illumination::Northwest => sun.azimuth_deg.is_none(),
            guided => guided.is_guided(),
        }
    }

    /// Decides the light of a scene for a network, by the rule above.
    #[must_use]
    pub fn decide(illumination: Illumination, sun: KnownSun, fit: &LightFit) -> Self {
        let KnownSun { azimuth_deg, elevation_deg } = sun;
        // For other networks a tile has no memory to find the axis.
        let fit = if illumination.is_guided() { *fit } else { fit.with_axis(None) };
        let found = match (illumination, azimuth_deg) {
            (Illumination::Any, _) => return Self::NOT_ASKED,
            // Only the quadrant matters; it does not depend on the elevation of the Sun.
            (Illumination::Northwest, Some(azimuth_deg)) => Light::from_azimuth_deg(azimuth_deg).map(Self::given),
            (Illumination::Northwest, None) => fit.estimate(None, None).map(Self::fitted),
            (_, _) => fit.estimate(azimuth_deg, elevation_deg).map(|found| {
                let known = azimuth_deg.is_some() && elevation_deg.is_some();
                let source = if known { LightSource::Given } else { LightSource::Fitted };
                Self { source, ..Self::fitted(found) }
            }),
        };
        found.unwrap_or_else(|| Self::assumed(azimuth_deg))
    }

    fn fitted(found: LightEstimate) -> Self {
        let LightEstimate { light, log_strength_sd, azimuth_sd_deg, trust, related, long_share } = found;
        Self { light, source: LightSource::Fitted, trust, related, long_share, log_strength_sd, azimuth_sd_deg }
    }

    /// Returns the assumed light. Its azimuth may be known, and its strength never is.
    fn assumed(azimuth_deg: Option<f64>) -> Self {
        let known = azimuth_deg.is_some_and(f64::is_finite);
        let (trust, azimuth_sd_deg) = if known { (1.0, 0.0) } else { (0.0, 180.0) };
        let (light, source) = (Light::assumed(azimuth_deg), LightSource::Assumed);
        Self { light, source, trust, related: trust, long_share: None, log_strength_sd: ASSUMED_SPREAD, azimuth_sd_deg }
    }

    /// Moves heights that were found under this light towards the coarse DTM, as far as it is likely that the image does not show its ground:
    /// the mean of both, weighted by their probabilities (our choice). Does nothing where [`Self::related`] is 1. Heights beyond the shorter
    /// slice are kept.
    pub fn settle(&self, heights_m: &mut [f32], coarse_m: &[f32]) {
        if self.related < 1.0 {
            for (z, coarse) in heights_m.iter_mut().zip(coarse_m) {
                *z = coarse + self.related * (*z - coarse);
            }
        }
    }

    /// Returns the light as the fit would state it.
    #[must_use]
    pub fn estimate(&self) -> LightEstimate {
        let Self { light, trust, related, long_share, log_strength_sd, azimuth_sd_deg, .. } = *self;
        LightEstimate { light, log_strength_sd, azimuth_sd_deg, trust, related, long_share }
    }

    /// Returns the mirroring that brings the Sun into the north-west quadrant; none for networks that know any light.
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

    /// The fit to hills under a Sun at an azimuth.
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
        LightFit::of_tile(&image[..], &heights, COLS, 2.0, 5.0)
    }

    fn sun(azimuth_deg: Option<f64>, elevation_deg: Option<f64>) -> KnownSun {
        KnownSun { azimuth_deg, elevation_deg }
    }

    /// Tests the table of [`Lighting`].
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
            // With the Sun on the other side the image shows no light.
            (I::Given, sun(Some(300.0), None), seen, Fitted),
            // These are not angles of a Sun that lights the ground.
            (I::Northwest, sun(Some(f64::NAN), None), seen, Assumed),
            (I::Given, sun(Some(120.0), Some(-2.0)), seen, Assumed),
        ] {
            let found = Lighting::decide(illumination, sun, &fit);
            assert_eq!(found.source, source, "{illumination:?} {sun:?}");
            // The fit matters only where it is asked for.
            if !Lighting::wants_fit(illumination, sun) {
                assert_eq!(found, Lighting::decide(illumination, sun, &seen));
                assert_eq!(found, Lighting::decide(illumination, sun, &dark));
            }
            if source == Assumed {
                assert_eq!(found.light, Light::assumed(sun.azimuth_deg));
            }
        }
    }

    /// Heights under a light that may be none are the mean of both cases.
    #[test]
    fn heights_settle_on_the_coarse_dtm_as_the_light_gets_doubtful() {
        let (coarse_m, found_m) = ([10.0, 20.0], [14.0, 18.0]);
        for (related, expected) in [(1.0, found_m), (0.25, [11.0, 19.5]), (0.0, coarse_m)] {
            let mut heights_m = found_m;
            Lighting { related, ..Lighting::given(Light { east: 1.0, south: 0.0 }) }.settle(&mut heights_m, &coarse_m);
            assert_eq!(heights_m, expected, "{related}");
        }
        let mut heights_m = found_m;
        Lighting::decide(Illumination::Weighed, KnownSun::default(), &LightFit::default())
            .settle(&mut heights_m, &coarse_m);
        assert_eq!(heights_m, coarse_m, "an assumed azimuth shows nothing");
        let told = Lighting::decide(Illumination::Weighed, sun(Some(120.0), None), &LightFit::default());
        assert_eq!(told.related, 1.0, "nothing speaks against a Sun that is told");
        let against = Lighting::decide(Illumination::Weighed, sun(Some(300.0), Some(30.0)), &fit(120.0));
        assert!(against.related < 1e-3, "a Sun on the other side: {against:?}");
    }

    #[test]
    fn the_light_is_the_suns_or_the_fits() {
        let seen = fit(120.0);
        let decide = |illumination, azimuth, elevation| Lighting::decide(illumination, sun(azimuth, elevation), &seen);
        let given = decide(Illumination::Given, Some(120.0), Some(40.0));
        assert_eq!(Some(given.light), seen.estimate(Some(120.0), Some(40.0)).map(|found| found.light));
        assert!((given.light.azimuth_deg() - 120.0).abs() < 1e-3);
        assert_eq!(
            Some(decide(Illumination::Given, None, None).light),
            seen.estimate(None, None).map(|found| found.light)
        );
        assert_eq!(
            Some(decide(Illumination::Northwest, None, Some(40.0)).light),
            seen.estimate(None, None).map(|found| found.light)
        );
        for (azimuth_deg, rows, cols) in
            [(315.0, false, false), (45.0, false, true), (225.0, true, false), (135.0, true, true)]
        {
            let found = decide(Illumination::Northwest, Some(azimuth_deg), None);
            assert_eq!(found.mirror(), Mirror { rows, cols }, "{azimuth_deg}");
            // The assumed elevation does not matter.
            assert_eq!(Lighting::given(Light::from_sun(azimuth_deg, 3.0).unwrap()).mirror(), found.mirror());
            assert!(decide(Illumination::Any, Some(azimuth_deg), None).mirror().is_none());
        }
    }
}
