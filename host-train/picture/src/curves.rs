//! Curves: losses and errors over training steps.

use super::canvas::Canvas;
use super::font::FONT;
use super::write_png;
use elunar_base::{Error, Result};
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
        let mut builder = ChartBuilder::on(&area);
        builder
            .caption(chart.title, (FONT, 20))
            .margin(10)
            .margin_right(28)
            .x_label_area_size(44)
            .y_label_area_size(64);
        area.fill(&WHITE).map_err(|e| e.to_string()).and_then(|()| {
            let margin = 0.05 * (y.end - y.start).max(1e-9 * y.end.abs()).max(f64::MIN_POSITIVE);
            let wide = y.start / 1.1..y.end * 1.1;
            let is_log_y = chart.log_y && wide.start.log10().floor() < wide.end.log10().floor();
            let (log_y, y) = (wide.log_scale(), y.start - margin..y.end + margin);
            let text = |e: DrawingAreaErrorKind<_>| e.to_string();
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

/// Draws axes, curves and legend.
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
        let drawn = context.draw_series(line).map_err(|e| text(&e))?;
        drawn.label(&one.name).legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
        if let [alone] = one.points[..] {
            let dot = Circle::new(alone, 4, style.filled());
            context.draw_series([dot]).map_err(|e| text(&e))?;
        }
    }
    context
        .configure_series_labels()
        .position(legend(series, |x| if log_x { x.ln() } else { x }, |y| if chart.log_y { y.ln() } else { y }))
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.3))
        .label_font((FONT, 14))
        .draw()
        .map_err(|e| text(&e))
}

/// Returns a number of a logarithmic axis as text if its first digit is 1, 2 or 5; others would crowd.
fn round_number(value: &f64) -> String {
    let digit = value / 10.0_f64.powf(value.log10().floor());
    if [1.0, 2.0, 5.0, 10.0].iter().any(|d| (digit - d).abs() < 1e-6) { format!("{value}") } else { String::new() }
}

/// Returns the corner with the least of the curves, the upper right one if several have as little.
fn legend(series: &[Series], x: impl Fn(f64) -> f64, y: impl Fn(f64) -> f64) -> SeriesLabelPosition {
    /// Points on every piece of a curve.
    const STEPS: u32 = 8;
    let point = |p: &(f64, f64)| (x(p.0), y(p.1));
    let points = || series.iter().flat_map(|s| s.points.iter().map(point));
    let (Some(across), Some(up)) = (range(points().map(|p| p.0)), range(points().map(|p| p.1))) else {
        return SeriesLabelPosition::UpperRight;
    };
    let corners = [
        (SeriesLabelPosition::UpperRight, (true, true)),
        (SeriesLabelPosition::UpperLeft, (false, true)),
        (SeriesLabelPosition::LowerRight, (true, false)),
        (SeriesLabelPosition::LowerLeft, (false, false)),
    ];
    let mut counts = [0.0; 4];
    for pair in series.iter().flat_map(|s| s.points.windows(2)) {
        let ((x0, y0), (x1, y1)) = (point(&pair[0]), point(&pair[1]));
        for k in 0..STEPS {
            let along = f64::from(k) / f64::from(STEPS);
            let u = (x0 + along * (x1 - x0) - across.start) / (across.end - across.start);
            let v = (y0 + along * (y1 - y0) - up.start) / (up.end - up.start);
            for ((_, (right, upper)), count) in corners.iter().zip(&mut counts) {
                let (beside, level) =
                    (if *right { u > 0.65 } else { u < 0.35 }, if *upper { v > 0.6 } else { v < 0.4 });
                let inside = beside && level;
                *count += if inside { (x1 - x0).abs() } else { 0.0 };
            }
        }
    }
    let best = (1..4).fold(0, |best, k| if counts[k] < counts[best] { k } else { best });
    corners[best].0.clone()
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
    fn the_legend_keeps_away_from_the_curves_and_logarithms_have_round_numbers() {
        let corner = |points: &[(f64, f64)]| {
            let series = [Series { name: "a".into(), points: points.to_vec() }];
            format!("{:?}", legend(&series, f64::ln, |y| y))
        };
        assert_eq!(corner(&[(1.0, 5.0), (100.0, 0.0)]), "UpperRight");
        assert_eq!(corner(&[(1.0, 0.0), (100.0, 5.0)]), "UpperLeft");
        assert_eq!(corner(&[(1.0, 0.0), (2.0, 5.0), (100.0, 5.0)]), "LowerRight");
        assert_eq!(corner(&[(1.0, 5.0), (50.0, 5.0), (100.0, 0.0)]), "LowerLeft");
        assert_eq!([0.05, 2.0, 70.0, 1000.0].map(|v| round_number(&v)), ["0.05", "2", "", "1000"]);
    }
}
