//! Error maps in four classes: those of the paper's figures, |e| below 2, 4 and 10 m and above, or classes of the same ratio that fit the errors.

use super::check_size;
use super::text::{Anchor, write};
use elunar_base::Result;
use elunar_base::quantile::nearest_rank;
use elunar_core::metrics::height::LIMITS_M;
use image::{Rgb, RgbImage};

/// Colours of positive errors, by class: white, orange, red, dark red.
const HIGH: [[u8; 3]; 4] = [[245, 245, 240], [253, 204, 138], [240, 100, 60], [150, 0, 20]];
/// Colours of negative errors, by class: white, light blue, blue, dark blue.
const LOW: [[u8; 3]; 4] = [[235, 240, 245], [166, 200, 230], [60, 130, 200], [10, 40, 120]];
/// Height of the legend, pixels.
const LEGEND_PX: u32 = 22;

/// Limits of the classes, metres, from the smallest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorLimits([f64; 3]);

impl ErrorLimits {
    /// Those of the paper's figures.
    pub const PAPER: Self = Self(LIMITS_M);

    /// Returns the paper's limits times a power of ten, or two or five times one, so that one error in fifty is beyond the last. Maps that
    /// are compared share their limits.
    #[must_use]
    pub fn of(maps: &[&[f32]]) -> Self {
        let mut sizes: Vec<f32> = maps.iter().copied().flatten().filter(|e| e.is_finite()).map(|e| e.abs()).collect();
        let Some(last) = nearest_rank(&mut sizes, 0.98).filter(|last| *last > 0.0) else { return Self::PAPER };
        let [.., top] = LIMITS_M;
        let share = f64::from(last) / top;
        let power = 10_f64.powf(share.log10().floor());
        let factor = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * power).into_iter().find(|factor| *factor >= share);
        Self(LIMITS_M.map(|limit_m| limit_m * factor.unwrap_or(share)))
    }

    /// Returns the limits, metres.
    #[must_use]
    pub fn metres(&self) -> [f64; 3] {
        self.0
    }

    /// Returns a limit as text, without digits that mean nothing.
    fn text(limit_m: f64) -> String {
        let digits = (2.0 - limit_m.abs().max(1e-9).log10().floor()).clamp(0.0, 9.0) as usize;
        let text = format!("{limit_m:+.digits$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
    }
}

/// Colours `error_m` (DTM minus truth) by class: positive errors red, negative errors blue. A legend of `LEGEND_PX` rows is added below.
/// Pixels without an error are black.
///
/// # Errors
/// [`elunar_base::Error::Input`] if there are not `rows · cols` samples.
pub fn error_map(error_m: &[f32], rows: usize, cols: usize, limits: ErrorLimits) -> Result<RgbImage> {
    check_size(error_m.len(), rows, cols)?;
    let mut map = ErrorMap::new(rows, cols, limits)?;
    map.add(error_m);
    Ok(map.finish())
}

/// An error map that is drawn row by row.
pub struct ErrorMap {
    picture: RgbImage,
    cols: usize,
    drawn: usize,
    limits: ErrorLimits,
}

impl ErrorMap {
    /// Starts a map.
    ///
    /// # Errors
    /// [`elunar_base::Error::Usage`] if it is too large for a picture.
    pub fn new(rows: usize, cols: usize, limits: ErrorLimits) -> Result<Self> {
        let (width, height) = check_size(rows.saturating_mul(cols), rows, cols)?;
        Ok(Self { picture: RgbImage::from_pixel(width, height + LEGEND_PX, Rgb([255; 3])), cols, drawn: 0, limits })
    }

    /// Draws the next errors, row by row. Those beyond the map are left out.
    pub fn add(&mut self, error_m: &[f32]) {
        let height = self.picture.height() - LEGEND_PX;
        for error in error_m {
            let (col, row) = ((self.drawn % self.cols) as u32, (self.drawn / self.cols) as u32);
            if row < height {
                self.picture.put_pixel(col, row, Rgb(class_colour(*error, self.limits)));
            }
            self.drawn += 1;
        }
    }

    /// Draws the legend.
    #[must_use]
    pub fn finish(mut self) -> RgbImage {
        let height = self.picture.height() - LEGEND_PX;
        legend(&mut self.picture, height, self.limits);
        self.picture
    }
}

fn class_colour(error_m: f32, limits: ErrorLimits) -> [u8; 3] {
    let class = limits.0.iter().filter(|&&limit_m| f64::from(error_m.abs()) >= limit_m).count();
    match error_m {
        e if !e.is_finite() => [0; 3],
        e if e < 0.0 => LOW[class],
        _ => HIGH[class],
    }
}

/// Draws eight swatches from the lowest to the highest class, with labels if there is room.
fn legend(picture: &mut RgbImage, top: u32, limits: ErrorLimits) {
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
    let signed = limits.0.iter().rev().map(|l| -l).chain([0.0]).chain(limits.0);
    for (k, limit_m) in signed.enumerate() {
        let text = if limit_m == 0.0 { "0 m".into() } else { ErrorLimits::text(limit_m) };
        write(picture, &text, edge(k as u32 + 1), top + 15, 12, Anchor::Middle);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_fit_the_errors() {
        let errors = |size: f32| (0..1000).map(|k| size * (k - 500) as f32 / 500.0).collect::<Vec<f32>>();
        let of = |size: f32| ErrorLimits::of(&[&errors(0.1), &errors(size)]).metres();
        for (size, [a, b, c]) in [(1.0, [0.2, 0.4, 1.0]), (18.0, [4.0, 8.0, 20.0]), (4.9, [1.0, 2.0, 5.0])] {
            let found = of(size);
            assert!([a, b, c].iter().zip(found).all(|(e, f)| (e - f).abs() < 1e-9), "{found:?}");
        }
        assert_eq!(ErrorLimits::of(&[&[f32::NAN, 0.0]]), ErrorLimits::PAPER);
        assert_eq!([0.2, -0.04, 20.0, 4.0, 0.1 + 0.2].map(ErrorLimits::text), ["+0.2", "-0.04", "+20", "+4", "+0.3"]);
    }
}
