//! `elunar evaluate`: compares a DTM with a truth. The coarse DTM is the baseline.

use crate::held::Held;
use crate::outputs as output;
use elunar_base::Result;
use elunar_evaluate::{
    Details, EvaluatedMaps, ExpectedErrorMaps, NamedSource, ReportSummary, calibration, json, octaves_picture,
    short_names, table,
};
use elunar_raster::align::Interpolation;
use std::path::{Path, PathBuf};

/// Options of `evaluate`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Compares all DTMs on the truth's grid, on the pixels that are valid in all of them. A DTM on another grid is interpolated \
bilinearly, a coarse DTM bicubically, as the network gets it. Errors are DTM minus truth.

Example:
  elunar evaluate --dtm dtm.tif --truth scene_0000_truth.tif --coarse scene_0000_coarse.tif --error-map error.png")]
pub struct Args {
    /// DTM to compare with the truth, heights in metres.
    #[arg(long, value_name = "D.tif")]
    pub dtm: PathBuf,
    /// True DTM.
    #[arg(long, value_name = "T.tif")]
    pub truth: PathBuf,
    /// Coarse DTM that the prediction started from. It is compared with the truth, too.
    #[arg(long, value_name = "C.tif")]
    pub coarse: Option<PathBuf>,
    /// Wavelength that the truth resolves, metres: also compare all DTMs after waves of this length are halved in them [default: as they are
    /// alone].
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub truth_resolution_m: Option<f64>,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    /// Also draw the DTM's errors, coloured by the limits of 2, 4 and 10 m.
    #[arg(long, value_name = "MAP.png")]
    pub error_map: Option<PathBuf>,
    /// Expected errors of the DTM, as `predict --uncertainty` writes them: report how many errors lie within one and 1.96 standard deviations.
    #[arg(long, value_name = "ERR.tif")]
    pub uncertainty: Option<PathBuf>,
    /// Also draw how often errors lie within limits that a Gaussian of the expected size keeps with a given probability.
    #[arg(long, value_name = "CHART.png", requires = "uncertainty")]
    pub reliability: Option<PathBuf>,
    /// Also draw correlation, gain and amplitude of the waves over their wavelength.
    #[arg(long, value_name = "CHART.png")]
    pub spectra: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// If a raster cannot be read, the rasters do not fit each other, or the map cannot be written.
pub fn run(args: Args) -> Result<()> {
    let (summary, details) = compare(&args, &Held::default())?;
    if args.json {
        println!("{}", json(summary, &details));
    } else {
        print!("{}", table(summary, &details));
    }
    Ok(())
}

/// Compares a DTM with a truth, and draws what is asked for. Expected errors are read from a file.
///
/// # Errors
/// As [`run`].
pub fn compare(args: &Args, held: &Held) -> Result<(ReportSummary, Details)> {
    let mut inputs: Vec<&Path> = vec![&args.dtm, &args.truth];
    inputs.extend([&args.coarse, &args.uncertainty].into_iter().flatten().map(PathBuf::as_path));
    let pictures = [&args.error_map, &args.reliability, &args.spectra];
    let _owners = output::take_all(pictures.into_iter().flatten(), &held.files(inputs))?;
    let open = |path: &Path| -> Result<NamedSource> { Ok((path.display().to_string(), held.heights(path)?.into())) };
    let (truth, dtm) = (open(&args.truth)?, open(&args.dtm)?);
    let expected =
        args.uncertainty.as_deref().map(|path| ExpectedErrorMaps::open(path, (&dtm.0, dtm.1.info()))).transpose()?;
    let mut candidates = vec![(dtm, Interpolation::Bilinear)];
    if let Some(coarse) = &args.coarse {
        candidates.push((open(coarse)?, Interpolation::Bicubic));
    }
    let maps = EvaluatedMaps::new(truth, candidates, args.truth_resolution_m)?;
    let summary = ReportSummary::of(&maps)?;
    let view = maps.at_resolution()?;
    let calibration = expected.as_ref().map(|expected| calibration(&view, expected)).transpose()?;
    if let Some(path) = &args.error_map {
        elunar_picture::write_png(path, view.error_map()?)?;
    }
    let details = Details { calibration, spectra: view.spectra()? };
    if let (Some(path), Some(found)) = (&args.reliability, &details.calibration) {
        elunar_picture::write_png(path, found.picture()?)?;
    }
    if let Some(path) = &args.spectra {
        elunar_picture::write_png(path, octaves_picture(&short_names(&summary), &details.spectra)?)?;
    }
    Ok((summary, details))
}
