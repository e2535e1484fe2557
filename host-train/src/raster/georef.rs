//! Pixel to map and back.

use super::Crs;

/// Affine pixel-to-map transform in GDAL's order: x = t0 + col*t1 + row*t2, y = t3 + col*t4 + row*t5, with (0, 0) the outer
/// corner of the first pixel. Map units are metres for projected systems, degrees for geographic ones.
pub type GeoTransform = [f64; 6];

/// Where a raster lies: its transform and its coordinate reference system.
#[derive(Debug, Clone, PartialEq)]
pub struct GeoRef {
    /// Pixel-to-map transform.
    pub transform: GeoTransform,
    /// Coordinate reference system; empty when the file names none.
    pub crs: Crs,
}

/// Affine map from pixel indices of one raster to pixel indices of another: `row' = row[0] + row[1]*row + row[2]*col`, the same for
/// `col'`. Indices are of pixel centres: (0, 0) is the centre of the first pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelMap {
    /// Constant, factor of the row, factor of the column, for the target row.
    pub row: [f64; 3],
    /// The same for the target column.
    pub col: [f64; 3],
}

impl PixelMap {
    /// Target (row, column) of a source (row, column).
    #[must_use]
    pub fn apply(&self, row: f64, col: f64) -> (f64, f64) {
        (self.row[0] + self.row[1] * row + self.row[2] * col, self.col[0] + self.col[1] * row + self.col[2] * col)
    }

    /// True if both grids have the same pixel centres to within `tolerance_px` over `rows` x `cols` pixels.
    #[must_use]
    pub fn is_identity(&self, rows: usize, cols: usize, tolerance_px: f64) -> bool {
        let (last_row, last_col) = (rows.saturating_sub(1) as f64, cols.saturating_sub(1) as f64);
        // An affine map is furthest from the identity at a corner.
        [(0.0, 0.0), (0.0, last_col), (last_row, 0.0), (last_row, last_col)].into_iter().all(|(row, col)| {
            let (r, c) = self.apply(row, col);
            (r - row).abs() <= tolerance_px && (c - col).abs() <= tolerance_px
        })
    }
}

impl GeoRef {
    /// Map coordinates (x, y) of the centre of pixel (row, column).
    #[must_use]
    pub fn centre(&self, row: f64, col: f64) -> (f64, f64) {
        let t = &self.transform;
        let (row, col) = (row + 0.5, col + 0.5);
        (t[0] + col * t[1] + row * t[2], t[3] + col * t[4] + row * t[5])
    }

    /// Map from this raster's pixel indices to `other`'s, through map coordinates. `None` if `other`'s transform has no inverse.
    /// Both must be in the same reference system; see [`Crs::same_as`].
    #[must_use]
    pub fn pixels_of(&self, other: &GeoRef) -> Option<PixelMap> {
        let (a, b) = (&self.transform, &other.transform);
        let det = b[1] * b[5] - b[2] * b[4];
        if !det.is_finite() || det == 0.0 {
            return None;
        }
        // Offsets are subtracted before anything is multiplied: map coordinates are large against a pixel.
        let (x0, y0) = self.centre(0.0, 0.0);
        let (dx, dy) = (x0 - b[0], y0 - b[3]);
        let col_of = |x: f64, y: f64| (b[5] * x - b[2] * y) / det;
        let row_of = |x: f64, y: f64| (b[1] * y - b[4] * x) / det;
        Some(PixelMap {
            row: [row_of(dx, dy) - 0.5, row_of(a[2], a[5]), row_of(a[1], a[4])],
            col: [col_of(dx, dy) - 0.5, col_of(a[2], a[5]), col_of(a[1], a[4])],
        })
    }

    /// Row and column spacing in metres at the centre of a raster of `rows` x `cols` pixels. Projected systems give the spacing
    /// on the map; geographic ones the spacing on their sphere. `None` if the system's unit is unknown.
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
    fn pixels_map_through_coordinates() {
        let image = place([349_000.0, 2.0, 0.0, 600_000.0, 0.0, -2.0]);
        let coarse = place([348_840.0, 60.0, 0.0, 600_160.0, 0.0, -60.0]);
        let map = image.pixels_of(&coarse).unwrap();
        // Centre of image pixel (0, 0): x 349001, y 599999, which is 161 m inside the coarse grid on both axes.
        let (row, col) = map.apply(0.0, 0.0);
        assert!((row - (161.0 / 60.0 - 0.5)).abs() < 1e-12 && (col - (161.0 / 60.0 - 0.5)).abs() < 1e-12);
        let back = coarse.pixels_of(&image).unwrap();
        let (r, c) = map.apply(37.0, 401.0);
        let (r, c) = back.apply(r, c);
        assert!((r - 37.0).abs() < 1e-9 && (c - 401.0).abs() < 1e-9);
        assert!(image.pixels_of(&image).unwrap().is_identity(512, 640, 1e-9));
        assert!(!map.is_identity(512, 640, 1e-3));
    }

    #[test]
    fn rotated_pixels_map_back() {
        let a = place([10.0, 1.5, 0.3, -20.0, 0.4, -1.2]);
        let b = place([3.0, -2.5, 0.1, 7.0, 0.2, 3.0]);
        let (r, c) = a.pixels_of(&b).unwrap().apply(5.0, 9.0);
        let (x, y) = a.centre(5.0, 9.0);
        let (bx, by) = b.centre(r, c);
        assert!((x - bx).abs() < 1e-12 && (y - by).abs() < 1e-12);
        assert!(a.pixels_of(&place([0.0, 1.0, 2.0, 0.0, 2.0, 4.0])).is_none());
    }

    #[test]
    fn pixel_size_is_in_metres() {
        assert_eq!(place([0.0, 2.0, 0.0, 0.0, 0.0, -3.0]).pixel_m(10, 10), Some((3.0, 2.0)));
    }
}
