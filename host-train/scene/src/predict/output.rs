//! Files of a prediction: the DTM with its provenance, and a hillshade beside it.

use super::identity::{Identity, sum_path};
use super::preview::{LONGEST_PX, Preview};
use elunar_base::{Error, Result, SOFTWARE, atomic_write};
use elunar_core::sun::Body;
use elunar_core::terrain::PixelSize;
use elunar_raster::geotiff::{WriteOptions, Writer};
use elunar_raster::{GeoRef, Raster};
use image::GrayImage;
use std::path::{Path, PathBuf};

/// Provenance of a DTM, for the file's metadata.
#[derive(Debug, Clone, Copy)]
pub struct Provenance<'a> {
    /// Description of the model, with its hash.
    pub model: &'a str,
    /// The light in words ([`super::job::light_text`]).
    pub light: &'a str,
    /// Name of the image.
    pub image: &'a str,
    /// Name of the coarse DTM.
    pub coarse: &'a str,
    /// What the job is, if it can be recognised by it.
    pub identity: Option<&'a Identity>,
}

impl Provenance<'_> {
    /// Returns the metadata items that say where a file comes from.
    pub(super) fn items(&self) -> Vec<(&'static str, String)> {
        let Self { model, light, image, coarse, identity } = *self;
        let mut items = vec![
            ("MODEL", model.into()),
            ("LIGHT", light.into()),
            ("IMAGE", image.into()),
            ("COARSE_DTM", coarse.into()),
            ("SOFTWARE", SOFTWARE.into()),
        ];
        items.extend(identity.into_iter().flat_map(Identity::items));
        items
    }
}

/// A writer of a DTM, rows from top to bottom. It writes a GeoTIFF (heights in metres, the image's georeference, NoData value, model hash
/// and input names) and its hillshade at [`hillshade_path`].
pub struct DtmWriter {
    output: PathBuf,
    file: Writer,
    preview: Preview,
    is_identified: bool,
}

impl DtmWriter {
    /// Starts a DTM of `rows` x `cols` pixels.
    ///
    /// # Errors
    /// [`elunar_base::Error::Io`] if the file cannot be created.
    pub fn create(output: &Path, rows: usize, cols: usize, georef: &GeoRef, from: &Provenance) -> Result<Self> {
        let radius_m = georef.crs.sphere_radius_m().unwrap_or(Body::Moon.radius_m());
        let Provenance { model, image, coarse, .. } = from;
        let description = format!(
            "DTM from one image: heights above the {radius_m} m sphere; {model}; image {image}; coarse DTM {coarse}"
        );
        let options = WriteOptions::heights(description)
            .with_item("VERTICAL_REFERENCE", format!("sphere of radius {radius_m} m"));
        let options = from.items().into_iter().fold(options, |options, (name, text)| options.with_item(name, text));
        let file = Writer::create(output, rows, cols, Some(georef), &options)?;
        Ok(Self {
            output: output.into(),
            file,
            preview: Preview::new(rows, cols, georef.clone(), LONGEST_PX),
            is_identified: from.identity.is_some(),
        })
    }

    /// Adds whole rows.
    ///
    /// # Errors
    /// [`elunar_base::Error::Io`] if they cannot be written.
    pub fn add(&mut self, samples: &[f32]) -> Result<()> {
        rayon::join(|| self.preview.add(samples), || self.file.write_rows(samples)).1
    }

    /// Writes the remaining data. The DTM is written last, so that a DTM on disk is always complete. The SHA-256 of a DTM with an identity
    /// comes before both files. `check` says whether the output is still ours; it is asked at the end.
    ///
    /// # Errors
    /// [`elunar_base::Error::Io`] if a file cannot be written. Then the DTM does not exist. Errors of `check` are passed on.
    pub fn finish(self, check: &dyn Fn() -> Result<()>) -> Result<()> {
        let shade = hillshade_path(&self.output);
        let (output, preview) = (self.output, self.preview);
        let mut staged = self.file.stage()?;
        check()?;
        let sum = || self.is_identified.then(|| staged.sha256()).transpose();
        let (sum, picture) = rayon::join(sum, || hillshade(&shade, &preview.finish()));
        // First of all: by it, what a killed run leaves is known.
        if let Some(sum) = sum? {
            write_sum(&output, &sum)?;
        }
        elunar_picture::write_png(&shade, picture?)?;
        let publish = || {
            check()?;
            staged.publish()
        };
        publish().inspect_err(|_| drop(std::fs::remove_file(&shade)))
    }
}

/// Writes the SHA-256 of a file beside it.
pub(super) fn write_sum(output: &Path, sum: &str) -> Result<()> {
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    atomic_write(&sum_path(output), format!("{sum}  {name}\n").as_bytes())
}

/// Draws the hillshade that `path` will have.
fn hillshade(path: &Path, dtm: &Raster) -> Result<GrayImage> {
    let unknown = || Error::usage(format!("{}: pixel size in metres unknown", path.display()));
    let (row_m, col_m) = dtm.pixel_m().ok_or_else(unknown)?;
    elunar_picture::hillshade(&dtm.samples, dtm.rows, dtm.cols, PixelSize { row_m, col_m })
}

/// Returns the path of the hillshade: `dtm_hillshade.png` beside `dtm.tif`. Another ending stays in the name, so that no two DTMs share one.
#[must_use]
pub fn hillshade_path(output: &Path) -> PathBuf {
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    output.with_file_name(format!("{}_hillshade.png", name.strip_suffix(".tif").unwrap_or(&name)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_dtm_has_a_hillshade_of_its_own() {
        let shades = ["a.tif", "a.tiff", "a.TIF", "a.b.tif"].map(|name| hillshade_path(&Path::new("x").join(name)));
        let names = ["a_hillshade.png", "a.tiff_hillshade.png", "a.TIF_hillshade.png", "a.b_hillshade.png"];
        assert_eq!(shades, names.map(|name| Path::new("x").join(name)));
    }
}
