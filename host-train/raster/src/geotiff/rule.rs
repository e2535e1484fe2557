//! Conversion of stored numbers to samples.

use super::super::GeoRef;
use super::super::sun::StatedSun;
use super::handle::Handle;
use super::{LOWEST_VALID, metadata, tag};
use crate::Result;
use elunar_core::mask::is_real_i16;
use tiff::decoder::DecodingResult;
use tiff::tags::Tag;

/// NoData values, scale and offset.
pub(super) struct Rule {
    /// The tag's value and the user's, if any.
    nodata: Vec<f64>,
    /// The same rounded to `f32`, as in `f32` files. The text may have more digits.
    nodata_f32: Vec<f64>,
    scale: f64,
    offset: f64,
    /// Unit of the samples after conversion.
    pub(super) unit: Option<String>,
    /// The Sun of an image (items `SUN_AZIMUTH_DEG` and `SUN_ELEVATION_DEG`).
    pub(super) sun: StatedSun,
}

impl Rule {
    /// Reads the tags. `nodata` is the user's value, beside that of the tag.
    pub(super) fn of(file: &mut Handle, georef: Option<&GeoRef>, nodata: Option<f64>) -> Result<Self> {
        let tagged = match file.text(Tag::GdalNodata)? {
            Some(text) if !text.trim().is_empty() => Some(number(file, "nodata tag 42113", &text)?),
            _ => None,
        };
        let (mut scale, mut offset, mut unit, mut sun) = (1.0, 0.0, None, StatedSun::default());
        let angle = |text: &str| Some(text.trim().parse().unwrap_or(f64::NAN));
        for item in metadata::parse(&file.text(tag::GDAL_METADATA)?.unwrap_or_default()) {
            match (item.role.as_str(), item.name.as_str()) {
                ("", "SUN_AZIMUTH_DEG") => sun.azimuth_deg = angle(&item.text),
                ("", "SUN_ELEVATION_DEG") => sun.elevation_deg = angle(&item.text),
                ("scale", _) => scale = number(file, "band scale", &item.text)?,
                ("offset", _) => offset = number(file, "band offset", &item.text)?,
                ("unittype", _) => unit = Some(item.text.trim().to_string()).filter(|unit| !unit.is_empty()),
                _ => {}
            }
        }
        let mut to_metres = match unit.as_deref().unwrap_or_default().to_lowercase().as_str() {
            "km" | "kilometre" | "kilometer" | "kilometres" | "kilometers" => Some(1000.0),
            "m" | "metre" | "meter" | "metres" | "meters" => Some(1.0),
            _ => None,
        };
        if let Some(radius_m) = georef.and_then(|g| g.crs.sphere_radius_m()) {
            let is_radius = |value: f64| (value - radius_m).abs() <= 1e-6 * radius_m;
            // A radius in kilometres implies the unit, even if the unit is not stated.
            if is_radius(offset * 1000.0) {
                (offset, to_metres) = (0.0, Some(1000.0));
            } else if is_radius(offset) {
                (offset, to_metres) = (0.0, Some(to_metres.unwrap_or(1.0)));
            }
        }
        if to_metres.is_some() {
            unit = Some("m".into());
        }
        let (scale, offset) = (scale * to_metres.unwrap_or(1.0), offset * to_metres.unwrap_or(1.0));
        let nodata: Vec<f64> = tagged.into_iter().chain(nodata).collect();
        let nodata_f32 = nodata.iter().map(|&v| f64::from(v as f32)).collect();
        Ok(Self { nodata, nodata_f32, scale, offset, unit, sun })
    }

    /// Converts all samples of a chunk; `None` for unsupported types.
    pub(super) fn samples(&self, data: &DecodingResult) -> Option<Vec<f32>> {
        Some(match data {
            DecodingResult::U8(v) => v.iter().map(|&v| self.whole(f64::from(v))).collect(),
            DecodingResult::I8(v) => v.iter().map(|&v| self.whole(f64::from(v))).collect(),
            DecodingResult::U16(v) => v.iter().map(|&v| self.whole(f64::from(v))).collect(),
            DecodingResult::I16(v) => {
                v.iter().map(|&v| if is_real_i16(v) { self.whole(f64::from(v)) } else { f32::NAN }).collect()
            }
            DecodingResult::U32(v) => v.iter().map(|&v| self.whole(f64::from(v))).collect(),
            DecodingResult::I32(v) => v.iter().map(|&v| self.whole(f64::from(v))).collect(),
            DecodingResult::F16(v) => v.iter().map(|v| self.float(v.to_f64(), &self.nodata)).collect(),
            DecodingResult::F32(v) => v.iter().map(|&v| self.float(f64::from(v), &self.nodata_f32)).collect(),
            DecodingResult::F64(v) => v.iter().map(|&v| self.float(v, &self.nodata)).collect(),
            DecodingResult::U64(_) | DecodingResult::I64(_) => return None,
        })
    }

    /// Returns the value of a chunk that was never written: NaN if a NoData value is stated, otherwise that of zeros, as in GDAL.
    pub(super) fn unwritten(&self) -> f32 {
        if !self.nodata.is_empty() { f32::NAN } else { self.finish(0.0) }
    }

    fn whole(&self, value: f64) -> f32 {
        if self.nodata.contains(&value) { f32::NAN } else { self.finish(value) }
    }

    fn float(&self, value: f64, nodata: &[f64]) -> f32 {
        let valid = value.is_finite() && value > LOWEST_VALID && !nodata.contains(&value);
        if valid { self.finish(value) } else { f32::NAN }
    }

    fn finish(&self, value: f64) -> f32 {
        let sample = (value * self.scale + self.offset) as f32;
        if sample.is_finite() { sample } else { f32::NAN }
    }
}

fn number(file: &Handle, name: &str, text: &str) -> Result<f64> {
    text.trim().parse().map_err(|_| file.broken(format!("{name} is {text:?}, a number expected")))
}
