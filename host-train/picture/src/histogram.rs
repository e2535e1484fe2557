//! Histograms.

use super::canvas::Canvas;
use super::font::FONT;
use elunar_base::{Error, Result};
use image::RgbImage;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Size of the picture, pixels.
const SIZE_PX: (u32, u32) = (900, 480);
/// Number of bars.
const BINS: usize = 60;
const BAR: RGBColor = RGBColor(31, 90, 165);
const LINE: RGBColor = RGBColor(214, 90, 30);

/// Draws the histogram of the finite `values`, with a labelled vertical line at each of `lines`.
///
/// # Errors
/// [`Error::Input`] if there is no finite value.
pub fn histogram(title: &str, x: &str, values: &[f64], lines: &[(String, f64)]) -> Result<RgbImage> {
    let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    if finite.is_empty() {
        return Err(Error::input(format!("{title}: no value to draw")));
    }
    let all = finite.iter().chain(lines.iter().map(|(_, at)| at)).filter(|v| v.is_finite());
    let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)));
    let room = 0.02 * (high - low).max(1e-6 * high.abs()).max(1e-6);
    let (low, high) = (low - room, high + room);
    let step = (high - low) / BINS as f64;
    let mut counts = vec![0_u32; BINS];
    finite.iter().for_each(|v| counts[(((v - low) / step) as usize).min(BINS - 1)] += 1);
    let top = f64::from(counts.iter().copied().max().unwrap_or(1)) * 1.12;
    let mut pixels = RgbImage::new(SIZE_PX.0, SIZE_PX.1);
    draw(&mut pixels, (title, x), (low, step, top), &counts, lines)
        .map_err(|e| Error::input(format!("{title}: {e}")))?;
    Ok(pixels)
}

fn draw(
    pixels: &mut RgbImage,
    (title, x): (&str, &str),
    (low, step, top): (f64, f64, f64),
    counts: &[u32],
    lines: &[(String, f64)],
) -> std::result::Result<(), String> {
    let text = |e: &dyn std::fmt::Display| e.to_string();
    let area = Canvas::new(pixels).into_drawing_area();
    area.fill(&WHITE).map_err(|e| text(&e))?;
    let mut builder = ChartBuilder::on(&area);
    builder.caption(title, (FONT, 20)).margin(10).x_label_area_size(44).y_label_area_size(64);
    let high = low + step * counts.len() as f64;
    let mut chart = builder.build_cartesian_2d(low..high, 0.0..top).map_err(|e| text(&e))?;
    let mut mesh = chart.configure_mesh();
    mesh.x_desc(x).y_desc("tiles").label_style((FONT, 14)).axis_desc_style((FONT, 15)).light_line_style(WHITE);
    mesh.draw().map_err(|e| text(&e))?;
    let bar = |(k, &count): (usize, &u32)| {
        let left = low + step * k as f64;
        Rectangle::new([(left, 0.0), (left + 0.9 * step, f64::from(count))], BAR.filled())
    };
    chart.draw_series(counts.iter().enumerate().filter(|(_, n)| **n > 0).map(bar)).map_err(|e| text(&e))?;
    for (label, at) in lines {
        chart.draw_series([PathElement::new([(*at, 0.0), (*at, top)], LINE.stroke_width(2))]).map_err(|e| text(&e))?;
        // Beside the line, on the side with more room.
        let (side, shift) = if *at > low + 0.75 * (high - low) { (HPos::Right, -0.4) } else { (HPos::Left, 0.4) };
        let style = (FONT, 14).into_font().color(&BLACK).pos(Pos::new(side, VPos::Top));
        let label = Text::new(label.clone(), (*at + shift * step, 0.99 * top), style);
        chart.draw_series([label]).map_err(|e| text(&e))?;
    }
    area.present().map_err(|e| text(&e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_and_lines_are_drawn() {
        let values: Vec<f64> = (0..500).map(|i| f64::from(i * 7919 % 97)).chain([f64::NAN]).collect();
        let made = histogram("Relief", "m", &values, &[("mean".into(), 48.0)]).unwrap();
        let of = |colour: RGBColor| made.pixels().filter(|p| p.0 == [colour.0, colour.1, colour.2]).count();
        assert!(of(BAR) > 50_000 && of(LINE) > 300, "{} {}", of(BAR), of(LINE));
        assert!(histogram("One", "m", &[3.0], &[]).is_ok());
        assert!(histogram("None", "m", &[f64::NAN], &[]).is_err());
    }
}
