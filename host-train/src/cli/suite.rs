//! `host-train suite`: compares models, and other programs' DTMs, on test scenes.

use crate::suite::list::List;
use crate::suite::method::{Method, Usage};
use crate::suite::{self, Baselines, SCENES, files, real, tables};
use elunar_base::output::Owner;
use elunar_base::{Error, Result, interrupt, progress};
use std::path::{Path, PathBuf};

/// Options of `suite`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Without --suite the scenes are synthetic ones that no shipped model was trained on; without --model the shipped models are \
scored. The coarse DTM and the pipeline without training (untrained: coarse DTM plus photoclinometry) are scored with them, so \
that what learning adds is seen. All are compared on the same pixels. Writes results.json, tables.md, CSV files, pictures, and the scenes and DTMs as \
GeoTIFFs; `report` makes a page of the folder. host-train/docs/experiments.md says how to write a list of scenes, and what the \
figures mean.

To compare with another program: write the scenes with --scenes-only, run the program on out/sfs/scenes, then name its folder of \
DTMs with --against.

Examples:
  host-train suite --out out/suite
  host-train suite --suite scenes.toml --model mine.safetensors --model mine.eld --out out/mine
  host-train suite --real DATA --out out/real
  host-train suite --linear-bound --out out/bound
  host-train suite --out out/sfs --scenes-only
  host-train suite --out out/suite --against sfs=out/sfs/dtm")]
pub struct Args {
    /// Folder to write into; created if absent.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// List of scenes [default: built-in synthetic scenes].
    #[arg(long, value_name = "LIST.toml")]
    pub suite: Option<PathBuf>,
    /// Built-in list of real scenes: a folder with their data sets, images with a DTM of stereo or altimetry. Absent sets are named and left out.
    #[arg(long, value_name = "DIR", conflicts_with = "suite")]
    pub real: Option<PathBuf>,
    /// Model: `ground` or `nano`, which are in this program, or a file, .safetensors or .eld; optionally with a name (NAME=FILE). Repeat for several models [default: the shipped ones].
    #[arg(long, value_name = "[NAME=]FILE")]
    pub model: Vec<String>,
    /// DTMs of another program: a folder with SCENE.tif or SCENE_dtm.tif for every scene.
    #[arg(long, value_name = "NAME=DIR")]
    pub against: Vec<String>,
    /// Also score the best linear filter of image and coarse DTM that other grounds under the scene's Sun teach: a bound for linear methods,
    /// made with truths. The Sun must be known.
    #[arg(long)]
    pub linear_bound: bool,
    /// Also score the best linear filter that the scene's own truth teaches: how far linear methods go on it. No Sun is needed.
    #[arg(long)]
    pub linear_own: bool,
    /// Do not pass the Sun's direction to the models, so that it is estimated.
    #[arg(long)]
    pub hide_sun: bool,
    /// Take the low frequencies from the networks, not from the coarse DTM, as in the paper.
    #[arg(long)]
    pub no_anchor: bool,
    /// Number of threads; 0 takes as many as the machine offers.
    #[arg(long, default_value_t = 0, value_parser = elunar::threads::number)]
    pub threads: usize,
    /// Write the scenes' files and stop.
    #[arg(long)]
    pub scenes_only: bool,
}

/// Folder of the shipped models.
const SHIPPED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/models");

/// Runs the command.
///
/// # Errors
/// If a list, a model or a scene cannot be read, or predicting or writing fails.
pub fn run(args: Args) -> Result<()> {
    interrupt::listen();
    if args.scenes_only {
        let list = list(&args, &[])?;
        suite::write_scenes(&list, &args.out)?;
        println!("{}: {} scenes, and a table of them, scenes.csv", args.out.join(SCENES).display(), list.scene.len());
        return Ok(());
    }
    let usage = Usage { anchor: !args.no_anchor, tell_sun: !args.hide_sun, threads: args.threads, ..Usage::default() };
    let baselines = Baselines { usage, linear_bound: args.linear_bound, linear_own: args.linear_own };
    let methods = methods(&args, usage)?;
    let list = list(&args, &baselines.methods().iter().chain(&methods).collect::<Vec<_>>())?;
    let bar = progress::bar("", list.scene.len() as u64, "scenes");
    let results = suite::run(&list, baselines, &methods, &args.out, &mut |_| bar.inc(1))?;
    bar.finish_and_clear();
    // If all scenes have a weak truth, there are no summaries.
    let sums = tables::sums(&results);
    let shown = if sums.rows.is_empty() { tables::scenes(&results) } else { sums };
    let learning = tables::learning(&results).markdown();
    if !learning.is_empty() {
        println!("What learning adds:\n\n{learning}");
    }
    print!("{}", shown.markdown());
    println!(
        "\n{}: results.json, tables.md and pictures; a page of it: host-train report {0} -o report.html",
        args.out.display()
    );
    Ok(())
}

/// Returns the list of scenes. Real ones are written, once it is known that they, and the results of `methods`, replace nothing of others.
fn list(args: &Args, methods: &[&Method]) -> Result<List> {
    let Some(data) = &args.real else { return args.suite.as_deref().map_or_else(List::built_in, List::read) };
    let names = real::names(data);
    let scenes = || names.iter().map(String::as_str);
    let methods: Vec<&str> = methods.iter().map(|method| method.name.as_str()).collect();
    let results = if args.scenes_only { vec![] } else { files::of_results(scenes(), &methods, &[]) };
    let _owner = Owner::of_folder(&args.out, files::COMMAND, files::of_scenes(scenes()).chain(results))?;
    let (list, absent) = real::real(data, &args.out.join(SCENES))?;
    absent.iter().for_each(|folder| elunar_base::say::note(&format!("SKIPPED: {folder}: not there")));
    Ok(list)
}

fn methods(args: &Args, usage: Usage) -> Result<Vec<Method>> {
    let mut methods = vec![];
    if args.model.is_empty() && args.against.is_empty() {
        for path in shipped()? {
            methods.push(Method::network(&file_name(&path), &path, usage)?);
        }
    }
    for model in &args.model {
        methods.push(match model.split_once('=') {
            Some((name, path)) => Method::network(name, Path::new(path), usage)?,
            None => Method::network(&file_name(Path::new(model)), Path::new(model), usage)?,
        });
    }
    for against in &args.against {
        let named = against.split_once('=');
        let (name, path) =
            named.ok_or_else(|| Error::usage(format!("--against: expected NAME=DIR, found {against:?}")))?;
        methods.push(Method::folder(name, Path::new(path))?);
    }
    Ok(methods)
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Returns every model of the models' folder, in order of name, float before int8.
fn shipped() -> Result<Vec<PathBuf>> {
    let folder = Path::new(SHIPPED);
    let hint = |e: std::io::Error| Error::usage(format!("{SHIPPED}: {e}; name a model with --model"));
    let entries = std::fs::read_dir(folder).map_err(hint)?;
    let mut found: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    found.retain(|path| path.extension().is_some_and(|e| e == "eld" || e == "safetensors"));
    // Float before int8.
    found.sort_by_key(|path| (path.file_stem().map(ToOwned::to_owned), path.extension().is_some_and(|e| e == "eld")));
    Ok(found)
}
