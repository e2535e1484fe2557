//! Transforms from pixel to map and back.

use super::Crs;

/// Affine pixel-to-map transform in GDAL's order: x = t0 + col*t1 + row*t2, y = t3 + col*t4 + row*t5, with (0, 0) the outer
/// corner of the first pixel. Map units are metres for projected systems, degrees for geographic ones.
pub type GeoTransform = [f64; 6];

/// Georeference of a raster: its transform and its coordinate reference system.
#[derive(Debug, Clone, PartialEq)]
pub struct GeoRef {
    /// Pixel-to-map transform.
    pub transform: GeoTransform,
    /// Coordinate reference system; empty if the file names none.
    pub crs: Crs,
}

impl GeoRef {
    /// Returns the map coordinates (x, y) of the centre of pixel (row, column).
    #[must_use]
    pub fn centre(&self, row: f64, col: f64) -> (f64, f64) {
        let t = &self.transform;
        let (row, col) = (row + 0.5, col + 0.5);
        (t[0] + col * t[1] + row * t[2], t[3] + col * t[4] + row * t[5])
    }

    /// Returns row and column spacing in metres at the centre of a raster of `rows` x `cols` pixels. For projected systems it is the
    /// spacing on the map, for geographic ones the spacing on their sphere. `None` if the system's unit is unknown.
    #[must_use]
    pub fn pixel_m(&self, rows: usize, cols: usize) -> Option<(f64, f64)> {
        let t = &self.transform;
        if self.crs.is_projected() || self.crs.is_empty() {
            let metres = if self.crs.is_empty() { 1.0 } else { self.crs.metres_per_unit()? };
            return Some((t[2].hypot(t[5]) * metres, t[1].hypot(t[4]) * metres));
        }
        let metres = self.crs.sphere_radius_m()?.to_radians();
        let (_, lat_deg) = self.centre((rows as f64 - 1.0) / 2.0, (cols as f64 - 1.0) / 2.0);
        let cos_lat = lat_deg.to_radians().cos();
        Some(((t[2] * cos_lat).hypot(t[5]) * metres, (t[1] * cos_lat).hypot(t[4]) * metres))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(transform: GeoTransform) -> GeoRef {
        GeoRef { transform, crs: Crs::moon_equirectangular(0.0, 0.0) }
    }

    #[test]
    fn pixel_size_is_in_metres() {
        assert_eq!(place([0.0, 2.0, 0.0, 0.0, 0.0, -3.0]).pixel_m(10, 10), Some((3.0, 2.0)));
    }

    #[test]
    fn degrees_become_metres_on_their_sphere() {
        let directory = vec![1, 1, 0, 3, 1024, 0, 1, 2, 2057, 34736, 1, 0, 2058, 34736, 1, 0];
        let crs = Crs { directory, doubles: vec![1_737_400.0], ascii: String::new() };
        // One pixel of a tenth of a degree, with its centre at 60 degrees north.
        let georef = GeoRef { transform: [10.0, 0.1, 0.0, 60.05, 0.0, -0.1], crs };
        let (row_m, col_m) = georef.pixel_m(1, 1).unwrap();
        let degree_m = 1_737_400.0 * std::f64::consts::PI / 180.0;
        assert!((row_m - 0.1 * degree_m).abs() < 1e-6 && (col_m - 0.05 * degree_m).abs() < 1e-6);
    }
}
