//! Compares slope and hillshade of `core` with those of GDAL, and footprints with those of numpy, on a DEM with voids and non-square
//! pixels.

use elunar_core::grid::GridView;
use elunar_core::terrain::{HazardLimits, LineMaps, LineOptions, PixelSize, Sun, TerrainLines, hazard};
use elunar_core::terrain::{hillshade, slope_deg};
use elunar_tests::{repository, tolerance};
use serde_json::Value;

struct Case {
    json: Value,
    heights_m: Vec<f32>,
    shape: (usize, usize),
    pixel: PixelSize,
}

fn json(path: &str) -> Value {
    serde_json::from_slice(&std::fs::read(repository().join(path)).unwrap()).unwrap()
}

fn case() -> Case {
    let json = json("tests/golden/gdaldem/case.json");
    let heights_m = numbers(&json["heights_m"]).into_iter().map(|h| h as f32).collect();
    let shape = (json["rows"].as_u64().unwrap() as usize, json["cols"].as_u64().unwrap() as usize);
    let pixel =
        PixelSize { row_m: json["pixel"]["row_m"].as_f64().unwrap(), col_m: json["pixel"]["col_m"].as_f64().unwrap() };
    Case { json, heights_m, shape, pixel }
}

/// Reads a JSON array; `null` becomes NaN.
fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect()
}

fn sun(shade: &Value) -> Sun {
    let number = |key: &str| shade[key].as_f64().unwrap();
    Sun {
        azimuth_deg: number("azimuth_deg"),
        elevation_deg: number("elevation_deg"),
        exaggeration: number("exaggeration"),
    }
}

#[test]
fn slope_matches_gdal() {
    let case = case();
    let grid = GridView::new(&case.heights_m, case.shape.0, case.shape.1).unwrap();
    let mut found = vec![0.0f32; case.heights_m.len()];
    slope_deg(grid, case.pixel, &mut found).unwrap();
    let expected = numbers(&case.json["slope_deg"]);
    assert_eq!(expected.len(), found.len());
    let mut compared = 0;
    for (i, (f, e)) in found.iter().zip(&expected).enumerate() {
        assert_eq!(f.is_nan(), e.is_nan(), "pixel {i}: {f} instead of {e}");
        if !e.is_nan() {
            assert!((f64::from(*f) - e).abs() <= tolerance::SLOPE_DEG, "pixel {i}: {f} instead of {e}");
            compared += 1;
        }
    }
    assert!(compared > 250, "only {compared} pixels compared");
}

#[test]
fn hillshade_is_gdals_byte_for_byte() {
    let case = case();
    let grid = GridView::new(&case.heights_m, case.shape.0, case.shape.1).unwrap();
    let shades = case.json["hillshade"].as_array().unwrap();
    assert_eq!(shades.len(), 3);
    for shade in shades {
        let sun = sun(shade);
        let mut found = vec![0u8; case.heights_m.len()];
        hillshade(grid, case.pixel, sun, &mut found).unwrap();
        let expected: Vec<u8> = numbers(&shade["bytes"]).into_iter().map(|b| b as u8).collect();
        assert_eq!(found, expected, "{sun:?}");
        assert!(expected.iter().max() > Some(&100) && expected.contains(&0), "a case that shows something");
    }
}

/// Limits that some pixels of this DEM exceed and others do not.
const HAZARD_DEG: f32 = 25.0;
const HAZARD_M: f32 = 3.0;

/// All maps of the grid.
struct WholeMaps {
    slope_deg: Vec<f32>,
    hillshade: Vec<u8>,
    footprint_slope_deg: Vec<f32>,
    roughness_m: Vec<f32>,
    hazard: Vec<u8>,
}

/// Returns the maps of the whole grid, computed line by line.
fn by_lines(case: &Case, sun: Sun, radius_px: usize) -> WholeMaps {
    let (cols, len) = (case.shape.1, case.heights_m.len());
    let limits = HazardLimits::new(HAZARD_DEG, HAZARD_M).unwrap();
    let options = LineOptions { cols, pixel: case.pixel, radius_px, sun, limits };
    let mut memory = vec![0.0; options.memory_len()];
    let mut lines = TerrainLines::new(options, &mut memory).unwrap();
    let floats = || vec![0.0f32; len];
    let mut found = WholeMaps {
        slope_deg: floats(),
        hillshade: vec![0; len],
        footprint_slope_deg: floats(),
        roughness_m: floats(),
        hazard: vec![0; len],
    };
    let mut heights = case.heights_m.chunks(cols);
    let mut row = 0;
    while row < case.shape.0 {
        let range = row * cols..(row + 1) * cols;
        let mut maps = LineMaps {
            slope_deg: &mut found.slope_deg[range.clone()],
            hillshade: &mut found.hillshade[range.clone()],
            footprint_slope_deg: &mut found.footprint_slope_deg[range.clone()],
            roughness_m: &mut found.roughness_m[range.clone()],
            hazard: &mut found.hazard[range],
        };
        let given = match heights.next() {
            Some(line) => lines.push(line, &mut maps),
            None => lines.finish(&mut maps),
        };
        if let Some(given) = given.unwrap() {
            assert_eq!(given, row as u64);
            row += 1;
        }
    }
    found
}

#[test]
fn lines_give_what_gdal_gives() {
    let case = case();
    let grid = GridView::new(&case.heights_m, case.shape.0, case.shape.1).unwrap();
    let mut slopes = vec![0.0f32; case.heights_m.len()];
    slope_deg(grid, case.pixel, &mut slopes).unwrap();
    let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    for shade in case.json["hillshade"].as_array().unwrap() {
        let sun = sun(shade);
        let WholeMaps { slope_deg: found, hillshade: shades, .. } = by_lines(&case, sun, 2);
        assert_eq!(bits(&found), bits(&slopes), "bit for bit the whole grid's, which is GDAL's");
        assert_eq!(shades, numbers(&shade["bytes"]).into_iter().map(|b| b as u8).collect::<Vec<_>>(), "{sun:?}");
    }
}

#[test]
fn footprints_match_numpy() {
    let case = case();
    let golden = json("tests/golden/footprint/case.json");
    let footprints = golden["footprints"].as_array().unwrap();
    assert_eq!(footprints.len(), 3);
    for footprint in footprints {
        let radius_px = footprint["radius_px"].as_u64().unwrap() as usize;
        let maps = by_lines(&case, Sun::default(), radius_px);
        let (slopes, roughness, hazards) = (maps.footprint_slope_deg, maps.roughness_m, maps.hazard);
        let expected = [numbers(&footprint["slope_deg"]), numbers(&footprint["roughness_m"])];
        let (mut compared, mut seen) = (0, [0; 8]);
        for i in 0..case.heights_m.len() {
            let (found, e) = ([slopes[i], roughness[i]].map(f64::from), [expected[0][i], expected[1][i]]);
            seen[usize::from(hazards[i])] += 1;
            if e[0].is_nan() {
                assert!(
                    found[0].is_nan() && found[1].is_nan() && hazards[i] == hazard::UNKNOWN,
                    "pixel {i}: {found:?}"
                );
                continue;
            }
            for (f, e) in found.iter().zip(e) {
                assert!((f - e).abs() <= tolerance::FOOTPRINT, "pixel {i}: {f} instead of {e}");
            }
            let (steep, rough) = (e[0] > f64::from(HAZARD_DEG), e[1] > f64::from(HAZARD_M));
            assert_eq!(
                hazards[i],
                hazard::TOO_STEEP * u8::from(steep) + hazard::TOO_ROUGH * u8::from(rough),
                "pixel {i}"
            );
            compared += 1;
        }
        assert!(compared > 50, "only {compared} pixels compared with r = {radius_px}");
        assert!(seen.iter().filter(|&&n| n > 0).count() >= 3, "hazards {seen:?} with r = {radius_px}");
    }
}
