//! External masks: `NAME.msk` beside a raster says which of its pixels are valid, as GDAL has it.

use super::source::{Info, Source};
use super::{format::Format, geotiff};
use elunar_base::{Error, Result};
use elunar_core::tile::Window;
use std::path::{Path, PathBuf};

/// Returns the path of the mask beside a raster, if there is one.
pub(crate) fn beside(path: &Path) -> Option<PathBuf> {
    let mut name = path.as_os_str().to_owned();
    name.push(".msk");
    Some(PathBuf::from(name)).filter(|mask| mask.is_file())
}

/// Puts the mask beside `path`, if there is one, on its raster: samples are invalid where the mask is 0, too.
///
/// # Errors
/// As [`geotiff::open`] about the mask; [`Error::Broken`] if it is no TIFF, or has another size.
pub(crate) fn masked(path: &Path, source: Box<dyn Source>) -> Result<Box<dyn Source>> {
    let Some(at) = beside(path) else { return Ok(source) };
    if Format::of(&at)? != Format::Tiff {
        return Err(Error::broken(
            &at,
            format!("a mask of {} as a TIFF expected, found something else", path.display()),
        ));
    }
    let mask = geotiff::open(&at)?;
    let size = |source: &dyn Source| (source.info().rows, source.info().cols);
    let ((rows, cols), found) = (size(&*source), size(&*mask));
    if found != (rows, cols) {
        let what = format!(
            "a mask of {rows} x {cols} pixels expected, as {}, found {} x {}",
            path.display(),
            found.0,
            found.1
        );
        return Err(Error::broken(&at, what));
    }
    Ok(Box::new(Masked { source, mask }))
}

struct Masked {
    source: Box<dyn Source>,
    mask: Box<dyn Source>,
}

impl Source for Masked {
    fn info(&self) -> &Info {
        self.source.info()
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        let (mut samples, mask) = (self.source.read(window)?, self.mask.read(window)?);
        let outside = samples.iter_mut().zip(mask).filter(|(_, mask)| mask.is_nan() || *mask == 0.0);
        outside.for_each(|(sample, _)| *sample = f32::NAN);
        Ok(samples)
    }
}

#[cfg(test)]
mod tests {
    use crate::content::files_of_raster;
    use crate::geotiff::{SampleType, WriteOptions, write};
    use crate::{Raster, source};
    use elunar_testing::rasterio;

    #[test]
    fn pixels_outside_the_mask_are_void() {
        let folder = tempfile::tempdir().unwrap();
        let (path, mask) = (folder.path().join("a.tif"), folder.path().join("a.tif.msk"));
        let raster = |rows, samples: Vec<f32>| Raster { rows, cols: samples.len() / rows, samples, georef: None };
        write(&path, &raster(2, vec![1.0, 2.0, 3.0, f32::NAN]), &WriteOptions::heights("t")).unwrap();
        let valid = || source::read(&path).map(|raster| raster.samples.iter().map(|v| !v.is_nan()).collect::<Vec<_>>());
        assert_eq!(valid().unwrap(), [true, true, true, false]);
        assert_eq!(files_of_raster(&path).unwrap().len(), 1);
        let bytes = WriteOptions::image(SampleType::U8, "mask");
        write(&mask, &raster(2, vec![255.0, 0.0, 1.0, 255.0]), &bytes).unwrap();
        assert_eq!(valid().unwrap(), [true, false, true, false]);
        assert_eq!(files_of_raster(&path).unwrap(), [path.clone(), mask.clone()], "it is never written");
        write(&mask, &raster(2, vec![255.0, f32::NAN, 1.0, 255.0]), &bytes).unwrap();
        assert_eq!(valid().unwrap(), [true, false, true, false], "a void of the mask");
        write(&mask, &raster(1, vec![255.0, 0.0, 1.0, 255.0]), &bytes).unwrap();
        let text = valid().unwrap_err().to_string();
        assert!(text.contains("a.tif.msk: broken file: a mask of 2 x 2 pixels expected"), "{text}");
        std::fs::write(&mask, "no").unwrap();
        assert!(valid().unwrap_err().to_string().contains("a.tif.msk"));
    }

    #[test]
    fn masks_of_gdal_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let script = "
rng = np.random.default_rng(4)
for name, more in (('a.tif', {}), ('b.tif', {'tiled': True, 'blockxsize': 16, 'blockysize': 32, 'compress': 'lzw'})):
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=False):
        with rasterio.open(name, 'w', driver='GTiff', width=70, height=50, count=1, dtype='float32', nodata=5, **more) as d:
            d.write(np.ones((1, 50, 70), 'f4')); d.write_mask(rng.random((50, 70)) > 0.3)
    (rasterio.open(name).read_masks(1) != 0).astype('u1').tofile(name + '.raw')
";
        if rasterio(script, folder.path()).is_none() {
            return;
        }
        for name in ["a.tif", "b.tif"] {
            let at = |end: &str| folder.path().join(format!("{name}{end}"));
            assert!(at(".msk").exists());
            let samples = source::read(&at("")).unwrap().samples;
            let valid: Vec<u8> = samples.iter().map(|v| u8::from(!v.is_nan())).collect();
            assert_eq!(valid, std::fs::read(at(".raw")).unwrap(), "{name}");
        }
    }
}
