//! The hillshade of any raster source, band by band. The result is that of `gdaldem hillshade` (Horn).

use elunar_base::{Error, Result};
use elunar_core::grid::GridView;
use elunar_core::terrain::{PixelSize, Sun, hillshade};
use elunar_core::tile::Window;
use elunar_raster::source::Source;
use rayon::prelude::*;
use std::ops::Range;

/// Options of a hillshade.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HillshadeOptions {
    /// Direction to the Sun. The default is `gdaldem`'s.
    pub sun: Sun,
    /// Whether the outermost pixels and those beside gaps are shaded, from the neighbours that exist (`gdaldem -compute_edges`).
    pub compute_edges: bool,
}

/// Returns the size of the source's pixels with the signs of its transform: negative where rows go north or columns go west. For geographic
/// rasters the size is in metres on their sphere, at the raster's centre.
///
/// # Errors
/// [`Error::Input`] if the source, called `name`, has no pixel size in metres.
pub fn pixel_of(source: &dyn Source, name: &str) -> Result<PixelSize> {
    let info = source.info();
    let georef = info.georef.as_ref();
    let size = georef.and_then(|georef| georef.pixel_m(info.rows, info.cols).map(|size| (size, georef.transform)));
    let Some(((row_m, col_m), transform)) = size.filter(|((row_m, col_m), _)| *row_m > 0.0 && *col_m > 0.0) else {
        return Err(Error::input(format!("{name}: a pixel size in metres expected, none found")));
    };
    let sign = |step: f64| if step < 0.0 { -1.0 } else { 1.0 };
    Ok(PixelSize { row_m: -sign(transform[5]) * row_m, col_m: sign(transform[1]) * col_m })
}

/// Shades whole `rows` of the source. The result has one byte per pixel: 0 where there is no value, otherwise 1 to 255.
///
/// # Errors
/// As [`Source::read`].
pub fn shade_rows(
    source: &dyn Source,
    rows: Range<usize>,
    pixel: PixelSize,
    shading: &HillshadeOptions,
) -> Result<Vec<u8>> {
    let (all_rows, cols) = (source.info().rows, source.info().cols);
    // One more row on each side, where the raster has one.
    let read = rows.start.saturating_sub(1)..(rows.end + 1).min(all_rows);
    let heights_m = source.read(Window { row: read.start, col: 0, rows: read.len(), cols })?;
    Band { heights_m: &heights_m, first: read.start, all_rows, cols }.shades(rows, pixel, shading)
}

/// Shades a raster in memory as [`shade_rows`] does. `heights_m` are row-major, whole rows of `cols`.
///
/// # Errors
/// [`Error::Input`] if they are not whole rows.
pub fn shade_all(heights_m: &[f32], cols: usize, pixel: PixelSize, shading: &HillshadeOptions) -> Result<Vec<u8>> {
    let rows = heights_m.len() / cols.max(1);
    if rows * cols != heights_m.len() {
        return Err(Error::input(format!("hillshade: rows of {cols} heights expected, {} found", heights_m.len())));
    }
    Band { heights_m, first: 0, all_rows: rows, cols }.shades(0..rows, pixel, shading)
}

/// Consecutive rows of a raster.
struct Band<'a> {
    heights_m: &'a [f32],
    /// Row of the raster at which the band begins.
    first: usize,
    /// Number of rows of the raster.
    all_rows: usize,
    cols: usize,
}

impl Band<'_> {
    fn shades(&self, rows: Range<usize>, pixel: PixelSize, shading: &HillshadeOptions) -> Result<Vec<u8>> {
        let lines: Result<Vec<Vec<u8>>> = rows.into_par_iter().map(|row| self.shade(row, pixel, shading)).collect();
        Ok(lines?.concat())
    }

    fn at(&self, row: usize, col: usize) -> f32 {
        self.heights_m[(row - self.first) * self.cols + col]
    }

    fn shade(&self, row: usize, pixel: PixelSize, shading: &HillshadeOptions) -> Result<Vec<u8>> {
        let mut line = vec![0; self.cols];
        if row > 0 && row + 1 < self.all_rows {
            let mut three = vec![0; 3 * self.cols];
            let above = &self.heights_m[(row - 1 - self.first) * self.cols..][..3 * self.cols];
            shade(above, 3, self.cols, pixel, shading.sun, &mut three)?;
            line.copy_from_slice(&three[self.cols..2 * self.cols]);
        }
        if shading.compute_edges {
            for (col, value) in line.iter_mut().enumerate() {
                if *value == 0 && self.at(row, col).is_finite() {
                    let mut nine = [0; 9];
                    shade(&self.surroundings(row, col), 3, 3, pixel, shading.sun, &mut nine)?;
                    *value = nine[4];
                }
            }
        }
        Ok(line)
    }

    /// Returns the 3 x 3 heights around a pixel, completed as in GDAL. Beyond the raster, the last two rows or columns are extrapolated
    /// linearly. A gap gets the height of the centre pixel.
    fn surroundings(&self, row: usize, col: usize) -> [f32; 9] {
        let beyond = |edge: f32, inner: f32| 2.0 * edge - inner;
        let inner = |i: usize, count: usize| if i == 0 { 1.min(count - 1) } else { i - 1 };
        let first_or_last = row == 0 || row + 1 == self.all_rows;
        std::array::from_fn(|k| {
            let r = neighbour(row, k / 3, self.all_rows);
            let c = neighbour(col, k % 3, self.cols);
            // In the first and last row, a column beyond the raster repeats the last column.
            let c = if first_or_last { c.or(Some(col)) } else { c };
            let value = match (r, c) {
                (Some(r), Some(c)) => self.at(r, c),
                (Some(r), None) => beyond(self.at(r, col), self.at(r, inner(col, self.cols))),
                (None, c) => {
                    let c = c.unwrap_or(col);
                    beyond(self.at(row, c), self.at(inner(row, self.all_rows), c))
                }
            };
            if value.is_finite() { value } else { self.at(row, col) }
        })
    }
}

/// Returns `index` + `step` − 1, or `None` if that is not in `0..count`.
fn neighbour(index: usize, step: usize, count: usize) -> Option<usize> {
    (index + step).checked_sub(1).filter(|&i| i < count)
}

fn shade(heights_m: &[f32], rows: usize, cols: usize, pixel: PixelSize, sun: Sun, out: &mut [u8]) -> Result<()> {
    let misfit = |e: elunar_core::error::LengthError| Error::input(format!("hillshade: {e}"));
    hillshade(GridView::new(heights_m, rows, cols).map_err(misfit)?, pixel, sun, out).map_err(misfit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_core::sun::Body;
    use elunar_raster::geotiff::{WriteOptions, write};
    use elunar_raster::source::InMemory;
    use elunar_raster::{Crs, GeoRef, Raster};

    fn rough(rows: usize, cols: usize, transform: [f64; 6]) -> Raster {
        let georef = GeoRef { transform, crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0) };
        let height = |i: usize| {
            let (r, c) = ((i / cols) as f32, (i % cols) as f32);
            let z = 30.0 * (r * 0.31).sin() + 25.0 * (c * 0.23 + r * 0.1).cos() + ((i * 7919) % 13) as f32 - 1900.0;
            // Gaps inside, at an edge and in a corner.
            let gap = (5..8).contains(&(i / cols)) && (9..11).contains(&(i % cols));
            if gap || i == 3 || i == rows * cols - 1 { f32::NAN } else { z }
        };
        Raster { rows, cols, samples: (0..rows * cols).map(height).collect(), georef: Some(georef) }
    }

    fn whole(raster: &Raster, shading: &HillshadeOptions) -> Vec<u8> {
        let source = InMemory::new(raster.clone(), None, "memory");
        let pixel = pixel_of(&source, "memory").unwrap();
        shade_rows(&source, 0..raster.rows, pixel, shading).unwrap()
    }

    #[test]
    fn bands_are_the_whole() {
        let raster = rough(40, 31, [0.0, 2.0, 0.0, 0.0, 0.0, -3.0]);
        let source = InMemory::new(raster.clone(), None, "memory");
        let pixel = pixel_of(&source, "memory").unwrap();
        for compute_edges in [false, true] {
            let shading = HillshadeOptions { compute_edges, ..HillshadeOptions::default() };
            let bands: Vec<u8> = [0..1, 1..17, 17..39, 39..40]
                .into_iter()
                .flat_map(|rows| shade_rows(&source, rows, pixel, &shading).unwrap())
                .collect();
            assert_eq!(bands, whole(&raster, &shading));
            let valid = bands.iter().filter(|&&b| b > 0).count();
            assert_eq!(
                valid == raster.valid_count(),
                compute_edges,
                "edges and neighbours of gaps are shaded on demand"
            );
        }
    }

    #[test]
    fn rasters_stored_upside_down_have_the_same_light() {
        let raster = rough(30, 20, [0.0, 2.0, 0.0, 60.0, 0.0, -2.0]);
        let mut flipped = raster.clone();
        flipped.samples = raster.samples.rchunks(20).flatten().copied().collect();
        flipped.georef.as_mut().unwrap().transform = [0.0, 2.0, 0.0, 0.0, 0.0, 2.0];
        let expected: Vec<u8> = whole(&raster, &HillshadeOptions::default()).rchunks(20).flatten().copied().collect();
        assert_eq!(whole(&flipped, &HillshadeOptions::default()), expected);
    }

    #[test]
    fn without_a_pixel_size_there_is_no_shade() {
        let mut raster = rough(9, 9, [0.0, 2.0, 0.0, 0.0, 0.0, -2.0]);
        raster.georef = None;
        let source = InMemory::new(raster, None, "memory");
        assert!(pixel_of(&source, "x.npy").unwrap_err().to_string().contains("x.npy: a pixel size in metres expected"));
    }

    /// Degrees on the sphere give the same metres as an equirectangular map at its standard parallel.
    #[test]
    fn degrees_are_shaded_as_metres() {
        let metres = rough(30, 30, [0.0, 500.0, 0.0, 15.0 * 500.0, 0.0, -500.0]);
        let mut degrees = metres.clone();
        let directory = vec![1, 1, 0, 3, 1024, 0, 1, 2, 2057, 34736, 1, 0, 2058, 34736, 1, 0];
        let crs = Crs { directory, doubles: vec![Body::Moon.radius_m()], ascii: String::new() };
        let step = 500.0 / Body::Moon.radius_m().to_radians();
        degrees.georef = Some(GeoRef { transform: [0.0, step, 0.0, 15.0 * step, 0.0, -step], crs });
        assert_eq!(whole(&degrees, &HillshadeOptions::default()), whole(&metres, &HillshadeOptions::default()));
    }

    #[test]
    fn matches_gdaldem_within_one() {
        let folder = tempfile::tempdir().unwrap();
        let raster = rough(61, 47, [1000.0, 2.0, 0.0, 600.0, 0.0, -3.0]);
        write(&folder.path().join("dem.tif"), &raster, &WriteOptions::heights("test")).unwrap();
        let suns = [(315.0, 45.0, 1.0), (60.0, 20.0, 2.5), (180.0, 8.0, 0.5)];
        for (k, (azimuth_deg, elevation_deg, exaggeration)) in suns.into_iter().enumerate() {
            for compute_edges in [false, true] {
                let out = folder.path().join(format!("{k}_{compute_edges}.tif"));
                let numbers = [azimuth_deg, elevation_deg, exaggeration].map(|v: f64| v.to_string());
                let Some(mut command) = elunar_testing::oracle::gdal("gdaldem") else { return };
                command.args(["hillshade", "-q", "-az", &numbers[0], "-alt", &numbers[1], "-z", &numbers[2]]);
                command.args(compute_edges.then_some("-compute_edges"));
                assert!(command.arg(folder.path().join("dem.tif")).arg(&out).status().unwrap().success());
                let expected = elunar_raster::geotiff::read(&out).unwrap();
                let sun = Sun { azimuth_deg, elevation_deg, exaggeration };
                let found = whole(&raster, &HillshadeOptions { sun, compute_edges });
                for (i, (&found, &expected)) in found.iter().zip(&expected.samples).enumerate() {
                    let expected = if expected.is_finite() { expected } else { 0.0 };
                    assert_eq!(found == 0, expected == 0.0, "pixel {i}: {found} instead of {expected}");
                    assert!((f32::from(found) - expected).abs() <= 1.0, "pixel {i}: {found} instead of {expected}");
                }
            }
        }
    }
}
