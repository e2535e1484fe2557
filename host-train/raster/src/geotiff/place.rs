//! Georeference of a GeoTIFF: its GeoKeys and its transform.

use super::super::{Crs, GeoRef, GeoTransform};
use super::handle::Handle;
use elunar_base::Result;
use tiff::tags::Tag;

/// Tie points agree if they lie within this part of a pixel, since writers round them (our choice).
const SAME_PLACE_PX: f64 = 0.1;

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
    let crs = crs.with_keys_of_citation();
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
        let &[sx, sy, ..] = scale.as_slice() else {
            return Err(file.broken(format!("3 pixel scales expected, {} found", scale.len())));
        };
        return placed((sx, sy.abs()), ties).map(Some).map_err(|defect| file.broken(defect));
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

/// Returns the transform of a pixel scale and of tie points, six numbers each. All must give the same place: the first one counts, as in
/// GDAL.
fn placed((sx, sy): (f64, f64), ties: &[f64]) -> std::result::Result<GeoTransform, String> {
    let (all, rest) = ties.as_chunks::<6>();
    let (Some((&[col, row, _, x, y, _], others)), []) = (all.split_first(), rest) else {
        return Err(format!("6 numbers for every tie point expected, {} found", ties.len()));
    };
    for &[col2, row2, _, x2, y2, _] in others {
        let (dx, dy) = (x2 - x - (col2 - col) * sx, y2 - y + (row2 - row) * sy);
        if !(dx.abs() <= SAME_PLACE_PX * sx.abs() && dy.abs() <= SAME_PLACE_PX * sy) {
            let what = format!("{} tie points that agree with the pixel scale {sx} x {sy} expected", all.len());
            return Err(format!(
                "{what}, found one at column {col2}, row {row2} that lies ({dx}, {dy}) map units from where the first one puts it"
            ));
        }
    }
    Ok([x - col * sx, sx, 0.0, y + row * sy, 0.0, -sy])
}

#[cfg(test)]
mod tests {
    use crate::source::open;
    use elunar_core::sun::Body;
    use std::path::Path;
    use tiff::encoder::{TiffEncoder, colortype::Gray8};
    use tiff::tags::Tag;

    /// Writes 80 x 60 pixels with a scale of 2 m and these tie points, on the Moon's equirectangular map.
    fn write(path: &Path, ties: &[f64], crs: &crate::Crs) {
        let mut file = std::fs::File::create(path).unwrap();
        let mut tiff = TiffEncoder::new(&mut file).unwrap();
        let mut image = tiff.new_image::<Gray8>(80, 60).unwrap();
        let tags = image.encoder();
        tags.write_tag(Tag::ModelPixelScaleTag, &[2.0, 2.0, 0.0][..]).unwrap();
        tags.write_tag(Tag::ModelTiepointTag, ties).unwrap();
        tags.write_tag(Tag::GeoKeyDirectoryTag, &crs.directory[..]).unwrap();
        tags.write_tag(Tag::GeoDoubleParamsTag, &crs.doubles[..]).unwrap();
        tags.write_tag(Tag::GeoAsciiParamsTag, &*crs.ascii).unwrap();
        image.write_data(&[7; 80 * 60]).unwrap();
    }

    #[test]
    fn scales_and_matrices_that_are_too_short_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.tif");
        let tie = [0.0, 0.0, 0.0, 1000.0, 500.0, 0.0];
        for (tags, what) in [
            (
                &[(Tag::ModelPixelScaleTag, &[2.0][..]), (Tag::ModelTiepointTag, &tie)][..],
                "3 pixel scales expected, 1 found",
            ),
            (
                &[(Tag::ModelTransformationTag, &[2.0, 0.0, 0.0, 7.0, 0.0, 2.0])],
                "transformation tag 34264 of 6 numbers, 16 expected",
            ),
        ] {
            let mut tiff = TiffEncoder::new(std::fs::File::create(&path).unwrap()).unwrap();
            let mut image = tiff.new_image::<Gray8>(2, 1).unwrap();
            for (tag, numbers) in tags {
                image.encoder().write_tag(*tag, *numbers).unwrap();
            }
            image.write_data(&[7; 2]).unwrap();
            let text = open(&path).err().expect("refused").to_string();
            assert!(text.contains(what) && text.contains("t.tif"), "{text}");
        }
    }

    /// Returns tie points at these pixels, on a map with its corner at (1000, 500), the last one off by this much.
    fn ties(pixels: &[(f64, f64)], off: (f64, f64)) -> Vec<f64> {
        let mut ties: Vec<f64> =
            pixels.iter().flat_map(|&(col, row)| [col, row, 0.0, 1000.0 + 2.0 * col, 500.0 - 2.0 * row, 0.0]).collect();
        let n = ties.len();
        (ties[n - 3], ties[n - 2]) = (ties[n - 3] + off.0, ties[n - 2] + off.1);
        ties
    }

    #[test]
    fn tie_points_that_agree_place_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.tif");
        let corners = [(0.0, 0.0), (80.0, 0.0), (0.0, 60.0), (80.0, 60.0)];
        for (pixels, off, agree) in [
            (&corners[..1], (0.0, 0.0), true),
            (&corners[..], (0.0, 0.0), true),
            (&corners[..2], (0.01, 0.0), true),
            (&[(12.5, 3.0), (40.0, 7.0), (12.5, 3.0)], (0.0, -0.05), true),
            (&corners[..], (1.0, 0.0), false),
            (&corners[..2], (0.0, -2.0), false),
            (&corners[..3], (f64::NAN, 0.0), false),
        ] {
            write(&path, &ties(pixels, off), &crate::Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0));
            match open(&path) {
                Ok(source) => {
                    assert!(agree, "{pixels:?} {off:?}");
                    let t = source.info().georef.as_ref().unwrap().transform;
                    assert_eq!(t, [1000.0, 2.0, 0.0, 500.0, 0.0, -2.0]);
                    let script = "print(*rasterio.open('t.tif').transform.to_gdal())";
                    let Some(out) = elunar_testing::rasterio(script, folder.path()) else { continue };
                    let gdal: Vec<f64> = out.split_whitespace().map(|v| v.parse().unwrap()).collect();
                    assert_eq!(t.to_vec(), gdal);
                }
                Err(error) => {
                    assert!(
                        !agree && error.to_string().contains("tie points that agree"),
                        "{pixels:?} {off:?}: {error}"
                    );
                }
            }
        }
        write(&path, &[0.0; 9], &crate::Crs::polar(Body::Moon.radius_m(), true));
        assert!(open(&path).err().unwrap().to_string().contains("9 found"));
    }

    #[test]
    fn a_body_of_any_size_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.tif");
        for radius_m in [f64::INFINITY, f64::NAN, 0.0, 1e300] {
            let mut crs = crate::Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0);
            crs.doubles[..2].fill(radius_m);
            write(&path, &ties(&[(0.0, 0.0)], (0.0, 0.0)), &crs);
            assert!(open(&path).err().unwrap().to_string().contains("semi-axes of a body expected"));
        }
    }

    #[test]
    fn files_of_others_are_placed_or_refused() {
        let Some(folder) = elunar_testing::shared_folder() else { return };
        let place =
            |name: &str| open(&folder.join("files").join(name)).map(|source| source.info().georef.clone().unwrap());
        if !folder.join("files/bugs").is_dir() {
            elunar_testing::skipped("files of others", "no files/bugs in the reference data");
            return;
        }
        let ties = "bugs/01_several_tie_points";
        let reference = place(&format!("{ties}/reference.tif")).unwrap();
        assert_eq!(place(&format!("{ties}/agreeing.tif")).unwrap().transform, reference.transform);
        assert!(place(&format!("{ties}/contradicting.tif")).is_err());
        let esri = "bugs/03_esri_pe_string";
        let (reference, found) = (place(&format!("{esri}/reference.tif")), place(&format!("{esri}/user_defined.tif")));
        let (reference, found) = (reference.unwrap(), found.unwrap());
        assert!(found.crs.same_as(&reference.crs) && found.transform == reference.transform, "{found:?}");
        assert!(place("user/image_R_inf.tif").unwrap_err().to_string().contains("inf m"));
    }
}
