//! Known shifts are found.

use super::csv;
use super::report::{ComparedTrack, Report, json, table};
use super::shift::{Fit, Shifted, TrackDtm};
use super::track::LaserSpot;
use elunar_core::sun::Body;
use elunar_raster::source::{self, InMemory};
use elunar_raster::{Crs, GeoRef, Projection, Raster, geotiff};
use elunar_testing::rasterio;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Returns the height of smooth terrain without symmetries; x and y in metres.
fn height(x: f64, y: f64) -> f64 {
    30.0 * (x / 60.0).sin() + 20.0 * (y / 45.0 + 0.7).cos() + 10.0 * ((x + 2.0 * y) / 37.0).sin() + 0.02 * x
}

/// Returns a DTM of 2 m pixels, far from the map's origin. `unit` is the map unit.
fn dtm(crs: Crs, rows: usize, cols: usize, unit: f64) -> (Raster, GeoRef) {
    let lat = if crs.is_projected() { 2000.0 } else { 0.0 };
    let georef = GeoRef { transform: [5000.0 * unit, 2.0 * unit, 0.0, lat * unit, 0.0, -2.0 * unit], crs };
    let sample = |i: usize| {
        let (x, y) = georef.centre((i / cols) as f64, (i % cols) as f64);
        height(x / unit, y / unit) as f32
    };
    (Raster { rows, cols, samples: (0..rows * cols).map(sample).collect(), georef: Some(georef.clone()) }, georef)
}

/// Returns a track down the middle. Its spots are `moved` metres beside the measured ground and `above` metres over it.
fn track(georef: &GeoRef, rows: usize, cols: usize, unit: f64, moved: (f64, f64), above: f64) -> Vec<LaserSpot> {
    let projection = Projection::of(&georef.crs).unwrap();
    let spot = |i: usize| {
        let row = 20.0 + i as f64 * (rows as f64 - 40.0) / 150.0;
        let (x, y) = georef.centre(row, cols as f64 / 2.0 + 0.2 * row);
        let (lon_deg, lat_deg) = projection.inverse(x - moved.0 * unit, y - moved.1 * unit);
        LaserSpot { lon_deg, lat_deg, height_m: height(x / unit, y / unit) + above, time_s: None }
    };
    (0..150).map(spot).collect()
}

fn fit(raster: Raster, track: &[LaserSpot], search_m: f64) -> Option<Fit> {
    let source = InMemory::new(raster, Some("m".into()), "memory");
    TrackDtm::new(&source, "d.tif", search_m).unwrap().fit(track, 10).unwrap()
}

#[test]
fn planted_shifts_are_found() {
    let systems = [
        (Crs::equirectangular(Body::Moon.radius_m(), 0.0, 180.0), 1.0),
        (Crs::polar(Body::Moon.radius_m(), true), 1.0),
        (Crs::parse("+proj=ortho +lat_0=26 +lon_0=3 +R=1737400").unwrap(), 1.0),
        (Crs::parse("+proj=tmerc +lat_0=-70 +lon_0=3 +k=0.999 +R=1737400").unwrap(), 1.0),
        (Crs::parse("+proj=merc +lon_0=180 +R=1737400 +units=km").unwrap(), 1e-3),
        (Crs::geographic(1_737_400.0), 1.0 / 1_737_400f64.to_radians()),
    ];
    for (crs, unit) in systems {
        for moved in [(0.0, 0.0), (7.0, -4.0), (-13.0, 11.0)] {
            let (raster, georef) = dtm(crs.clone(), 200, 140, unit);
            let track = track(&georef, 200, 140, unit, moved, 0.0);
            let fit = fit(raster, &track, 20.0).unwrap();
            // The error of bilinear interpolation is some millimetres on this terrain. Spots lie within a millimetre of half pixels.
            for at in [fit.median_removed, fit.eq_18] {
                assert!((at.x_m - moved.0).abs() < 1e-3 && (at.y_m - moved.1).abs() < 1e-3, "{moved:?}: {fit:?}");
                assert!(at.std_m < 0.02 && at.std_median_removed_m <= at.std_m && !at.at_edge, "{fit:?}");
            }
            let Shifted { std_m, std_median_removed_m, .. } = fit.unshifted;
            assert!(moved == (0.0, 0.0) || std_m > 1.0 && std_median_removed_m > 1.0, "{fit:?}");
            // Some points near the edge cannot be moved by every shift.
            assert!(fit.points >= 100 && fit.points <= 150, "{fit:?}");
        }
    }
}

#[test]
fn the_deviation_is_that_of_eq_18() {
    let (raster, georef) = dtm(Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0), 200, 140, 1.0);
    let mut track = track(&georef, 200, 140, 1.0, (0.0, 0.0), 0.0);
    track.iter_mut().enumerate().for_each(|(i, p)| p.height_m += if i % 2 == 0 { 1.0 } else { -2.0 } - 0.25);
    // Without a search the figures follow the definition: e = -1 + 0.25 and 2 + 0.25, no mean removed, divided by n - 1.
    let fit = fit(raster, &track, 0.0).unwrap();
    let n = fit.points as f64;
    assert_eq!(fit.points, 150);
    let expected = (75.0 * (0.75f64.powi(2) + 2.25f64.powi(2)) / (n - 1.0)).sqrt();
    let about_median = (150.0 * 1.5f64.powi(2) / (n - 1.0)).sqrt();
    let Shifted { std_m, median_m, std_median_removed_m, at_edge, .. } = fit.eq_18;
    assert!((std_m - expected).abs() < 0.02, "{fit:?} {expected}");
    assert!((median_m - 0.75).abs() < 0.02 && (std_median_removed_m - about_median).abs() < 0.02, "{fit:?}");
    assert!(!at_edge && [fit.unshifted, fit.median_removed] == [fit.eq_18; 2], "{fit:?}");
}

#[test]
fn an_offset_is_the_medians_and_the_search_has_an_edge() {
    let (raster, georef) = dtm(Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0), 200, 140, 1.0);
    let above = track(&georef, 200, 140, 1.0, (3.0, 2.0), -0.05);
    let offset = fit(raster.clone(), &above, 10.0).unwrap();
    let Shifted { median_m, std_median_removed_m, .. } = offset.median_removed;
    assert!((median_m - 0.05).abs() < 0.01 && std_median_removed_m < 0.02, "{offset:?}");
    let far = track(&georef, 200, 140, 1.0, (9.0, 0.0), 0.0);
    let far = fit(raster, &far, 4.0).unwrap();
    assert!(far.median_removed.at_edge && far.eq_18.at_edge);
}

/// A track 5 m above its DTM lies where it lies. By Eq. 18 it moves to ground that is 5 m higher.
#[test]
fn a_constant_offset_does_not_move_the_answer() {
    let (raster, georef) = dtm(Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0), 200, 140, 1.0);
    for (moved, above) in [((0.0, 0.0), 5.0), ((3.0, -6.0), 5.0), ((3.0, -6.0), -40.0)] {
        let track = track(&georef, 200, 140, 1.0, moved, above);
        let Fit { median_removed: found, eq_18, unshifted, .. } = fit(raster.clone(), &track, 12.0).unwrap();
        assert_eq!((found.x_m, found.y_m), moved, "{above}");
        assert!((found.median_m + above).abs() < 0.02 && found.std_median_removed_m < 0.02, "{found:?}");
        assert!((eq_18.x_m, eq_18.y_m) != moved && eq_18.std_m < found.std_m, "{eq_18:?} {found:?}");
        assert!(eq_18.std_median_removed_m > found.std_median_removed_m && unshifted.std_m > 4.0);
    }
}

/// The shared folder's track: DTM + 5 m, not shifted.
#[test]
fn the_shared_track_stays() {
    let Some(folder) = elunar_testing::shared_folder().map(|folder| folder.join("files/user")) else { return };
    if !folder.is_dir() {
        return elunar_testing::skipped("the_shared_track_stays", "no files/user in the reference data");
    }
    let dtm = source::open(&folder.join("lola_dtm.tif")).unwrap();
    let ground = TrackDtm::new(&*dtm, "d.tif", 20.0).unwrap();
    let table = csv::read(&folder.join("lola_bias5m.csv"), None, ground.sphere_m()).unwrap();
    let found = ground.fit(&table.points, 10).unwrap().unwrap().median_removed;
    assert_eq!((found.x_m, found.y_m), (0.0, 0.0));
    assert!((found.median_m + 5.0).abs() < 0.1 && (found.std_m - 5.0).abs() < 0.1, "{found:?}");
}

/// A DTM across 180 degrees has values of x beyond half a turn.
#[test]
fn a_map_across_the_seam_is_found() {
    let crs = Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0);
    let period = Projection::of(&crs).unwrap().period().unwrap();
    let (mut raster, georef) = dtm(crs, 200, 140, 1.0);
    let here = fit(raster.clone(), &track(&georef, 200, 140, 1.0, (0.0, 0.0), 0.0), 8.0).unwrap();
    let turned =
        GeoRef { transform: georef.transform.map(|v| if v == 5000.0 { 0.5 * period - 180.0 } else { v }), ..georef };
    raster.georef = Some(turned.clone());
    let mut track = track(&turned, 200, 140, 1.0, (0.0, 0.0), 0.0);
    assert!(track.iter().any(|p| p.lon_deg < 0.0) && track.iter().any(|p| p.lon_deg > 0.0));
    track.iter_mut().zip(0..).for_each(|(p, i)| {
        let row = 20.0 + f64::from(i) * 160.0 / 150.0;
        p.height_m = height(5000.0 + 2.0 * (70.5 + 0.2 * row), 2000.0 - 2.0 * (row + 0.5));
    });
    let across = fit(raster, &track, 8.0).unwrap();
    assert_eq!(across.points, here.points);
    assert!(across.median_removed.std_m < 0.02, "{across:?}");
}

#[test]
fn gaps_and_edges_take_points_away() {
    let (mut raster, georef) = dtm(Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0), 200, 140, 1.0);
    let track = track(&georef, 200, 140, 1.0, (0.0, 0.0), 0.0);
    let all = fit(raster.clone(), &track, 6.0).unwrap().points;
    raster.samples[90 * 140..110 * 140].fill(f32::NAN);
    let fewer = fit(raster.clone(), &track, 6.0).unwrap().points;
    assert!(fewer < all - 15, "{fewer} of {all}");
    raster.samples.fill(f32::NAN);
    assert_eq!(fit(raster.clone(), &track, 6.0), None);
    let elsewhere: Vec<LaserSpot> = track.iter().map(|p| LaserSpot { lon_deg: p.lon_deg + 10.0, ..*p }).collect();
    assert_eq!(fit(raster, &elsewhere, 6.0), None);
}

#[test]
fn what_cannot_be_searched_is_refused() {
    let (raster, _) = dtm(Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0), 30, 30, 1.0);
    let refused = |raster: Raster, search_m: f64| {
        let source = InMemory::new(raster, None, "memory");
        TrackDtm::new(&source, "d.tif", search_m).err().expect("refused").to_string()
    };
    assert!(
        refused(Raster { georef: None, ..raster.clone() }, 1.0).contains("d.tif: a DTM with a geotransform expected")
    );
    for search_m in [1000.0, -1.0, f64::NAN] {
        assert!(refused(raster.clone(), search_m).contains("at most 200 half pixels"));
    }
    let mut nameless = raster;
    nameless.georef.as_mut().unwrap().crs = Crs::default();
    assert!(refused(nameless, 1.0).contains("a coordinate reference system"));
}

#[test]
fn reports_hold_every_track() {
    let shifted = |x_m: f64, std_m: f64, at_edge| Shifted {
        x_m,
        y_m: -0.0,
        std_m,
        median_m: 0.5,
        std_median_removed_m: 1.25,
        at_edge,
    };
    let (unshifted, median_removed) = (shifted(0.0, 4.0, false), shifted(-3.0, 2.0, true));
    let fit = Fit { points: 12, unshifted, median_removed, eq_18: shifted(7.5, 1.5, false) };
    let compared = ComparedTrack { name: "a.csv#1".into(), points: 20, fit: Some(fit) };
    let skipped = ComparedTrack { name: "a.csv#2".into(), points: 3, fit: None };
    let report = Report { dtm: "d.tif".into(), tracks: vec![compared, skipped], flagged: 7 };
    let text = table(&report);
    assert!(text.contains("d.tif: 1 of 2 tracks compared, 7 flagged rows"), "{text}");
    assert!(text.contains("  the shift at the search's edge") && !text.contains("-0.00"), "{text}");
    assert!(text.lines().last().unwrap().starts_with("mean") && text.contains("3 too few"), "{text}");
    let json = json(&report);
    assert_eq!(json["tracks"][0]["shift_x_m"], -3.0);
    assert_eq!(json["tracks"][1]["judged"], false);
    assert_eq!((&json["tracks"][0]["std_m"], &json["tracks"][0]["eq_18"]["shift_x_m"]), (&2.0.into(), &7.5.into()));
    let means = ["std_median_removed_m", "std_unshifted_m", "std_m", "eq_18_std_m"].map(|name| &json["mean"][name]);
    assert_eq!(means.map(|mean| mean.as_f64().unwrap()), [1.25, 4.0, 2.0, 1.5]);
}

/// The definition in numpy, on rough terrain: every shift is tried, bilinear, with the same points for all.
const TWIN: &str = "
d = rasterio.open('d.tif'); z = d.read(1).astype('f8')
lon, lat, h = np.loadtxt('t.csv', delimiter=',', skiprows=1).T
R = 1737400.0
x, y = R * np.radians(lon - 180), R * np.radians(lat)
c, r = ~d.transform * (x, y); c, r = c - 0.5, r - 0.5
def at(r, c):
    i, j = np.floor(r).astype(int), np.floor(c).astype(int)
    f, g = r - i, c - j
    return (1-f)*(1-g)*z[i, j] + (1-f)*g*z[i, j+1] + f*(1-g)*z[i+1, j] + f*g*z[i+1, j+1]
n = 9
keep = (r > n/2 + 1) & (c > n/2 + 1) & (r < z.shape[0] - n/2 - 2) & (c < z.shape[1] - n/2 - 2)
r, c, h = r[keep], c[keep], h[keep]
def figures(i, j):
    e = at(r + i/2, c + j/2) - h
    m = np.median(e)
    return [np.sqrt((v**2).sum() / (len(h) - 1)) for v in (e, e - m)] + [m, j/2 * d.transform.a, i/2 * d.transform.e]
all = [figures(i, j) for i in range(-n, n+1) for j in range(-n, n+1)]
print(len(h), *min(all, key=lambda f: f[0]), *min(all, key=lambda f: f[1]))
";

#[test]
fn a_twin_in_numpy_agrees() {
    let folder = tempfile::tempdir().unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (rows, cols) = (90, 70);
    let georef = GeoRef {
        transform: [-40_000.0, 2.0, 0.0, 9000.0, 0.0, -2.0],
        crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 180.0),
    };
    let samples: Vec<f32> = (0..rows * cols).map(|i| (i % cols) as f32 * 0.5 + rng.random_range(-3.0..3.0)).collect();
    let raster = Raster { rows, cols, samples, georef: Some(georef.clone()) };
    geotiff::write(&folder.path().join("d.tif"), &raster, &geotiff::WriteOptions::heights("heights")).unwrap();
    let projection = Projection::of(&georef.crs).unwrap();
    let mut text = String::from("lon,lat,height_m\n");
    for _ in 0..300 {
        let (row, col) = (rng.random_range(7.0..82.0), rng.random_range(7.0..62.0));
        let (x, y) = georef.centre(row, col);
        let (lon, lat) = projection.inverse(x, y);
        text += &format!("{lon:.9},{lat:.9},{:.4}\n", (col + 2.3) * 0.5 + rng.random_range(-2.0..2.0));
    }
    std::fs::write(folder.path().join("t.csv"), text).unwrap();
    let Some(out) = rasterio(TWIN, folder.path()) else { return };
    let expected: Vec<f64> = out.split_whitespace().map(|word| word.parse().unwrap()).collect();
    let source = source::open(&folder.path().join("d.tif")).unwrap();
    let ground = TrackDtm::new(&*source, "d.tif", 9.0).unwrap();
    let table = csv::read(&folder.path().join("t.csv"), None, ground.sphere_m()).unwrap();
    let fit = ground.fit(&table.points, 10).unwrap().unwrap();
    let figures = |at: Shifted| vec![at.std_m, at.std_median_removed_m, at.median_m, at.x_m, at.y_m];
    let found = [vec![fit.points as f64], figures(fit.eq_18), figures(fit.median_removed)].concat();
    assert_eq!(expected.len(), found.len());
    for (found, expected) in found.iter().zip(&expected) {
        assert!((found - expected).abs() < 1e-4, "{fit:?}, numpy {expected:?}");
    }
}
