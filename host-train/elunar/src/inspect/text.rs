//! Descriptions of labels and tables.

use elunar_base::Result;
use elunar_core::sun::Body;
use elunar_evaluate::lola::{csv, track};
use elunar_raster::pds3::LabelBlock;
use std::path::Path;

/// Keywords that identify a product.
const TELLING: [&str; 8] = [
    "DATA_SET_ID",
    "PRODUCT_ID",
    "PRODUCT_TYPE",
    "INSTRUMENT_HOST_NAME",
    "INSTRUMENT_ID",
    "TARGET_NAME",
    "START_TIME",
    "PRODUCT_CREATION_TIME",
];

/// Describes a label by its identifying keywords, its pointers and its blocks.
pub(super) fn label(label: &LabelBlock) -> String {
    let mut text = format!("PDS3 label of {} keywords\n", count(label));
    for key in TELLING {
        if let Some(item) = label.items.iter().find(|item| item.key == key) {
            text += &format!("{key}: {}\n", item.value);
        }
    }
    let mut names = Vec::new();
    outline(label, "", &mut names);
    (text + &names.join("\n")).trim_end().into()
}

pub(super) fn label_points_at_image(label: &LabelBlock) -> bool {
    label.items.iter().any(|item| item.key == "^IMAGE") || label.blocks.iter().any(label_points_at_image)
}

fn count(block: &LabelBlock) -> usize {
    block.items.len() + block.blocks.iter().map(count).sum::<usize>()
}

fn outline(block: &LabelBlock, indent: &str, out: &mut Vec<String>) {
    let pointers = block.items.iter().filter(|item| item.key.starts_with('^'));
    out.extend(pointers.map(|item| format!("{indent}{} = {}", item.key, item.value)));
    for inner in &block.blocks {
        out.push(format!("{indent}{} with {} keywords", inner.name, count(inner)));
        outline(inner, &format!("{indent}  "), out);
    }
}

/// Returns the first line of a text, if it is the heading of a table of points.
pub(super) fn heading(head: &[u8]) -> Option<String> {
    let text = String::from_utf8_lossy(head);
    let line =
        text.trim_start_matches('\u{feff}').lines().find(|line| !line.trim().is_empty() && !line.starts_with('#'))?;
    csv::is_heading(line).then(|| line.trim().to_owned())
}

/// Describes a table of points. Radii are relative to the Moon's sphere.
pub(super) fn points(path: &Path, heading: &str) -> Result<String> {
    let radius_m = Body::Moon.radius_m();
    let table = csv::read(path, None, radius_m)?;
    let tracks = track::split(&table.points, track::TRACK_GAP_S).len();
    let range = |of: fn(&track::LaserSpot) -> f64| {
        let values = table.points.iter().map(of);
        (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
    };
    let ((lon0, lon1), (lat0, lat1), (low, high)) = (range(|p| p.lon_deg), range(|p| p.lat_deg), range(|p| p.height_m));
    Ok(format!(
        "table of {} points in {tracks} tracks, {} more rows flagged\ncolumns: {heading}\nlongitude: {lon0} to {lon1} deg\n\
         latitude: {lat0} to {lat1} deg\nheight: {low:.3} to {high:.3} m above {radius_m} m",
        table.points.len(),
        table.flagged
    ))
}
