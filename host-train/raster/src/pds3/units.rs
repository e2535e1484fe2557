//! Numbers with units: lengths, scales, and the offsets of height products.

use super::super::unit::{Conversion, conversion, metres_per};
use super::Defect;
use super::label::{LabelBlock, LabelItem};
use super::value::ValueKind;

/// Radius of the body's sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Radius {
    pub(super) metres: f64,
}

impl Radius {
    /// Reads A_AXIS_RADIUS, in kilometres unless its unit says otherwise; `None` without one.
    pub(super) fn of(projection: &LabelBlock) -> Result<Option<Self>, Defect> {
        let Some(item) = projection.find("A_AXIS_RADIUS")? else { return Ok(None) };
        let metres = length_m(item, "km")?;
        if metres > 0.0 {
            return Ok(Some(Self { metres }));
        }
        Err(Defect::at(item.line, format!("a radius above 0 expected, found {metres} m")))
    }
}

/// Returns a length in metres. `default` is the unit if none is stated.
pub(crate) fn length_m(item: &LabelItem, default: &str) -> Result<f64, Defect> {
    let unit = item.value.unit.as_deref().unwrap_or(default);
    let metres = metres_per(unit).ok_or_else(|| {
        Defect::at(item.line, format!("{} in metres or kilometres expected, found <{unit}>", item.key))
    })?;
    Ok(finite(item)? * metres)
}

/// Returns a finite number.
pub(crate) fn finite(item: &LabelItem) -> Result<f64, Defect> {
    let refuse = || Defect::at(item.line, format!("a number as {} expected, found {:?}", item.key, item.value.kind));
    item.value.number().filter(|v| v.is_finite()).ok_or_else(refuse)
}

/// Returns a count.
pub(crate) fn whole(item: &LabelItem) -> Result<u64, Defect> {
    let number = match item.value.kind {
        ValueKind::Integer(n) | ValueKind::Based { value: n, .. } => u64::try_from(n).ok(),
        _ => None,
    };
    number
        .ok_or_else(|| Defect::at(item.line, format!("a count as {} expected, found {:?}", item.key, item.value.kind)))
}

/// Returns a number that may be missing.
pub(super) fn number(block: &LabelBlock, key: &str) -> Result<Option<f64>, Defect> {
    block.find(key)?.map(finite).transpose()
}

/// Returns the unit of the samples as the label states it, and the conversion of stored numbers. The unit is that of UNIT; without one, that of
/// SCALING_FACTOR or else of OFFSET. A SCALING_FACTOR or OFFSET in another unit of length is converted to it.
pub(super) fn heights(image: &LabelBlock, radius: Option<Radius>) -> Result<(Option<String>, Conversion), Defect> {
    let (factor, constant) = (Quantity::of(image, "SCALING_FACTOR", 1.0)?, Quantity::of(image, "OFFSET", 0.0)?);
    if factor.value == 0.0 {
        return Err(Defect::missing("a SCALING_FACTOR other than 0 expected, found 0"));
    }
    let unit = image.find("UNIT")?.and_then(|item| item.value.text()).or(factor.length).or(constant.length);
    let (scale, offset) = (factor.in_unit(unit), constant.in_unit(unit));
    let conversion = conversion(unit, scale, offset, radius.map(|radius| radius.metres));
    Ok((unit.map(str::to_owned), conversion))
}

/// A number with its unit of length, if it has one.
struct Quantity<'a> {
    value: f64,
    length: Option<&'a str>,
}

impl<'a> Quantity<'a> {
    /// Reads a keyword. Its unit may be a length or a length per stored number: `<KM>`, `<M/DN>`.
    fn of(image: &'a LabelBlock, key: &str, default: f64) -> Result<Self, Defect> {
        let Some(item) = image.find(key)? else { return Ok(Self { value: default, length: None }) };
        let unit = item.value.unit.as_deref().and_then(|unit| unit.split('/').next());
        Ok(Self { value: finite(item)?, length: unit.filter(|unit| metres_per(unit).is_some()) })
    }

    /// Returns the number in another unit; unchanged if one of the two is no known length.
    fn in_unit(&self, unit: Option<&str>) -> f64 {
        let metres = |unit: Option<&str>| unit.and_then(metres_per);
        let ratio = metres(self.length).zip(metres(unit)).map_or(1.0, |(own, other)| own / other);
        self.value * ratio
    }
}
