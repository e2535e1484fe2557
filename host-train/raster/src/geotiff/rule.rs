//! Conversion of stored numbers to samples.

use super::super::nodata::{self, Nodata};
use super::super::sun::StatedSun;
use super::super::{GeoRef, unit};
use super::handle::Handle;
use super::plain::SampleKind;
use super::{metadata, tag};
use elunar_base::Result;
use elunar_core::mask::is_real_i16;
use tiff::decoder::DecodingResult;
use tiff::tags::Tag;

/// GeoKeys of the vertical reference system and of the unit of heights (OGC 19-008).
const VERTICAL_SYSTEM: u16 = 4096;
const VERTICAL_UNIT: u16 = 4099;

/// NoData values, scale and offset.
pub(super) struct Rule {
    nodata: Nodata,
    /// Whether a NoData value is stated, in the range of the samples or not.
    has_nodata: bool,
    scale: f64,
    offset: f64,
    /// Unit of the samples after conversion.
    pub(super) unit: Option<String>,
    /// Unit that the file states.
    pub(super) unit_in_file: Option<String>,
    /// The Sun of an image (items `SUN_AZIMUTH_DEG` and `SUN_ELEVATION_DEG`).
    pub(super) sun: StatedSun,
}

impl Rule {
    /// Reads the tags of a file of samples of one kind. `nodata` is the user's value, beside that of the tag.
    pub(super) fn of(
        file: &mut Handle,
        kind: SampleKind,
        georef: Option<&GeoRef>,
        nodata: Option<f64>,
    ) -> Result<Self> {
        let tagged = match file.text(Tag::GdalNodata)? {
            Some(text) if !text.trim().is_empty() => Some(number(file, "nodata tag 42113", &text)?),
            _ => None,
        };
        let (mut scale, mut offset, mut of_band, mut sun) = (1.0, 0.0, None, StatedSun::default());
        for item in metadata::parse(&file.text(tag::GDAL_METADATA)?.unwrap_or_default()) {
            match (item.role.as_str(), item.name.as_str()) {
                ("", key) => sun.add(key, &item.text),
                ("scale", _) => scale = finite(file, "band scale", &item.text)?,
                ("offset", _) => offset = finite(file, "band offset", &item.text)?,
                ("unittype", _) => of_band = Some(item.text.trim().to_string()).filter(|unit| !unit.is_empty()),
                _ => {}
            }
        }
        let unit_in_file = of_band.or_else(|| georef.and_then(vertical_unit));
        let radius_m = georef.and_then(|g| g.crs.sphere_radius_m());
        let unit::Conversion { unit, scale, offset } =
            unit::conversion(unit_in_file.as_deref(), scale, offset, radius_m);
        let stated: Vec<f64> = tagged.into_iter().chain(nodata).collect();
        let has_nodata = !stated.is_empty();
        let nodata = match (kind.letter, kind.bits) {
            ('f', bits) => Nodata::of_floats(stated, bits.into()),
            (letter, bits) => Nodata::of_integers(stated, &nodata::range_of(letter == 'i', bits.into())),
        };
        Ok(Self { nodata, has_nodata, scale, offset, unit, unit_in_file, sun })
    }

    /// Returns scale and offset if they change a number.
    pub(super) fn applied(&self) -> Option<(f64, f64)> {
        Some((self.scale, self.offset)).filter(|&applied| applied != (1.0, 0.0))
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
            DecodingResult::F16(v) => v.iter().map(|v| self.float(v.to_f64())).collect(),
            DecodingResult::F32(v) => v.iter().map(|&v| self.float(f64::from(v))).collect(),
            DecodingResult::F64(v) => v.iter().map(|&v| self.float(v)).collect(),
            DecodingResult::U64(_) | DecodingResult::I64(_) => return None,
        })
    }

    /// Returns the value of a chunk that was never written: NaN if a NoData value is stated, otherwise that of zeros, as in GDAL.
    pub(super) fn unwritten(&self) -> f32 {
        if self.has_nodata { f32::NAN } else { self.finish(0.0) }
    }

    fn whole(&self, value: f64) -> f32 {
        if self.nodata.has_integer(value) { f32::NAN } else { self.finish(value) }
    }

    fn float(&self, value: f64) -> f32 {
        if self.nodata.has_float(value) { f32::NAN } else { self.finish(value) }
    }

    fn finish(&self, value: f64) -> f32 {
        nodata::sample(value * self.scale + self.offset)
    }
}

/// Returns the unit of heights that the GeoKeys name, as far as it is known not to be the metre.
fn vertical_unit(georef: &GeoRef) -> Option<String> {
    let code = |wanted: u16| {
        let mut keys = georef.crs.directory.as_chunks::<4>().0.iter().skip(1);
        keys.find(|[key, tag, ..]| (*key, *tag) == (wanted, 0)).map(|[.., code]| *code)
    };
    let of_system = || code(VERTICAL_SYSTEM).and_then(unit::of_vertical_system).map(str::to_owned);
    code(VERTICAL_UNIT).map(unit::of_code).or_else(of_system)
}

fn number(file: &Handle, name: &str, text: &str) -> Result<f64> {
    nodata::number(text).ok_or_else(|| file.broken(format!("{name} is {text:?}, a number expected")))
}

/// Reads a number that converts samples. With another one all samples would be void.
fn finite(file: &Handle, name: &str, text: &str) -> Result<f64> {
    let value = number(file, name, text)?;
    if value.is_finite() {
        Ok(value)
    } else {
        Err(file.broken(format!("{name} is {text:?}, a finite number expected")))
    }
}
