//! Outlines of rasters on their body.

use super::{GeoRef, Projection};

/// Points along each side of a footprint.
const SIDE_POINTS: usize = 8;

/// Returns the outline of a raster, closed, counter-clockwise on a map with north up: longitudes (-180 to 180 at its first corner, on from there)
/// and latitudes, degrees. `None` for maps without longitudes, and where the outline leaves the map.
#[must_use]
pub fn footprint(georef: &GeoRef, rows: usize, cols: usize) -> Option<Vec<[f64; 2]>> {
    let projection = Projection::of(&georef.crs)?;
    let [x0, x_col, x_row, y0, y_col, y_row] = georef.transform;
    let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)];
    let mut ring: Vec<[f64; 2]> = vec![];
    for pair in corners.windows(2) {
        for k in 0..SIDE_POINTS {
            let along = k as f64 / SIDE_POINTS as f64;
            let at = |a: f64, b: f64| a + (b - a) * along;
            let (row, col) = (at(pair[0].0, pair[1].0) * rows as f64, at(pair[0].1, pair[1].1) * cols as f64);
            let (lon, lat) = projection.inverse(x0 + x_col * col + x_row * row, y0 + y_col * col + y_row * row);
            let before = ring.last().map_or(0.0, |point| point[0]);
            ring.push([(lon - before + 180.0).rem_euclid(360.0) - 180.0 + before, lat]);
        }
    }
    let (first, last) = (*ring.first()?, *ring.last()?);
    if (last[0] - first[0]).abs() > 180.0 {
        // A map about a pole: all longitudes, from the outline to the pole.
        let edge = ring.iter().map(|point| point[1]).fold(f64::INFINITY, |a, b| if b.abs() < a.abs() { b } else { a });
        let (south, north) = if edge > 0.0 { (edge, 90.0) } else { (-90.0, edge) };
        ring = vec![[-180.0, north], [-180.0, south], [180.0, south], [180.0, north]];
    }
    ring.push(*ring.first()?);
    ring.iter().flatten().all(|v| v.is_finite()).then_some(ring)
}

/// Returns the ranges of longitudes (west, east) and latitudes (south, north) of an outline, degrees.
#[must_use]
pub fn bounds(ring: &[[f64; 2]]) -> [(f64, f64); 2] {
    [0, 1].map(|k| {
        let of = |fold: fn(f64, f64) -> f64, from| ring.iter().map(|point| point[k]).fold(from, fold);
        (of(f64::min, f64::INFINITY), of(f64::max, f64::NEG_INFINITY))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Crs;

    #[test]
    fn footprints_run_counter_clockwise_and_close_about_a_pole() {
        let of = |srs: &str, transform| {
            let ring = footprint(&GeoRef { transform, crs: Crs::parse(srs).unwrap() }, 100, 100).unwrap();
            let area: f64 = ring.windows(2).map(|p| p[0][0] * p[1][1] - p[1][0] * p[0][1]).sum();
            (ring, area)
        };
        // Across the meridian of 180 degrees.
        let (ring, area) = of("+proj=longlat +R=1737400", [179.5, 0.01, 0.0, 10.0, 0.0, -0.01]);
        assert!(area > 0.0 && (ring[16][0] - 180.5).abs() < 1e-9 && (ring[16][1] - 9.0).abs() < 1e-9, "{ring:?}");
        let [(west, east), (south, north)] = bounds(&ring);
        assert!((west - 179.5).abs() < 1e-9 && (east - 180.5).abs() < 1e-9 && (north - south - 1.0).abs() < 1e-9);
        let (ring, area) = of("+proj=stere +lat_0=-90 +lon_0=0 +R=1737400", [-500.0, 10.0, 0.0, 500.0, 0.0, -10.0]);
        assert!(area > 0.0 && ring.len() == 5 && ring[1] == [-180.0, -90.0] && ring[0][1] < -89.9, "{ring:?}");
    }
}
