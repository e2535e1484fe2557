//! Error maps in the classes of the paper's figures: |e| below 2, 4 and 10 m, and above.

use super::check_size;
use super::text::{Anchor, write};
use elunar_base::Result;
use elunar_core::metrics::height::LIMITS_M;
use image::{Rgb, RgbImage};

/// Colours of positive errors, by class: white, orange, red, dark red.
const HIGH: [[u8; 3]; 4] = [[245, 245, 240], [253, 204, 138], [240, 100, 60], [150, 0, 20]];
/// Colours of negative errors, by class: white, light blue, blue, dark blue.
const LOW: [[u8; 3]; 4] = [[235, 240, 245], [166, 200, 230], [60, 130, 200], [10, 40, 120]];
/// Height of the legend, pixels.
const LEGEND_PX: u32 = 22;

/// Colours `error_m` (DTM minus truth) by class: positive errors red, negative errors blue. A legend of `LEGEND_PX` rows is added below.
/// Pixels without an error are black.
///
/// # Errors
/// [`elunar_base::Error::Input`] if there are not `rows · cols` samples.
pub fn error_map(error_m: &[f32], rows: usize, cols: usize) -> Result<RgbImage> {
    check_size(error_m.len(), rows, cols)?;
    let mut map = ErrorMap::new(rows, cols)?;
    map.add(error_m);
    Ok(map.finish())
}

/// An error map that is drawn row by row.
pub struct ErrorMap {
    picture: RgbImage,
    cols: usize,
    drawn: usize,
}

impl ErrorMap {
    /// Starts a map.
    ///
    /// # Errors
    /// [`elunar_base::Error::Usage`] if it is too large for a picture.
    pub fn new(rows: usize, cols: usize) -> Result<Self> {
        let (width, height) = check_size(rows.saturating_mul(cols), rows, cols)?;
        Ok(Self { picture: RgbImage::from_pixel(width, height + LEGEND_PX, Rgb([255; 3])), cols, drawn: 0 })
    }

    /// Draws the next errors, row by row. Those beyond the map are left out.
    pub fn add(&mut self, error_m: &[f32]) {
        let height = self.picture.height() - LEGEND_PX;
        for error in error_m {
            let (col, row) = ((self.drawn % self.cols) as u32, (self.drawn / self.cols) as u32);
            if row < height {
                self.picture.put_pixel(col, row, Rgb(class_colour(*error)));
            }
            self.drawn += 1;
        }
    }

    /// Draws the legend.
    #[must_use]
    pub fn finish(mut self) -> RgbImage {
        let height = self.picture.height() - LEGEND_PX;
        legend(&mut self.picture, height);
        self.picture
    }
}

fn class_colour(error_m: f32) -> [u8; 3] {
    let class = LIMITS_M.iter().filter(|&&limit_m| f64::from(error_m.abs()) >= limit_m).count();
    match error_m {
        e if !e.is_finite() => [0; 3],
        e if e < 0.0 => LOW[class],
        _ => HIGH[class],
    }
}

/// Draws eight swatches from the lowest to the highest class, with labels if there is room.
fn legend(picture: &mut RgbImage, top: u32) {
    let width = picture.width();
    let swatches: Vec<[u8; 3]> = LOW.iter().rev().chain(&HIGH).copied().collect();
    let count = swatches.len() as u32;
    let edge = |k: u32| k * width / count;
    for (k, colour) in swatches.iter().enumerate() {
        for col in edge(k as u32)..edge(k as u32 + 1) {
            for row in top + 2..top + 8 {
                picture.put_pixel(col, row, Rgb(*colour));
            }
        }
    }
    const LABEL_ROOM_PX: u32 = 30;
    if width < count * LABEL_ROOM_PX {
        return;
    }
    let limits: Vec<f64> = LIMITS_M.iter().rev().map(|l| -l).chain([0.0]).chain(LIMITS_M).collect();
    for (k, limit_m) in limits.iter().enumerate() {
        let unit = if *limit_m == 0.0 { " m" } else { "" };
        write(
            picture,
            &format!("{limit_m:+}{unit}").replace("+0", "0"),
            edge(k as u32 + 1),
            top + 15,
            12,
            Anchor::Middle,
        );
    }
}
