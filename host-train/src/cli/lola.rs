//! `host-train lola`: laser altimeter tracks over a DTM.

use crate::lola::csv::{self, CsvFormat};
use crate::lola::report::{Judged, Report, json, table};
use crate::lola::shift::Ground;
use crate::lola::track::{TRACK_GAP_S, split};
use crate::raster::source;
use crate::{Error, Result};
use indicatif::{ProgressBar, ProgressStyle};
use std::path::PathBuf;

/// Options of `lola`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:
  host-train lola --dtm dtm.tif --tracks RDR_30E31E_20N21NPointPerRow_csv_table.csv

Each track is shifted over the DTM in steps of half a pixel; reported are the shift x, y of the track along the map's axes with the smallest
standard deviation of DTM minus track (no mean removed, divided by points - 1), that deviation, and what is left of it without the median.
A table is cut into tracks where its times pause. Rows with a flag other than 0 are left out. The columns are found by the
heading (LOLA RDR PointPerRow; or lon,lat,radius_km; or lon,lat,height_m), or named as for the Ames Stereo Pipeline.")]
pub struct Args {
    /// DTM, heights in metres above the sphere.
    #[arg(long, value_name = "D.tif")]
    pub dtm: PathBuf,
    /// Tables of points, one or several.
    #[arg(long, value_name = "F.csv", required = true, num_args = 1..)]
    pub tracks: Vec<PathBuf>,
    /// How far to shift along either axis, metres.
    #[arg(long, value_name = "M", default_value_t = 20.0)]
    pub search_m: f64,
    /// Columns, such as '2:lon 3:lat 4:radius_km'; also radius_m, height_above_datum, time and flag.
    #[arg(long, value_name = "COLUMNS")]
    pub csv_format: Option<CsvFormat>,
    /// Pauses longer than this, in seconds, begin a new track.
    #[arg(long, value_name = "S", default_value_t = TRACK_GAP_S)]
    pub track_gap_s: f64,
    /// Tracks with fewer comparable points are not judged.
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub min_points: usize,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// From reading the files, from a DTM without a known place, and if no track can be judged.
pub fn run(args: Args) -> Result<()> {
    let report = judge(&args)?;
    if args.json {
        println!("{:#}", json(&report));
    } else {
        print!("{}", table(&report));
    }
    Ok(())
}

fn judge(args: &Args) -> Result<Report> {
    let dtm = source::open(&args.dtm)?;
    let name = args.dtm.display().to_string();
    let ground = Ground::new(&*dtm, &name, args.search_m)?;
    let mut report = Report { dtm: name, tracks: Vec::new(), flagged: 0 };
    for path in &args.tracks {
        let table = csv::read(path, args.csv_format.as_ref(), ground.sphere_m())?;
        report.flagged += table.flagged;
        let tracks = split(&table.points, args.track_gap_s);
        let style = ProgressStyle::with_template("{msg} {bar:30} {pos}/{len} tracks, {per_sec}, {eta} left");
        let bar = ProgressBar::new(tracks.len() as u64).with_style(style.expect("a valid template"));
        bar.set_message(path.display().to_string());
        let file =
            path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned());
        for (index, track) in tracks.iter().enumerate() {
            let name = if tracks.len() == 1 { file.clone() } else { format!("{file}#{}", index + 1) };
            report.tracks.push(Judged { name, points: track.len(), fit: ground.fit(track, args.min_points)? });
            bar.inc(1);
        }
        bar.finish_and_clear();
    }
    if report.tracks.iter().all(|track| track.fit.is_none()) {
        let points: usize = report.tracks.iter().map(|track| track.points).sum();
        return Err(Error::usage(format!(
            "{}: at least {} points of a track on valid heights, {} m from the edge, expected, found none such among {points} points of {} tracks",
            report.dtm,
            args.min_points.max(2),
            args.search_m,
            report.tracks.len()
        )));
    }
    Ok(report)
}
