//! IMAGE_MAP_PROJECTION: the georeference of the image.

use super::super::GeoRef;
use super::super::binary::Layout;
use super::super::named_map::NamedMap;
use super::super::unit::metres_per;
use super::label::{LabelBlock, LabelItem};
use super::units::{Radius, finite, length_m, number};
use super::{Defect, Refusal};

/// Greatest difference of MAP_SCALE and MAP_RESOLUTION, as a share. Both state the same size, and labels round both.
const SAME_SCALE: f64 = 1e-3;

/// Returns the georeference of an image: a reference system from the projection's keywords, a transform of pixel corners from its offsets.
///
/// LINE_ and SAMPLE_PROJECTION_OFFSET count from the centre of the first pixel to the map's origin. Hence, for the outer corner of that
/// pixel, x = -(S0 + 1/2) * scale and y = (L0 + 1/2) * scale, in all projections.
pub(super) fn georef(block: &LabelBlock, layout: &Layout) -> Result<GeoRef, Refusal> {
    let radius_m = sphere(block)?;
    let (map, line) = projection(block)?;
    refuse_turned(block)?;
    let scale_m = scale_m(block, radius_m)?;
    let offset = |key: &str| required(block, key).and_then(finite);
    let (row, col) = (offset("LINE_PROJECTION_OFFSET")?, offset("SAMPLE_PROJECTION_OFFSET")?);
    let transform = [-(col + 0.5) * scale_m, scale_m, 0.0, (row + 0.5) * scale_m, 0.0, -scale_m];
    let crs = map.crs(radius_m).map_err(|what| Refusal::Unsupported(format!("line {line}: {what}")))?;
    if ["EQUIRECTANGULAR", "SIMPLECYLINDRICAL"].contains(&map.plain_name().as_str()) {
        check_latitude(block, transform[3], scale_m, radius_m, layout.rows)?;
    }
    match crs.defect() {
        Some(defect) => Err(Defect::missing(defect).into()),
        None => Ok(GeoRef { transform, crs }),
    }
}

fn required<'a>(block: &'a LabelBlock, key: &str) -> Result<&'a LabelItem, Defect> {
    block.find(key)?.ok_or_else(|| Defect::missing(format!("{key} of the map projection expected, found none")))
}

fn sphere(block: &LabelBlock) -> Result<f64, Refusal> {
    let Some(radius) = Radius::of(block)? else {
        return Err(Defect::missing("A_AXIS_RADIUS of the map projection expected, found none").into());
    };
    for key in ["B_AXIS_RADIUS", "C_AXIS_RADIUS"] {
        let Some(item) = block.find(key)? else { continue };
        let axis_m = length_m(item, "km")?;
        if (axis_m - radius.metres).abs() > 1e-6 {
            let what = format!("line {}: {key} {axis_m} m; a sphere of {} m expected", item.line, radius.metres);
            return Err(Refusal::Unsupported(what));
        }
    }
    Ok(radius.metres)
}

fn projection(block: &LabelBlock) -> Result<(NamedMap, usize), Refusal> {
    let item = required(block, "MAP_PROJECTION_TYPE")?;
    let map = NamedMap {
        name: item.value.text().unwrap_or("").to_ascii_uppercase().replace('_', " "),
        lat_deg: number(block, "CENTER_LATITUDE")?.unwrap_or(0.0),
        origin_deg: 0.0,
        lon_deg: number(block, "CENTER_LONGITUDE")?.unwrap_or(0.0),
        scale: 1.0,
        parallels_deg: None,
    };
    Ok((map, item.line))
}

fn refuse_turned(block: &LabelBlock) -> Result<(), Refusal> {
    let turned = number(block, "MAP_PROJECTION_ROTATION")?.unwrap_or(0.0);
    if turned % 360.0 != 0.0 {
        return Err(Refusal::Unsupported(format!("MAP_PROJECTION_ROTATION {turned}; 0 expected")));
    }
    let direction = block.find("POSITIVE_LONGITUDE_DIRECTION")?.and_then(|item| item.value.text()).unwrap_or("EAST");
    if !direction.eq_ignore_ascii_case("EAST") {
        return Err(Refusal::Unsupported(format!("longitudes positive to the {direction}; EAST expected")));
    }
    Ok(())
}

/// Returns metres per pixel: MAP_SCALE, in kilometres per pixel unless its unit says otherwise, or else MAP_RESOLUTION in pixels per
/// degree.
fn scale_m(block: &LabelBlock, radius_m: f64) -> Result<f64, Defect> {
    let by_scale = block.find("MAP_SCALE")?.map(|item| -> Result<f64, Defect> {
        let unit = item.value.unit.as_deref().unwrap_or("km/pix");
        let metres = unit.split('/').next().and_then(metres_per).ok_or_else(|| {
            Defect::at(item.line, format!("MAP_SCALE in metres or kilometres per pixel expected, found <{unit}>"))
        })?;
        Ok(finite(item)? * metres)
    });
    let by_scale = by_scale.transpose()?;
    let by_resolution = number(block, "MAP_RESOLUTION")?.map(|per_deg| radius_m.to_radians() / per_deg);
    let scale = match (by_scale, by_resolution) {
        (Some(a), Some(b)) if (a - b).abs() > SAME_SCALE * a.abs() => Err(Defect::missing(format!(
            "MAP_SCALE and MAP_RESOLUTION of one size expected, found {a} m and {b} m per pixel"
        ))),
        (Some(scale), _) | (None, Some(scale)) => Ok(scale),
        (None, None) => Err(Defect::missing("MAP_SCALE or MAP_RESOLUTION expected, found neither")),
    }?;
    if scale > 0.0 && scale.is_finite() {
        return Ok(scale);
    }
    Err(Defect::missing(format!("a MAP_SCALE above 0 expected, found {scale} m per pixel")))
}

/// Refuses offsets with the wrong sign, which some products have. Their stated latitude shows it. The stated latitude may be that of the
/// valid samples only, so a tenth of the image is allowed.
fn check_latitude(block: &LabelBlock, top_m: f64, scale_m: f64, radius_m: f64, rows: usize) -> Result<(), Defect> {
    let Some(stated_deg) = number(block, "MAXIMUM_LATITUDE")? else { return Ok(()) };
    let found_deg = (top_m / radius_m).to_degrees();
    let pixel_deg = (scale_m / radius_m).to_degrees();
    if (found_deg - stated_deg).abs() <= (0.1 * rows as f64).max(2.0) * pixel_deg {
        return Ok(());
    }
    let what = format!(
        "MAXIMUM_LATITUDE {stated_deg} and LINE_PROJECTION_OFFSET to agree expected, the offset gives {found_deg:.6}"
    );
    Err(Defect::missing(what))
}
