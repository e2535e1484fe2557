//! Projections against themselves and PROJ.

use super::*;
use elunar_core::sun::Body;
use elunar_testing::rasterio;

const SYSTEMS: [&str; 25] = [
    "+proj=longlat +R=1737400",
    "+proj=eqc +R=1737400",
    "+proj=eqc +lat_ts=26.1 +lon_0=180 +R=1737400",
    "+proj=eqc +lat_ts=-43 +lat_0=12 +lon_0=-33.25 +x_0=1000 +y_0=-2500.5 +R=1737400",
    "+proj=eqc +lat_ts=1 +lon_0=180 +x_0=70000 +R=1737400 +units=km",
    "+proj=eqc +lon_0=77 +R=3396190",
    "+proj=stere +lat_0=90 +R=1737400",
    "+proj=stere +lat_0=-90 +lon_0=0 +R=1737400",
    "+proj=stere +lat_0=-90 +lon_0=123.5 +k=0.994 +x_0=2000000 +y_0=-1e6 +R=1737400",
    "+proj=stere +lat_0=90 +lat_ts=71 +lon_0=-45 +R=3396190",
    "+proj=stere +lat_0=-90 +lat_ts=-80 +lon_0=10 +x_0=5000 +R=1737400 +units=km",
    "+proj=ortho +lat_0=26.1 +lon_0=3.6 +R=1737400",
    "+proj=ortho +lat_0=0 +lon_0=180 +R=1737400",
    "+proj=ortho +lat_0=-90 +lon_0=20 +x_0=1e6 +R=1737400 +units=km",
    // Zone 23 of the Lunar Transverse Mercator grid, south.
    "+proj=tmerc +lat_0=0 +lon_0=0 +k=0.999 +x_0=250000 +y_0=2500000 +R=1737400",
    "+proj=tmerc +lat_0=40 +lon_0=170 +R=3396190",
    "+proj=merc +lon_0=180 +lat_ts=30 +R=1737400",
    "+proj=merc +lon_0=-20 +k=0.9 +y_0=-3000 +R=1737400",
    "+proj=stere +lat_0=45 +lon_0=20 +k=0.99 +x_0=10 +R=1737400",
    "+proj=stere +lat_0=0 +lon_0=-60 +R=1737400",
    "+proj=sterea +lat_0=-33 +lon_0=100 +R=1737400",
    "+proj=sinu +lon_0=180 +R=1737400",
    "+proj=lcc +lat_1=30 +lat_0=30 +lon_0=5 +k_0=0.99 +x_0=7 +y_0=8 +R=1737400",
    "+proj=lcc +lat_1=-20 +lat_2=-60 +lat_0=-40 +lon_0=-5 +x_0=7000 +y_0=8 +R=1737400 +units=km",
    "+proj=lcc +lat_1=89.5 +lat_2=85 +lat_0=90 +lon_0=15 +R=1737400",
];

fn points() -> Vec<(f64, f64)> {
    let lons = [-180.0, -179.99, -123.4, -45.0, 0.0, 0.001, 33.3, 90.0, 179.9999, 180.0, 200.0, 359.5];
    let lats = [-90.0, -89.999, -80.0, -45.5, -1.0, 0.0, 12.345, 59.9, 80.0, 89.5, 90.0];
    lons.iter().flat_map(|&lon| lats.iter().map(move |&lat| (lon, lat))).collect()
}

fn of(text: &str) -> Projection {
    Projection::of(&Crs::parse(text).unwrap()).unwrap_or_else(|| panic!("{text}"))
}

#[test]
fn every_point_comes_back() {
    for text in SYSTEMS {
        let projection = of(text);
        let mut tried = 0;
        for (lon, lat) in points() {
            let (x, y) = projection.forward(lon, lat);
            let pole_is_a_line = ["longlat", "eqc", "=merc"].iter().any(|name| text.contains(name));
            // A pole has no longitude, and the antipode of a stereographic map no position.
            if !x.is_finite() || !pole_is_a_line && lat.abs() == 90.0 || x.hypot(y) > 1e9 {
                continue;
            }
            let (lon2, lat2) = projection.inverse(x, y);
            // Near the limb of an orthographic map, a position says little about the angle; near a pole, little about the longitude.
            let small = if text.contains("ortho") { 1e-5 } else { 1e-9 };
            let share = match projection.method {
                Method::Ported(_) => lat.to_radians().cos(),
                _ => 1.0,
            };
            assert!(
                wrapped(lon2 - lon).abs() * share < small && (lat2 - lat).abs() < small,
                "{text}: {lon} {lat} -> {lon2} {lat2}"
            );
            tried += 1;
        }
        let shown = if text.contains("ortho") { 45 } else { 80 };
        assert!(tried >= shown, "{text}: {tried}");
    }
}

#[test]
fn a_text_says_it_all() {
    for text in SYSTEMS {
        let projection = of(text);
        assert!(of(&projection.proj_text()).same_as(&projection), "{text}: {}", projection.proj_text());
        for other in SYSTEMS {
            assert_eq!(of(other).same_as(&projection), other == text, "{text}, {other}");
        }
    }
}

/// Beyond the edge of a map, formulas still give numbers.
#[test]
fn beyond_the_edge_is_no_position() {
    let moon = |text: &str| of(&format!("+proj={text} +R=1737400"));
    let r = 1_737_400.0;
    let quarter = r * std::f64::consts::FRAC_PI_2;
    for (text, shown, hidden) in [
        ("ortho +lat_0=10", (89.0, 0.0), (91.0, 0.0)),
        ("ortho +lat_0=10", (180.0, 80.5), (180.0, 79.5)),
        ("ortho +lat_0=90", (77.0, 0.0), (77.0, -0.001)),
        ("merc", (0.0, 89.99), (0.0, 90.0)),
        ("merc", (0.0, -89.99), (0.0, -90.0)),
        ("tmerc", (89.0, 0.0), (90.0, 0.0)),
        ("tmerc", (91.0, 3.0), (-90.0, 0.0)),
        ("stere +lat_0=45", (180.0, -44.0), (180.0, -45.0)),
        ("lcc +lat_1=30", (0.0, 90.0), (0.0, -90.0)),
    ] {
        let (a, b) = (moon(text).forward(shown.0, shown.1), moon(text).forward(hidden.0, hidden.1));
        assert!(a.0.is_finite() && a.1.is_finite(), "{text} {shown:?}");
        assert!(b.0.is_nan() && b.1.is_nan(), "{text} {hidden:?}: {b:?}");
    }
    for (text, shown, hidden) in [
        ("ortho +lat_0=10", (0.999 * r, 0.0), (1.001 * r, 0.0)),
        ("ortho +lat_0=10", (0.7 * r, 0.7 * r), (0.8 * r, 0.8 * r)),
        ("merc", (0.0, 5.0 * r), (0.0, 40.0 * r)),
        ("tmerc", (0.0, 1.999 * quarter), (0.0, 2.001 * quarter)),
        ("tmerc", (3.0 * r, 0.0), (40.0 * r, 0.0)),
        ("sinu", (1.999 * quarter, 0.0), (2.001 * quarter, 0.0)),
        ("sinu", (0.4 * quarter, 0.86 * quarter), (0.5 * quarter, 0.86 * quarter)),
        ("sinu", (0.0, 0.999 * quarter), (0.0, 1.001 * quarter)),
        ("lcc +lat_1=30", (0.1 * r, 0.1 * r), (0.1 * r, 4.0 * r)),
    ] {
        let (a, b) = (moon(text).inverse(shown.0, shown.1), moon(text).inverse(hidden.0, hidden.1));
        assert!(a.0.is_finite() && a.1.is_finite(), "{text} {shown:?}");
        assert!(b.0.is_nan() && b.1.is_nan(), "{text} {hidden:?}: {b:?}");
    }
    // A map that repeats itself does not end.
    let merc = moon("merc");
    let (x, y) = merc.forward(170.0, 20.0);
    let (lon, lat) = merc.inverse(x + 3.0 * merc.period().unwrap(), y);
    assert!((lon - 170.0).abs() < 1e-9 && (lat - 20.0).abs() < 1e-9, "{lon} {lat}");
    for value in [f64::NAN, f64::INFINITY, 1e300] {
        for text in SYSTEMS {
            let none = |(a, b): (f64, f64)| a.is_nan() || b.is_nan();
            assert!(none(of(text).inverse(value, value)) || text.contains("stere"), "{text} {value}");
            assert!(none(of(text).forward(0.0, value)), "{text} {value}");
        }
    }
}

#[test]
fn known_places() {
    // A quarter of the equator; a pole in the map of the other; the scale at the standard parallel.
    assert_eq!(of("+proj=eqc +R=1737400").forward(90.0, 0.0), (1_737_400.0 * std::f64::consts::FRAC_PI_2, 0.0));
    let south = of("+proj=stere +lat_0=-90 +R=1737400");
    assert_eq!(south.forward(0.0, -90.0), (0.0, 0.0));
    assert!(south.forward(0.0, 90.0).0.is_nan());
    let (x, y) = south.forward(90.0, 0.0);
    assert!(
        (x - 2.0 * 1_737_400.0).abs() < 1e-6 && y.abs() < 1e-6,
        "the equator at twice the radius, east to the right"
    );
    assert!(south.forward(0.0, -80.0).1 > 0.0 && of("+proj=stere +lat_0=90 +R=1737400").forward(0.0, 80.0).1 < 0.0);
    let b = of("+proj=stere +lat_0=90 +lat_ts=70 +R=1");
    let step = b.forward(0.0, 70.0).1 - b.forward(0.0, 70.001).1;
    assert!((step / -0.001_f64.to_radians() - 1.0).abs() < 1e-4, "{step}");
}

#[test]
fn points_that_do_not_exist_are_nan() {
    let plane = of("+proj=eqc +R=1737400");
    assert!(plane.forward(0.0, 90.5).0.is_nan() && plane.forward(f64::NAN, 0.0).0.is_nan());
    assert!(plane.inverse(0.0, 3e6).0.is_nan() && plane.inverse(f64::INFINITY, 0.0).1.is_nan());
    assert_eq!(plane.inverse(0.0, plane.forward(0.0, 90.0).1).1, 90.0);
}

#[test]
fn other_systems_are_not_guessed() {
    let moon = Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0);
    let change = |key: u16, value: u16| {
        let mut crs = moon.clone();
        let at = crs.directory[4..].chunks(4).position(|entry| entry[0] == key).unwrap() * 4 + 4;
        crs.directory[at + 3] = value;
        crs
    };
    assert!(Projection::of(&change(key::METHOD, 7)).is_some_and(|p| p.proj_text().contains("merc")));
    for method in (1..40).filter(|method| ![1, 7, 14, 16, 17, 21, 24].contains(method)) {
        assert!(Projection::of(&change(key::METHOD, method)).is_none(), "method {method}");
    }
    assert!(Projection::of(&change(key::ANGULAR_UNIT, 9101)).is_none(), "radians");
    let mut flat = moon.clone();
    flat.doubles[1] -= 2000.0;
    assert!(Projection::of(&flat).is_none(), "an ellipsoid");
    let mut turned = moon.clone();
    turned.doubles[2] = 5.0;
    assert!(Projection::of(&turned).is_none(), "another prime meridian");
    assert!(Projection::of(&Crs::default()).is_none());
}

/// The keys as GDAL reads them decide, not the text, so that writing is tested too. Then the same with GDAL's own keys.
const COMPARE: &str = "
from rasterio.warp import transform
def compare(i, geographic, text, points):
    crs = rasterio.open(f'keys{i}.tif').crs
    lon, lat = zip(*points)
    x, y = transform(geographic, crs, lon, lat)
    x2, y2 = transform(geographic, text, lon, lat)
    for row in zip(x, y, x2, y2):
        print(*map(repr, map(float, row)))
    with rasterio.open(f'gdal{i}.tif', 'w', driver='GTiff', width=1, height=1, count=1, dtype='uint8', crs=text,
                       transform=Affine(1, 0, 0, 0, -1, 0)) as d:
        d.write(np.ones((1, 1, 1), 'uint8'))
";

/// Comparison with PROJ through rasterio: our keys as GDAL reads them, and GDAL's as we do.
#[test]
fn proj_agrees_to_a_tenth_of_a_millimetre() {
    let folder = tempfile::tempdir().unwrap();
    let options = crate::geotiff::WriteOptions::heights("x");
    let file = |kind: &str, i: usize| folder.path().join(format!("{kind}{i}.tif"));
    let mut script = COMPARE.to_owned();
    let points_of = |text: &str| {
        let mut points = points();
        points.retain(|&(lon, lat)| of(text).forward(lon, lat).0.is_finite());
        points
    };
    for (i, text) in SYSTEMS.into_iter().enumerate() {
        let list: String = points_of(text).iter().map(|(lon, lat)| format!("({lon}, {lat}),")).collect();
        script += &format!("compare({i}, '+proj=longlat +R={}', '{text}', [{list}])\n", of(text).radius_m());
        let crs = Crs::parse(text).unwrap();
        let georef = crate::GeoRef { transform: [0.0, 1.0, 0.0, 0.0, 0.0, -1.0], crs };
        let raster = crate::Raster { rows: 1, cols: 1, samples: vec![1.0], georef: Some(georef) };
        crate::geotiff::write(&file("keys", i), &raster, &options).unwrap();
    }
    let Some(out) = rasterio(&script, folder.path()) else { return };
    let (mut compared, mut lines) = (0, out.lines());
    for (i, text) in SYSTEMS.into_iter().enumerate() {
        let ours = of(text);
        let gdals = crate::geotiff::read(file("gdal", i)).unwrap();
        crate::geotiff::write(&file("copy", i), &gdals, &options).unwrap();
        let gdals = gdals.georef.unwrap().crs;
        assert!(Projection::of(&gdals).is_some_and(|p| p.same_as(&ours)), "{text}: {gdals:?}");
        let unit_m = if text.contains("longlat") { 1.0_f64.to_radians() * ours.radius_m() } else { ours.unit_m };
        for (lon, lat) in points_of(text) {
            let line = lines.next().expect("a line for every point");
            let n: Vec<f64> = line.split_whitespace().map(|v| v.parse().unwrap()).collect();
            let (x, y) = ours.forward(lon, lat);
            if !(n[0].abs() < 1e9 && n[1].abs() < 1e9) || text.contains("longlat") && lon > 180.0 {
                continue;
            }
            // At half a turn from its meridian a map has two positions.
            let twice = 2.0 * (x - ours.false_origin.0);
            let at_seam = ((x - n[0]).abs() - ours.period().unwrap_or(twice.abs())).abs() * unit_m < 1e-3;
            for (px, py) in [(n[0], n[1]), (n[2], n[3])] {
                let off_m = if at_seam { (y - py).abs() } else { (x - px).hypot(y - py) } * unit_m;
                // Far from the pole, a stereographic map has few digits left: 1e-12 of the distance.
                assert!(
                    off_m <= 1e-4_f64.max(1e-12 * x.hypot(y) * unit_m),
                    "{text}: {lon} {lat}: {x} {y}, PROJ {px} {py}"
                );
                compared += 1;
            }
        }
    }
    let script =
        "for i in range(COUNT): assert rasterio.open(f'copy{i}.tif').crs == rasterio.open(f'gdal{i}.tif').crs, i";
    rasterio(&script.replace("COUNT", &SYSTEMS.len().to_string()), folder.path()).unwrap();
    println!("{compared} points compared");
    assert!(compared > 4000 && lines.next().is_none(), "{compared}");
}

/// Comparison with PROJ through rasterio: positions and points at random, also beyond the edges of the maps.
#[test]
fn proj_agrees_beyond_the_edges() {
    let folder = tempfile::tempdir().unwrap();
    let (mut shown, mut hidden, mut worst_m) = (0, 0, 0.0_f64);
    for text in SYSTEMS.iter().filter(|text| matches!(of(text).method, Method::Ported(_))) {
        let ours = of(text);
        let (x0, y0, side) = (ours.false_origin.0, ours.false_origin.1, 2.6 * ours.radius_m / ours.unit_m);
        let script = format!(
            "
import rasterio.warp
def transform(a, b, xs, ys):
    try:
        return rasterio.warp.transform(a, b, xs, ys)
    except Exception:
        if len(xs) == 1: return [np.inf], [np.inf]
        middle = len(xs) // 2
        parts = [transform(a, b, xs[part], ys[part]) for part in (slice(0, middle), slice(middle, None))]
        return [sum((list(part[axis]) for part in parts), []) for axis in (0, 1)]
geographic, system = '+proj=longlat +R={}', '{text}'
rng = np.random.default_rng(5)
lon, lat = rng.uniform(-180, 180, 200), np.degrees(np.arcsin(rng.uniform(-1, 1, 200)))
x, y = transform(geographic, system, lon, lat)
px, py = {x0} + rng.uniform(-1, 1, 200) * {side}, {y0} + rng.uniform(-1, 1, 200) * {side}
lon2, lat2 = transform(system, geographic, px, py)
bx, by = transform(geographic, system, np.array(lon2), np.array(lat2))
for row in zip(lon, lat, x, y, px, py, lon2, lat2, bx, by):
    print(*map(repr, map(float, row)))
",
            ours.radius_m,
        );
        let Some(out) = rasterio(&script, folder.path()) else { return };
        for line in out.lines() {
            let n: Vec<f64> = line.split_whitespace().map(|v| v.parse().unwrap()).collect();
            let (x, y) = ours.forward(n[0], n[1]);
            assert_eq!(x.is_nan(), n[2].is_infinite(), "{text}: {} {} -> {x} {y}, PROJ {} {}", n[0], n[1], n[2], n[3]);
            if x.is_finite() {
                worst_m =
                    worst_m.max((x - n[2]).hypot(y - n[3]) * ours.unit_m / (1.0 + 1e-8 * x.hypot(y) * ours.unit_m));
                shown += 1;
            }
            // PROJ also answers beyond the edge; then its point is shown elsewhere.
            let (lon, lat) = ours.inverse(n[4], n[5]);
            let away = (n[8] - n[4]).hypot(n[9] - n[5]) * ours.unit_m;
            let repeats = ours.period().is_some();
            if lon.is_nan() {
                assert!(away.is_nan() || away >= 1.0, "{text}: {} {}, PROJ {} {}", n[4], n[5], n[6], n[7]);
                hidden += 1;
                continue;
            }
            assert!(away < 1.0 || repeats, "{text}: {} {} -> {lon} {lat}, PROJ {} {}", n[4], n[5], n[6], n[7]);
            let on_sphere = |lon: f64, lat: f64| {
                let (lon, lat) = (lon.to_radians(), lat.to_radians());
                [lat.cos() * lon.cos(), lat.cos() * lon.sin(), lat.sin()]
            };
            let (a, b) = (on_sphere(lon, lat), on_sphere(n[6], n[7]));
            let off = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt() * ours.radius_m();
            worst_m = worst_m.max(off);
            shown += 1;
        }
    }
    println!("{shown} points and positions compared, {hidden} beyond an edge, worst {worst_m} m");
    assert!(worst_m < 1e-5 && shown > 4_000 && hidden > 600, "{shown} {hidden} {worst_m}");
}

/// Returns the map of a method of GeoTIFF on the Moon, with these keys.
fn map(method: u16, keys: &[(u16, f64)]) -> Option<Projection> {
    let mut crs = Crs {
        directory: vec![1, 1, 0, 4, 1024, 0, 1, 1, 3072, 0, 1, 32767, 3075, 0, 1, method, 2057, 34736, 1, 0],
        doubles: vec![1_737_400.0],
        ascii: String::new(),
    };
    for &(key, value) in keys {
        crs.directory.extend([key, 34736, 1, crs.doubles.len() as u16]);
        crs.directory[3] += 1;
        crs.doubles.push(value);
    }
    Projection::of(&crs)
}

#[test]
fn keys_that_make_no_map_are_refused() {
    use crate::crs::code::*;
    use crate::crs::key::*;
    let far = f64::INFINITY;
    for (method, keys) in [
        (SINUSOIDAL, &[(CENTRE_LAT, 0.0)][..]),
        (MERCATOR, &[(NAT_ORIGIN_LAT, 0.0)]),
        (MERCATOR, &[(STD_PARALLEL_1, 30.0)]),
        (LAMBERT_1SP, &[(NAT_ORIGIN_LAT, 30.0), (STD_PARALLEL_1, 30.0)]),
        (LAMBERT_2SP, &[(STD_PARALLEL_1, 20.0), (STD_PARALLEL_2, 60.0)]),
        (ORTHOGRAPHIC, &[(CENTRE_LON, 7.0)]),
        (TRANSVERSE_MERCATOR, &[(SCALE, 0.9)]),
        (POLAR_STEREOGRAPHIC, &[(NAT_ORIGIN_LAT, 90.0), (SCALE, 0.9)]),
        (EQUIRECTANGULAR, &[(FALSE_EASTING, 5.0), (FALSE_NORTHING, 6.0)]),
    ] {
        assert!(map(method, keys).is_some(), "{method} {keys:?}");
    }
    for (method, keys) in [
        (SINUSOIDAL, &[(CENTRE_LAT, 10.0)][..]),
        (MERCATOR, &[(NAT_ORIGIN_LAT, 10.0)]),
        (MERCATOR, &[(STD_PARALLEL_1, 30.0), (NAT_ORIGIN_LAT, 10.0)]),
        (MERCATOR, &[(STD_PARALLEL_1, 30.0), (SCALE, 0.9)]),
        (LAMBERT_1SP, &[(NAT_ORIGIN_LAT, 30.0), (STD_PARALLEL_1, 40.0)]),
        (LAMBERT_2SP, &[(STD_PARALLEL_1, 20.0), (STD_PARALLEL_2, 60.0), (SCALE, 0.9)]),
        (ORTHOGRAPHIC, &[(CENTRE_LON, far)]),
        (ORTHOGRAPHIC, &[(CENTRE_LAT, 100.0)]),
        (TRANSVERSE_MERCATOR, &[(SCALE, far)]),
        (TRANSVERSE_MERCATOR, &[(SCALE, 0.0)]),
        (POLAR_STEREOGRAPHIC, &[(NAT_ORIGIN_LAT, 90.0), (SCALE, far)]),
        (POLAR_STEREOGRAPHIC, &[(NAT_ORIGIN_LAT, 90.0), (SCALE, -1.0)]),
        (EQUIRECTANGULAR, &[(FALSE_EASTING, far)]),
        (EQUIRECTANGULAR, &[(FALSE_NORTHING, far)]),
        (EQUIRECTANGULAR, &[(SEMI_MAJOR, -1.0)]),
        (EQUIRECTANGULAR, &[(SEMI_MAJOR, far)]),
    ] {
        assert!(map(method, keys).is_none(), "{method} {keys:?}");
    }
    // A stereographic map about a pole is the polar one.
    let polar = Projection::of(&Crs::polar(Body::Moon.radius_m(), true)).unwrap();
    assert!(map(STEREOGRAPHIC, &[(CENTRE_LAT, -90.0)]).unwrap().same_as(&polar));
    // A scale beyond all maps: y has no number.
    let (x, y) = map(TRANSVERSE_MERCATOR, &[(SCALE, 1e305)]).unwrap().forward(0.0, 80.0);
    assert!(x.is_nan() && y.is_nan(), "{x} {y}");
}

#[test]
fn maps_differ_in_every_parameter() {
    let texts = [
        "+proj=eqc +lat_ts=20 +R=1737400",
        "+proj=eqc +lat_ts=20 +lat_0=5 +R=1737400",
        "+proj=eqc +lat_ts=20 +lon_0=5 +R=1737400",
        "+proj=eqc +lat_ts=20 +x_0=5 +R=1737400",
        "+proj=eqc +lat_ts=20 +y_0=5 +R=1737400",
        "+proj=eqc +lat_ts=20 +R=1737400 +units=km",
        "+proj=eqc +lat_ts=20 +R=1737500",
        "+proj=eqc +lat_ts=25 +R=1737400",
    ];
    for (i, a) in texts.iter().enumerate() {
        for (j, b) in texts.iter().enumerate() {
            assert_eq!(of(a).same_as(&of(b)), i == j, "{a} and {b}");
        }
    }
    let (lon, lat) = of(texts[0]).inverse(0.0, f64::NAN);
    assert!(lon.is_nan() && lat.is_nan(), "{lon} {lat}");
}
