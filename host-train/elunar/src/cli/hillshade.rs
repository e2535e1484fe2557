//! `elunar hillshade`: the shaded relief of a DTM.

use crate::held::Held;
use crate::outputs as output;
use elunar_base::{Error, Result, interrupt, progress};
use elunar_core::terrain::{PixelSize, Sun};
use elunar_net::sun::check_azimuth;
use elunar_picture::shading::{HillshadeOptions, pixel_of, shade_rows};
use elunar_raster::geotiff::{SampleType, WriteOptions, Writer};
use elunar_raster::source::Source;
use std::path::PathBuf;

/// Options of `hillshade`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The result is that of `gdaldem hillshade` (Horn): bytes, 0 where there is no value, else 1 to 255. The azimuth is counted \
clockwise from north. Rasters in degrees are shaded with metres on their sphere.

Example:
  elunar hillshade dtm.tif -o shade.tif --sun-azimuth 300 --sun-elevation 20")]
pub struct Args {
    /// DTM, heights in metres.
    #[arg(value_name = "INPUT")]
    pub input: PathBuf,
    /// Hillshade to write: a GeoTIFF with the DTM's georeference, or a PNG picture.
    #[arg(short, long, value_name = "OUT.tif|OUT.png")]
    pub output: PathBuf,
    /// Azimuth of the light, degrees clockwise from north, -360 to 360.
    #[arg(
        long,
        visible_alias = "sun-azimuth",
        value_name = "DEG",
        default_value_t = 315.0,
        allow_negative_numbers = true
    )]
    pub azimuth: f64,
    /// Elevation of the light above the horizon, degrees, 0 to 90.
    #[arg(
        long,
        visible_alias = "sun-elevation",
        value_name = "DEG",
        default_value_t = 45.0,
        allow_negative_numbers = true
    )]
    pub altitude: f64,
    /// Factor on the heights.
    #[arg(long, value_name = "Z", default_value_t = 1.0)]
    pub z_factor: f64,
    /// Shade also the outermost pixels and those beside gaps.
    #[arg(long)]
    pub compute_edges: bool,
}

/// Number of rows shaded at a time.
const BAND_ROWS: usize = 512;

/// Runs the command.
///
/// # Errors
/// If an option is out of range, the DTM cannot be read, or the result cannot be written. Then no output file exists.
pub fn run(args: Args) -> Result<()> {
    println!("{}", write(&args, &Held::default())?);
    Ok(())
}

/// An opened DTM, and how it is shaded.
pub struct ShadedDtm {
    source: Box<dyn Source>,
    name: String,
    pixel: PixelSize,
    shading: HillshadeOptions,
}

impl ShadedDtm {
    /// Opens the DTM.
    ///
    /// # Errors
    /// If an option is out of range, or the DTM cannot be read or has no pixel size.
    pub fn open(args: &Args, held: &Held) -> Result<Self> {
        let (shading, name) = (args.shading()?, args.input.display().to_string());
        let source = held.heights(&args.input)?;
        let pixel = pixel_of(source.as_ref(), &name)?;
        Ok(Self { source, name, pixel, shading })
    }

    /// Returns rows and columns.
    #[must_use]
    pub fn shape(&self) -> (usize, usize) {
        (self.source.info().rows, self.source.info().cols)
    }

    /// Shades the DTM, and passes whole rows to `take`, from top to bottom: 0 where there is no value, else 1 to 255. Returns how many have one.
    ///
    /// # Errors
    /// If the DTM cannot be read, or nothing can be shaded. Errors of `take` are passed on.
    pub fn make(&self, take: &mut dyn FnMut(Vec<u8>) -> Result<()>) -> Result<usize> {
        let (rows, _) = self.shape();
        let (bar, mut valid) = (progress::bar("", rows as u64, "rows"), 0);
        for first in (0..rows).step_by(BAND_ROWS) {
            interrupt::check("hillshade")?;
            let band = first..(first + BAND_ROWS).min(rows);
            bar.inc(band.len() as u64);
            let shade = shade_rows(self.source.as_ref(), band, self.pixel, &self.shading)?;
            valid += shade.iter().filter(|&&b| b > 0).count();
            take(shade)?;
        }
        bar.finish_and_clear();
        match valid {
            0 => Err(Error::usage(format!("{}: 3 x 3 valid heights expected, none found", self.name))),
            _ => Ok(valid),
        }
    }
}

/// Shades a DTM and writes the hillshade. Returns a line about it.
///
/// # Errors
/// As [`run`].
pub fn write(args: &Args, held: &Held) -> Result<String> {
    let kind = output::extension(&args.output, &["tif", "tiff", "png"])?;
    let _owner = output::take(&args.output, &held.files([args.input.as_path()]))?;
    let shade = ShadedDtm::open(args, held)?;
    let (rows, cols) = shade.shape();
    let mut target = match kind {
        "png" => Target::Picture(Vec::with_capacity(rows * cols)),
        _ => {
            let Sun { azimuth_deg, elevation_deg, exaggeration } = shade.shading.sun;
            let about = format!(
                "hillshade, light from {azimuth_deg} deg, {elevation_deg} deg high, heights times {exaggeration}"
            );
            let options = WriteOptions::image(SampleType::U8, about);
            let georef = shade.source.info().georef.as_ref();
            Target::Raster(Box::new(Writer::create(&args.output, rows, cols, georef, &options)?))
        }
    };
    let valid = shade.make(&mut |shade| match &mut target {
        Target::Picture(bytes) => {
            bytes.extend(shade);
            Ok(())
        }
        Target::Raster(writer) => {
            let samples = shade.into_iter().map(|b| if b == 0 { f32::NAN } else { f32::from(b) });
            writer.write_rows(&samples.collect::<Vec<f32>>())
        }
    })?;
    match target {
        Target::Picture(bytes) => elunar_picture::write_png(&args.output, elunar_picture::grey(bytes, rows, cols)?)?,
        Target::Raster(writer) => writer.finish()?,
    }
    Ok(format!("{}: {rows} x {cols} pixels, {valid} of them shaded", args.output.display()))
}

/// Destination of the bytes.
enum Target {
    Picture(Vec<u8>),
    Raster(Box<Writer>),
}

impl Args {
    fn shading(&self) -> Result<HillshadeOptions> {
        if !(0.0..=90.0).contains(&self.altitude) {
            return Err(Error::usage(format!("--altitude: 0 to 90 degrees expected, {} found", self.altitude)));
        }
        check_azimuth("--azimuth", self.azimuth)?;
        if !(self.z_factor.is_finite() && self.z_factor > 0.0) {
            return Err(Error::usage(format!("a finite --z-factor above 0 expected, {} found", self.z_factor)));
        }
        let sun = Sun { azimuth_deg: self.azimuth, elevation_deg: self.altitude, exaggeration: self.z_factor };
        Ok(HillshadeOptions { sun, compute_edges: self.compute_edges })
    }
}
