//! Numbers with units: lengths, scales, and the offsets of height products.

use super::super::unit::{Conversion, conversion, metres_per};
use super::Defect;
use super::label::{Block, Item};

/// Radius of the body's sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Radius {
    pub(super) metres: f64,
}

impl Radius {
    /// Reads A_AXIS_RADIUS, in kilometres unless its unit says otherwise; `None` without one.
    pub(super) fn of(projection: &Block) -> Result<Option<Self>, Defect> {
        let Some(item) = projection.find("A_AXIS_RADIUS")? else { return Ok(None) };
        let metres = length_m(item, "km")?;
        if metres > 0.0 {
            return Ok(Some(Self { metres }));
        }
        Err(Defect::at(item.line, format!("a radius above 0 expected, found {metres} m")))
    }
}

/// Returns a length in metres. `default` is the unit if none is stated.
pub(super) fn length_m(item: &Item, default: &str) -> Result<f64, Defect> {
    let unit = item.value.unit.as_deref().unwrap_or(default);
    let metres = metres_per(unit).ok_or_else(|| {
        Defect::at(item.line, format!("{} in metres or kilometres expected, found <{unit}>", item.key))
    })?;
    Ok(finite(item)? * metres)
}

/// Returns a finite number.
pub(super) fn finite(item: &Item) -> Result<f64, Defect> {
    let refuse = || Defect::at(item.line, format!("a number as {} expected, found {:?}", item.key, item.value.kind));
    item.value.number().filter(|v| v.is_finite()).ok_or_else(refuse)
}

/// Returns a number that may be missing.
pub(super) fn number(block: &Block, key: &str) -> Result<Option<f64>, Defect> {
    block.find(key)?.map(finite).transpose()
}

/// Returns the unit of the samples as the label states it, and the conversion of stored numbers.
pub(super) fn heights(image: &Block, radius: Option<Radius>) -> Result<(Option<String>, Conversion), Defect> {
    let scale = number(image, "SCALING_FACTOR")?.unwrap_or(1.0);
    if scale == 0.0 {
        return Err(Defect::missing("a SCALING_FACTOR other than 0 expected, found 0"));
    }
    let offset = number(image, "OFFSET")?.unwrap_or(0.0);
    let unit = image.find("UNIT")?.and_then(|item| item.value.text());
    let conversion = conversion(unit, scale, offset, radius.map(|radius| radius.metres));
    Ok((unit.map(str::to_owned), conversion))
}
