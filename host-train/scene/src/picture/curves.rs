//! Curves: losses and errors over training steps.

use super::text::{FONT, install_font};
use super::write_png;
use elunar_raster::{Error, Result};
use image::RgbImage;
use plotters::coord::ranged1d::ValueFormatter;
use plotters::prelude::*;
use std::ops::Range;
use std::path::Path;

/// One curve.
#[derive(Debug, Clone)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Points (x, y), in order of x. Points that are not finite are left out.
    pub points: Vec<(f64, f64)>,
}

/// Title and axes of a chart.
#[derive(Debug, Clone, Copy)]
pub struct Chart<'a> {
    /// Title.
    pub title: &'a str,
    /// Name of x, with its unit.
    pub x: &'a str,
    /// Name of y, with its unit.
    pub y: &'a str,
    /// Whether y is logarithmic. Points with y ≤ 0 are then left out.
    pub log_y: bool,
}

/// Size of the picture, pixels.
const SIZE_PX: (u32, u32) = (900, 480);
/// Colours of the curves, in turn.
const COLOURS: [RGBColor; 13] = [
    RGBColor(31, 90, 165),
    RGBColor(214, 90, 30),
    RGBColor(40, 140, 70),
    RGBColor(170, 40, 60),
    RGBColor(120, 80, 170),
    RGBColor(110, 110, 110),
    RGBColor(0, 160, 170),
    RGBColor(230, 170, 20),
    RGBColor(225, 110, 175),
    RGBColor(120, 70, 30),
    RGBColor(140, 190, 60),
    RGBColor(95, 170, 230),
    RGBColor(20, 20, 20),
];

/// Draws the curves into a PNG file.
///
/// # Errors
/// [`Error::Usage`] if there is no point to draw, [`Error::Io`] if the file cannot be written.
pub fn curves(path: &Path, chart: &Chart, series: &[Series]) -> Result<()> {
    write_png(path, plot(chart, series)?)
}

/// Draws the curves as [`curves`] does, in memory.
///
/// # Errors
/// [`Error::Usage`] if there is no point to draw.
pub fn plot(chart: &Chart, series: &[Series]) -> Result<RgbImage> {
    install_font();
    let fits = |(x, y): &(f64, f64)| x.is_finite() && y.is_finite() && (!chart.log_y || *y > 0.0);
    let series: Vec<Series> = series
        .iter()
        .map(|s| Series { name: s.name.clone(), points: s.points.iter().copied().filter(fits).collect() })
        .collect();
    let points = || series.iter().flat_map(|s| &s.points);
    let (Some(x), Some(y)) = (range(points().map(|p| p.0)), range(points().map(|p| p.1))) else {
        return Err(Error::usage(format!("{}: no point to draw", chart.title)));
    };
    let mut pixels = RgbImage::new(SIZE_PX.0, SIZE_PX.1);
    let drawn = {
        let area = BitMapBackend::with_buffer(pixels.as_mut(), SIZE_PX).into_drawing_area();
        let mut builder = ChartBuilder::on(&area);
        builder
            .caption(chart.title, (FONT, 20))
            .margin(10)
            .margin_right(28)
            .x_label_area_size(44)
            .y_label_area_size(64);
        area.fill(&WHITE).map_err(|e| e.to_string()).and_then(|()| {
            if chart.log_y {
                let context = builder.build_cartesian_2d(x, (y.start / 1.1..y.end * 1.1).log_scale());
                context.map_err(|e| e.to_string()).and_then(|c| fill(c, chart, &series))
            } else {
                let margin = 0.05 * (y.end - y.start).max(1e-9 * y.end.abs()).max(f64::MIN_POSITIVE);
                let context = builder.build_cartesian_2d(x, y.start - margin..y.end + margin);
                context.map_err(|e| e.to_string()).and_then(|c| fill(c, chart, &series))
            }
        })
    };
    drawn.map_err(|e| Error::usage(format!("{}: {e}", chart.title)))?;
    Ok(pixels)
}

/// Draws axes, curves and legend.
fn fill<'a, Y>(
    mut context: ChartContext<'a, BitMapBackend<'a>, Cartesian2d<plotters::coord::types::RangedCoordf64, Y>>,
    chart: &Chart,
    series: &[Series],
) -> std::result::Result<(), String>
where
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let text = |e: &dyn std::fmt::Display| e.to_string();
    context
        .configure_mesh()
        .x_desc(chart.x)
        .y_desc(chart.y)
        .label_style((FONT, 14))
        .axis_desc_style((FONT, 15))
        .light_line_style(WHITE)
        .draw()
        .map_err(|e| text(&e))?;
    for (k, one) in series.iter().enumerate() {
        let style = COLOURS[k % COLOURS.len()].stroke_width(2);
        let line = LineSeries::new(one.points.iter().copied(), style);
        let drawn = context.draw_series(line).map_err(|e| text(&e))?;
        drawn.label(&one.name).legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
        if let [alone] = one.points[..] {
            let dot = Circle::new(alone, 4, style.filled());
            context.draw_series([dot]).map_err(|e| text(&e))?;
        }
    }
    context
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.3))
        .label_font((FONT, 14))
        .draw()
        .map_err(|e| text(&e))
}

/// Returns the smallest and largest value. A single value gets a small margin. `None` without values.
fn range(values: impl Iterator<Item = f64>) -> Option<Range<f64>> {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    match low <= high {
        false => None,
        true if low < high => Some(low..high),
        true => Some(low - 0.5 * low.abs().max(1e-6)..low + 0.5 * low.abs().max(1e-6)),
    }
}
