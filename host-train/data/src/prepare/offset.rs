//! The offset between a DTM and its image. The DTM's hillshade, under the image's light, is moved over the image to the best agreement.

use elunar_base::{Error, Result};
use elunar_core::terrain::{PixelSize, Sun};
use elunar_picture::shading::{HillshadeOptions, shade_rows};
use elunar_raster::Raster;
use elunar_raster::source::InMemory;

/// Radius, in pixels, of the box whose mean is subtracted from both pictures. It removes albedo and slow changes of light.
const BOX_PX: usize = 12;

/// The offset with the best agreement.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Offset {
    /// Rows by which the DTM lies below the image; negative above.
    pub rows_px: f64,
    /// Columns by which the DTM lies right of the image; negative left.
    pub cols_px: f64,
    /// Normalised cross-correlation at this offset, -1 to 1.
    pub correlation: f64,
}

impl Offset {
    /// Returns the length of the offset, pixels.
    #[must_use]
    pub fn distance_px(&self) -> f64 {
        self.rows_px.hypot(self.cols_px)
    }
}

/// Measures the offset of `heights_m` from `image`, both row-major `rows` x `cols` without gaps. It is the maximum of the normalised
/// cross-correlation of image and hillshade within `search_px` pixels in each direction. A paraboloid through the maximum and its
/// neighbours gives the fraction. At the border of the search, the offset is that of the border; the true offset is at least as large.
/// `None` if image or hillshade is constant.
///
/// # Errors
/// [`Error::Input`] if the maps are too small for the search or do not have `rows · cols` samples.
pub fn measure(
    image: &[f32],
    heights_m: &[f32],
    (rows, cols): (usize, usize),
    pixel: PixelSize,
    sun: Sun,
    search_px: usize,
) -> Result<Option<Offset>> {
    if image.len() != rows * cols || heights_m.len() != rows * cols || rows.min(cols) < 4 * (search_px + 1) {
        let found = format!("{} and {} samples, {rows} x {cols}", image.len(), heights_m.len());
        return Err(Error::input(format!(
            "offset: maps of four times {search_px} pixels and more expected, {found} found"
        )));
    }
    let shade = shaded(heights_m, rows, cols, pixel, sun)?;
    let (image, shade) = (detail(image, rows, cols), detail(&shade, rows, cols));
    let side = 2 * search_px + 1;
    let template = Template::new(&shade, rows, cols, search_px + 1);
    let scores: Option<Vec<f64>> = (0..side * side).map(|k| template.correlate(&image, k / side, k % side)).collect();
    let Some(scores) = scores else { return Ok(None) };
    let best = (0..scores.len()).fold(0, |best, k| if scores[k] > scores[best] { k } else { best });
    let (row, col) = (best / side, best % side);
    let at_border = row == 0 || col == 0 || row + 1 == side || col + 1 == side;
    let (row_fraction, col_fraction) = if at_border {
        (0.0, 0.0)
    } else {
        peak(std::array::from_fn(|k| scores[(row + k / 3 - 1) * side + col + k % 3 - 1]))
    };
    // The image was searched around the hillshade. If the image lies to the right, the DTM lies to the left.
    Ok(Some(Offset {
        rows_px: search_px as f64 - row as f64 - row_fraction,
        cols_px: search_px as f64 - col as f64 - col_fraction,
        correlation: scores[best],
    }))
}

/// Returns the peak of the paraboloid that fits 3 x 3 values best (least squares): rows and columns from the centre; (0, 0) if there is no
/// peak.
///
/// Light from one side stretches the peak across its direction, oblique to rows and columns. Two parabolas along rows and columns would
/// miss the peak by a third of a pixel.
fn peak(values: [f64; 9]) -> (f64, f64) {
    let sum = |weight: fn(f64, f64) -> f64| -> f64 {
        let weighted = |(k, v): (usize, &f64)| v * weight((k / 3) as f64 - 1.0, (k % 3) as f64 - 1.0);
        values.iter().enumerate().map(weighted).sum()
    };
    let level = sum(|_, _| 1.0) / 3.0;
    // Half the second derivatives, then the mixed derivative, then the first derivatives.
    let (rr, cc) = (0.5 * sum(|r, _| r * r) - level, 0.5 * sum(|_, c| c * c) - level);
    let (rc, r, c) = (0.25 * sum(|r, c| r * c), sum(|r, _| r) / 6.0, sum(|_, c| c) / 6.0);
    let determinant = 4.0 * rr * cc - rc * rc;
    if !(rr < 0.0 && determinant > 0.0) {
        return (0.0, 0.0);
    }
    let (row, col) = ((rc * c - 2.0 * cc * r) / determinant, (rc * r - 2.0 * rr * c) / determinant);
    (row.clamp(-1.0, 1.0), col.clamp(-1.0, 1.0))
}

fn shaded(heights_m: &[f32], rows: usize, cols: usize, pixel: PixelSize, sun: Sun) -> Result<Vec<f32>> {
    let raster = Raster { rows, cols, samples: heights_m.to_vec(), georef: None };
    let shading = HillshadeOptions { sun, compute_edges: true };
    let bytes = shade_rows(&InMemory::new(raster, None, "tile"), 0..rows, pixel, &shading)?;
    Ok(bytes.into_iter().map(f32::from).collect())
}

/// Subtracts from a map its mean over a box around each pixel. Only the part of the box within the map counts.
fn detail(map: &[f32], rows: usize, cols: usize) -> Vec<f32> {
    // Sums over all pixels above and to the left, so that the sum over any box needs four reads.
    let stride = cols + 1;
    let mut sums = vec![0.0_f64; (rows + 1) * stride];
    for row in 0..rows {
        let mut line = 0.0;
        for col in 0..cols {
            line += f64::from(map[row * cols + col]);
            sums[(row + 1) * stride + col + 1] = sums[row * stride + col + 1] + line;
        }
    }
    let mean = |row: usize, col: usize| {
        let (top, bottom) = (row.saturating_sub(BOX_PX), (row + BOX_PX + 1).min(rows));
        let (left, right) = (col.saturating_sub(BOX_PX), (col + BOX_PX + 1).min(cols));
        let sum = sums[bottom * stride + right] - sums[top * stride + right] - sums[bottom * stride + left]
            + sums[top * stride + left];
        sum / ((bottom - top) * (right - left)) as f64
    };
    (0..rows * cols).map(|i| map[i] - mean(i / cols, i % cols) as f32).collect()
}

/// The inner part of a picture, to be searched in another picture of the same size.
struct Template {
    /// Samples minus their mean, row-major.
    values: Vec<f32>,
    rows: usize,
    cols: usize,
    /// Number of columns of the whole picture.
    stride: usize,
    square: f64,
}

impl Template {
    fn new(whole: &[f32], rows: usize, cols: usize, margin: usize) -> Self {
        let (inner_rows, inner_cols) = (rows - 2 * margin, cols - 2 * margin);
        let line = |row: usize| &whole[(row + margin) * cols + margin..][..inner_cols];
        let mut values: Vec<f32> = (0..inner_rows).flat_map(|row| line(row).iter().copied()).collect();
        let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64;
        values.iter_mut().for_each(|v| *v -= mean as f32);
        let square = values.iter().map(|&v| f64::from(v) * f64::from(v)).sum();
        Self { values, rows: inner_rows, cols: inner_cols, stride: cols, square }
    }

    /// Returns the normalised cross-correlation with the part of `picture` whose upper left pixel is (`row` + 1, `col` + 1); `None` if
    /// either is constant.
    fn correlate(&self, picture: &[f32], row: usize, col: usize) -> Option<f64> {
        let (mut product, mut sum, mut square) = (0.0_f64, 0.0_f64, 0.0_f64);
        for r in 0..self.rows {
            let here = &self.values[r * self.cols..][..self.cols];
            let there = &picture[(r + row + 1) * self.stride + col + 1..][..self.cols];
            // Each row is summed in f32 for speed. It has some hundred addends at most.
            let (mut p, mut s, mut q) = (0.0_f32, 0.0_f32, 0.0_f32);
            for (a, b) in here.iter().zip(there) {
                p += a * b;
                s += b;
                q += b * b;
            }
            product += f64::from(p);
            sum += f64::from(s);
            square += f64::from(q);
        }
        // The template's mean is 0, so the picture's mean does not change the product.
        let variance = square - sum * sum / self.values.len() as f64;
        let scale = (self.square * variance.max(0.0)).sqrt();
        (scale > 0.0).then(|| product / scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_raster::resample::{PixelMap, resample_bicubic};
    use elunar_synth::{Moon, SynthOptions};

    fn sun_of(azimuth_deg: f64, elevation_deg: f64) -> Sun {
        Sun { azimuth_deg, elevation_deg, exaggeration: 1.0 }
    }

    #[test]
    fn planted_offsets_are_found() {
        let moon = Moon::new(5, SynthOptions { rows: 300, cols: 360, ..SynthOptions::default() }).unwrap();
        let planted = [(0.0, 0.0), (1.3, -2.6), (-3.45, 0.75), (5.2, 4.1), (-0.4, -0.5), (0.25, 6.7)];
        let mut worst: f64 = 0.0;
        for (index, &(down, right)) in planted.iter().enumerate() {
            let tile = moon.tile(index as u64);
            let sun = sun_of(tile.sun_azimuth_deg, tile.sun_elevation_deg);
            // The ground at (row - down, col - right) appears at (row, col): moved down and right.
            let map = PixelMap {
                row0: 22.0 - down,
                row_per_row: 1.0,
                row_per_col: 0.0,
                col0: 20.0 - right,
                col_per_row: 0.0,
                col_per_col: 1.0,
            };
            let truth = resample_bicubic(&tile.truth_m, tile.rows, tile.cols, &map, 256, 320);
            let image: Vec<f32> =
                (0..256 * 320).map(|i| tile.image[(i / 320 + 22) * tile.cols + i % 320 + 20]).collect();
            let found = measure(&image, &truth, (256, 320), PixelSize::square(2.0), sun, 8).unwrap().unwrap();
            eprintln!("planted {down} {right}, found {found:?}");
            worst = worst.max((found.rows_px - down).abs()).max((found.cols_px - right).abs());
            assert!(found.correlation > 0.5, "{found:?}");
        }
        assert!(worst < 0.1, "{worst} px");
    }

    #[test]
    fn paraboloids_have_their_peak_where_it_is() {
        let surface = |r0: f64, c0: f64| -> [f64; 9] {
            std::array::from_fn(|k| {
                let (r, c) = ((k / 3) as f64 - 1.0 - r0, (k % 3) as f64 - 1.0 - c0);
                0.9 - 0.03 * r * r - 0.05 * c * c + 0.06 * r * c
            })
        };
        let (row, col) = peak(surface(0.3, -0.45));
        assert!((row - 0.3).abs() < 1e-12 && (col + 0.45).abs() < 1e-12, "{row} {col}");
        assert_eq!(peak(surface(0.0, 0.0).map(|v| -v)), (0.0, 0.0), "a hollow has no peak");
    }

    #[test]
    fn nothing_to_see_has_no_offset_and_small_maps_are_refused() {
        let flat = vec![1.0; 64 * 64];
        let pixel = PixelSize::square(2.0);
        assert_eq!(measure(&flat, &flat, (64, 64), pixel, Sun::default(), 4).unwrap(), None);
        assert!(measure(&flat, &flat, (64, 64), pixel, Sun::default(), 20).is_err());
        assert!(measure(&flat, &flat[1..], (64, 64), pixel, Sun::default(), 4).is_err());
    }
}
