//! `elunar predict`: makes a DTM from an image and a coarse DTM.

use super::output::{self, Target};
use super::{beside, words};
use elunar_net::illumination::{KnownSun, Lighting};
use elunar_net::shipped;
use elunar_raster::output::Owner;
use elunar_raster::stated::{HeightUnit, Statements};
use elunar_raster::sun::StatedSun;
use elunar_raster::{Crs, Error, Result};
use elunar_scene::interrupt;
use elunar_scene::mosaic::BLEND;
use elunar_scene::predict::errors::{assumed_sigma_m, origins_text};
use elunar_scene::predict::identity::{self, Identity, sha256_of_input};
use elunar_scene::predict::job::{Files, ReadRows, fill, finish, light_text, summary, survey};
use elunar_scene::predict::network::Model;
use elunar_scene::predict::notices::{check_exchange, notice_of_heights, notices, share_of_relief};
use elunar_scene::predict::record::{ErrorsRecord, LightRecord, Phases, Record};
use elunar_scene::predict::rows::{RowsHead, RowsReader, RowsWriter, rows_path};
use elunar_scene::predict::span::{PartOf, Span};
use elunar_scene::predict::sun::{KnownFrom, check_sun};
use elunar_scene::predict::{
    Input, Options, Part, Scene, Survey, Tally, int8, part_path, predict_span, shared_survey, survey_path,
};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Help text below the options.
pub const HELP: &str = "\
Image and coarse DTM are GeoTIFFs or PDS3 products, each on a grid of its own and in a projection of its own, on \
one sphere. The DTM gets the image's grid. Pixels without a valid image sample or coarse height become nodata. A hillshade is \
written beside the DTM (dtm_hillshade.png).

Finished rows wait in dtm.tif.part until all are done: after Ctrl-C or a kill the same command goes on from there. A DTM that the \
same job has finished, with the SHA-256 that lies beside it (dtm.tif.sha256), is not made again.

Example:
  elunar predict --image scene_0000_image.tif --coarse scene_0000_coarse.tif --model ground -o dtm.tif";

/// Options of `predict`.
#[derive(Debug, clap::Args)]
#[command(after_help = HELP)]
pub struct Args {
    /// Orbiter image: GeoTIFF or PDS3.
    #[arg(long, value_name = "I.tif")]
    pub image: PathBuf,
    /// Coarse DTM: GeoTIFF or PDS3, heights above the sphere in metres, or in the unit that the file names.
    #[arg(long, value_name = "C.tif")]
    pub coarse: PathBuf,
    /// Model: `ground` or `nano`, which are in this program, or a file, .eld for the int8 runner. `host-train` also accepts .safetensors, the float network.
    #[arg(long, value_name = "M")]
    pub model: PathBuf,
    /// DTM to write.
    #[arg(short, long, value_name = "DTM.tif")]
    pub output: PathBuf,
    /// Write the errors that heights and slopes are expected to have: a GeoTIFF with their standard deviations (metres; metres per metre
    /// along either axis) and the origin of each height. For models of weighed maps.
    #[arg(long, value_name = "ERR.tif")]
    pub uncertainty: Option<PathBuf>,
    /// Standard deviation of the coarse DTM's own heights, metres [default: 0.04 of its pixels, at most 3 m].
    #[arg(long, value_name = "M", value_parser = metres, requires = "uncertainty")]
    pub coarse_sigma: Option<f32>,
    /// Number of threads; 0 takes as many as the machine offers.
    #[arg(long, default_value_t = 0, value_parser = super::threads::number)]
    pub threads: usize,
    /// Reference system of the image, if the file does not state it: IAU_2015:30110 and the like, a PROJ text, or WKT.
    #[arg(long, value_name = "SRS", value_parser = Crs::parse)]
    pub image_srs: Option<Crs>,
    /// Reference system of the coarse DTM, if the file does not state it.
    #[arg(long, value_name = "SRS", value_parser = Crs::parse)]
    pub coarse_srs: Option<Crs>,
    /// Unit of the coarse DTM's heights, if the file does not state it [default: m].
    #[arg(long)]
    pub coarse_unit: Option<HeightUnit>,
    /// Azimuth of the Sun, degrees clockwise from the grid's up, -360 to 360 [default: as the image's file states it, else fitted to image and coarse DTM].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub sun_azimuth: Option<f64>,
    /// Elevation of the Sun, degrees above the horizon, above 0 and below 90 [default: as the image's file states it, else the change of brightness with slope is fitted to image and coarse DTM].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub sun_elevation: Option<f64>,
    /// Do not use the angles of the Sun that the image's file states: fit those that are not given.
    #[arg(long)]
    pub fit_sun: bool,
    /// Value of the image's file, before scale and offset, that means no measurement, as if its nodata tag said so.
    #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
    pub image_nodata: Option<f64>,
    /// Value of the coarse DTM's file, before scale, offset and unit, that means no measurement.
    #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
    pub coarse_nodata: Option<f64>,
    /// Make only the rows of part K of N, in dtm.tif.K-of-N.rows; `join` makes the DTM of all parts.
    #[arg(long, value_name = "K/N")]
    pub part: Option<PartOf>,
    /// Folder for the rows of the unfinished DTM, such as a disk of this machine [default: beside the DTM].
    #[arg(long, value_name = "DIR")]
    pub part_dir: Option<PathBuf>,
    /// SHA-256 of the image: the file is not read for it. That of a PDS3 product is LABEL+IMAGE. A manifest knows it.
    #[arg(long, value_name = "HEX", value_parser = hashes, hide = true)]
    pub image_sha256: Option<String>,
    /// SHA-256 of the coarse DTM, likewise.
    #[arg(long, value_name = "HEX", value_parser = hashes, hide = true)]
    pub coarse_sha256: Option<String>,
    /// Print what was taken and found as one JSON object on stdout; the text goes to stderr.
    #[arg(long)]
    pub json: bool,
    /// Overlap of neighbouring tiles, pixels [default: 100, or a third of a smaller tile's shorter side].
    #[arg(long, value_name = "PX")]
    pub overlap: Option<usize>,
    /// Take the low frequencies from the network, not from the coarse DTM, as in the paper.
    #[arg(long)]
    pub no_anchor: bool,
}

impl Args {
    /// Opens the coarse DTM, with what the user says about it.
    ///
    /// # Errors
    /// As [`Input::heights`].
    pub fn open_coarse(&self) -> Result<Input> {
        let stated = Statements { srs: self.coarse_srs.clone(), unit: self.coarse_unit };
        Input::heights(&self.coarse, stated, self.coarse_nodata)
    }

    /// Returns the angles of the Sun that the user gives.
    fn known_sun(&self) -> KnownSun {
        KnownSun { azimuth_deg: self.sun_azimuth, elevation_deg: self.sun_elevation }
    }
}

/// Runs the command.
///
/// # Errors
/// If an input cannot be read, the model cannot be opened, or predicting or writing fails. Then no DTM exists.
pub fn run(args: Args) -> Result<()> {
    run_with(args, open)
}

/// Opens a model file of the int8 runner.
///
/// # Errors
/// [`Error::Unsupported`] if the file's name is that of float weights, or of no known kind; otherwise as [`int8::open`].
pub fn open(path: &Path) -> Result<Box<dyn Model>> {
    let wrong = |what| Err(Error::unsupported(path, what));
    match path.extension().and_then(|extension| extension.to_str()) {
        None if shipped::find(path).is_some() => Ok(Box::new(int8::open(path)?)),
        Some("eld") => Ok(Box::new(int8::open(path)?)),
        Some("safetensors") => {
            wrong("expected a model (.eld); `host-train` runs float weights, `export` makes a model of them")
        }
        _ => wrong("expected a model with extension .eld, or one of this program: ground, nano"),
    }
}

/// Runs the command with models from `open`.
///
/// # Errors
/// As [`run`].
pub fn run_with(args: Args, open: impl FnOnce(&Path) -> Result<Box<dyn Model>>) -> Result<()> {
    interrupt::listen();
    use_threads(args.threads);
    match args.part {
        Some(part) => make_part(&args, part, open),
        None => make_whole(&args, open),
    }
}

/// Lets the compression of blocks use as many threads as the network.
fn use_threads(threads: usize) {
    // Fails if it was done before, as in tests of one process.
    let _ = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
}

fn make_whole(args: &Args, open: impl FnOnce(&Path) -> Result<Box<dyn Model>>) -> Result<()> {
    let start = Instant::now();
    let (owner, _owners) = take(args)?;
    let task = Task::new(args, open)?;
    let path = part_path(&args.output, args.part_dir.as_deref())?;
    if task.is_finished(args) {
        // A run that was killed at its end leaves its rows.
        Part::discard(&path, &task.identity.job, task.width())?;
        return say_finished(args, &task);
    }
    let mut watch = Watch::new();
    let survey = survey(&task.scene)?;
    let lighting = task.lighting(&survey);
    let warnings = task.warn(args, &survey, &lighting)?;
    let survey_s = watch.lap_s();
    let part = Part::open_at(path, &task.identity.job, task.width(), owner.is_successor())?;
    let light = survey.light_for(task.model.input_rules().illumination, task.sun.sun);
    let rows = task.scene.rows;
    let (mut part, tally) = fill(part, rows, &owner, |from, keep, progress| {
        predict_span(
            &task.scene,
            task.model.as_ref(),
            &task.options,
            light,
            &Span { rows: 0..rows, from },
            keep,
            progress,
        )
    })?;
    let phases = Phases { survey_s, tiles_s: watch.lap_s(), write_s: 0.0 };
    let found = Found { survey, warnings, start, phases };
    let said = write(args, &task, &mut |take| part.read(take), &tally, found, &owner)?;
    // First of all, since nobody may listen any more.
    part.remove()?;
    said.print();
    Ok(())
}

/// Makes the rows of a part of the scene.
fn make_part(args: &Args, part_of: PartOf, open: impl FnOnce(&Path) -> Result<Box<dyn Model>>) -> Result<()> {
    check_sun(args.known_sun())?;
    let output = rows_path(&args.output, part_of);
    let inputs: [&Path; 3] = [&args.image, &args.coarse, &args.model];
    output::check_dtm(&args.output, &further(args), &inputs)?;
    beside::check_rows(&output)?;
    let owner = output::take(&output, &inputs)?;
    let task = Task::new(args, open)?;
    let tiling = task.options.tiling(&task.scene, task.model.tile())?;
    let rows = part_of.rows(&tiling, task.scene.rows);
    let is_ours = |head: &RowsHead| head.job == task.identity.job && head.part == part_of;
    let is_whole = |reader: RowsReader| is_ours(&reader.head) && reader.read(&mut |_| Ok(())).is_ok();
    if output.is_file() && RowsReader::open(&output).is_ok_and(is_whole) {
        println!("{}: finished before", output.display());
        return Ok(());
    }
    let (survey, lighting) = task.shared_survey(args)?;
    // The other parts would say the same.
    if part_of.k == 1 {
        task.warn(args, &survey, &lighting)?;
    }
    let id = format!("{} {part_of}", task.identity.job);
    let path = part_path(&output, args.part_dir.as_deref())?;
    let part = Part::open_at(path, &id, task.width(), owner.is_successor())?;
    let light = survey.light_for(task.model.input_rules().illumination, task.sun.sun);
    let (mut part, tally) = fill(part, rows.len(), &owner, |done, keep, progress| {
        let span = Span { rows: rows.clone(), from: rows.start + done };
        predict_span(&task.scene, task.model.as_ref(), &task.options, light, &span, keep, progress)
    })?;
    let Tally { tiles_coarse, tiles_empty, tiles, .. } = tally;
    let (first, job, width) = (rows.start, task.identity.job.clone(), task.width());
    let head = RowsHead { job, part: part_of, first, rows: rows.len(), width, tiles_coarse, tiles_empty };
    let mut writer = RowsWriter::create(&output, head)?;
    part.read(&mut |rows| writer.add(rows))?;
    owner.check()?;
    writer.finish()?;
    part.remove()?;
    println!("{}: rows {first} to {} of {}, {tiles} tiles", output.display(), rows.end, task.scene.rows);
    Ok(())
}

/// Joins the finished parts of a DTM, and removes them.
///
/// # Errors
/// [`Error::Io`] if a part is missing; [`Error::Input`] if one is of another job; otherwise as [`run`].
pub fn join(args: &Args, parts: usize, open: impl FnOnce(&Path) -> Result<Box<dyn Model>>) -> Result<()> {
    let start = Instant::now();
    interrupt::listen();
    use_threads(args.threads);
    let (owner, _owners) = take(args)?;
    let task = Task::new(args, open)?;
    let paths: Vec<PathBuf> = (1..=parts).map(|k| rows_path(&args.output, PartOf { k, n: parts })).collect();
    let survey_at = survey_path(&args.output);
    if task.is_finished(args) {
        // A join that was killed at its end leaves parts.
        paths.iter().chain([&survey_at]).for_each(|path| drop(std::fs::remove_file(path)));
        return say_finished(args, &task);
    }
    let tiling = task.options.tiling(&task.scene, task.model.tile())?;
    let mut tally = Tally { tiles: tiling.len(), ..Tally::default() };
    for (path, k) in paths.iter().zip(1..) {
        let head = RowsReader::open(path)?.head;
        let part = PartOf { k, n: parts };
        let rows = part.rows(&tiling, task.scene.rows);
        let same = head.job == task.identity.job && head.part == part && head.width == task.width();
        if !same || (head.first..head.first + head.rows) != rows {
            let what = "rows of the same inputs, model and options expected, those of another job found";
            return Err(Error::input(format!("{}: {what}; make the part again", path.display())));
        }
        tally.tiles_coarse += head.tiles_coarse;
        tally.tiles_empty += head.tiles_empty;
    }
    if tally.tiles_empty == tally.tiles {
        return Err(task.scene.nothing_valid());
    }
    let mut watch = Watch::new();
    let (survey, lighting) = task.shared_survey(args)?;
    let warnings = task.warn(args, &survey, &lighting)?;
    let phases = Phases { survey_s: watch.lap_s(), ..Phases::default() };
    let light = survey.light_for(task.model.input_rules().illumination, task.sun.sun);
    (tally.light, tally.change) = (light.whole, light.change());
    let mut read = |take: &mut dyn FnMut(&[f32]) -> Result<()>| {
        paths.iter().try_for_each(|path| RowsReader::open(path)?.read(take))
    };
    let said = write(args, &task, &mut read, &tally, Found { survey, warnings, start, phases }, &owner)?;
    paths.iter().chain([&survey_at]).try_for_each(|path| std::fs::remove_file(path).map_err(Error::io(path)))?;
    said.print();
    Ok(())
}

/// Measures phases one after the other.
struct Watch(Instant);

impl Watch {
    fn new() -> Self {
        Self(Instant::now())
    }

    /// Returns the seconds since the last call, or the start.
    fn lap_s(&mut self) -> f64 {
        let start = std::mem::replace(&mut self.0, Instant::now());
        start.elapsed().as_secs_f64()
    }
}

/// Takes the outputs.
fn take(args: &Args) -> Result<(Owner, Vec<Owner>)> {
    check_sun(args.known_sun())?;
    let inputs: [&Path; 3] = [&args.image, &args.coarse, &args.model];
    if let Some(path) = &args.uncertainty {
        output::extension(path, &["tif", "tiff"])?;
    }
    output::take_dtm(&args.output, &further(args), &inputs)
}

/// Returns what is written besides the DTM.
fn further(args: &Args) -> Vec<Target<'_>> {
    args.uncertainty.iter().map(|path| Target::Errors(path)).collect()
}

/// What a run works with: the opened inputs and the identity of the job.
struct Task {
    model: Box<dyn Model>,
    scene: Scene,
    sun: KnownFrom,
    options: Options,
    identity: Identity,
}

impl Task {
    fn new(args: &Args, open: impl FnOnce(&Path) -> Result<Box<dyn Model>>) -> Result<Self> {
        let model = open(&args.model)?;
        if args.uncertainty.is_some() && !model.input_rules().illumination.is_weighed() {
            return Err(Error::unsupported(
                &args.model,
                "--uncertainty: a model of weighed maps expected; this one does not say how much an image explains",
            ));
        }
        let (scene, sun) = scene(args, args.known_sun())?;
        let options = Options {
            overlap_px: args.overlap.unwrap_or_else(|| Options::overlap_for(model.tile())),
            anchor: !args.no_anchor,
            threads: args.threads,
            sun: sun.sun,
            expected_errors: args.uncertainty.is_some(),
        };
        let identity = identity(args, &options, &model.description())?;
        Ok(Self { model, scene, sun, options, identity })
    }

    /// Returns the number of samples of a row, with all maps.
    fn width(&self) -> usize {
        self.scene.cols * self.options.layers()
    }

    fn is_finished(&self, args: &Args) -> bool {
        let outputs = std::iter::once(&args.output).chain(&args.uncertainty);
        outputs.into_iter().all(|output| self.identity.is_finished(output))
    }

    fn lighting(&self, survey: &Survey) -> Lighting {
        survey.lighting(self.model.input_rules().illumination, self.sun.sun)
    }

    /// Returns the survey that all parts of the DTM and `join` use. The first of them makes it.
    fn shared_survey(&self, args: &Args) -> Result<(Survey, Lighting)> {
        let survey = shared_survey(&survey_path(&args.output), &self.identity.job, || survey(&self.scene))?;
        let lighting = self.lighting(&survey);
        Ok((survey, lighting))
    }

    fn warn(&self, args: &Args, survey: &Survey, lighting: &Lighting) -> Result<Vec<String>> {
        let warnings = notices(&self.scene, survey, &self.sun, lighting, args.coarse_unit.is_some())?;
        warnings.iter().for_each(|warning| eprintln!("WARNING: {warning}"));
        Ok(warnings)
    }
}

/// Says that nothing was to be done.
fn say_finished(args: &Args, task: &Task) -> Result<()> {
    let text = format!("{}: finished before, by the same job; its SHA-256 holds", args.output.display());
    if args.json {
        eprintln!("{text}");
        let output = args.output.display().to_string();
        println!("{}", serde_json::json!({ "output": output, "finished_before": true, "job": task.identity.job }));
    } else {
        println!("{text}");
    }
    Ok(())
}

/// What a run found before it predicted.
struct Found {
    survey: Survey,
    warnings: Vec<String>,
    start: Instant,
    phases: Phases,
}

/// What a run says at its end.
struct Said {
    text: String,
    /// The record, if it was asked for. The text then goes to stderr.
    json: Option<String>,
}

impl Said {
    fn print(self) {
        match self.json {
            Some(json) => {
                eprintln!("{}", self.text);
                println!("{json}");
            }
            None => println!("{}", self.text),
        }
    }
}

/// Writes the files of finished rows. Returns what they are.
fn write(args: &Args, task: &Task, read: ReadRows, tally: &Tally, found: Found, owner: &Owner) -> Result<Said> {
    let (scene, sun) = (&task.scene, &task.sun);
    let model = task.model.description();
    let Tally { light, change, .. } = *tally;
    let changes = change.map_or(String::new(), |change| format!("; {change}"));
    let stored = light_text(&light) + sun.origin_of(&light) + &changes;
    let sigma_m = coarse_sigma(args, scene);
    let errors = args.uncertainty.as_deref().map(|path| (path, sigma_m));
    let files = Files { output: &args.output, image: &args.image, coarse: &args.coarse, errors };
    let mut watch = Watch::new();
    let finished = finish(read, scene, (&model, &stored, &task.identity), files, owner)?;
    let phases = Phases { write_s: watch.lap_s(), ..found.phases };
    let mut warnings = found.warnings;
    let beyond = notice_of_heights(&args.output.display().to_string(), scene, &finished);
    beyond.iter().for_each(|warning| eprintln!("WARNING: {warning}"));
    warnings.extend(beyond);
    let mut text = summary(&args.output, scene, &finished, tally) + sun.origin_of(&light) + &changes;
    if let (Some((path, sigma_m)), Some(origins)) = (errors, &finished.origins) {
        let said = if args.coarse_sigma.is_some() { "as told" } else { "assumed; --coarse-sigma tells it" };
        let origins = origins_text(origins);
        text += &format!(
            "\nheights: {origins}\n{}: expected errors, the coarse DTM's own {sigma_m:.2} m ({said})",
            path.display()
        );
    }
    if !args.json {
        return Ok(Said { text, json: None });
    }
    let name = |path: &Path| path.display().to_string();
    let record = Record {
        image: name(&args.image),
        coarse: name(&args.coarse),
        model,
        output: name(&args.output),
        uncertainty: errors
            .map(|(path, sigma_m)| ErrorsRecord::new(path, sigma_m, &finished.origins.unwrap_or_default())),
        rows: scene.rows,
        cols: scene.cols,
        pixel_m: scene.pixel_m,
        coarse_px: scene.coarse_px,
        lowest_m: finished.low_m,
        highest_m: finished.high_m,
        pixels_valid: finished.pixels_valid,
        pixels_void: scene.rows * scene.cols - finished.pixels_valid,
        coarse_covers: found.survey.coverage(),
        tiles: tally.into(),
        light: LightRecord::new(&light, change, sun),
        share_of_relief: share_of_relief(&found.survey, &light),
        warnings,
        seconds: found.start.elapsed().as_secs_f64(),
        phases,
    };
    Ok(Said { text, json: Some(record.json()) })
}

/// Returns the standard deviation of the coarse DTM's own heights, metres.
fn coarse_sigma(args: &Args, scene: &Scene) -> f32 {
    args.coarse_sigma.unwrap_or_else(|| assumed_sigma_m(scene.coarse_px * scene.pixel_m))
}

/// Parses a SHA-256, or several joined by `+`.
pub(crate) fn hashes(text: &str) -> std::result::Result<String, String> {
    let is_hash = |hash: &str| hash.len() == 64 && hash.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
    if text.split('+').all(is_hash) {
        Ok(text.into())
    } else {
        Err("64 hexadecimal digits in lower case expected, or several such numbers joined by +".into())
    }
}

/// Parses a standard deviation, metres.
fn metres(text: &str) -> std::result::Result<f32, String> {
    let sigma_m = text.parse().map_err(|_| "a number of metres expected".to_string())?;
    if (0.0..1e6).contains(&sigma_m) { Ok(sigma_m) } else { Err("metres from 0 to 1,000,000 expected".into()) }
}

/// Opens image and coarse DTM. Angles of the Sun that the user does not give are those of the image's file.
fn scene(args: &Args, user: KnownSun) -> Result<(Scene, KnownFrom)> {
    let image = Input::image(&args.image, args.image_srs.clone(), args.image_nodata)?;
    let coarse = args.open_coarse()?;
    check_exchange(&image, &coarse, args.coarse_unit.is_some())?;
    let of_file = if args.fit_sun { StatedSun::default() } else { image.source.info().sun };
    let sun = KnownFrom::new(user, &image.name, of_file)?;
    Ok((Scene::new(image, coarse)?, sun))
}

/// Returns what identifies this job. With a changed input, model or option, the job starts anew.
fn identity(args: &Args, options: &Options, model: &str) -> Result<Identity> {
    let known = |stated: &Option<String>, path: &Path| stated.clone().map_or_else(|| sha256_of_input(path), Ok);
    let image = known(&args.image_sha256, &args.image)?;
    Ok(Identity::new(image, known(&args.coarse_sha256, &args.coarse)?, model, in_words(args, options)))
}

/// Returns the options that change the result. The number of threads does not.
fn in_words(args: &Args, options: &Options) -> String {
    let yes = |yes: bool| Some(if yes { "yes" } else { "no" }.to_string());
    let number = |value: Option<f64>| value.map(|value| value.to_string());
    identity::words([
        ("overlap_px", Some(options.overlap_px.to_string())),
        ("blend", Some(BLEND.into())),
        ("anchor", yes(options.anchor)),
        ("sun_azimuth_deg", number(options.sun.azimuth_deg)),
        ("sun_elevation_deg", number(options.sun.elevation_deg)),
        ("expected_errors", yes(options.expected_errors)),
        ("image_srs", args.image_srs.as_ref().map(words::srs)),
        ("coarse_srs", args.coarse_srs.as_ref().map(words::srs)),
        ("coarse_unit", args.coarse_unit.as_ref().and_then(words::name)),
        ("image_nodata", number(args.image_nodata)),
        ("coarse_nodata", number(args.coarse_nodata)),
        ("coarse_sigma_m", args.coarse_sigma.map(|sigma_m| sigma_m.to_string())),
    ])
}
