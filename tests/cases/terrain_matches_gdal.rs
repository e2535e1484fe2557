//! Slope and hillshade of `core` against those of GDAL on a DEM with voids and non-square pixels.

use elunar_core::grid::GridView;
use elunar_core::terrain::{PixelSize, Sun, hillshade, slope_deg};
use elunar_tests::{repository, tolerance};
use serde_json::Value;

struct Case {
    json: Value,
    heights_m: Vec<f32>,
    shape: (usize, usize),
    pixel: PixelSize,
}

fn case() -> Case {
    let path = repository().join("tests/golden/gdaldem/case.json");
    let json: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let heights_m = numbers(&json["heights_m"]).into_iter().map(|h| h as f32).collect();
    let shape = (json["rows"].as_u64().unwrap() as usize, json["cols"].as_u64().unwrap() as usize);
    let pixel =
        PixelSize { row_m: json["pixel"]["row_m"].as_f64().unwrap(), col_m: json["pixel"]["col_m"].as_f64().unwrap() };
    Case { json, heights_m, shape, pixel }
}

/// A JSON array; `null` becomes NaN.
fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect()
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
        let number = |key: &str| shade[key].as_f64().unwrap();
        let sun = Sun {
            azimuth_deg: number("azimuth_deg"),
            elevation_deg: number("elevation_deg"),
            exaggeration: number("exaggeration"),
        };
        let mut found = vec![0u8; case.heights_m.len()];
        hillshade(grid, case.pixel, sun, &mut found).unwrap();
        let expected: Vec<u8> = numbers(&shade["bytes"]).into_iter().map(|b| b as u8).collect();
        assert_eq!(found, expected, "{sun:?}");
        assert!(expected.iter().max() > Some(&100) && expected.contains(&0), "a case that shows something");
    }
}
