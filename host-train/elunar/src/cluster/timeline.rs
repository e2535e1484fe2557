//! Picture of a run: a bar for every attempt, a lane for every slot of every machine.

use super::outcome::{Outcome, Verdict};
use elunar_raster::{Error, Result};
use elunar_scene::picture::{Canvas, FONT};
use image::RgbImage;
use plotters::prelude::*;
use std::collections::BTreeMap;

/// Width of the picture, and its greatest height, pixels.
const WIDTH_PX: u32 = 1200;
const MOST_PX: u32 = 2000;

const KINDS: [(&str, Verdict, RGBColor); 4] = [
    ("done", Verdict::Done, RGBColor(64, 132, 92)),
    ("done before", Verdict::DoneBefore, RGBColor(160, 200, 170)),
    ("to try again", Verdict::TryAgain, RGBColor(230, 170, 20)),
    ("failed", Verdict::Failed, RGBColor(170, 40, 60)),
];

/// Draws the attempts.
///
/// # Errors
/// [`Error::Input`] if there is none.
pub fn timeline(attempts: &[Outcome]) -> Result<RgbImage> {
    if attempts.is_empty() {
        return Err(Error::input("timeline: an attempt at least expected, none found in the logs"));
    }
    let mut lanes: BTreeMap<(&str, &str, usize), usize> = BTreeMap::new();
    lanes.extend(attempts.iter().map(|a| ((a.host.as_str(), a.chunk.as_str(), a.slot), 0)));
    lanes.values_mut().enumerate().for_each(|(number, lane)| *lane = number);
    let size = (WIDTH_PX, (140 + 12 * lanes.len() as u32).min(MOST_PX));
    let mut pixels = RgbImage::new(size.0, size.1);
    draw(&mut pixels, attempts, &lanes).map_err(|e| Error::input(format!("timeline: {e}")))?;
    Ok(pixels)
}

fn draw(
    pixels: &mut RgbImage,
    attempts: &[Outcome],
    lanes: &BTreeMap<(&str, &str, usize), usize>,
) -> std::result::Result<(), String> {
    let text = |e: &dyn std::fmt::Display| e.to_string();
    let area = Canvas::new(pixels).into_drawing_area();
    area.fill(&WHITE).map_err(|e| text(&e))?;
    let start = attempts.iter().map(|a| a.start_s).fold(f64::INFINITY, f64::min);
    let end = attempts.iter().map(|a| a.start_s + a.seconds).fold(0.0, f64::max);
    let span = (end - start).max(1e-3);
    let mut builder = ChartBuilder::on(&area);
    let title = format!("{} attempts on {} lanes in {span:.0} s", attempts.len(), lanes.len());
    builder.caption(title, (FONT, 18)).margin(12).x_label_area_size(40).y_label_area_size(50);
    let mut chart = builder.build_cartesian_2d(0.0..span, lanes.len() as f64..0.0).map_err(|e| text(&e))?;
    let mut mesh = chart.configure_mesh();
    mesh.x_desc("time, s").y_desc("lane (machine, chunk, slot)").disable_mesh();
    mesh.label_style((FONT, 13)).axis_desc_style((FONT, 14)).draw().map_err(|e| text(&e))?;
    for (name, verdict, colour) in KINDS {
        let bars = attempts.iter().filter(|a| a.verdict == verdict).map(|a| {
            let lane = lanes.get(&(a.host.as_str(), a.chunk.as_str(), a.slot)).copied().unwrap_or_default() as f64;
            let from = a.start_s - start;
            Rectangle::new([(from, lane + 0.1), (from + a.seconds, lane + 0.9)], colour.filled())
        });
        let drawn = chart.draw_series(bars).map_err(|e| text(&e))?;
        drawn.label(name).legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 14, y + 5)], colour.filled()));
    }
    let mut legend = chart.configure_series_labels();
    legend.position(SeriesLabelPosition::UpperRight).background_style(WHITE.mix(0.85)).border_style(BLACK.mix(0.3));
    legend.label_font((FONT, 13)).draw().map_err(|e| text(&e))
}
