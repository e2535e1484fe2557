//! Georeference of a GeoTIFF: its GeoKeys and its transform.

use super::super::{Crs, GeoRef, GeoTransform};
use super::handle::Handle;
use crate::Result;
use tiff::tags::Tag;

/// Returns the georeference that the tags state; `None` without a transform.
pub(super) fn georef(file: &mut Handle) -> Result<Option<GeoRef>> {
    let crs = Crs {
        directory: file.unsigned_list(Tag::GeoKeyDirectoryTag)?.unwrap_or_default(),
        doubles: file.doubles(Tag::GeoDoubleParamsTag)?.unwrap_or_default(),
        ascii: file.text(Tag::GeoAsciiParamsTag)?.unwrap_or_default(),
    };
    if let Some(defect) = crs.defect() {
        return Err(file.broken(defect));
    }
    let Some(mut t) = transform(file)? else { return Ok(None) };
    if !t.iter().all(|v| v.is_finite()) || t[1] * t[5] == t[2] * t[4] {
        return Err(file.broken(format!("transform {t:?} has no inverse")));
    }
    if crs.pixel_is_point() {
        t[0] -= 0.5 * (t[1] + t[2]);
        t[3] -= 0.5 * (t[4] + t[5]);
    }
    Ok(Some(GeoRef { transform: t, crs }))
}

fn transform(file: &mut Handle) -> Result<Option<GeoTransform>> {
    let scale = file.doubles(Tag::ModelPixelScaleTag)?;
    let ties = file.doubles(Tag::ModelTiepointTag)?;
    if let (Some(scale), Some(ties)) = (&scale, &ties) {
        let (&[sx, sy, ..], &[col, row, _, x, y, _]) = (scale.as_slice(), ties.as_slice()) else {
            let what = format!("{} pixel scales and {} tie point numbers, 3 and 6 expected", scale.len(), ties.len());
            return Err(file.unsupported(what));
        };
        let sy = sy.abs();
        return Ok(Some([x - col * sx, sx, 0.0, y + row * sy, 0.0, -sy]));
    }
    if let Some(m) = file.doubles(Tag::ModelTransformationTag)? {
        let &[a, b, _, x, c, d, _, y, ..] = m.as_slice() else {
            return Err(file.broken(format!("transformation tag 34264 of {} numbers, 16 expected", m.len())));
        };
        return Ok(Some([x, a, b, y, c, d]));
    }
    match ties {
        Some(ties) => Err(file.unsupported(format!("{} ground control points, a transform expected", ties.len() / 6))),
        None => Ok(None),
    }
}
