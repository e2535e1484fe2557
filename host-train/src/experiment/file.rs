//! An experiment as a TOML file: a preset or another experiment, and the changes to it.

use crate::suite::list::is_plain;
use crate::suite::method::Usage;
use crate::toml_file::at_line;
use elunar_learn::train::recipe::Recipe;
use elunar_net::config::{NetConfig, Preset};
use elunar_raster::{Error, Result, read};
use elunar_scene::data::source::{DataSpec, VALIDATION_SEED};
use elunar_scene::evaluate::CoAlignment;
use elunar_synth::SynthOptions;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Everything that determines an experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Experiment {
    /// Name of the experiment and of its file.
    pub name: String,
    /// Question that the experiment answers.
    pub answers: String,
    /// Base of the experiment: `preset nano`, or another experiment.
    pub like: String,
    /// Changes to the base, as `network.nr = 1`.
    pub changes: Vec<String>,
    /// Seed of initial weights and of cropping.
    pub seed: u64,
    /// The network.
    pub network: NetConfig,
    /// The hyper-parameters.
    pub recipe: Recipe,
    /// Training tiles.
    pub data: DataSpec,
    /// Validation tiles.
    pub validation_data: DataSpec,
    /// Use of the network on the test scenes.
    pub evaluation: Evaluation,
}

/// Use of the trained network.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Whether every tile keeps the coarse DTM's low frequencies (ours). Otherwise they come from the network (the paper).
    pub anchor: bool,
    /// Co-alignment of the finished DTM.
    pub co_alignment: CoAlignment,
    /// Whether the Sun's direction is given to the network.
    pub tell_sun: bool,
    /// Number of coarser scales that are predicted first ([`Usage::coarser_scales`]).
    #[serde(default)]
    pub coarser_scales: u32,
}

impl Evaluation {
    /// Returns the usage for a method of a suite.
    #[must_use]
    pub fn usage(self, threads: usize) -> Usage {
        let Self { anchor, co_alignment, tell_sun, coarser_scales } = self;
        Usage { anchor, co_alignment, tell_sun, threads, coarser_scales }
    }
}

/// Greatest number of experiments in a chain of derivations.
const DEPTH: usize = 8;

impl Experiment {
    /// Returns the paper's network and recipe of a preset, on the synthetic Moon.
    fn of_preset(preset: Preset) -> Self {
        let moon = |seed| DataSpec::Synth { seed, options: SynthOptions::default() };
        Self {
            name: String::new(),
            answers: String::new(),
            like: format!("preset {preset:?}").to_lowercase(),
            changes: vec![],
            seed: 1,
            network: NetConfig::preset(preset),
            recipe: Recipe::preset(preset),
            data: moon(1),
            validation_data: moon(1 + VALIDATION_SEED),
            evaluation: Evaluation {
                anchor: false,
                co_alignment: CoAlignment::None,
                tell_sun: true,
                coarser_scales: 0,
            },
        }
    }

    /// Reads an experiment, and its bases.
    ///
    /// # Errors
    /// [`Error::Io`] if a file cannot be read; [`Error::Broken`], with file and line, for entries that are not understood or do not fit
    /// together.
    pub fn read(path: &Path) -> Result<Self> {
        Self::derived(path, DEPTH)
    }

    fn derived(path: &Path, depth: usize) -> Result<Self> {
        let text = read::text(path, read::MOST_SETTINGS_BYTES)?;
        let broken = |what: String| Error::broken(path, what);
        let table = DeTable::parse(&text).map_err(|e| {
            let message = e.message().split_whitespace().collect::<Vec<_>>().join(" ");
            at_line(path, &text, e.span().map_or(0, |span| span.start), &message)
        })?;
        let table = table.into_inner();
        let word = |key: &str| table.get(key).map(|v| v.get_ref().as_str().map(String::from));
        let base = match (word("like"), word("preset")) {
            (Some(Some(like)), None) if is_plain(&like) && depth > 0 => {
                let parent = Self::derived(&path.with_file_name(format!("{like}.toml")), depth - 1)?;
                Self { like, changes: vec![], ..parent }
            }
            (Some(Some(_)), None) => {
                return Err(broken("like: expected the name of another experiment beside it".into()));
            }
            (None, Some(Some(preset))) => {
                let preset = <Preset as clap::ValueEnum>::from_str(&preset, false);
                Self::of_preset(preset.map_err(|_| broken("preset: expected paper, small, tiny or nano".into()))?)
            }
            _ => return Err(broken("expected either preset or like, a text".into())),
        };
        for key in ["name", "answers"] {
            if word(key).is_none() {
                return Err(broken(format!("expected a key {key}, found none")));
            }
        }
        let mut overlay = Overlay { path, text: &text, experiment: base.clone(), value: json!(base), changes: vec![] };
        for (key, value) in table.iter().filter(|(key, _)| !["like", "preset"].contains(&key.get_ref().as_ref())) {
            if ["like", "changes"].contains(&key.get_ref().as_ref()) {
                return Err(at_line(path, &text, key.span().start, &format!("unknown key {}", key.get_ref())));
            }
            overlay.set(&mut vec![], key.get_ref(), key.span().start, value)?;
        }
        let made = Self { changes: overlay.changes, ..overlay.experiment };
        made.check(path).map_err(broken)?;
        Ok(made)
    }

    fn check(&self, path: &Path) -> std::result::Result<(), String> {
        if path.file_stem().and_then(|stem| stem.to_str()) != Some(&self.name) || !is_plain(&self.name) {
            return Err(format!("name: expected that of the file, found {:?}", self.name));
        }
        self.network.check()?;
        self.recipe.check()
    }

    /// Replaces the number of steps.
    ///
    /// # Errors
    /// [`Error::Input`] if it is 0.
    pub fn with_steps(mut self, steps: usize) -> Result<Self> {
        let recipe = &mut self.recipe;
        recipe.steps = steps;
        recipe.warm_up = recipe.warm_up.min(steps / 2);
        self.changes.push(format!("recipe.steps = {steps} (on the command line)"));
        self.recipe.check().map_err(|what| Error::input(format!("{}: {what}", self.name)))?;
        Ok(self)
    }

    /// Returns the experiment from `count` seeds, its own and the next ones. Of several, the names end in the seed.
    #[must_use]
    pub fn with_seeds(&self, count: u64) -> Vec<Self> {
        let of = |offset: u64| {
            let seed = self.seed.wrapping_add(offset);
            let mut one = Self { seed, ..self.clone() };
            if count > 1 {
                one.name = format!("{}-seed{seed}", self.name);
                one.changes.push(format!("seed = {seed} (on the command line)"));
            }
            one
        };
        (0..count).map(of).collect()
    }
}

/// Overlays the values of a file on an experiment, one by one. The error names the first bad value with its line.
struct Overlay<'a> {
    path: &'a Path,
    text: &'a str,
    experiment: Experiment,
    value: Value,
    changes: Vec<String>,
}

impl Overlay<'_> {
    /// Sets `key` in the table at `place`.
    fn set(&mut self, place: &mut Vec<String>, key: &str, offset: usize, given: &Spanned<DeValue>) -> Result<()> {
        place.push(key.into());
        // For data of another kind than the preset's, start from an empty value of that kind.
        if let (["data" | "validation_data"], Some(table)) = (parts(place).as_slice(), given.get_ref().as_table()) {
            let empty = [json!({"folder": {"path": ""}}), json!({"prepared": {"path": "", "split": "train"}})];
            let other = empty
                .into_iter()
                .find(|v| v.as_object().is_some_and(|v| v.keys().all(|k| table.contains_key(k.as_str()))));
            if let (Some(other), Some(slot)) = (other, self.slot(place)) {
                *slot = other;
            }
        }
        let dotted = place.join(".");
        let Some(slot) = self.slot(place) else {
            return Err(at_line(self.path, self.text, offset, &format!("unknown key {dotted}")));
        };
        match given.get_ref().as_table() {
            Some(table) if slot.is_object() => {
                for (key, value) in table.iter() {
                    self.set(place, key.get_ref(), key.span().start, value)?;
                }
            }
            _ => self.leaf(place, offset, given)?,
        }
        place.pop();
        Ok(())
    }

    fn leaf(&mut self, place: &[String], offset: usize, given: &Spanned<DeValue>) -> Result<()> {
        let dotted = place.join(".");
        let new = plain(given.get_ref());
        let Some(slot) = self.slot(place) else { return Ok(()) };
        let old = std::mem::replace(slot, new.clone());
        self.experiment = serde_json::from_value(self.value.clone())
            .map_err(|e| at_line(self.path, self.text, offset, &format!("{dotted}: {e}")))?;
        // Compared as numbers: 1 and 1.0 are equal.
        let same = old == new || old.as_f64().zip(new.as_f64()).is_some_and(|(old, new)| old == new);
        if !same && !["name", "answers"].contains(&dotted.as_str()) {
            self.changes.push(format!("{dotted} = {new}"));
        }
        Ok(())
    }

    fn slot(&mut self, place: &[String]) -> Option<&mut Value> {
        place.iter().try_fold(&mut self.value, |value, key| value.as_object_mut()?.get_mut(key))
    }
}

fn parts(place: &[String]) -> Vec<&str> {
    place.iter().map(String::as_str).collect()
}

/// Converts a TOML value to JSON. Dates, which no setting uses, become text.
fn plain(value: &DeValue) -> Value {
    let text = |number: &str| number.replace('_', "").parse::<f64>();
    match value {
        DeValue::String(text) => json!(text),
        DeValue::Integer(number) => {
            let digits = number.as_str().replace('_', "");
            u64::from_str_radix(&digits, number.radix()).map_or_else(
                |_| i64::from_str_radix(&digits, number.radix()).map_or(Value::Null, Value::from),
                Value::from,
            )
        }
        DeValue::Float(number) => text(number.as_str()).map_or(Value::Null, Value::from),
        DeValue::Boolean(flag) => json!(flag),
        DeValue::Datetime(date) => json!(date.to_string()),
        DeValue::Array(items) => items.iter().map(|item| plain(item.get_ref())).collect(),
        DeValue::Table(table) => {
            Value::Object(table.iter().map(|(key, v)| (key.get_ref().to_string(), plain(v.get_ref()))).collect())
        }
    }
}

/// Returns every `.toml` file of a folder, in order of name.
///
/// # Errors
/// [`Error::Io`] if it cannot be read.
pub fn files(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut found = vec![];
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let path = entry.map_err(Error::io(folder))?.path();
        if path.extension().is_some_and(|e| e == "toml") {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_net::config::{Head, ImageEncoderKind};

    const BASE: &str = "name = 'base'\nanswers = '?'\npreset = 'nano'\nseed = 3\n[recipe]\nsteps = 7\n";

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            std::fs::write(folder.path().join(format!("{name}.toml")), text).unwrap();
        }
        folder
    }

    #[test]
    fn an_ablation_is_its_parent_with_what_it_says() {
        let text = "name = 'child'\nanswers = 'more?'\nlike = 'base'\n[network]\nimage_encoder = 'resnet'\nnr = 1\n\
            [data.synth]\nseed = 9\noptions = { kind = 'mare', sun_elevation_deg = [20, 30.5] }\n[evaluation]\nco_alignment = 'low-pass'\n";
        let folder = folder(&[("base", BASE), ("child", text)]);
        let base = Experiment::read(&folder.path().join("base.toml")).unwrap();
        assert_eq!((base.seed, base.recipe.steps, base.network.head), (3, 7, Head::Relu));
        assert_eq!((base.like.as_str(), base.changes.len()), ("preset nano", 2));
        let child = Experiment::read(&folder.path().join("child.toml")).unwrap();
        let network = NetConfig { image_encoder: ImageEncoderKind::Resnet, nr: 1.0, ..base.network.clone() };
        assert_eq!((&child.network, &child.recipe, child.seed), (&network, &base.recipe, 3));
        let DataSpec::Synth { seed: 9, options } = &child.data else { panic!("{:?}", child.data) };
        assert_eq!(options.sun_elevation_deg, (20.0, 30.5));
        assert_eq!(child.evaluation.co_alignment, CoAlignment::LowPass);
        assert!(child.changes.contains(&"network.nr = 1".to_string()), "{:?}", child.changes);
        assert_eq!(serde_json::from_value::<Experiment>(json!(child)).unwrap(), child);
        assert_eq!(child.with_steps(4).unwrap().recipe.warm_up, 2);
    }

    #[test]
    fn other_data_may_be_named() {
        let text =
            format!("{BASE}[data.prepared]\npath = 'tiles'\nsplit = 'train'\n[validation_data.folder]\npath = 'v'\n");
        let folder = folder(&[("base", &text)]);
        let found = Experiment::read(&folder.path().join("base.toml")).unwrap();
        assert!(matches!(&found.data, DataSpec::Prepared { path, .. } if path.as_os_str() == "tiles"));
        assert_eq!(found.validation_data, DataSpec::Folder { path: "v".into() });
    }

    #[test]
    fn seeds_have_names_of_their_own() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("experiments/full.toml");
        let one = Experiment::read(&path).unwrap();
        assert_eq!(one.with_seeds(1)[0].name, one.name);
        let several = one.with_seeds(3);
        for (offset, found) in several.iter().enumerate() {
            let seed = one.seed + offset as u64;
            assert_eq!((found.seed, &found.name), (seed, &format!("{}-seed{seed}", one.name)));
            assert_eq!((&found.network, &found.recipe), (&one.network, &one.recipe));
        }
    }

    #[test]
    fn mistakes_are_named_with_their_line() {
        for (text, expected) in [
            (format!("{BASE}step = 3\n"), "line 7: unknown key recipe.step"),
            (format!("{BASE}[network]\nhead = 'round'\n"), "line 8: network.head: unknown variant `round`"),
            (format!("{BASE}[network]\n\ndecoder = [1, 2]\n"), "line 9: network.decoder"),
            (format!("{BASE}[data.synth.options]\nrow = 3\n"), "line 8: unknown key data.synth.options.row"),
            (format!("changes = []\n{BASE}"), "line 1: unknown key changes"),
            (format!("{BASE}batch = 0\n"), "batch: expected at least 1"),
            (format!("{BASE}[network]\nhead = 'residual'\nuse_coarse = false\n"), "use_coarse"),
            (BASE.replace("'base'", "'other'"), "expected that of the file"),
            (BASE.replace("preset = 'nano'", ""), "either preset or like"),
            (BASE.replace("preset = 'nano'", "like = '../x'"), "like: expected"),
            (BASE.replace("preset = 'nano'", "like = 'base'"), "like: expected"),
            (BASE.replace("'nano'", "'giant'"), "preset: expected"),
            (BASE.replace("answers = '?'", ""), "answers"),
            ("name = ".into(), "line 1"),
        ] {
            let folder = folder(&[("base", &text)]);
            let refused = Experiment::read(&folder.path().join("base.toml")).unwrap_err().to_string();
            assert!(refused.contains(expected) && refused.lines().count() == 1, "{refused}, not {expected}");
        }
    }
}
