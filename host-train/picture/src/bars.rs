//! Bar charts with horizontal bars, several values per line.

use super::text::{Anchor, write};
use elunar_base::{Error, Result};
use image::{Rgb, RgbImage};

/// Width of the picture and of its column of names, pixels.
const WIDTH_PX: (u32, u32) = (1000, 320);
/// Height of a bar, and the gap between lines, pixels.
const BAR_PX: (u32, u32) = (7, 6);
/// Height above the first line, for title and legend, pixels.
const HEAD_PX: u32 = 64;
/// Width right of the longest bar, for its value, pixels.
const VALUE_PX: u32 = 90;
/// Colours of the values of a line.
const COLOURS: [Rgb<u8>; 4] = [Rgb([214, 90, 30]), Rgb([31, 90, 165]), Rgb([40, 140, 70]), Rgb([120, 80, 170])];

/// Contents of a bar chart.
#[derive(Debug, Clone)]
pub struct Bars<'a> {
    /// Title, with the unit.
    pub title: &'a str,
    /// Names of the values of a line; at most four.
    pub legend: &'a [&'a str],
    /// Name and values of every line; a value may be missing.
    pub lines: Vec<(String, Vec<Option<f64>>)>,
}

/// Draws the bars from 0 on. The first value of a line is written behind its bars.
///
/// # Errors
/// [`Error::Input`] without a positive value.
pub fn bars(bars: &Bars<'_>) -> Result<RgbImage> {
    let finite = |v: &Option<f64>| v.filter(|v| v.is_finite());
    let largest = bars.lines.iter().flat_map(|(_, values)| values.iter().filter_map(finite)).fold(0.0, f64::max);
    if largest <= 0.0 {
        return Err(Error::input(format!("{}: no bar to draw", bars.title)));
    }
    let each = bars.legend.len().clamp(1, COLOURS.len()) as u32;
    let line_px = each * BAR_PX.0 + BAR_PX.1;
    let height = HEAD_PX + line_px * bars.lines.len() as u32 + BAR_PX.1;
    let mut picture = RgbImage::from_pixel(WIDTH_PX.0, height, Rgb([255; 3]));
    write(&mut picture, bars.title, 10, 18, 18, Anchor::Left);
    let mut left = 10;
    for (name, colour) in bars.legend.iter().zip(COLOURS) {
        fill(&mut picture, (left, 38), (14, 10), colour);
        write(&mut picture, name, left + 20, 43, 14, Anchor::Left);
        left += 44 + 8 * name.len() as u32;
    }
    let room = (WIDTH_PX.0 - WIDTH_PX.1 - VALUE_PX) as f64;
    for (index, (name, values)) in bars.lines.iter().enumerate() {
        let top = HEAD_PX + line_px * index as u32;
        let middle = top + each * BAR_PX.0 / 2;
        write(&mut picture, name, 10, middle, 12, Anchor::Left);
        let mut longest = 0;
        for (k, (value, colour)) in values.iter().zip(COLOURS).enumerate() {
            let Some(value) = finite(value) else { continue };
            // Every positive value is at least one pixel long.
            let length = (value.max(0.0) / largest * room).ceil() as u32;
            fill(&mut picture, (WIDTH_PX.1, top + k as u32 * BAR_PX.0), (length, BAR_PX.0 - 1), colour);
            longest = longest.max(length);
        }
        if let Some(value) = values.iter().find_map(finite) {
            write(&mut picture, &format!("{value:.4}"), WIDTH_PX.1 + longest + 6, middle, 12, Anchor::Left);
        }
    }
    Ok(picture)
}

fn fill(picture: &mut RgbImage, (left, top): (u32, u32), (width, height): (u32, u32), colour: Rgb<u8>) {
    for (col, row) in (left..left + width).flat_map(|col| (top..top + height).map(move |row| (col, row))) {
        if let Some(pixel) = picture.get_pixel_mut_checked(col, row) {
            *pixel = colour;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_as_long_as_their_values() {
        let lines = vec![("one".into(), vec![Some(2.0), None]), ("two".into(), vec![Some(1.0), Some(0.5)])];
        let made = bars(&Bars { title: "Lengths", legend: &["a", "b"], lines }).unwrap();
        let of = |colour: Rgb<u8>, from: u32| {
            made.enumerate_pixels().filter(|(_, row, p)| **p == colour && *row >= from).count() as f64
        };
        // The legend's squares are left out.
        let (a, b) = (of(COLOURS[0], HEAD_PX), of(COLOURS[1], HEAD_PX));
        assert!((a / b - 6.0).abs() < 0.05, "{a} {b}");
        assert!(bars(&Bars { title: "None", legend: &["a"], lines: vec![("x".into(), vec![None])] }).is_err());
    }
}
