//! `elunar lola`: compares a DTM with laser altimeter tracks.

use crate::held::Held;
use elunar_base::{Error, Result, interrupt, progress};
use elunar_evaluate::lola::csv;
use elunar_evaluate::lola::csv::CsvFormat;
use elunar_evaluate::lola::report::{ComparedTrack, Report, json, table};
use elunar_evaluate::lola::shift::TrackDtm;
use elunar_evaluate::lola::track::{TRACK_GAP_S, split};
use std::path::PathBuf;

/// Options of `lola`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Shifts each track over the DTM in steps of half a pixel. Reports the shift x, y of the track along the map's axes that has the \
smallest standard deviation of DTM minus track about its median, and the median: a constant offset does not move it. Beside it \
the shift with the smallest deviation of the paper's Eq. 18 (nothing removed, divided by points - 1). Cuts a table into tracks where its times pause. Leaves out rows with a flag other than 0. Finds the columns \
by the heading (LOLA RDR PointPerRow; or lon,lat,radius_km; or lon,lat,height_m), or by names as for the Ames Stereo Pipeline.

Example:
  elunar lola --dtm dtm.tif --tracks RDR_30E31E_20N21NPointPerRow_csv_table.csv")]
pub struct Args {
    /// DTM, heights in metres above the sphere.
    #[arg(long, value_name = "D.tif")]
    pub dtm: PathBuf,
    /// Tables of points, one or several.
    #[arg(long, value_name = "F.csv", required = true, num_args = 1..)]
    pub tracks: Vec<PathBuf>,
    /// Greatest shift along either axis, metres.
    #[arg(long, value_name = "M", default_value_t = 20.0)]
    pub search_m: f64,
    /// Columns, such as '2:lon 3:lat 4:radius_km'. Further names are radius_m, height_above_datum, time and flag.
    #[arg(long, value_name = "COLUMNS")]
    pub csv_format: Option<CsvFormat>,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Least number of points of a track on valid heights. Tracks with fewer are left out.
const MIN_POINTS: usize = 10;

/// Runs the command.
///
/// # Errors
/// If a file cannot be read, the DTM has no georeference, or no track can be compared.
pub fn run(args: Args) -> Result<()> {
    let report = compare(&args, &Held::default())?;
    if args.json {
        println!("{:#}", json(&report));
    } else {
        print!("{}", table(&report));
    }
    Ok(())
}

/// Compares a DTM with tracks.
///
/// # Errors
/// As [`run`].
pub fn compare(args: &Args, held: &Held) -> Result<Report> {
    let dtm = held.heights(&args.dtm)?;
    let name = args.dtm.display().to_string();
    let ground = TrackDtm::new(&*dtm, &name, args.search_m)?;
    let mut report = Report { dtm: name, tracks: Vec::new(), flagged: 0 };
    for path in &args.tracks {
        let table = csv::read(path, args.csv_format.as_ref(), ground.sphere_m())?;
        report.flagged += table.flagged;
        let tracks = split(&table.points, TRACK_GAP_S);
        let bar = progress::bar("", tracks.len() as u64, "tracks");
        bar.set_message(path.display().to_string());
        let file =
            path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned());
        for (index, track) in tracks.iter().enumerate() {
            interrupt::check("lola")?;
            let name = if tracks.len() == 1 { file.clone() } else { format!("{file}#{}", index + 1) };
            report.tracks.push(ComparedTrack { name, points: track.len(), fit: ground.fit(track, MIN_POINTS)? });
            bar.inc(1);
        }
        bar.finish_and_clear();
    }
    if report.tracks.iter().all(|track| track.fit.is_none()) {
        let points: usize = report.tracks.iter().map(|track| track.points).sum();
        return Err(Error::usage(format!(
            "{}: at least {MIN_POINTS} points of a track on valid heights, {} m from the edge, expected, found none such among {points} points of {} tracks",
            report.dtm,
            args.search_m,
            report.tracks.len()
        )));
    }
    Ok(report)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::{Cli, Command, Shared};
    use clap::Parser;
    use elunar_core::sun::Body;
    use elunar_raster::{Crs, GeoRef, Raster, geotiff};
    use std::path::Path;

    fn args(words: &[&str]) -> Args {
        match Cli::try_parse_from([&["elunar", "lola"], words].concat()).unwrap().command {
            Command::Shared(Shared::Lola(args)) => args,
            other => panic!("{other:?}"),
        }
    }

    /// Writes a ridged DTM of 80 x 60 pixels of 2 m around longitude 0, latitude 0.
    fn write_dtm(path: &Path) {
        let georef = GeoRef {
            transform: [-60.0, 2.0, 0.0, 80.0, 0.0, -2.0],
            crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0),
        };
        let height = |i: usize| ((i / 60) as f32 * 0.31).sin() * 20.0 + ((i % 60) as f32 * 0.17).cos() * 15.0;
        let raster = Raster { rows: 80, cols: 60, samples: (0..4800).map(height).collect(), georef: Some(georef) };
        geotiff::write(path, &raster, &geotiff::WriteOptions::heights("heights")).unwrap();
    }

    /// Returns points on every third pixel centre of a diagonal, from `start_s` seconds after midnight, shifted west by two pixels.
    fn rows(start_s: f64) -> String {
        let degrees = |metres: f64| (metres / 1_737_400.0).to_degrees();
        let row = |i: usize| {
            let (row, col) = (12 + i, 15 + i / 2);
            let height = ((row as f32 * 0.31).sin() * 20.0 + (col as f32 * 0.17).cos() * 15.0) as f64;
            let (x, y) = (-59.0 + 2.0 * col as f64 - 4.0, 79.0 - 2.0 * row as f64);
            let (minute, second) = ((start_s / 60.0) as usize % 60, start_s % 60.0 + i as f64 * 0.05);
            let hour = (start_s / 3600.0) as usize;
            let radius_km = 1737.4 + height / 1000.0;
            format!(
                "2010-07-17T{hour:02}:{minute:02}:{second:06.3},{:.9},{:.9},{radius_km:.6},0\n",
                degrees(x),
                degrees(y)
            )
        };
        (0..50).map(row).collect()
    }

    #[test]
    fn tracks_of_a_table_are_compared_one_by_one() {
        let folder = tempfile::tempdir().unwrap();
        let (dtm, csv) = (folder.path().join("d.tif"), folder.path().join("t.csv"));
        write_dtm(&dtm);
        let heading = "Coordinated_Universal_Time,Pt_Longitude,Pt_Latitude,Pt_Radius,Pt_Flg\n";
        let few: String = rows(20_000.0).lines().take(3).map(|line| format!("{line}\n")).collect();
        std::fs::write(&csv, heading.to_owned() + &rows(3600.0) + &rows(10_830.0) + &few).unwrap();
        let (dtm, csv) = (dtm.to_str().unwrap(), csv.to_str().unwrap());
        let report = compare(&args(&["--dtm", dtm, "--tracks", csv, "--search-m", "8"]), &Held::default()).unwrap();
        let names: Vec<&str> = report.tracks.iter().map(|track| track.name.as_str()).collect();
        assert_eq!(names, ["t.csv#1", "t.csv#2", "t.csv#3"]);
        for track in &report.tracks[..2] {
            let fit = track.fit.unwrap().median_removed;
            assert!((fit.x_m - 4.0).abs() < 1e-3 && fit.y_m.abs() < 1e-3 && fit.std_m < 0.01, "{fit:?}");
        }
        assert_eq!(report.tracks[2].fit, None);
        std::fs::write(csv, heading.to_owned() + &few).unwrap();
        let named = args(&["--dtm", dtm, "--tracks", csv, csv, "--csv-format", "2:lon 3:lat 4:radius_km"]);
        let text = compare(&named, &Held::default()).unwrap_err().to_string();
        assert!(text.contains("at least 10 points") && text.contains("6 points of 2 tracks"), "{text}");
    }
}
