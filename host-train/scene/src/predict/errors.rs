//! File of the errors that a DTM's heights and slopes are expected to have.

use super::Provenance;
use super::output::write_sum;
use super::sigma::CoarseSigma;
use elunar_base::Result;
use elunar_core::photoclinometry::Origin;
use elunar_raster::GeoRef;
use elunar_raster::geotiff::{WriteOptions, Writer};
use std::path::{Path, PathBuf};

/// Number of pixels of each [`Origin`], by its code.
pub type Origins = [u64; 5];

/// Writer of a GeoTIFF with three bands: standard deviations of heights (metres) and of slopes along either axis (metres per metre), and the
/// codes of [`Origin`]. The first two are void where the DTM is.
pub struct ErrorsWriter {
    file: Writer,
    output: PathBuf,
    is_identified: bool,
    coarse_sigma: CoarseSigma,
    origins: Origins,
}

impl ErrorsWriter {
    /// Starts a file of `rows` x `cols` pixels. `coarse_sigma` is the standard deviation of the coarse DTM's own heights.
    ///
    /// # Errors
    /// As [`Writer::create`].
    pub fn create(
        output: &Path,
        (rows, cols): (usize, usize),
        georef: &GeoRef,
        from: &Provenance,
        coarse_sigma: CoarseSigma,
    ) -> Result<Self> {
        let heights = "expected standard deviation of the height's error";
        let origins = "origin of the height: 0 image, 1 image and coarse DTM, 2 coarse DTM, 3 shadow, 4 no height";
        let options = WriteOptions::heights(heights)
            .with_band("expected standard deviation of the slope's error along either axis, metres per metre", None)
            .with_band(origins, None)
            .with_item("COARSE_SIGMA_M", format!("{}", coarse_sigma.sigma_m))
            .with_item("COARSE_SIGMA_FROM", coarse_sigma.from.to_string())
            .with_item("COARSE_CORRELATION_M", format!("{}", coarse_sigma.correlation_m))
            .with_item("COARSE_CORRELATION_FROM", coarse_sigma.correlation_from());
        let options = from.items().into_iter().fold(options, |options, (name, text)| options.with_item(name, text));
        let file = Writer::create(output, rows, cols, Some(georef), &options)?;
        let is_identified = from.identity.is_some();
        Ok(Self { file, output: output.into(), is_identified, coarse_sigma, origins: Origins::default() })
    }

    /// Adds a row: the expected errors of heights and slopes, the share that the image explains, and darkness.
    ///
    /// # Errors
    /// As [`Writer::write_band_rows`].
    pub(super) fn add(&mut self, [heights_m, slopes, explained, dark]: [&[f32]; 4]) -> Result<()> {
        let with_coarse: Vec<f32> =
            heights_m.iter().map(|sd_m| with_coarse(*sd_m, self.coarse_sigma.sigma_m)).collect();
        let origins = origins_of(explained, dark);
        origins.iter().for_each(|origin| self.origins[*origin as usize] += 1);
        self.file.write_band_rows(0, &with_coarse)?;
        self.file.write_band_rows(1, slopes)?;
        self.file.write_band_rows(2, &origins.iter().map(|origin| f32::from(*origin as u8)).collect::<Vec<_>>())
    }

    /// Completes the file.
    ///
    /// # Errors
    /// As [`Writer::finish`].
    pub fn finish(self) -> Result<Origins> {
        let mut staged = self.file.stage()?;
        if self.is_identified {
            write_sum(&self.output, &staged.sha256()?)?;
        }
        staged.publish()?;
        Ok(self.origins)
    }
}

/// Returns the standard deviation of a height, metres, from the one that the image leaves and that of the coarse DTM's own heights.
pub(super) fn with_coarse(height_sd_m: f32, coarse_sigma_m: f32) -> f32 {
    // In steps that every machine rounds alike; `hypot` is the platform's.
    let square = |v: f32| f64::from(v) * f64::from(v);
    (square(height_sd_m) + square(coarse_sigma_m)).sqrt() as f32
}

/// Returns the origins of a row's heights from the share that the image explains, and darkness.
pub(super) fn origins_of(explained: &[f32], dark: &[f32]) -> Vec<Origin> {
    explained.iter().zip(dark).map(|(e, d)| Origin::of(*e, *d)).collect()
}

/// Returns the origins in words.
#[must_use]
pub fn origins_text(origins: &Origins) -> String {
    let all = origins.iter().sum::<u64>().max(1);
    let names = ["from the image", "from image and coarse DTM", "from the coarse DTM", "in shadow", "without height"];
    let shares: Vec<String> = origins
        .iter()
        .zip(names)
        .filter(|(count, _)| **count > 0)
        .map(|(count, name)| format!("{:.0} % {name}", 100.0 * *count as f64 / all as f64))
        .collect();
    shares.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn origins_are_told_in_percent() {
        assert_eq!(origins_text(&[3, 0, 1, 0, 0]), "75 % from the image, 25 % from the coarse DTM");
    }
}
