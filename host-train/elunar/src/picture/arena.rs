//! Picture of the int8 runner's memory during a tile: one rectangle per tensor.

use elunar_base::{Error, Result};
use elunar_net::inspect::model::{ModelFigures, TensorLife};
use elunar_picture::{Canvas, FONT};
use image::RgbImage;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Size of the picture, pixels.
const SIZE_PX: (u32, u32) = (1400, 800);
/// Size of the axes, about, pixels.
const AXES_PX: (u32, u32) = (110, 110);
/// Size of the text inside rectangles, and the width of a letter, about, pixels.
const LETTER_PX: (u32, f64) = (12, 6.2);

/// Parts of the network and their colours.
const PARTS: [(&str, RGBColor); 6] = [
    ("inputs", RGBColor(178, 178, 178)),
    ("image encoder", RGBColor(132, 172, 220)),
    ("DTM encoder", RGBColor(236, 170, 120)),
    ("fusion and decoder", RGBColor(136, 194, 150)),
    ("upsampled maps", RGBColor(186, 160, 212)),
    ("output", RGBColor(222, 136, 146)),
];
const SCRATCH: RGBColor = RGBColor(235, 205, 90);
const LIVE: RGBColor = RGBColor(20, 20, 20);

/// Draws when each tensor is in use (in multiply-accumulates done) and its place in the arena. Also drawn are the scratch memory above the
/// tensors, the bytes of all tensors in use as a line, and their peak.
///
/// # Errors
/// [`Error::Usage`] if drawing fails.
pub fn arena(plan: &ModelFigures) -> Result<RgbImage> {
    let mut pixels = RgbImage::new(SIZE_PX.0, SIZE_PX.1);
    draw(&mut pixels, plan).map_err(|e| Error::usage(format!("plan: {e}")))?;
    Ok(pixels)
}

/// Returns the part of the network to which a tensor belongs, by its name.
fn part(name: &str) -> usize {
    let numbered = |letter: char| name.strip_prefix(letter).is_some_and(|n| n.parse::<u8>().is_ok());
    match name {
        "image" | "coarse" => 0,
        "output" => 5,
        _ if name.ends_with(elunar_net::export::quantise::UPSAMPLED) => 4,
        _ if name.starts_with("image_encoder") || numbered('e') => 1,
        _ if name.starts_with("dtm_encoder") || numbered('s') => 2,
        _ => 3,
    }
}

fn draw(pixels: &mut RgbImage, plan: &ModelFigures) -> std::result::Result<(), String> {
    let text = |e: &dyn std::fmt::Display| e.to_string();
    let area = Canvas::new(pixels).into_drawing_area();
    area.fill(&WHITE).map_err(|e| text(&e))?;
    let (end, top) = (plan.macs.max(1) as f64 / 1e6, plan.arena_bytes as f64 / 1e3);
    let name = if plan.name.is_empty() { "model" } else { &plan.name };
    let title = format!(
        "{name} ({}): arena {} bytes; tensors alive together take {} at most",
        plan.precision, plan.arena_bytes, plan.live_peak_bytes
    );
    let mut builder = ChartBuilder::on(&area);
    builder.caption(title, (FONT, 20)).margin(14).x_label_area_size(44).y_label_area_size(72);
    let mut chart = builder.build_cartesian_2d(0.0..end, 0.0..top * 1.12).map_err(|e| text(&e))?;
    let mut mesh = chart.configure_mesh();
    mesh.x_desc("work done, 10^6 multiply-accumulates").y_desc("place in the arena, 10^3 bytes");
    mesh.label_style((FONT, 14)).axis_desc_style((FONT, 15)).disable_mesh().draw().map_err(|e| text(&e))?;
    for (index, (label, colour)) in PARTS.iter().enumerate() {
        let members: Vec<&TensorLife> = plan.tensors.iter().filter(|t| part(&t.name) == index).collect();
        let block = |t: &&TensorLife| Rectangle::new(corners(t), colour.filled());
        let drawn = chart.draw_series(members.iter().map(block)).map_err(|e| text(&e))?;
        drawn.label(*label).legend(|(x, y)| Rectangle::new([(x, y - 5), (x + 14, y + 5)], colour.filled()));
    }
    chart.draw_series(plan.tensors.iter().map(|t| Rectangle::new(corners(t), WHITE))).map_err(|e| text(&e))?;
    let scratch = [(0.0, (plan.arena_bytes - plan.scratch_bytes) as f64 / 1e3), (end, top)];
    let drawn = chart.draw_series([Rectangle::new(scratch, SCRATCH.filled())]).map_err(|e| text(&e))?;
    drawn.label("scratch").legend(|(x, y)| Rectangle::new([(x, y - 5), (x + 14, y + 5)], SCRATCH.filled()));
    let peak = plan.live_peak_bytes as f64 / 1e3;
    let line = DashedLineSeries::new([(0.0, peak), (end, peak)], 6, 4, LIVE.stroke_width(1));
    let drawn = chart.draw_series(line).map_err(|e| text(&e))?;
    drawn.label("their peak").legend(|(x, y)| PathElement::new([(x, y), (x + 14, y)], LIVE.mix(0.5)));
    let drawn = chart.draw_series(LineSeries::new(live(plan), LIVE.stroke_width(2))).map_err(|e| text(&e))?;
    drawn.label("bytes of live tensors").legend(|(x, y)| PathElement::new([(x, y), (x + 14, y)], LIVE.stroke_width(2)));
    chart.draw_series(labels(plan, (end, top * 1.12))).map_err(|e| text(&e))?;
    let mut legend = chart.configure_series_labels();
    legend.position(SeriesLabelPosition::UpperRight).background_style(WHITE.mix(0.85)).border_style(BLACK.mix(0.3));
    legend.label_font((FONT, 14)).draw().map_err(|e| text(&e))
}

fn corners(t: &TensorLife) -> [(f64, f64); 2] {
    let (from, to) = (t.offset as f64 / 1e3, (t.offset + t.bytes) as f64 / 1e3);
    [(t.first_mac as f64 / 1e6, from), (t.last_mac as f64 / 1e6, to)]
}

/// Returns the bytes of tensors in use as steps.
fn live(plan: &ModelFigures) -> Vec<(f64, f64)> {
    let mut points: Vec<(f64, f64)> = Vec::with_capacity(2 * plan.live.len() + 1);
    for &(macs, bytes) in &plan.live {
        let (x, y) = (macs as f64 / 1e6, bytes as f64 / 1e3);
        points.extend(points.last().map(|last| (x, last.1)));
        points.push((x, y));
    }
    points.extend(points.last().map(|last| (plan.macs as f64 / 1e6, last.1)));
    points
}

/// Returns names and bytes where they fit. Tensors that share bytes while in use have one label: a sum and what is added to it, the output
/// and the inputs.
fn labels(plan: &ModelFigures, (end, top): (f64, f64)) -> Vec<Text<'static, (f64, f64), String>> {
    let mut groups: Vec<Vec<&TensorLife>> = Vec::new();
    for t in &plan.tensors {
        match groups.iter_mut().find(|group| group.iter().any(|other| share(t, other))) {
            Some(group) => group.push(t),
            None => groups.push(vec![t]),
        }
    }
    let (width, height) = ((SIZE_PX.0 - AXES_PX.0) as f64, (SIZE_PX.1 - AXES_PX.1) as f64);
    let style = (FONT, LETTER_PX.0).into_font().color(&BLACK).pos(Pos::new(HPos::Center, VPos::Center));
    let mut texts = Vec::new();
    for group in &groups {
        let [(left, low), (right, high)] = corners(group[0]);
        let names: Vec<&str> = group.iter().map(|t| t.name.as_str()).collect();
        let bytes = group.iter().map(|t| t.bytes).max().unwrap_or(0);
        let fits = |label: &String| {
            let wide = (right - left) / end * width > LETTER_PX.1 * label.len() as f64;
            wide && (high - low) / top * height > LETTER_PX.0 as f64
        };
        let labels = [format!("{} {bytes}", names.join(" + ")), format!("{} + {} {bytes}", names[0], names.len() - 1)];
        if let Some(label) = labels.into_iter().find(fits) {
            texts.push(Text::new(label, ((left + right) / 2.0, (low + high) / 2.0), style.clone()));
        }
    }
    texts
}

fn share(a: &TensorLife, b: &TensorLife) -> bool {
    let places = a.offset < b.offset + b.bytes && b.offset < a.offset + a.bytes;
    places && a.first_mac < b.last_mac && b.first_mac < a.last_mac
}
