//! Reflectance of a slope: Lunar–Lambert, seen from straight above, with its derivatives.

use elunar_base::{Error, Result};
use elunar_core::terrain::lunar_lambert_weight;

/// Direction to the Sun, and its Lunar–Lambert weight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SfsLight {
    /// Unit vector towards the Sun: components along columns (east), along rows (south), and up.
    towards: [f64; 3],
    /// The Lunar–Lambert weight L.
    weight: f64,
}

/// Reflectance of a slope, and its derivatives with respect to the slope's two components.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shade {
    /// Reflectance per unit albedo.
    pub value: f64,
    /// Derivative with respect to the gradient along columns (east).
    pub by_east: f64,
    /// Derivative with respect to the gradient along rows (south).
    pub by_south: f64,
}

impl SfsLight {
    /// Makes the light from `azimuth_deg` (clockwise from the grid's up) and `elevation_deg` above the horizon. Seen from straight above,
    /// the phase angle is 90° minus the elevation. L is McEwen's polynomial of the phase angle (1991), clamped to [0, 1].
    ///
    /// # Errors
    /// [`Error::Usage`] unless the azimuth is finite and the elevation above 0 and at most 90°.
    pub fn new(azimuth_deg: f64, elevation_deg: f64) -> Result<Self> {
        if !(azimuth_deg.is_finite() && elevation_deg > 0.0 && elevation_deg <= 90.0) {
            let found = format!("{azimuth_deg} and {elevation_deg} found");
            return Err(Error::usage(format!(
                "Sun: a finite azimuth and an elevation above 0 and at most 90 degrees expected, {found}"
            )));
        }
        let (sin_az, cos_az) = azimuth_deg.to_radians().sin_cos();
        let (sin_el, cos_el) = elevation_deg.to_radians().sin_cos();
        let weight = lunar_lambert_weight(90.0 - elevation_deg);
        Ok(Self { towards: [sin_az * cos_el, -cos_az * cos_el, sin_el], weight })
    }

    /// Returns the reflectance of ground that rises by `east` and `south` (metres per metre):
    ///
    /// R = 2 L u / (u + 1) + (1 − L) u / N, with N = |(−east, −south, 1)|, μ = 1 / N and μ0 = u / N the cosines towards camera and Sun.
    ///
    /// Ground that faces away from the Sun (u < 0) is dark. Both terms continue below zero there, the first one linearly, so that a solver
    /// still finds the direction in which brightness increases. Value and derivatives are continuous. The Ames Stereo Pipeline does not
    /// clamp either.
    #[must_use]
    pub fn shade(&self, east: f64, south: f64) -> Shade {
        let [to_east, to_south, to_up] = self.towards;
        let u = to_up - east * to_east - south * to_south;
        let square = 1.0 + east * east + south * south;
        let per_length = 1.0 / square.sqrt();
        let (first, first_by_u) = if u > 0.0 { (u / (1.0 + u), 1.0 / ((1.0 + u) * (1.0 + u))) } else { (u, 1.0) };
        let (lunar, lambert) = (2.0 * self.weight, 1.0 - self.weight);
        let by_u = lunar * first_by_u + lambert * per_length;
        let by_gradient = lambert * u * per_length / square;
        Shade {
            value: lunar * first + lambert * u * per_length,
            by_east: -by_u * to_east - by_gradient * east,
            by_south: -by_u * to_south - by_gradient * south,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Computes the reflectance from its definition, with vectors and angles.
    fn independent(azimuth_deg: f64, elevation_deg: f64, east: f64, south: f64) -> f64 {
        let (azimuth, elevation) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
        let sun = [elevation.cos() * azimuth.sin(), elevation.cos() * azimuth.cos(), elevation.sin()];
        let north = -south;
        let length = (1.0 + east * east + north * north).sqrt();
        let normal = [-east / length, -north / length, 1.0 / length];
        let incidence = normal[0] * sun[0] + normal[1] * sun[1] + normal[2] * sun[2];
        let phase_deg = sun[2].acos().to_degrees();
        let weight = 1.0 - 0.019 * phase_deg + 2.42e-4 * phase_deg.powi(2) - 1.46e-6 * phase_deg.powi(3);
        2.0 * weight * incidence / (incidence + normal[2]) + (1.0 - weight) * incidence
    }

    #[test]
    fn lit_slopes_follow_the_definition() {
        let mut lit = 0;
        for azimuth in [0.0, 37.0, 123.0, 251.0] {
            for elevation in [15.0, 42.0, 80.0] {
                let light = SfsLight::new(azimuth, elevation).unwrap();
                for (east, south) in [(0.0, 0.0), (0.3, -0.1), (-0.4, 0.5), (0.9, 0.2)] {
                    let expected = independent(azimuth, elevation, east, south);
                    if expected > 0.0 {
                        lit += 1;
                        assert!((light.shade(east, south).value - expected).abs() < 1e-12);
                    }
                }
            }
        }
        assert!(lit > 30);
    }

    #[test]
    fn derivatives_are_those_of_finite_differences_also_across_the_terminator() {
        let light = SfsLight::new(250.0, 25.0).unwrap();
        let step = 1e-6;
        let mut dark = 0;
        for i in -12..=12 {
            for j in -12..=12 {
                let (east, south) = (0.123 * f64::from(i), 0.117 * f64::from(j));
                let shade = light.shade(east, south);
                dark += usize::from(shade.value < 0.0);
                let by = |de: f64, ds: f64| {
                    (light.shade(east + de, south + ds).value - light.shade(east - de, south - ds).value) / (2.0 * step)
                };
                assert!((by(step, 0.0) - shade.by_east).abs() < 1e-5, "{east} {south}");
                assert!((by(0.0, step) - shade.by_south).abs() < 1e-5, "{east} {south}");
            }
        }
        assert!(dark > 50, "{dark}");
    }

    #[test]
    fn a_sun_below_the_horizon_is_refused() {
        for (azimuth, elevation) in [(0.0, 0.0), (10.0, -3.0), (0.0, 91.0), (f64::NAN, 30.0), (0.0, f64::NAN)] {
            let text = SfsLight::new(azimuth, elevation).unwrap_err().to_string();
            assert!(text.contains("elevation"), "{text}");
        }
    }
}
