//! Description of a raster.

use elunar_base::Result;
use elunar_core::tile::Window;
use elunar_raster::source::{Info, Source};
use elunar_raster::{GeoRef, Projection};

/// Greatest number of samples read. Larger rasters are sampled in whole rows at even distances.
const MOST_SAMPLES: usize = 1 << 22;

pub(super) fn describe(source: &dyn Source) -> Result<String> {
    let Info { rows, cols, georef, unit, unit_in_file, format, sun, warnings, .. } = source.info();
    let mut text = format!("raster of {rows} x {cols} pixels (rows x columns)\nformat: {format}\n");
    text += &match (unit.as_deref(), unit_in_file.as_deref()) {
        (Some(unit), Some(in_file)) if unit != in_file => format!("unit: {unit}; the file says {in_file:?}\n"),
        (None, Some(in_file)) => format!("unit: not stated; the file says {in_file:?}\n"),
        (None, None) => "unit: not stated\n".into(),
        (Some("m"), _) => "unit: m\n".into(),
        (Some(unit), _) => format!("unit: {unit}, no known length: refused as heights\n"),
    };
    text += &warnings.iter().map(|warning| format!("warning: {warning}\n")).collect::<String>();
    let angle = |what: &str, deg: Option<f64>| deg.map(|deg| format!("{what} {deg:.3} deg"));
    let angles = [angle("azimuth", sun.azimuth_deg), angle("elevation", sun.elevation_deg)];
    if angles.iter().any(Option::is_some) {
        text += &format!("sun: {}\n", angles.into_iter().flatten().collect::<Vec<_>>().join(", "));
    }
    text += &match georef {
        Some(georef) => place(georef, *rows, *cols),
        None => "place: none\n".into(),
    };
    Ok(text + &values(source)?)
}

fn place(georef: &GeoRef, rows: usize, cols: usize) -> String {
    let mut text = format!("reference system: {}\n", georef.crs.summary());
    if let Some((row_m, col_m)) = georef.pixel_m(rows, cols) {
        text += &format!("pixel: {row_m:.6} x {col_m:.6} m (rows x columns)\n");
    }
    let (x0, y0) = georef.centre(-0.5, -0.5);
    let (x1, y1) = georef.centre(rows as f64 - 0.5, cols as f64 - 0.5);
    text += &format!("corners: ({x0:.6}, {y0:.6}) to ({x1:.6}, {y1:.6})\n");
    if let Some(what) = georef.contradiction(rows, cols).or_else(|| georef.doubt(rows, cols)) {
        text += &format!("note: {what}\n");
    }
    if let Some(projection) = Projection::of(&georef.crs) {
        let (x, y) = georef.centre((rows as f64 - 1.0) / 2.0, (cols as f64 - 1.0) / 2.0);
        let (lon_deg, lat_deg) = projection.inverse(x, y);
        text += &match lon_deg.is_nan() {
            true => "centre: off the map\n".into(),
            false => format!("centre: longitude {lon_deg:.6}, latitude {lat_deg:.6} deg\n"),
        };
    }
    text
}

/// Describes the range and the valid share of all samples, or of rows at even distances.
fn values(source: &dyn Source) -> Result<String> {
    let &Info { rows, cols, .. } = source.info();
    let looked_at = (MOST_SAMPLES / cols.max(1)).clamp(1, rows.max(1));
    let (mut valid, mut low, mut high) = (0usize, f32::INFINITY, f32::NEG_INFINITY);
    for index in 0..looked_at {
        // Every row, or the middle rows of equal parts.
        let row = (2 * index + 1) * rows / (2 * looked_at);
        for value in source.read(Window { row, col: 0, rows: 1, cols })? {
            if value.is_finite() {
                (valid, low, high) = (valid + 1, low.min(value), high.max(value));
            }
        }
    }
    let share = 100.0 * valid as f64 / (looked_at * cols).max(1) as f64;
    let of = if looked_at == rows { "all samples".into() } else { format!("{looked_at} of {rows} rows") };
    Ok(match valid {
        0 => format!("values: none valid in {of}"),
        _ => format!("values: {low} to {high}, {share:.2} % valid, in {of}"),
    })
}
