//! Curves: losses and errors over training steps.

use super::canvas::Canvas;
use super::font::FONT;
use super::write_png;
use elunar_base::{Error, Result};
use image::RgbImage;
use plotters::coord::Shift;
use plotters::coord::ranged1d::ValueFormatter;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
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
    /// Whether y is logarithmic; points with y ≤ 0 are then left out. An axis within one power of ten would have no number, and is linear.
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
/// [`Error::Input`] if there is no point to draw, [`Error::Io`] if the file cannot be written.
pub fn curves(path: &Path, chart: &Chart, series: &[Series]) -> Result<()> {
    write_png(path, plot(chart, series)?)
}

/// Draws the curves as [`curves`] does, in memory.
///
/// # Errors
/// [`Error::Input`] if there is no point to draw.
pub fn plot(chart: &Chart, series: &[Series]) -> Result<RgbImage> {
    draw(chart, series, false)
}

/// Draws the curves over a logarithmic x, in memory. Points with x ≤ 0 are left out.
///
/// # Errors
/// [`Error::Input`] if there is no point to draw.
pub fn plot_log_x(chart: &Chart, series: &[Series]) -> Result<RgbImage> {
    draw(chart, series, true)
}

fn draw(chart: &Chart, series: &[Series], log_x: bool) -> Result<RgbImage> {
    let fits =
        |(x, y): &(f64, f64)| x.is_finite() && y.is_finite() && (!chart.log_y || *y > 0.0) && (!log_x || *x > 0.0);
    let series: Vec<Series> = series
        .iter()
        .map(|s| Series { name: s.name.clone(), points: s.points.iter().copied().filter(fits).collect() })
        .collect();
    let points = || series.iter().flat_map(|s| &s.points);
    let (Some(x), Some(y)) = (range(points().map(|p| p.0)), range(points().map(|p| p.1))) else {
        return Err(Error::input(format!("{}: no point to draw", chart.title)));
    };
    let mut pixels = RgbImage::new(SIZE_PX.0, SIZE_PX.1);
    let drawn = {
        let area = Canvas::new(&mut pixels).into_drawing_area();
        let text = |e: DrawingAreaErrorKind<_>| e.to_string();
        area.fill(&WHITE).map_err(text).and_then(|()| {
            let (places, head_px) = legend(&area, &series).map_err(text)?;
            let (head, body) = area.split_vertically(head_px);
            draw_head(&head, chart.title, &series, &places).map_err(text)?;
            let mut builder = ChartBuilder::on(&body);
            builder.margin(10).margin_right(28).x_label_area_size(44).y_label_area_size(64);
            let margin = 0.05 * (y.end - y.start).max(1e-9 * y.end.abs()).max(f64::MIN_POSITIVE);
            let wide = y.start / 1.1..y.end * 1.1;
            let is_log_y = chart.log_y && wide.start.log10().floor() < wide.end.log10().floor();
            let (log_y, y) = (wide.log_scale(), y.start - margin..y.end + margin);
            match (log_x, is_log_y) {
                (false, false) => fill(builder.build_cartesian_2d(x, y).map_err(text)?, chart, &series, log_x),
                (false, true) => fill(builder.build_cartesian_2d(x, log_y).map_err(text)?, chart, &series, log_x),
                (true, false) => {
                    fill(builder.build_cartesian_2d(x.log_scale(), y).map_err(text)?, chart, &series, log_x)
                }
                (true, true) => {
                    fill(builder.build_cartesian_2d(x.log_scale(), log_y).map_err(text)?, chart, &series, log_x)
                }
            }
        })
    };
    drawn.map_err(|e| Error::input(format!("{}: {e}", chart.title)))?;
    Ok(pixels)
}

/// Draws axes and curves.
fn fill<'a, X, Y>(
    mut context: ChartContext<'a, Canvas<'a>, Cartesian2d<X, Y>>,
    chart: &Chart,
    series: &[Series],
    log_x: bool,
) -> std::result::Result<(), String>
where
    X: Ranged<ValueType = f64> + ValueFormatter<f64>,
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let text = |e: &dyn std::fmt::Display| e.to_string();
    let mut mesh = context.configure_mesh();
    mesh.x_desc(chart.x).y_desc(chart.y).label_style((FONT, 14)).axis_desc_style((FONT, 15)).light_line_style(WHITE);
    if log_x {
        mesh.x_label_formatter(&round_number);
    }
    mesh.draw().map_err(|e| text(&e))?;
    for (k, one) in series.iter().enumerate() {
        let style = COLOURS[k % COLOURS.len()].stroke_width(2);
        let line = LineSeries::new(one.points.iter().copied(), style);
        context.draw_series(line).map_err(|e| text(&e))?;
        if let [alone] = one.points[..] {
            let dot = Circle::new(alone, 4, style.filled());
            context.draw_series([dot]).map_err(|e| text(&e))?;
        }
    }
    Ok(())
}

type Failure<'a> = DrawingAreaErrorKind<<Canvas<'a> as DrawingBackend>::ErrorType>;

/// Height of the title, and of a line of the legend below it, pixels.
const HEAD_PX: (u32, u32) = (36, 20);
/// Length of a curve's sample in the legend, and the gaps behind it and behind its name, pixels.
const SAMPLE_PX: (i32, i32, i32) = (18, 6, 22);

/// Returns the place of every curve in the legend, which stands above the chart so that it covers nothing, and the height of title and legend,
/// pixels.
fn legend<'a>(
    area: &DrawingArea<Canvas<'a>, Shift>,
    series: &[Series],
) -> std::result::Result<(Vec<(i32, i32)>, u32), Failure<'a>> {
    let style = (FONT, 14).into_text_style(area);
    let (first, line_px) = (64, HEAD_PX.1 as i32);
    let (mut col, mut row, mut places) = (first, HEAD_PX.0 as i32 + line_px / 2, vec![]);
    for one in series {
        let width = area.estimate_text_size(&one.name, &style)?.0 as i32 + SAMPLE_PX.0 + SAMPLE_PX.1;
        if col > first && col + width > SIZE_PX.0 as i32 - 20 {
            (col, row) = (first, row + line_px);
        }
        places.push((col, row));
        col += width + SAMPLE_PX.2;
    }
    Ok((places, (row + line_px / 2).unsigned_abs()))
}

/// Draws title and legend.
fn draw_head<'a>(
    head: &DrawingArea<Canvas<'a>, Shift>,
    title: &str,
    series: &[Series],
    places: &[(i32, i32)],
) -> std::result::Result<(), Failure<'a>> {
    let middle = Pos::new(HPos::Center, VPos::Center);
    head.draw_text(title, &(FONT, 20).into_text_style(head).pos(middle), (SIZE_PX.0 as i32 / 2, HEAD_PX.0 as i32 / 2))?;
    let level = (FONT, 14).into_text_style(head).pos(Pos::new(HPos::Left, VPos::Center));
    for (k, (one, (col, row))) in series.iter().zip(places).enumerate() {
        let style = COLOURS[k % COLOURS.len()].stroke_width(2);
        head.draw(&PathElement::new([(*col, *row), (col + SAMPLE_PX.0, *row)], style))?;
        head.draw_text(&one.name, &level, (col + SAMPLE_PX.0 + SAMPLE_PX.1, *row))?;
    }
    Ok(())
}

/// Returns a number of a logarithmic axis as text if its first digit is 1, 2 or 5; others would crowd.
fn round_number(value: &f64) -> String {
    let digit = value / 10.0_f64.powf(value.log10().floor());
    if [1.0, 2.0, 5.0, 10.0].iter().any(|d| (digit - d).abs() < 1e-6) { format!("{value}") } else { String::new() }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_legend_stands_above_the_chart_and_logarithms_have_round_numbers() {
        let named = |name: &str| Series { name: name.into(), points: vec![(1.0, 5.0), (100.0, 0.0)] };
        let series: Vec<Series> = (0..13).map(|k| named(&format!("a curve with a name, number {k}"))).collect();
        let chart = Chart { title: "t", x: "x", y: "y", log_y: false };
        let made = plot(&chart, &series).unwrap();
        let coloured = |RGBColor(r, g, b)| made.enumerate_pixels().filter(move |(.., p)| p.0 == [r, g, b]);
        // The samples of all curves that are not grey as letters are, in five lines.
        let first = |colour: &RGBColor| coloured(*colour).map(|(_, row, _)| row).min();
        let colours = COLOURS.iter().filter(|RGBColor(r, g, _)| r != g);
        let rows: Vec<u32> = colours.filter_map(first).collect();
        assert!(rows.len() == 11 && rows.is_sorted() && rows[0] < 60 && rows[10] > 100, "{rows:?}");
        assert_eq!([0.05, 2.0, 70.0, 1000.0].map(|v| round_number(&v)), ["0.05", "2", "", "1000"]);
    }
}
