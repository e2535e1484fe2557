//! The group Mapping: the georeference of a cube.

use super::super::GeoRef;
use super::super::named_map::NamedMap;
use super::super::pds3::units::{finite, length_m};
use super::super::pds3::{Defect, LabelBlock, Refusal};
use super::super::unit::metres_per;
use super::{find, number, required, text};

/// Returns the georeference of a cube. UpperLeftCornerX and UpperLeftCornerY are the outer corner of the first pixel.
pub(super) fn georef(mapping: &LabelBlock) -> Result<GeoRef, Refusal> {
    let radius_m = sphere(mapping)?;
    let item = required(mapping, "ProjectionName")?;
    let map = NamedMap {
        name: text(item)?,
        lat_deg: number(mapping, "CenterLatitude", 0.0)?,
        origin_deg: 0.0,
        lon_deg: number(mapping, "CenterLongitude", 0.0)?,
        scale: number(mapping, "scaleFactor", 1.0)?,
        parallels_deg: parallels(mapping)?,
    };
    refuse_turned(mapping)?;
    let crs = map.crs(radius_m).map_err(|what| Refusal::Unsupported(format!("line {}: {what}", item.line)))?;
    let corner = |key| required(mapping, key).and_then(|item| length_m(item, "m"));
    let (x, y, side) = (corner("UpperLeftCornerX")?, corner("UpperLeftCornerY")?, resolution_m(mapping)?);
    match crs.defect() {
        Some(defect) => Err(Defect::missing(defect).into()),
        None => Ok(GeoRef { transform: [x, side, 0.0, y, 0.0, -side], crs }),
    }
}

fn sphere(mapping: &LabelBlock) -> Result<f64, Refusal> {
    let radius = |key| required(mapping, key).and_then(|item| length_m(item, "m"));
    let (equator, pole) = (radius("EquatorialRadius")?, radius("PolarRadius")?);
    if (equator - pole).abs() > 1e-6 {
        return Err(Refusal::Unsupported(format!(
            "EquatorialRadius {equator} m and PolarRadius {pole} m; a sphere expected"
        )));
    }
    if equator > 0.0 {
        return Ok(equator);
    }
    Err(Defect::missing(format!("an EquatorialRadius above 0 expected, found {equator} m")).into())
}

fn parallels(mapping: &LabelBlock) -> Result<Option<[f64; 2]>, Defect> {
    let parallel = |key| find(mapping, key)?.map(finite).transpose();
    Ok(parallel("FirstStandardParallel")?.zip(parallel("SecondStandardParallel")?).map(<[f64; 2]>::from))
}

fn refuse_turned(mapping: &LabelBlock) -> Result<(), Refusal> {
    let turned = number(mapping, "Rotation", 0.0)?;
    if turned % 360.0 != 0.0 {
        return Err(Refusal::Unsupported(format!("Rotation {turned}; 0 expected")));
    }
    let direction = find(mapping, "LongitudeDirection")?.map_or(Ok("PositiveEast".into()), text)?;
    if !direction.eq_ignore_ascii_case("PositiveEast") {
        return Err(Refusal::Unsupported(format!("LongitudeDirection {direction}; PositiveEast expected")));
    }
    Ok(())
}

/// Returns PixelResolution in metres.
fn resolution_m(mapping: &LabelBlock) -> Result<f64, Defect> {
    let item = required(mapping, "PixelResolution")?;
    let unit = item.value.unit.as_deref().and_then(|unit| unit.split('/').next()).unwrap_or("m");
    let found = finite(item)?;
    let metres = metres_per(unit).map(|metres| metres * found).filter(|&metres| metres > 0.0);
    metres.ok_or_else(|| {
        let what = format!("metres per pixel above 0 as PixelResolution expected, found {}", item.value);
        Defect::at(item.line, what)
    })
}
