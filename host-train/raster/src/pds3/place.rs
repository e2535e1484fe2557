//! IMAGE_MAP_PROJECTION: the georeference of the image.

use super::super::binary::Layout;
use super::super::crs::{ProjectionMethod, ProjectionParameters};
use super::super::unit::metres_per;
use super::super::{Axes, Crs, GeoRef};
use super::label::{LabelBlock, LabelItem};
use super::units::{Radius, finite, length_m, number};
use super::{Defect, Refusal};

/// Greatest difference of MAP_SCALE and MAP_RESOLUTION, as a share. Both state the same size, and labels round both.
const SAME_SCALE: f64 = 1e-3;

/// A map projection of a label, as supported here.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Projection {
    Equirectangular {
        lat_ts_deg: f64,
    },
    /// `lat_ts_deg` is the latitude of true scale; its sign gives the pole.
    Polar {
        lat_ts_deg: f64,
    },
    /// Of this kind, with its origin at the label's centre.
    Ported {
        kind: ProjectionMethod,
        lat0_deg: f64,
    },
}

/// Returns the georeference of an image: a reference system from the projection's keywords, a transform of pixel corners from its offsets.
///
/// LINE_ and SAMPLE_PROJECTION_OFFSET count from the centre of the first pixel to the map's origin. Hence, for the outer corner of that
/// pixel, x = -(S0 + 1/2) * scale and y = (L0 + 1/2) * scale, in all projections.
pub(super) fn georef(block: &LabelBlock, layout: &Layout) -> Result<GeoRef, Refusal> {
    let radius_m = sphere(block)?;
    let projection = projection(block)?;
    refuse_turned(block)?;
    let scale_m = scale_m(block, radius_m)?;
    let lon0_deg = number(block, "CENTER_LONGITUDE")?.unwrap_or(0.0);
    let offset = |key: &str| required(block, key).and_then(finite);
    let (row, col) = (offset("LINE_PROJECTION_OFFSET")?, offset("SAMPLE_PROJECTION_OFFSET")?);
    let transform = [-(col + 0.5) * scale_m, scale_m, 0.0, (row + 0.5) * scale_m, 0.0, -scale_m];
    if let Projection::Equirectangular { .. } = projection {
        check_latitude(block, transform[3], scale_m, radius_m, layout.rows)?;
    }
    let crs = crs(projection, lon0_deg, radius_m);
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

fn projection(block: &LabelBlock) -> Result<Projection, Refusal> {
    let item = required(block, "MAP_PROJECTION_TYPE")?;
    let name = item.value.text().unwrap_or("").to_ascii_uppercase().replace('_', " ");
    let lat_deg = number(block, "CENTER_LATITUDE")?.unwrap_or(0.0);
    let ported = |kind| Projection::Ported { kind, lat0_deg: lat_deg };
    match name.as_str() {
        "EQUIRECTANGULAR" if lat_deg.abs() < 90.0 => Ok(Projection::Equirectangular { lat_ts_deg: lat_deg }),
        "SIMPLE CYLINDRICAL" if lat_deg == 0.0 => Ok(Projection::Equirectangular { lat_ts_deg: 0.0 }),
        "POLAR STEREOGRAPHIC" if lat_deg != 0.0 && lat_deg.abs() <= 90.0 => {
            Ok(Projection::Polar { lat_ts_deg: lat_deg })
        }
        "ORTHOGRAPHIC" if lat_deg.abs() <= 90.0 => Ok(ported(ProjectionMethod::Orthographic)),
        "TRANSVERSE MERCATOR" if lat_deg.abs() < 90.0 => Ok(ported(ProjectionMethod::TransverseMercator)),
        "MERCATOR" if lat_deg == 0.0 => Ok(ported(ProjectionMethod::Mercator)),
        "SINUSOIDAL" if lat_deg == 0.0 => Ok(ported(ProjectionMethod::Sinusoidal)),
        _ => {
            let read = "equirectangular, polar stereographic (centre off the equator), orthographic, transverse Mercator, \
                        and simple cylindrical, Mercator and sinusoidal (centre on the equator) are read";
            Err(Refusal::Unsupported(format!(
                "line {}: projection {name}, centre latitude {lat_deg}; {read}",
                item.line
            )))
        }
    }
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

fn crs(projection: Projection, lon0_deg: f64, radius_m: f64) -> Crs {
    match projection {
        Projection::Equirectangular { lat_ts_deg } => {
            Crs::equirectangular(radius_m, lat_ts_deg, (0.0, lon0_deg), Axes::PLAIN)
        }
        Projection::Polar { lat_ts_deg } => Crs::polar_stereographic(radius_m, lat_ts_deg, 1.0, lon0_deg, Axes::PLAIN),
        Projection::Ported { kind, lat0_deg } => {
            Crs::ported(radius_m, ProjectionParameters::new(kind, lat0_deg, lon0_deg, 1.0), Axes::PLAIN)
        }
    }
}
