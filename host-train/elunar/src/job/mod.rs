//! A prediction as a job: inputs, identity, light, warnings, parts, survey, finish. The commands, `batch` and the tour run it; none has a rule of its
//! own.
//!
//! [`Request`] says what is wanted. [`run`] makes a DTM, or the rows of a part; [`join`] makes a DTM of parts. [`predict`] makes the maps in memory.
//! Messages go to stderr or to a caller in this process, what was made comes back as [`Done`].

mod inputs;
mod memory;
mod pds4;
mod report;
mod request;
mod stac;
mod task;
mod tracks;
pub mod words;
mod write;

use crate::outputs::{self, OutputTarget, beside};
use elunar_base::output::{Owner, settle};
use elunar_base::{Error, HAS_THREADS, Result, caller, interrupt, say};
use elunar_net::shipped;
use elunar_net::sun::check_sun;
use elunar_scene::predict::job::{Keep, fill, fill_files, survey};
use elunar_scene::predict::network::TileModel;
use elunar_scene::predict::record::Phases;
use elunar_scene::predict::rows::{RowsHead, RowsReader, RowsWriter, rows_path};
use elunar_scene::predict::span::{PartOf, Span};
use elunar_scene::predict::{PartFile, Tally, TileProgress, int8, part_path, survey_path};
pub use inputs::{Inputs, Opened};
pub use memory::{MemoryJob, PredictedMaps, predict};
pub use request::Request;
pub(crate) use request::hashes;
use std::path::{Path, PathBuf};
use std::time::Instant;
use task::Task;
use write::Found;

/// What a job has made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Done {
    /// For the user.
    pub text: String,
    /// What was taken and found, as one JSON object; `None` for a part.
    pub json: Option<String>,
}

impl Done {
    /// Prints the text, or with `json` the object, where there is one; the text then goes to stderr.
    pub fn print(self, json: bool) {
        match self.json.filter(|_| json) {
            Some(json) => {
                say::note(&self.text);
                println!("{json}");
            }
            None => println!("{}", self.text),
        }
    }
}

/// Says warnings.
pub fn warn<'a>(warnings: impl IntoIterator<Item = &'a String>) {
    warnings.into_iter().for_each(|warning| say::warning(warning));
}

/// Opens a model file of the int8 runner.
///
/// # Errors
/// [`Error::Unsupported`] if the file's name is that of float weights, or of no known kind; otherwise as [`int8::open`].
pub fn open(path: &Path) -> Result<Box<dyn TileModel>> {
    let wrong = |what| Err(Error::unsupported(path, what));
    match path.extension().and_then(|extension| extension.to_str()) {
        None if shipped::find(path).is_some() => Ok(Box::new(int8::open(path)?.in_large_steps()?)),
        Some("eld") => Ok(Box::new(int8::open(path)?.in_large_steps()?)),
        Some("safetensors") => {
            wrong("expected a model (.eld); `host-train` runs float weights, `export` makes a model of them")
        }
        _ => wrong("expected a model with extension .eld, or one of this program: ground, nano"),
    }
}

/// Makes what is asked for, with a model from `open`: a DTM, or the rows of `part` in dtm.tif.K-of-N.rows.
///
/// # Errors
/// If an input cannot be read, the model cannot be opened, or predicting or writing fails. Then no DTM exists.
pub fn run(
    args: &Request,
    part: Option<PartOf>,
    open: impl FnOnce(&Path) -> Result<Box<dyn TileModel>>,
) -> Result<Done> {
    begin(args);
    match part {
        Some(_) if !HAS_THREADS => {
            Err(Error::usage("--part: a program with threads expected; parts are for several machines"))
        }
        Some(part) => make_part(args, part, open),
        None => make_whole(args, open),
    }
}

/// Listens for Ctrl-C, and lets the compression of blocks use as many threads as the network. A caller in this process has done both its way.
fn begin(args: &Request) {
    if caller::current().is_some() {
        return;
    }
    interrupt::listen();
    if !HAS_THREADS {
        return;
    }
    // Fails if it was done before, as in tests of one process.
    let _ = rayon::ThreadPoolBuilder::new().num_threads(args.threads).build_global();
}

/// Makes a DTM. Rows of an interrupted run are kept; a DTM that the same job has finished is not made again.
///
/// # Errors
/// If an input cannot be read, the model cannot be opened, or predicting or writing fails. Then no DTM exists.
fn make_whole(args: &Request, open: impl FnOnce(&Path) -> Result<Box<dyn TileModel>>) -> Result<Done> {
    let start = Instant::now();
    let (owner, _owners) = take(args)?;
    let task = Task::new(args, open)?;
    let path = part_path(&args.output, args.part_dir.as_deref())?;
    if let Some(done) = finished_before(args, &task)? {
        // A run that was killed at its end leaves its rows.
        PartFile::discard(&path, &task.identity.job, task.width())?;
        return Ok(done);
    }
    let mut watch = Watch::new();
    let survey = survey(&task.work.scene)?;
    let lighting = task.work.lighting(&survey);
    let warnings = task.work.warn(args, &survey, &lighting)?;
    let survey_s = watch.lap_s();
    let part = PartFile::open_at(path, &task.identity.job, task.width(), owner.is_successor())?;
    let (rows, light) = (task.work.scene.rows, task.work.light(&survey));
    let make = |from, keep: Keep, progress: TileProgress| {
        task.work.predict(task.work.light(&survey), &Span { rows: 0..rows, from }, keep, progress)
    };
    let (part, tally, files, coarse_sigma) = if task.work.tracks.is_some() {
        // What the file of expected errors holds is known with the last row.
        let (mut part, tally) = fill(part, rows, &owner, make)?;
        let coarse_sigma = task.work.coarse_sigma(args, |see| part.read(see))?;
        let mut files = write::begin(args, &task, &light, coarse_sigma)?;
        part.read(&mut |rows| files.add(rows))?;
        (part, tally, files, coarse_sigma)
    } else {
        let coarse_sigma = task.work.told_or_assumed(args);
        let mut files = write::begin(args, &task, &light, coarse_sigma)?;
        let (part, tally) = fill_files(part, rows, (&mut files, &owner), make)?;
        (part, tally, files, coarse_sigma)
    };
    let phases = Phases { survey_s, tiles_s: watch.lap_s(), write_s: 0.0 };
    let found = Found { survey, warnings, coarse_sigma, start, phases };
    let done = write::end(args, &task, files, &tally, found, &owner)?;
    part.remove()?;
    Ok(done)
}

/// Makes the rows of a part of the scene.
fn make_part(args: &Request, part_of: PartOf, open: impl FnOnce(&Path) -> Result<Box<dyn TileModel>>) -> Result<Done> {
    check_sun(args.inputs.known_sun())?;
    let output = rows_path(&args.output, part_of);
    outputs::check_dtm(&args.output, &args.further(), &args.read())?;
    beside::check_rows(&output)?;
    let owner = outputs::take(&output, &args.read())?;
    let task = Task::new(args, open)?;
    let tiling = task.work.options.tiling(&task.work.scene, task.work.model.tile())?;
    let rows = part_of.rows(&tiling, task.work.scene.rows);
    let is_ours = |head: &RowsHead| head.job == task.identity.job && head.part == part_of;
    let is_whole = |reader: RowsReader| is_ours(&reader.head) && reader.read(&mut |_| Ok(())).is_ok();
    if output.is_file() && RowsReader::open(&output).is_ok_and(is_whole) {
        settle(&output)?;
        return Ok(Done { text: format!("{}: finished before", output.display()), json: None });
    }
    let (survey, lighting) = task.shared_survey(args)?;
    // The other parts would say the same.
    if part_of.k == 1 {
        task.work.warn(args, &survey, &lighting)?;
    }
    let id = format!("{} {part_of}", task.identity.job);
    let path = part_path(&output, args.part_dir.as_deref())?;
    let part = PartFile::open_at(path, &id, task.width(), owner.is_successor())?;
    let (mut part, tally) = fill(part, rows.len(), &owner, |done, keep, progress| {
        let span = Span { rows: rows.clone(), from: rows.start + done };
        task.work.predict(task.work.light(&survey), &span, keep, progress)
    })?;
    let Tally { tiles_coarse, tiles_empty, tiles, .. } = tally;
    let (first, job, width) = (rows.start, task.identity.job.clone(), task.width());
    let head = RowsHead { job, part: part_of, first, rows: rows.len(), width, tiles_coarse, tiles_empty };
    let mut writer = RowsWriter::create(&output, head)?;
    part.read(&mut |rows| writer.add(rows))?;
    owner.check()?;
    writer.finish()?;
    part.remove()?;
    let text = format!("{}: rows {first} to {} of {}, {tiles} tiles", output.display(), rows.end, task.work.scene.rows);
    Ok(Done { text, json: None })
}

/// Joins the finished parts of a DTM, and removes them.
///
/// # Errors
/// [`Error::Io`] if a part is missing; [`Error::Input`] if one is of another job; otherwise as [`run`].
pub fn join(args: &Request, parts: usize, open: impl FnOnce(&Path) -> Result<Box<dyn TileModel>>) -> Result<Done> {
    let start = Instant::now();
    begin(args);
    let (owner, _owners) = take(args)?;
    let task = Task::new(args, open)?;
    let paths: Vec<PathBuf> = (1..=parts).map(|k| rows_path(&args.output, PartOf { k, n: parts })).collect();
    let survey_at = survey_path(&args.output);
    if let Some(done) = finished_before(args, &task)? {
        // A join that was killed at its end leaves parts.
        paths.iter().chain([&survey_at]).for_each(|path| drop(std::fs::remove_file(path)));
        return Ok(done);
    }
    let tiling = task.work.options.tiling(&task.work.scene, task.work.model.tile())?;
    let mut tally = Tally { tiles: tiling.len(), ..Tally::default() };
    for (path, k) in paths.iter().zip(1..) {
        let head = RowsReader::open(path)?.head;
        let part = PartOf { k, n: parts };
        let rows = part.rows(&tiling, task.work.scene.rows);
        let same = head.job == task.identity.job && head.part == part && head.width == task.width();
        if !same || (head.first..head.first + head.rows) != rows {
            let what = "rows of the same inputs, model and options expected, those of another job found";
            return Err(Error::input(format!("{}: {what}; make the part again", path.display())));
        }
        tally.tiles_coarse += head.tiles_coarse;
        tally.tiles_empty += head.tiles_empty;
    }
    if tally.tiles_empty == tally.tiles {
        return Err(task.work.scene.nothing_valid());
    }
    let mut watch = Watch::new();
    let (survey, lighting) = task.shared_survey(args)?;
    let warnings = task.work.warn(args, &survey, &lighting)?;
    let mut phases = Phases { survey_s: watch.lap_s(), ..Phases::default() };
    let light = task.work.light(&survey);
    (tally.light, tally.change) = (light.whole, light.change());
    let read = |see: Keep| paths.iter().try_for_each(|path| RowsReader::open(path)?.read(&mut *see));
    let coarse_sigma = task.work.coarse_sigma(args, read)?;
    let mut files = write::begin(args, &task, &light, coarse_sigma)?;
    read(&mut |rows| files.add(rows))?;
    phases.write_s = watch.lap_s();
    let found = Found { survey, warnings, coarse_sigma, start, phases };
    let done = write::end(args, &task, files, &tally, found, &owner)?;
    paths.iter().chain([&survey_at]).try_for_each(|path| std::fs::remove_file(path).map_err(Error::io(path)))?;
    Ok(done)
}

/// Measures phases one after the other.
pub(crate) struct Watch(Instant);

impl Watch {
    pub(crate) fn new() -> Self {
        Self(Instant::now())
    }

    /// Returns the seconds since the last call, or the start.
    pub(crate) fn lap_s(&mut self) -> f64 {
        let start = std::mem::replace(&mut self.0, Instant::now());
        start.elapsed().as_secs_f64()
    }
}

/// Takes the outputs.
fn take(args: &Request) -> Result<(Owner, Vec<Owner>)> {
    check_sun(args.inputs.known_sun())?;
    if let Some(path) = &args.uncertainty {
        outputs::extension(path, &["tif", "tiff"])?;
    }
    if let Some(path) = &args.report {
        outputs::extension(path, &["html"])?;
    }
    if let Some(path) = &args.stac {
        outputs::extension(path, &["json"])?;
    }
    if let Some(path) = &args.pds4 {
        outputs::extension(path, &["xml"])?;
    }
    outputs::take_dtm(&args.output, &args.further(), &args.read())
}

/// Says that nothing was to be done, if all files are there and on disk.
fn finished_before(args: &Request, task: &Task) -> Result<Option<Done>> {
    if !task.is_finished(args) {
        return Ok(None);
    }
    settle(&args.output)?;
    args.further().into_iter().map(OutputTarget::path).try_for_each(settle)?;
    let text = format!("{}: finished before, by the same job; its SHA-256 holds", args.output.display());
    let output = args.output.display().to_string();
    let json = serde_json::json!({ "output": output, "finished_before": true, "job": task.identity.job });
    Ok(Some(Done { text, json: Some(json.to_string()) }))
}
