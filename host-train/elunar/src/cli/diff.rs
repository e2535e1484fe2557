//! `elunar diff`: one DTM minus another.

use crate::held::Held;
use crate::outputs as output;
use elunar_base::{Error, Result};
use elunar_evaluate::diff::{Statistics, difference};
use elunar_picture::{ErrorLimits, error_map, write_png};
use elunar_raster::Raster;
use elunar_raster::align::Named;
use elunar_raster::geotiff::{self, WriteOptions};
use std::path::PathBuf;

/// Options of `diff`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Takes the first minus the second on the grid of the first. The second is interpolated bilinearly, as the Ames Stereo Pipeline's \
geodiff does. Statistics go to stdout.

Example:
  elunar diff dtm.tif stereo.tif -o diff.tif --picture error.png")]
pub struct Args {
    /// DTM that gives the grid, heights in metres.
    #[arg(value_name = "DEM1")]
    pub first: PathBuf,
    /// DTM to subtract.
    #[arg(value_name = "DEM2")]
    pub second: PathBuf,
    /// Take the absolute difference.
    #[arg(long)]
    pub absolute: bool,
    /// Write the difference.
    #[arg(short, long, value_name = "DIFF.tif")]
    pub output: Option<PathBuf>,
    /// Draw the difference, coloured by the paper's limits of 2, 4 and 10 m.
    #[arg(long, value_name = "ERROR.png")]
    pub picture: Option<PathBuf>,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// If a DTM cannot be read, the DTMs do not fit each other, or a file cannot be written. Then no output file exists.
pub fn run(args: Args) -> Result<()> {
    let MadeDifference { statistics, what, .. } = make(&args, &Held::default())?;
    if args.json {
        println!("{:#}", json(&statistics, &what));
    } else {
        print!("{what}\n{}", statistics.table());
    }
    Ok(())
}

/// A difference, on the grid of the first DTM.
#[derive(Debug, Clone)]
pub struct MadeDifference {
    /// The difference, metres; NaN where either DTM is void.
    pub difference: Raster,
    /// Its statistics.
    pub statistics: Statistics,
    /// What was taken from what.
    pub what: String,
}

/// Returns statistics as one object.
#[must_use]
pub fn json(statistics: &Statistics, what: &str) -> serde_json::Value {
    let mut object = statistics.json();
    object["difference"] = what.into();
    object
}

/// Subtracts, and writes the files that are asked for.
///
/// # Errors
/// As [`run`].
pub fn make(args: &Args, held: &Held) -> Result<MadeDifference> {
    let inputs = held.files([args.first.as_path(), &args.second]);
    let _owners = output::take_all(args.output.iter().chain(&args.picture), &inputs)?;
    let (first, second) = (held.read_heights(&args.first)?, held.read_heights(&args.second)?);
    let (first_name, second_name) = (args.first.display().to_string(), args.second.display().to_string());
    let made = difference(Named::new(&first_name, &first), Named::new(&second_name, &second), args.absolute)?;
    let statistics = Statistics::of(&made.samples).ok_or_else(|| Error::usage("diff: no difference found"))?;
    let what = format!("{first_name} - {second_name}");
    let what = if args.absolute { format!("|{what}|") } else { what };
    if let Some(path) = &args.picture {
        let map = error_map(&made.samples, made.rows, made.cols, ErrorLimits::PAPER)?;
        write_png(path, map)?;
    }
    if let Some(path) = &args.output {
        let undo = |_: &Error| args.picture.iter().for_each(|picture| drop(std::fs::remove_file(picture)));
        geotiff::write(path, &made, &WriteOptions::heights(format!("difference of heights: {what}")))
            .inspect_err(undo)?;
    }
    Ok(MadeDifference { difference: made, statistics, what })
}
