//! `cart:Cartography`: the georeference of the image.

use super::super::GeoRef;
use super::super::binary::Layout;
use super::super::named_map::NamedMap;
use super::super::pds3::{Defect, Refusal};
use super::super::unit::metres_per;
use super::super::xml::Element;

/// Returns the georeference of an image on a map; `None` if the label describes no map. `upperleft_corner_x` and `_y` are the outer corner of
/// the first pixel.
pub(super) fn georef(cart: Element, layout: &Layout) -> Result<Option<GeoRef>, Refusal> {
    let Some(planar) = cart.inside("Planar") else {
        return match cart.inside("Geographic") {
            Some(found) => Err(Refusal::Unsupported(format!(
                "line {}: a map projection (Planar) in Cartography expected, found Geographic",
                found.line()
            ))),
            None => Ok(None),
        };
    };
    let projection = planar.required("Map_Projection")?;
    let map = map(projection)?;
    let radius_m = sphere(cart)?;
    let crs = map.crs(radius_m).map_err(|what| Refusal::Unsupported(format!("line {}: {what}", projection.line())))?;
    let corners = planar.required("Geo_Transformation")?;
    let corner = |name| corners.required(name).and_then(length_m);
    let (x, y) = (corner("upperleft_corner_x")?, corner("upperleft_corner_y")?);
    let information = planar.required("Planar_Coordinate_Information")?;
    let pixels = information.required("Coordinate_Representation")?;
    let side = |name| pixels.required(name).and_then(side_m);
    let transform = [x, side("pixel_resolution_x")?, 0.0, y, 0.0, -side("pixel_resolution_y")?];
    if let Some(defect) = crs.defect() {
        return Err(Defect::at(projection.line(), defect).into());
    }
    let georef = GeoRef { transform, crs };
    check_latitude(cart, &map, &georef, radius_m, layout)?;
    Ok(Some(georef))
}

/// Reads the projection's name and numbers.
fn map(projection: Element) -> Result<NamedMap, Defect> {
    let name = projection.required("map_projection_name")?.text();
    // Misspelt in an edition of the dictionary.
    let name = if name == "Orothographic" { "Orthographic" } else { name };
    let number = |names: &[&str]| -> Result<Option<f64>, Defect> {
        names.iter().find_map(|name| projection.inside(name)).map(Element::number).transpose()
    };
    let longitudes = [
        "longitude_of_central_meridian",
        "straight_vertical_longitude_from_pole",
        "longitude_of_projection_center",
        "longitude_of_projection_origin",
    ];
    let origin_deg = number(&["latitude_of_projection_origin", "latitude_of_projection_center"])?.unwrap_or(0.0);
    let first = number(&["standard_parallel_1"])?;
    let parallels = first.zip(number(&["standard_parallel_2"])?);
    let scale = number(&["scale_factor_at_projection_origin", "scale_factor_at_central_meridian"])?;
    let (lat_deg, scale) = match name {
        "Equirectangular" => (first.unwrap_or(0.0), scale.unwrap_or(1.0)),
        "Mercator" => (origin_deg, scale.unwrap_or_else(|| first.map_or(1.0, |lat| lat.to_radians().cos()))),
        _ => (origin_deg, scale.unwrap_or(1.0)),
    };
    let (name, lon_deg) = (name.to_owned(), number(&longitudes)?.unwrap_or(0.0));
    Ok(NamedMap { name, lat_deg, origin_deg, lon_deg, scale, parallels_deg: parallels.map(<[f64; 2]>::from) })
}

/// Returns the radius, which all axes have. Their names changed with the dictionary's edition.
fn sphere(cart: Element) -> Result<f64, Refusal> {
    let model = cart.inside("Geodetic_Model").ok_or_else(|| cart.lacks("Geodetic_Model"))?;
    let west = model.child("longitude_direction").filter(|found| !found.text().eq_ignore_ascii_case("Positive East"));
    if let Some(found) = west {
        let what = format!("longitude_direction {}; Positive East expected", found.text());
        return Err(Refusal::Unsupported(format!("line {}: {what}", found.line())));
    }
    let names = match model.child("semi_major_radius") {
        Some(_) => ["semi_major_radius", "semi_minor_radius", "polar_radius"],
        None => ["a_axis_radius", "b_axis_radius", "c_axis_radius"],
    };
    let first = model.required(names[0])?;
    let radius_m = length_m(first)?;
    for axis in names[1..].iter().filter_map(|name| model.child(name)) {
        let axis_m = length_m(axis)?;
        if (axis_m - radius_m).abs() > 1e-6 {
            let what = format!("{} {axis_m} m; a sphere of {radius_m} m expected", axis.name());
            return Err(Refusal::Unsupported(format!("line {}: {what}", axis.line())));
        }
    }
    if radius_m > 0.0 {
        return Ok(radius_m);
    }
    Err(Defect::at(first.line(), format!("a radius above 0 expected, found {radius_m} m")).into())
}

/// Returns a length in metres; the unit is an attribute.
fn length_m(item: Element) -> Result<f64, Defect> {
    let unit = item.attribute("unit").unwrap_or("m");
    let unit = unit.split('/').next().unwrap_or(unit);
    let metres = metres_per(unit).ok_or_else(|| {
        Defect::at(item.line(), format!("{} in metres or kilometres expected, found {unit}", item.name()))
    })?;
    Ok(item.number()? * metres)
}

fn side_m(item: Element) -> Result<f64, Defect> {
    let side = length_m(item)?;
    if side > 0.0 {
        return Ok(side);
    }
    Err(Defect::at(item.line(), format!("{} above 0 expected, found {side} m", item.name())))
}

/// Refuses a corner of an equirectangular map that contradicts the northern bound, by more than a tenth of the image. Labels disagree about where y
/// is 0.
fn check_latitude(
    cart: Element,
    map: &NamedMap,
    georef: &GeoRef,
    radius_m: f64,
    layout: &Layout,
) -> Result<(), Defect> {
    let Some(north) = cart.inside("north_bounding_coordinate") else { return Ok(()) };
    if map.name != "Equirectangular" {
        return Ok(());
    }
    let stated_deg = north.number()?;
    let found_deg = (georef.transform[3] / radius_m).to_degrees() + map.origin_deg;
    let pixel_deg = (-georef.transform[5] / radius_m).to_degrees();
    if (found_deg - stated_deg).abs() <= (0.1 * layout.rows as f64).max(2.0) * pixel_deg {
        return Ok(());
    }
    let what = format!("{} {stated_deg} and upperleft_corner_y to agree", north.name());
    Err(Defect::at(north.line(), format!("{what} expected, the corner gives {found_deg:.6}")))
}
