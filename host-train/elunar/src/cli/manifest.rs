//! `elunar manifest`: makes or checks a manifest.

use crate::cluster::apart::{self, User};
use crate::cluster::item::BatchItem;
use crate::cluster::manifest::{BatchManifest, text};
use crate::job::Inputs;
use crate::outputs::uses::Uses;
use crate::outputs::{self as output, OutputTarget};
use elunar_base::{Error, Result, atomic_write, folder_of, read, say};
use elunar_net::shipped;
use elunar_raster::content::sha256_of_raster;
use elunar_raster::source;
use serde_json::{Map, Value};
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

/// Options of `manifest`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A table has a heading of the fields' names: id, image, coarse, model, output, sun_azimuth, sun_elevation, options.overlap and so \
on. Empty cells and absent columns take the options of the command line. Paths in a table start from the current folder; those of \
a manifest from the manifest's. An image that cannot be opened gets a line, and a warning.

Examples:
  elunar manifest images/ --coarse sldem.tif --model nano.eld --output-dir dtms -o m.jsonl
  elunar manifest --table list.csv --model nano.eld --output-dir dtms -o m.jsonl
  elunar manifest --check m.jsonl")]
pub struct Args {
    /// Images, and folders of images (.tif, .tiff, .lbl, .img).
    #[arg(value_name = "IMAGE", required_unless_present_any = ["table", "check"], conflicts_with_all = ["table", "check"])]
    pub images: Vec<PathBuf>,
    /// Table of images (CSV).
    #[arg(long, value_name = "T.csv", conflicts_with = "check")]
    pub table: Option<PathBuf>,
    /// Check a manifest, and do nothing else.
    #[arg(long, value_name = "M.jsonl")]
    pub check: Option<PathBuf>,
    /// Coarse DTM of all images.
    #[arg(long, value_name = "C.tif")]
    pub coarse: Option<PathBuf>,
    /// Model: `ground` or `nano`, which are in this program, or a file.
    #[arg(long, value_name = "M")]
    pub model: Option<PathBuf>,
    /// Folder for the DTMs.
    #[arg(long, value_name = "DIR", default_value = "dtms")]
    pub output_dir: PathBuf,
    /// An option of `predict` for all images, such as overlap=80 or no_anchor=true; may be repeated.
    #[arg(long = "option", value_name = "NAME=VALUE")]
    pub options: Vec<String>,
    /// Which inputs are hashed now, so that no run has to: a coarse DTM of many images is otherwise read for each.
    #[arg(long, value_enum, default_value = "coarse")]
    pub hash: Hash,
    /// Manifest to write.
    #[arg(short, long, value_name = "M.jsonl", required_unless_present = "check")]
    pub output: Option<PathBuf>,
}

/// Which inputs are hashed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Hash {
    /// None.
    None,
    /// The coarse DTMs.
    Coarse,
    /// Images and coarse DTMs.
    All,
}

/// Runs the command.
///
/// # Errors
/// If an input is missing, an option is wrong, or the manifest cannot be written.
pub fn run(args: Args) -> Result<()> {
    if let Some(path) = &args.check {
        let manifest = BatchManifest::read(path)?;
        apart::check(path, uses_of(&manifest, path))?;
        println!("{}: {} items", path.display(), manifest.items.len());
        return Ok(());
    }
    let Some(target) = &args.output else { return Err(Error::usage("--output: a path expected, none found")) };
    let inputs: Vec<&Path> = args.images.iter().chain(&args.table).map(PathBuf::as_path).collect();
    let _owner = output::take(target, &inputs)?;
    let folder = absolute(folder_of(target))?;
    let mut hashes = HashMap::new();
    let (mut content, mut count, mut pixels) = (String::new(), 0, 0);
    let mut take = |fields: Fields| {
        let item = item(&args, fields, &folder, &mut hashes)?;
        content += &text([&item])?;
        if content.len() as u64 > read::MOST_BYTES {
            let what = format!("a manifest of at most {} bytes expected", read::MOST_BYTES);
            return Err(Error::input(format!("{}: {what}; divide the images", target.display())));
        }
        count += 1;
        pixels += item.rows.zip(item.cols).map_or(0, |(rows, cols)| rows * cols);
        Ok(())
    };
    match &args.table {
        Some(table) => of_table(table, &mut take)?,
        None => of_images(&args.images)?.into_iter().try_for_each(take)?,
    }
    let manifest = BatchManifest::parse(target, &content)?;
    let mut uses = apart::uses(&manifest);
    uses.write(&OutputTarget::File(target).files(), User::other("--output"));
    inputs.iter().for_each(|input| uses.read(input, User::other("this command")));
    apart::check(target, uses)?;
    atomic_write(target, content.as_bytes())?;
    println!("{}: {count} items, {:.1} megapixels", target.display(), pixels as f64 / 1e6);
    Ok(())
}

/// Returns what the items of a manifest read and write, and the manifest itself, which is read.
pub(super) fn uses_of(manifest: &BatchManifest, path: &Path) -> Uses<User> {
    let mut uses = apart::uses(manifest);
    uses.read(path, User::other("the manifest"));
    uses
}

/// Fields of an item, by their names.
type Fields = BTreeMap<String, String>;

fn of_images(images: &[PathBuf]) -> Result<Vec<Fields>> {
    let mut all = vec![];
    for path in images {
        if !path.is_dir() {
            all.push(path.clone());
            continue;
        }
        let entries = std::fs::read_dir(path).map_err(Error::io(path))?;
        let mut found: Vec<PathBuf> =
            entries.flatten().map(|entry| entry.path()).filter(|path| is_image(path)).collect();
        found.sort();
        if found.is_empty() {
            return Err(Error::input(format!(
                "{}: images (.tif, .tiff, .lbl, .img) expected, none found",
                path.display()
            )));
        }
        all.extend(found);
    }
    Ok(all.iter().map(|path| BTreeMap::from([("image".to_string(), path.display().to_string())])).collect())
}

/// Returns whether a file is an image by its name. Of a label with an image the label counts.
fn is_image(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let has_label = || ["lbl", "LBL"].iter().any(|label| path.with_extension(label).exists());
    let may_have_one = ["img", "cub"].contains(&extension.as_str());
    path.is_file() && (matches!(extension.as_str(), "tif" | "tiff" | "lbl") || may_have_one && !has_label())
}

/// Passes on the rows of a table, one after the other.
fn of_table(path: &Path, take: &mut dyn FnMut(Fields) -> Result<()>) -> Result<()> {
    let broken = |e: csv::Error| Error::broken(path, e.to_string());
    let text = read::text(path, read::MOST_BYTES)?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let heading = reader.headers().map_err(broken)?.clone();
    for record in reader.records() {
        let record = record.map_err(broken)?;
        let cells = heading.iter().zip(record.iter()).filter(|(_, cell)| !cell.is_empty());
        take(cells.map(|(name, cell)| (name.to_string(), cell.to_string())).collect())?;
    }
    Ok(())
}

/// Makes an item of the fields of a table and the options of the command line.
fn item(args: &Args, mut fields: Fields, folder: &Path, hashes: &mut HashMap<PathBuf, String>) -> Result<BatchItem> {
    let path = |path: &Path| -> Result<PathBuf> {
        read::refuse_address(path)?;
        let whole = absolute(path)?;
        Ok(whole.strip_prefix(folder).map(Path::to_path_buf).unwrap_or(whole))
    };
    let missing = |name: &str| Error::usage(format!("{name}: expected in the table or as an option, found in neither"));
    let image = PathBuf::from(fields.remove("image").ok_or_else(|| missing("image"))?);
    let coarse =
        fields.remove("coarse").map(PathBuf::from).or(args.coarse.clone()).ok_or_else(|| missing("--coarse"))?;
    let model = fields.remove("model").map(PathBuf::from).or(args.model.clone()).ok_or_else(|| missing("--model"))?;
    let id = fields.remove("id").unwrap_or_else(|| name_of(&image));
    let output = fields.remove("output").map_or_else(|| args.output_dir.join(format!("{id}.tif")), PathBuf::from);
    let mut line = Map::new();
    let mut put = |name: &str, value: Value| drop(line.insert(name.into(), value));
    put("id", id.into());
    for (name, file) in [("image", &image), ("coarse", &coarse), ("model", &model), ("output", &output)] {
        let is_shipped = name == "model" && shipped::find(file).is_some();
        put(name, if is_shipped { file.clone() } else { path(file)? }.display().to_string().into());
    }
    if shipped::find(&model).is_none() {
        model.metadata().map_err(Error::io(&model))?;
    }
    let mut options = options(&args.options)?;
    for (name, value) in fields {
        match name.strip_prefix("options.") {
            Some(option) => drop(options.insert(option.into(), typed(&value))),
            None => put(&name, typed(&value)),
        }
    }
    if !options.is_empty() {
        put("options", options.into());
    }
    let line = Value::Object(line).to_string();
    let wrong = |(field, what)| Error::input(format!("{}: field {field}: {what}", image.display()));
    let mut item = BatchItem::parse(&line).map_err(wrong)?;
    // Before all of it is read for its hash, and as `predict` will read it.
    Inputs { coarse: coarse.clone(), ..item.predict(folder)?.request.inputs }.open_coarse()?;
    match source::open(&image) {
        Ok(source) => {
            item.rows.get_or_insert(source.info().rows as u64);
            item.cols.get_or_insert(source.info().cols as u64);
        }
        Err(error) => say::warning(&format!("{error}; its item will fail")),
    }
    describe(&image, args.hash == Hash::All, (&mut item.image_bytes, &mut item.image_sha256), hashes)?;
    describe(&coarse, args.hash != Hash::None, (&mut item.coarse_bytes, &mut item.coarse_sha256), hashes)?;
    Ok(item)
}

/// Adds the size of a file and, if `wanted`, its hash, which is computed once. What a table states stays.
fn describe(
    file: &Path,
    wanted: bool,
    (bytes, sha256): (&mut Option<u64>, &mut Option<String>),
    hashes: &mut HashMap<PathBuf, String>,
) -> Result<()> {
    let Ok(known) = file.metadata() else { return Ok(()) };
    bytes.get_or_insert(known.len());
    if wanted && sha256.is_none() {
        let hash = hashes.get(file).map_or_else(|| sha256_of_raster(file), |hash| Ok(hash.clone()))?;
        hashes.insert(file.into(), hash.clone());
        *sha256 = Some(hash);
    }
    Ok(())
}

/// Returns the options of the command line.
fn options(words: &[String]) -> Result<Map<String, Value>> {
    let wrong = |word| Error::usage(format!("--option: NAME=VALUE expected, {word:?} found"));
    let pair = |word: &String| word.split_once('=').map(|(name, value)| (name.into(), typed(value)));
    words.iter().map(|word| pair(word).ok_or_else(|| wrong(word))).collect()
}

/// Returns a cell as what it looks like: a number, true or false, or a text.
fn typed(text: &str) -> Value {
    match text {
        "true" | "false" => Value::Bool(text == "true"),
        _ => text.parse::<serde_json::Number>().map_or_else(|_| text.into(), Value::Number),
    }
}

/// Returns a name for an item: the file's name without extension, with `_` for other characters.
fn name_of(image: &Path) -> String {
    let stem = image.file_stem().unwrap_or_default().to_string_lossy();
    stem.chars().map(|c| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '_' }).collect()
}

fn absolute(path: &Path) -> Result<PathBuf> {
    let path = std::path::absolute(path).map_err(Error::io(path))?;
    Ok(path.canonicalize().unwrap_or(path))
}
