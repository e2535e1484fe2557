//! Transforms from pixel to map and back.

use super::{Crs, Projection};

/// Affine pixel-to-map transform in GDAL's order: x = t0 + col*t1 + row*t2, y = t3 + col*t4 + row*t5, with (0, 0) the outer
/// corner of the first pixel. Map units are metres for projected systems, degrees for geographic ones.
pub type GeoTransform = [f64; 6];

/// Longitudes beyond two turns are no longitudes (our choice).
const MOST_LON_DEG: f64 = 720.0;

/// Pixels below this many map units are finer than those of orbiter images, if the unit is the metre (our choice). LDEM of 4 pixels a degree
/// has 0.25 degrees.
const FINEST_UNITS: f64 = 0.26;

/// Pixels below this many map units, a length, are none of orbiter images (our choice).
const ABSURD_UNITS: f64 = 0.02;

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
    /// spacing on the map, for geographic ones the spacing on their sphere. `None` if the system or its unit is unknown.
    #[must_use]
    pub fn pixel_m(&self, rows: usize, cols: usize) -> Option<(f64, f64)> {
        let t = &self.transform;
        if !self.crs.is_geographic() {
            let metres = if self.crs.is_empty() { 1.0 } else { self.crs.metres_per_unit()? };
            return Some((t[2].hypot(t[5]) * metres, t[1].hypot(t[4]) * metres));
        }
        let metres = self.crs.sphere_radius_m().filter(|_| self.crs.is_in_degrees())?.to_radians();
        let (_, lat_deg) = self.centre((rows as f64 - 1.0) / 2.0, (cols as f64 - 1.0) / 2.0);
        let cos_lat = lat_deg.to_radians().cos();
        Some(((t[2] * cos_lat).hypot(t[5]) * metres, (t[1] * cos_lat).hypot(t[4]) * metres))
    }

    /// Returns why a raster of `rows` x `cols` pixels cannot lie where its coordinates say: no point of it has a longitude and latitude in
    /// its reference system, or its pixels are below [`ABSURD_UNITS`]. The usual causes are metres under a system of degrees, and the reverse.
    #[must_use]
    pub fn contradiction(&self, rows: usize, cols: usize) -> Option<String> {
        let projection = Projection::of(&self.crs)?;
        let state = "State their system (--image-srs, --coarse-srs), or gdal_translate -a_srs";
        if self.side() < ABSURD_UNITS
            && let Some(doubt) = self.doubt(rows, cols)
        {
            return Some(format!("{doubt} {state}"));
        }
        let at = |i: usize, count: usize| i as f64 / 8.0 * (count as f64 - 1.0);
        let mut points = (0..81).map(|i| self.centre(at(i / 9, rows), at(i % 9, cols)));
        let shows = |(x, y): (f64, f64)| {
            let (lon_deg, lat_deg) = projection.inverse(x, y);
            lon_deg.abs() <= MOST_LON_DEG && lat_deg.is_finite()
        };
        if points.any(shows) {
            return None;
        }
        let (summary, extent) = (self.crs.summary(), self.extent(rows, cols));
        let metres = if self.crs.is_geographic() { format!(": are they metres? {state}") } else { String::new() };
        Some(format!("coordinates within its reference system ({summary}) expected, found {extent}{metres}"))
    }

    /// Returns a doubt about coordinates that look like degrees, though their unit is a length: all are within a turn and the poles, and the
    /// pixels are finer than those of any orbiter image.
    #[must_use]
    pub fn doubt(&self, rows: usize, cols: usize) -> Option<String> {
        let [x0, y0, x1, y1] = self.limits(rows, cols);
        let within = x0 >= -360.0 && x1 <= 360.0 && y0 >= -90.5 && y1 <= 90.5;
        (self.crs.is_projected() && within && self.side() < FINEST_UNITS).then(|| {
            let (extent, side, summary) = (self.extent(rows, cols), self.side(), self.crs.summary());
            format!("coordinates in the unit of its system ({summary}) expected, found {extent}, pixels of {side:.3e}: are they degrees?")
        })
    }

    /// Returns the longer side of a pixel, map units.
    fn side(&self) -> f64 {
        let t = &self.transform;
        t[1].hypot(t[4]).max(t[2].hypot(t[5]))
    }

    /// Describes the map coordinates of the outer edges.
    #[must_use]
    pub fn extent(&self, rows: usize, cols: usize) -> String {
        let [x0, y0, x1, y1] = self.limits(rows, cols);
        format!("x {x0:.1} to {x1:.1}, y {y0:.1} to {y1:.1}")
    }

    /// Returns the lowest x and y and the highest x and y of the outer corners.
    fn limits(&self, rows: usize, cols: usize) -> [f64; 4] {
        let corners = [(0, 0), (0, cols), (rows, 0), (rows, cols)];
        let corners = corners.map(|(row, col)| self.centre(row as f64 - 0.5, col as f64 - 0.5));
        let far = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        corners.iter().fold(far, |[x0, y0, x1, y1], &(x, y)| [x0.min(x), y0.min(y), x1.max(x), y1.max(y)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_core::sun::Body;

    fn place(transform: GeoTransform) -> GeoRef {
        GeoRef { transform, crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0) }
    }

    #[test]
    fn pixel_size_is_in_metres() {
        let transform = [0.0, 2.0, 0.0, 0.0, 0.0, -3.0];
        assert_eq!(place(transform).pixel_m(10, 10), Some((3.0, 2.0)));
        assert_eq!(GeoRef { transform, crs: Crs::default() }.pixel_m(10, 10), Some((3.0, 2.0)), "metres");
    }

    #[test]
    fn metres_under_degrees_contradict_them() {
        let metres = [349_000.0, 2.0, 0.0, 600_000.0, 0.0, -2.0];
        let degrees = GeoRef { transform: metres, crs: Crs::geographic(1_737_400.0) };
        let what = degrees.contradiction(100, 100).unwrap();
        assert!(
            what.contains("longitude/latitude") && what.contains("x 349000.0 to 349200.0") && what.contains("metres?")
        );
        assert_eq!(place(metres).contradiction(100, 100), None);
        assert!(place([0.0, 2.0, 0.0, 3e6, 0.0, -2.0]).contradiction(10, 10).is_some(), "beyond the pole");
        let disc = GeoRef { transform: [-2e6, 1e5, 0.0, 2e6, 0.0, -1e5], crs: Crs::parse("IAU_2015:30165").unwrap() };
        assert_eq!(disc.contradiction(40, 40), None, "only the corners of a disc are off the Moon");
        for (transform, absurd) in
            [([-180.0, 0.25, 0.0, 90.0, 0.0, -0.25], false), ([300.0, 1e-4, 0.0, -20.0, 0.0, -1e-4], true)]
        {
            assert!(place(transform).doubt(10, 10).unwrap().contains("are they degrees?"));
            assert_eq!(place(transform).contradiction(10, 10).is_some(), absurd);
            let honest = GeoRef { transform, crs: Crs::geographic(1_737_400.0) };
            assert!(honest.doubt(10, 10).is_none() && honest.contradiction(10, 10).is_none());
        }
        for corner in [(-370.0, 0.0), (370.0, 0.0), (0.0, -91.0), (0.0, 100.0)] {
            assert!(place([corner.0, 0.25, 0.0, corner.1, 0.0, -0.25]).doubt(10, 10).is_none(), "{corner:?}");
        }
        assert!(place([0.0, 0.5, 0.0, 0.0, 0.0, -0.5]).doubt(10, 10).is_none());
        assert!(place([9000.0, 0.01, 0.0, 0.0, 0.0, -0.01]).contradiction(10, 10).is_none());
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
        let mut radians = georef;
        radians.crs.directory.extend([2054, 0, 1, 9101]);
        radians.crs.directory[3] += 1;
        assert_eq!(radians.pixel_m(1, 1), None, "an angle that is not in degrees");
    }
}
