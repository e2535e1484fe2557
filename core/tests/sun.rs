//! The Sun beside JPL's ephemeris DE421 (`core/fixtures/sun.py`).

use elunar_core::sun::{Body, SubSolarPoint, UtcTime, sub_solar};

/// Degrees by which azimuth or elevation may differ.
const TOLERANCE_DEG: f64 = 0.02;

/// Relative difference of distances.
const DISTANCE: f64 = 1e-3;

fn unit(point: &SubSolarPoint) -> [f64; 3] {
    let (lat, lon) = (point.lat_deg.to_radians(), point.lon_deg.to_radians());
    [lat.cos() * lon.cos(), lat.cos() * lon.sin(), lat.sin()]
}

/// The angle between two directions, degrees: no azimuth near the horizon and no elevation differs by more.
fn angle_deg(a: &SubSolarPoint, b: &SubSolarPoint) -> f64 {
    let (a, b) = (unit(a), unit(b));
    let chord: f64 = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
    (2.0 * (chord / 2.0).asin()).to_degrees()
}

#[test]
fn the_sun_is_where_the_ephemeris_has_it() {
    let (mut worst, mut count) = ([0.0f64; 2], 0);
    for line in include_str!("../fixtures/sun.csv").lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |i: usize| cells[i].parse::<f64>().unwrap();
        let time: UtcTime = cells[1].parse().unwrap();
        let expected = SubSolarPoint { lon_deg: number(2), lat_deg: number(3), distance_au: number(4) };
        let body = if cells[0] == "moon" { Body::Moon } else { Body::Mars };
        let found = sub_solar(body, time);
        let off = angle_deg(&found, &expected);
        assert!(off < TOLERANCE_DEG, "{line}: {found:?}, {off} degrees");
        assert!((found.distance_au / expected.distance_au - 1.0).abs() < DISTANCE, "{line}: {found:?}");
        assert!((-180.0..=180.0).contains(&found.lon_deg));
        worst[body as usize] = worst[body as usize].max(off);
        count += 1;
    }
    println!("largest angle between the directions, degrees: Moon {:.4}, Mars {:.4}", worst[0], worst[1]);
    assert_eq!(count, 400);
}

#[test]
fn directions_at_a_place() {
    let sun = SubSolarPoint { lat_deg: 1.0, lon_deg: 10.0, distance_au: 1.0 };
    let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-9, "{found} for {expected}");
    let at = |lat: f64, lon: f64| sun.seen_from(lat, lon);
    near(at(1.0, 10.0).elevation_deg, 90.0);
    near(at(-44.0, 10.0).elevation_deg, 45.0);
    near(at(-44.0, 10.0).azimuth_deg, 0.0);
    near(at(46.0, 10.0).azimuth_deg, 180.0);
    near(at(0.0, -80.0).elevation_deg, 0.0);
    near(at(0.0, -80.0).azimuth_deg, 89.0);
    near(at(0.0, 100.0).azimuth_deg, 271.0);
    near(at(-1.0, -170.0).elevation_deg, -90.0);
    near(at(90.0, 0.0).elevation_deg, 1.0);
}
