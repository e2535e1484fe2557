//! The point of the Moon under the Sun (Meeus, *Astronomical Algorithms*, 2nd edition, chapters 25, 47 and 53).

use super::{SubSolarPoint, UtcTime, cos, sin};

/// Inclination of the Moon's equator to the ecliptic, degrees.
const INCLINATION_DEG: f64 = 1.54242;

/// Kilometres of an astronomical unit.
const AU_KM: f64 = 149_597_870.7;

/// Mean arguments of Sun and Moon, degrees.
struct Arguments {
    /// Elongation of the Moon.
    d: f64,
    /// Anomaly of the Sun.
    m: f64,
    /// Anomaly of the Moon.
    m_moon: f64,
    /// Distance of the Moon from its ascending node.
    f: f64,
    /// Longitude of the ascending node.
    node: f64,
    /// Julian centuries since J2000.
    t: f64,
}

impl Arguments {
    fn at(t: f64) -> Self {
        Self {
            d: 297.850_192_1 + 445_267.111_403_4 * t,
            m: 357.529_109_2 + 35_999.050_290_9 * t,
            m_moon: 134.963_396_4 + 477_198.867_505_5 * t,
            f: 93.272_095_0 + 483_202.017_523_3 * t,
            node: 125.044_547_9 - 1_934.136_289_1 * t,
            t,
        }
    }

    /// Apparent longitude of the Sun seen from the Earth, degrees, and its distance, astronomical units.
    fn sun(&self) -> (f64, f64) {
        let Self { m, t, .. } = *self;
        let e = 0.016_708_634 - 0.000_042_037 * t;
        let centre = (1.914_602 - 0.004_817 * t) * sin(m) + 0.019_993 * sin(2.0 * m) + 0.000_289 * sin(3.0 * m);
        let lon = 280.466_46 + 36_000.769_83 * t + centre;
        let distance_au = 1.000_001_018 * (1.0 - e * e) / (1.0 + e * cos(m + centre));
        (lon - 0.005_69 - 0.004_78 * sin(self.node), distance_au)
    }

    /// Longitude and latitude of the Moon seen from the Earth, degrees, and its distance, kilometres: to half a degree, of which a
    /// four-hundredth counts.
    fn moon(&self) -> (f64, f64, f64) {
        let Self { d, m, m_moon, f, node, .. } = *self;
        let evection = 1.274 * sin(2.0 * d - m_moon) + 0.658 * sin(2.0 * d) - 0.186 * sin(m);
        (f + node + 6.289 * sin(m_moon) + evection, 5.128 * sin(f), 385_001.0 - 20_905.0 * cos(m_moon))
    }

    /// Physical librations ρ, σ and τ (Eckhardt 1981), degrees: the terms above 0.001. The large terms of ρ and σ in F, which together are
    /// a constant tilt of 0.0224 degrees towards the Earth, are left out: they lead from the mean-Earth system to the principal axes.
    fn librations(&self) -> [f64; 3] {
        let Self { d, m, m_moon, f, node, t } = *self;
        let (k1, k2) = (119.75 + 131.849 * t, 2.0 * (m_moon - f));
        let rho = -0.02752 * cos(m_moon) + 0.00684 * cos(m_moon - 2.0 * f) - 0.00293 * cos(2.0 * f);
        let sigma = -0.02816 * sin(m_moon) - 0.00682 * sin(m_moon - 2.0 * f) - 0.00279 * sin(2.0 * f);
        let tau = 0.02520 * sin(m) + 0.00473 * sin(k2) - 0.00467 * sin(m_moon)
            + 0.00396 * sin(k1)
            + 0.00276 * sin(2.0 * (m_moon - d))
            + 0.00196 * sin(node)
            - 0.00183 * cos(m_moon - f)
            + 0.00115 * sin(m_moon - 2.0 * d);
        [rho, sigma, tau]
    }
}

pub(super) fn sub_solar(time: UtcTime) -> SubSolarPoint {
    let at = Arguments::at(time.terrestrial_days() / 36_525.0);
    let (sun_lon, distance_au) = at.sun();
    let (moon_lon, moon_lat, moon_km) = at.moon();
    // The Moon seen from the Sun: a triangle whose short side is the Moon's distance.
    let share = moon_km / (distance_au * AU_KM);
    let lon = sun_lon + 180.0 + share.to_degrees() * cos(moon_lat) * sin(sun_lon - moon_lon);
    let lat = share * moon_lat;
    // Optical libration; longitudes count from the mean node of date.
    let w = lon - 0.004_78 * -sin(at.node) - at.node;
    let (si, ci) = (sin(INCLINATION_DEG), cos(INCLINATION_DEG));
    let a = libm::atan2(sin(w) * cos(lat) * ci - sin(lat) * si, cos(w) * cos(lat)).to_degrees();
    let b = libm::asin(-sin(w) * cos(lat) * si - sin(lat) * ci).to_degrees();
    let [rho, sigma, tau] = at.librations();
    SubSolarPoint {
        lat_deg: b + sigma * cos(a) - rho * sin(a),
        lon_deg: a - at.f - tau + (rho * cos(a) + sigma * sin(a)) * sin(b) / cos(b),
        distance_au: distance_au * (1.0 - share * cos(sun_lon - moon_lon)),
    }
}
