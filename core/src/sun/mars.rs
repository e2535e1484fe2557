//! The point of Mars under the Sun (Allison and McEwen 2000, with the constants of NASA GISS's Mars24).

use super::{SubSolarPoint, UtcTime, cos, sin};

/// Perturbations by planets: amplitude in degrees, period in Julian years, phase in degrees.
const PERTURBATIONS: [[f64; 3]; 7] = [
    [0.0071, 2.2353, 49.409],
    [0.0057, 2.7543, 168.173],
    [0.0039, 1.1177, 191.837],
    [0.0037, 15.7866, 21.736],
    [0.0021, 2.1354, 15.704],
    [0.0020, 2.4694, 95.528],
    [0.0018, 32.8493, 49.095],
];

/// Sine of the obliquity.
const OBLIQUITY_SINE: f64 = 0.42565;

pub(super) fn sub_solar(time: UtcTime) -> SubSolarPoint {
    let days = time.terrestrial_days();
    let m = 19.3871 + 0.524_020_73 * days;
    let perturbed: f64 =
        PERTURBATIONS.iter().map(|[size, years, phase]| size * cos(0.985_626 * days / years + phase)).sum();
    let centre = (10.691 + 3.0e-7 * days) * sin(m)
        + 0.623 * sin(2.0 * m)
        + 0.050 * sin(3.0 * m)
        + 0.005 * sin(4.0 * m)
        + 0.0005 * sin(5.0 * m)
        + perturbed;
    let solar_lon = 270.3871 + 0.524_038_496 * days + centre;
    let equation = 2.861 * sin(2.0 * solar_lon) - 0.071 * sin(4.0 * solar_lon) + 0.002 * sin(6.0 * solar_lon) - centre;
    // Mean time at the prime meridian, in sols.
    let sols = (days - 4.5) / 1.027_491_251_7 + 44_796.0 - 0.000_962_6;
    let west = (sols - libm::floor(sols)) * 360.0 + equation + 180.0;
    let distance =
        1.00436 - 0.09309 * cos(m) - 0.004_336 * cos(2.0 * m) - 0.00031 * cos(3.0 * m) - 0.00003 * cos(4.0 * m);
    SubSolarPoint {
        lat_deg: libm::asin(OBLIQUITY_SINE * sin(solar_lon)).to_degrees(),
        lon_deg: -west,
        distance_au: 1.523_679_34 * distance,
    }
}
