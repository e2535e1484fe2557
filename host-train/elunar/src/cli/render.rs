//! `elunar render`: renders an image of a DTM under a given Sun.

use crate::held::Held;
use crate::outputs as output;
use elunar_base::{Error, Result};
use elunar_net::sun::check_azimuth;
use elunar_raster::Raster;
use elunar_raster::geotiff::{self, SampleType, WriteOptions};
use elunar_synth::photograph;
use std::path::PathBuf;

/// Options of `render`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Shows what an orbiter's camera would see from straight above: Lunar-Lambert reflectance, cast shadows, blur, noise, relative DN \
from 0 to 4095, as on the synthetic Moon. The albedo is 1 everywhere. The image lies on the DTM's grid and says which Sun it was \
made with. With a coarse DTM it makes a test or training scene of real ground (`prepare`, `host-train suite`). For a relief to \
look at, see `hillshade`.

Example:
  elunar render dtm.tif -o image.tif --sun-azimuth 300 --sun-elevation 20")]
pub struct Args {
    /// DTM, heights in metres. Every pixel must have a height, and pixels must be square.
    #[arg(value_name = "DTM")]
    pub input: PathBuf,
    /// Image to write: a GeoTIFF of 16 bits with the DTM's georeference, or a PNG picture of 8 bits.
    #[arg(short, long, value_name = "OUT.tif|OUT.png")]
    pub output: PathBuf,
    /// Azimuth of the Sun, degrees clockwise from the top of the raster, -360 to 360.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub sun_azimuth: f64,
    /// Elevation of the Sun above the horizon, degrees, 2 to 90.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub sun_elevation: f64,
    /// Seed of blur, exposure and noise.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
}

/// Runs the command.
///
/// # Errors
/// If the DTM cannot be read, has gaps, has no pixel size or pixels that are not square, or the Sun is out of range. Then no output file
/// exists.
pub fn run(args: Args) -> Result<()> {
    println!("{}", write(&args, &Held::default())?);
    Ok(())
}

/// Renders an image in memory: relative DN, 0 to 4095.
///
/// # Errors
/// As [`run`].
pub fn image(args: &Args, held: &Held) -> Result<Raster> {
    check_azimuth("--sun-azimuth", args.sun_azimuth)?;
    if !(2.0..=90.0).contains(&args.sun_elevation) {
        let found = args.sun_elevation;
        return Err(Error::usage(format!("--sun-elevation: a number from 2 to 90 degrees expected, found {found}")));
    }
    let dtm = held.read_heights(&args.input)?;
    photograph(&dtm, (args.sun_azimuth, args.sun_elevation), args.seed)
        .map_err(|e| Error::usage(format!("{}: {e}", args.input.display())))
}

/// Renders an image and writes it. Returns a line about it.
///
/// # Errors
/// As [`run`].
pub fn write(args: &Args, held: &Held) -> Result<String> {
    let kind = output::extension(&args.output, &["tif", "tiff", "png"])?;
    let _owner = output::take(&args.output, &held.files([args.input.as_path()]))?;
    let image = image(args, held)?;
    let (rows, cols) = (image.rows, image.cols);
    let (low, high) = image.range().unwrap_or_default();
    match kind {
        "png" => {
            let grey = |dn: f32| (255.0 * (dn - low) / (high - low).max(1.0)).round() as u8;
            let bytes = image.samples.iter().map(|&dn| grey(dn)).collect();
            elunar_picture::write_png(&args.output, elunar_picture::grey(bytes, rows, cols)?)?;
        }
        _ => {
            let options = WriteOptions::image(SampleType::U16, "image rendered from a DTM, relative DN")
                .with_item("SYNTHETIC", "yes")
                .with_sun(Some(args.sun_azimuth), Some(args.sun_elevation));
            geotiff::write(&args.output, &image, &options)?;
        }
    }
    Ok(format!("{}: {rows} x {cols} pixels, DN {low} to {high}", args.output.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_synth::{Moon, SynthOptions};

    fn args(input: PathBuf, output: PathBuf, sun_elevation: f64) -> Args {
        Args { input, output, sun_azimuth: 300.0, sun_elevation, seed: 4 }
    }

    #[test]
    fn an_image_lies_on_the_grid_of_its_dtm_and_bad_input_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let truth = Moon::new(3, SynthOptions::default()).unwrap().scene(1, 64, 80).unwrap().truth_raster();
        geotiff::write(&at("dtm.tif"), &truth, &WriteOptions::heights("a DTM")).unwrap();
        run(args(at("dtm.tif"), at("image.tif"), 25.0)).unwrap();
        run(args(at("dtm.tif"), at("image.png"), 25.0)).unwrap();
        let image = elunar_raster::source::read(&at("image.tif")).unwrap();
        assert_eq!(image.georef, truth.georef);
        // Sixteen bits represent the camera's integers exactly.
        assert_eq!(image.samples, photograph(&truth, (300.0, 25.0), 4).unwrap().samples);
        assert!(at("image.png").exists());
        for (output, elevation, expected) in [
            ("low.tif", 1.0, "--sun-elevation: a number from 2 to 90 degrees expected, found 1"),
            ("nan.tif", f64::NAN, "found NaN"),
            ("dtm.tif", 25.0, "overwrite"),
        ] {
            let error = run(args(at("dtm.tif"), at(output), elevation)).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        assert!(!at("low.tif").exists() && !at("nan.tif").exists());
        assert_eq!(elunar_raster::source::read(&at("dtm.tif")).unwrap().samples, truth.samples);
    }
}
