//! `elunar sfs`: shape from shading, without a network, for comparison.

use crate::held::Held;
use crate::job::{Inputs, Opened, warn};
use crate::outputs::{self as output, OutputTarget};
use elunar_base::{Error, Result, interrupt};
use elunar_core::nn::Illumination;
use elunar_net::illumination::{KnownSun, LightSource, Lighting};
use elunar_net::sun::check_sun;
use elunar_raster::stated::Statements;
use elunar_scene::mosaic::BLEND;
use elunar_scene::predict::identity::{self, Identity};
use elunar_scene::predict::job::{Files, Outputs, fill_files, summary, survey, tiles};
use elunar_scene::predict::notices::{notice_of_heights, notices};
use elunar_scene::predict::{NamedRaster, PartFile, Scene, part_path};
use elunar_scene::sfs::{SfsJournal, SfsSettings, TileLog, curve, json, seconds_per_tile, solve_rows, write_curve};
use std::path::PathBuf;

/// Options of `sfs`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Takes and makes the same files as `predict`, from the Sun's direction instead of a model. With --truth the curve also has errors \
by step.

Finished rows wait in sfs.tif.part until all are done: after Ctrl-C or a kill the same command goes on from there. The curve is \
then that of the tiles made since.

Example:
  elunar sfs --image scene_0000_image.tif --coarse scene_0000_coarse.tif --sun-azimuth 312.5 --sun-elevation 31 -o sfs.tif")]
pub struct Args {
    /// Image and coarse DTM.
    #[command(flatten)]
    pub inputs: Inputs,
    /// DTM to write.
    #[arg(short, long, value_name = "DTM.tif")]
    pub output: PathBuf,
    /// Weight of second derivatives against relative brightness, metres [default: a quarter of a pixel].
    #[arg(long, value_name = "M")]
    pub smoothness_weight: Option<f64>,
    /// Weight of the departure from the coarse DTM against relative brightness, per metre [default: 0.06 per pixel].
    #[arg(long, value_name = "PER_M")]
    pub dem_constraint_weight: Option<f64>,
    /// Pixels at or below this share of the tile's mean brightness are shadow; their brightness has no weight [default: 0].
    #[arg(long, value_name = "SHARE")]
    pub shadow_threshold: Option<f64>,
    /// Number of threads, each with its own tiles; 0 takes as many as the machine offers.
    #[arg(long, default_value_t = 0, value_parser = crate::threads::number)]
    pub threads: usize,
    /// Write cost (and errors) by step, as a table or a picture.
    #[arg(long, value_name = "CURVE.csv|CURVE.png")]
    pub curve: Vec<PathBuf>,
    /// True DTM, only for the curve.
    #[arg(long, value_name = "T.tif")]
    pub truth: Option<PathBuf>,
    /// Print settings, tiles, times and the curve as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// If an option is out of range, an input cannot be read, or writing fails. Then no DTM exists.
pub fn run(args: Args) -> Result<()> {
    let (text, json) = write(&args)?;
    println!("{}", if args.json { json } else { text });
    Ok(())
}

/// Opened inputs, and how they are solved.
pub struct Solving {
    /// Image and coarse DTM.
    pub scene: Scene,
    settings: SfsSettings,
    journal: SfsJournal,
    light: String,
}

impl Solving {
    /// Opens the inputs, surveys them and warns.
    ///
    /// # Errors
    /// If an option is out of range, an input cannot be read, or the Sun is neither known nor to be fitted.
    pub fn open(args: &Args, held: &Held) -> Result<Self> {
        check_sun(args.inputs.known_sun())?;
        let Opened { image, scene, sun } = args.inputs.open(held)?;
        if !args.inputs.fit_sun {
            both_angles(sun.sun, &image.name)?;
        }
        let truth =
            args.truth.as_deref().map(|path| NamedRaster::heights(path, Statements::default(), None)).transpose()?;
        let side_m = image.source.info().side_m(&image.name)?;
        let survey = survey(&scene)?;
        let lighting = survey.lighting(Illumination::Given, sun.sun);
        let angles = if args.inputs.fit_sun { fitted(sun.sun, &lighting, &image.name)? } else { sun.sun };
        let settings = args.settings(both_angles(angles, &image.name)?, side_m);
        settings.light()?;
        warn(&notices(&scene, &survey, &sun, &lighting, args.inputs.coarse_unit.is_some())?);
        let journal = SfsJournal::new(&scene, &image, truth)?;
        let source = if angles == sun.sun { "given" } else { "fitted" };
        let (azimuth_deg, elevation_deg) = (settings.sun_azimuth_deg, settings.sun_elevation_deg);
        let light = format!("azimuth {azimuth_deg} deg, elevation {elevation_deg} deg; {source}");
        Ok(Self { light: light + &sun.origin_of(&lighting), scene, settings, journal })
    }

    /// Solves the scene in memory. Returns the heights, metres, row-major, NaN where an input is void.
    ///
    /// # Errors
    /// As [`solve_rows`].
    pub fn make(&self) -> Result<Vec<f32>> {
        let mut heights_m = vec![];
        let mut keep = |rows: &[f32]| {
            heights_m.extend_from_slice(rows);
            Ok(())
        };
        tiles(|progress| solve_rows(&self.scene, &self.settings, &self.journal, 0, &mut keep, progress))?;
        Ok(heights_m)
    }

    /// Returns settings, tiles, times and the curve as JSON.
    #[must_use]
    pub fn json(&self) -> String {
        json(&self.settings, &self.journal.tiles())
    }
}

/// Makes a DTM and writes it. Returns lines about it, and settings, tiles, times and the curve as JSON.
///
/// # Errors
/// As [`run`].
pub fn write(args: &Args) -> Result<(String, String)> {
    check_sun(args.inputs.known_sun())?;
    let mut inputs = vec![args.inputs.image.as_path(), &args.inputs.coarse];
    inputs.extend(args.truth.as_deref());
    for path in &args.curve {
        output::extension(path, &["csv", "png"])?;
    }
    let further: Vec<OutputTarget> = args.curve.iter().map(|path| OutputTarget::File(path)).collect();
    // A signal must not leave the lock.
    interrupt::listen();
    let (owner, _owners) = output::take_dtm(&args.output, &further, &inputs)?;
    let solving = Solving::open(args, &Held::default())?;
    let Solving { scene, settings, journal, light } = &solving;
    let identity = args.identity(settings)?;
    let part = PartFile::open_at(part_path(&args.output, None)?, &identity.job, scene.cols, owner.is_successor())?;
    let files = Files { output: &args.output, image: &args.inputs.image, coarse: &args.inputs.coarse, errors: None };
    let mut files = Outputs::create(scene, (&settings.description(), light, &identity), files)?;
    let (part, tally) = fill_files(part, scene.rows, (&mut files, &owner), |from, keep, progress| {
        solve_rows(scene, settings, journal, from, keep, progress)
    })?;
    let finished = files.finish(&owner)?;
    part.remove()?;
    warn(&notice_of_heights(&args.output.display().to_string(), scene, &finished));
    let tiles = journal.tiles();
    let points = curve(&tiles);
    for path in &args.curve {
        write_curve(path, &points)?;
    }
    let mut text = summary(&args.output, scene, &finished, &tally) + "\nlight: " + light;
    text.extend(times(&tiles));
    Ok((text, solving.json()))
}

/// Returns a line, after the others, about how long tiles took.
fn times(tiles: &[TileLog]) -> Option<String> {
    let (median, mean, largest) = seconds_per_tile(tiles)?;
    let done = tiles.iter().filter(|tile| tile.converged()).count();
    Some(format!(
        "\nseconds per tile, one thread: median {median:.2}, mean {mean:.2}, largest {largest:.2}; {done} of {} converged",
        tiles.len()
    ))
}

/// Returns azimuth and elevation of the Sun, degrees, which must both be known.
fn both_angles(sun: KnownSun, image: &str) -> Result<(f64, f64)> {
    let missing = |option: &str| Error::usage(format!("{option} expected, and {image} states none; --fit-sun fits it"));
    let azimuth_deg = sun.azimuth_deg.ok_or_else(|| missing("--sun-azimuth"))?;
    Ok((azimuth_deg, sun.elevation_deg.ok_or_else(|| missing("--sun-elevation"))?))
}

/// Returns the known angles of the Sun and, for the others, those of the fit, in whole tenths of a degree. The elevation is that of a Sun of
/// the fitted strength, which also covers offsets and nonlinear values of the image.
fn fitted(known: KnownSun, lighting: &Lighting, image: &str) -> Result<KnownSun> {
    let tenths = |deg: f64| (deg * 10.0).round() / 10.0;
    let both = known.azimuth_deg.is_some() && known.elevation_deg.is_some();
    if lighting.source == LightSource::Assumed && !both {
        let what = "--fit-sun: a light that the coarse DTM shows expected, and none could be fitted to";
        return Err(Error::input(format!("{what} {image}: give --sun-azimuth and --sun-elevation")));
    }
    let light = lighting.light;
    Ok(KnownSun {
        azimuth_deg: known.azimuth_deg.or(Some(tenths(light.azimuth_deg()))),
        elevation_deg: known.elevation_deg.or(Some(tenths(light.elevation_deg()).clamp(0.1, 89.9))),
    })
}

impl Args {
    fn settings(&self, (azimuth_deg, elevation_deg): (f64, f64), pixel_m: f64) -> SfsSettings {
        let default = SfsSettings::new(azimuth_deg, elevation_deg, pixel_m);
        SfsSettings {
            smoothness_weight_m: self.smoothness_weight.unwrap_or(default.smoothness_weight_m),
            dem_constraint_weight_per_m: self.dem_constraint_weight.unwrap_or(default.dem_constraint_weight_per_m),
            shadow_threshold: self.shadow_threshold.unwrap_or(default.shadow_threshold),
            threads: self.threads,
            ..default
        }
    }

    /// Returns what identifies this job.
    fn identity(&self, settings: &SfsSettings) -> Result<Identity> {
        let number = |value: Option<f64>| value.map(|value| value.to_string());
        let of_run = [
            ("sun_azimuth_deg", number(Some(settings.sun_azimuth_deg))),
            ("sun_elevation_deg", number(Some(settings.sun_elevation_deg))),
            ("smoothness_weight_m", number(Some(settings.smoothness_weight_m))),
            ("dem_constraint_weight_per_m", number(Some(settings.dem_constraint_weight_per_m))),
            ("shadow_threshold", number(Some(settings.shadow_threshold))),
            ("levels", Some(settings.levels.to_string())),
            ("iterations", Some(settings.iterations.to_string())),
            ("tolerance", number(Some(settings.tolerance))),
            ("tile_px", Some(format!("{}x{}", settings.tile.0, settings.tile.1))),
            ("overlap_px", Some(settings.overlap_px.to_string())),
            ("blend", Some(BLEND.into())),
        ];
        let options = identity::words(of_run.into_iter().chain(self.inputs.words()));
        Identity::of(&self.inputs.image, &self.inputs.coarse, "shape from shading", options)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Cli;
    use clap::Parser;
    use elunar_raster::geotiff;
    use elunar_synth::{Moon, SynthOptions};
    use std::path::Path;

    fn scene(folder: &Path) -> (f64, f64) {
        let scene = Moon::new(3, SynthOptions::default()).unwrap().scene(0, 60, 70).unwrap();
        scene.write(folder).unwrap();
        (scene.sun_azimuth_deg, scene.sun_elevation_deg)
    }

    fn run_with(folder: &Path, more: &[(&str, &str)]) -> Result<()> {
        run_without(folder, &[], more, &[])
    }

    /// Runs without the options `less`, with other values of `more`, and with the switches `on`.
    fn run_without(folder: &Path, less: &[&str], more: &[(&str, &str)], on: &[&str]) -> Result<()> {
        let file = |name: &str| folder.join(name).display().to_string();
        let mut options = vec![
            ("--image", file("scene_0000_image.tif")),
            ("--coarse", file("scene_0000_coarse.tif")),
            ("--sun-azimuth", "100".into()),
            ("--sun-elevation", "30".into()),
            ("--output", file("dtm.tif")),
        ];
        for &(name, value) in more {
            options.retain(|(known, _)| *known != name);
            options.push((name, value.into()));
        }
        options.retain(|(name, _)| !less.contains(name));
        let words = options.into_iter().flat_map(|(name, value)| [name.to_string(), value]);
        let words =
            ["elunar".to_string(), "sfs".into()].into_iter().chain(words).chain(on.iter().map(ToString::to_string));
        crate::cli::run(Cli::try_parse_from(words).unwrap().command)
    }

    #[test]
    fn files_go_in_and_a_dtm_with_its_provenance_comes_out() {
        let folder = tempfile::tempdir().unwrap();
        let (azimuth, elevation) = scene(folder.path());
        let curve = folder.path().join("curve.csv").display().to_string();
        let truth = folder.path().join("scene_0000_truth.tif").display().to_string();
        let (azimuth, elevation) = (azimuth.to_string(), elevation.to_string());
        let sun = [("--sun-azimuth", azimuth.as_str()), ("--sun-elevation", &elevation)];
        run_with(folder.path(), &[&sun[..], &[("--curve", &curve), ("--truth", &truth)]].concat()).unwrap();
        let dtm = geotiff::read(folder.path().join("dtm.tif")).unwrap();
        assert_eq!((dtm.rows, dtm.cols, dtm.valid_count()), (60, 70, 60 * 70));
        let text = std::fs::read(folder.path().join("dtm.tif")).unwrap();
        let said = |what: &str| text.windows(what.len()).any(|bytes| bytes == what.as_bytes());
        assert!(said("shape from shading") && said("smoothness weight 0.5 m") && said("0.03 /m"));
        assert!(said(&format!("azimuth {azimuth} deg, elevation {elevation} deg; given")));
        assert!(folder.path().join("dtm_hillshade.png").exists() && !folder.path().join("dtm.tif.part").exists());
        let curve = std::fs::read_to_string(curve).unwrap();
        assert!(curve.lines().count() > 5 && !curve.lines().last().unwrap().ends_with(','), "{curve}");
    }

    #[test]
    fn a_sun_that_is_not_known_is_fitted_where_the_user_wants_it() {
        let folder = tempfile::tempdir().unwrap();
        let options =
            SynthOptions { sun_elevation_deg: (30.0, 30.0), sun_azimuth_deg: (300.0, 300.0), ..Default::default() };
        Moon::new(3, options).unwrap().scene(0, 400, 500).unwrap().write(folder.path()).unwrap();
        let suns = ["--sun-azimuth", "--sun-elevation"];
        let light = |less: &[&str], more: &[(&str, &str)], on: &[&str]| {
            run_without(folder.path(), less, more, on).unwrap();
            let text = String::from_utf8_lossy(&std::fs::read(folder.path().join("dtm.tif")).unwrap()).into_owned();
            let from = text.find("azimuth ").unwrap();
            text[from..].split(['"', '<', '\0', '\n']).next().unwrap().to_string()
        };
        assert!(
            light(&suns, &[], &[]).starts_with("azimuth 300 deg, elevation 30 deg; given (azimuth and elevation from")
        );
        let fitted = light(&suns, &[], &["--fit-sun"]);
        let number = |word: usize| fitted.split(' ').nth(word).unwrap().parse::<f64>().unwrap();
        assert!(
            (number(1) - 300.0).abs() < 15.0 && (number(4) - 30.0).abs() < 12.0 && fitted.ends_with("fitted"),
            "{fitted}"
        );
        assert!(number(1) != 300.0 && number(4) != 30.0, "{fitted}");
        let half = light(&["--sun-elevation"], &[("--sun-azimuth", "280")], &["--fit-sun"]);
        assert!(half.starts_with("azimuth 280 deg, elevation ") && half.ends_with("fitted"), "{half}");
        assert_eq!(light(&[], &[], &["--fit-sun"]), "azimuth 100 deg, elevation 30 deg; given");
    }

    #[test]
    fn a_light_that_nothing_shows_is_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        scene(folder.path());
        let level = folder.path().join("scene_0000_coarse.tif");
        let mut coarse = geotiff::read(&level).unwrap();
        coarse.samples.fill(5.0);
        geotiff::write(&level, &coarse, &geotiff::WriteOptions::heights("level")).unwrap();
        let suns = ["--sun-azimuth", "--sun-elevation"];
        let text = run_without(folder.path(), &suns, &[], &["--fit-sun"]).unwrap_err().to_string();
        assert!(
            text.contains("--fit-sun: a light that the coarse DTM shows expected")
                && text.contains("give --sun-azimuth"),
            "{text}"
        );
        assert!(!folder.path().join("dtm.tif").exists() && !folder.path().join("dtm.tif.part").exists());
    }

    #[test]
    fn mistakes_are_named_and_leave_nothing() {
        let folder = tempfile::tempdir().unwrap();
        scene(folder.path());
        let files = || {
            let mut names: Vec<_> =
                std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
            names.sort();
            names
        };
        let before = files();
        let image = folder.path().join("scene_0000_image.tif").display().to_string();
        let cases = [
            (("--sun-elevation", "-2"), "--sun-elevation: a number above 0 and below 90 degrees expected, found -2"),
            (("--sun-elevation", "90"), "found 90"),
            (("--sun-azimuth", "NaN"), "--sun-azimuth: a number from -360 to 360 degrees expected, found NaN"),
            (("--smoothness-weight", "0"), "smoothness weight"),
            (("--shadow-threshold", "2"), "shadow threshold"),
            (("--curve", "curve.txt"), ".csv or .png"),
            (("--truth", "nowhere.tif"), "nowhere.tif"),
            (("--output", image.as_str()), "overwrite"),
        ];
        for (option, expected) in cases {
            let text = run_with(folder.path(), &[option]).unwrap_err().to_string();
            assert!(text.contains(expected), "{option:?}: {text}");
        }
        assert_eq!(files(), before);
    }
}
