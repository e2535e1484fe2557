//! Heights that a body has: a warning for DTMs that are made, and for those that are given.

use elunar_core::sun::Body;

/// A body and its ground.
struct Ground {
    /// Its name in messages, as an owner.
    whose: &'static str,
    /// Radii of spheres that are taken for it, metres.
    radii_m: std::ops::RangeInclusive<f64>,
    /// What its heights are, in words.
    heights: &'static str,
    /// Lowest and highest height above its sphere without a warning, metres (our choice).
    limits_m: (f32, f32),
}

/// The limits leave a margin for errors of DTMs. Those of Mars also cover its flattening: heights above a sphere are 20 km lower at the poles.
const BODIES: [Ground; 4] = [
    Ground {
        whose: "the Moon's",
        radii_m: Body::Moon.radius_m() - 2_000.0..=Body::Moon.radius_m() + 2_000.0,
        heights: "between -9,200 and 10,800 m",
        limits_m: (-12_000.0, 12_000.0),
    },
    Ground {
        whose: "those of Mars",
        radii_m: 3_374_000.0..=3_398_000.0,
        heights: "between -8,200 and 21,200 m above the areoid",
        limits_m: (-28_000.0, 28_000.0),
    },
    Ground {
        whose: "Mercury's",
        radii_m: 2_437_000.0..=2_442_000.0,
        heights: "between -5,400 and 4,500 m",
        limits_m: (-8_000.0, 8_000.0),
    },
    Ground {
        whose: "those of Venus",
        radii_m: 6_050_000.0..=6_053_000.0,
        heights: "between -3,000 and 11,500 m",
        limits_m: (-5_000.0, 14_000.0),
    },
];

/// Returns words about heights that the body of a sphere of `radius_m` does not have: what they are, and what they should be. `None` for
/// heights that it has, and for other bodies, about which nothing is known here.
#[must_use]
pub fn beyond(radius_m: Option<f64>, (low_m, high_m): (f32, f32)) -> Option<String> {
    let radius_m = radius_m.unwrap_or(Body::Moon.radius_m());
    let Ground { whose, heights, limits_m, .. } = BODIES.iter().find(|body| body.radii_m.contains(&radius_m))?;
    (low_m < limits_m.0 || high_m > limits_m.1)
        .then(|| format!("heights from {low_m} to {high_m} m, but {whose} are {heights}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_body_has_its_own_heights() {
        let moon = |low, high| beyond(Some(Body::Moon.radius_m()), (low, high));
        assert_eq!((moon(-9_200.0, 10_800.0), moon(-12_000.0, 12_000.0)), (None, None));
        assert!(
            moon(-12_001.0, 0.0).unwrap().contains("-12001 to 0 m, but the Moon's are between -9,200 and 10,800 m")
        );
        assert!(moon(0.0, 18_000.0).is_some() && beyond(None, (-18_000.0, 0.0)).is_some());
        let mars = |low, high| beyond(Some(3_396_190.0), (low, high));
        assert_eq!((mars(-8_200.0, 21_200.0), mars(-25_000.0, -15_000.0)), (None, None), "and its poles");
        assert!(mars(-40_000.0, 0.0).unwrap().contains("those of Mars"));
        assert!(beyond(Some(2_439_400.0), (-18_000.0, 0.0)).is_some());
        assert!(beyond(Some(6_051_800.0), (0.0, 18_000.0)).is_some());
        assert_eq!(beyond(Some(255_000.0), (-40_000.0, 40_000.0)), None, "Vesta's spheres and ellipsoids are many");
    }
}
