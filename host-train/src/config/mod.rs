//! The configuration: one document that determines a training and the use of its network.
//!
//! A preset (`host-train/models/presets`) or another file is the base. A file states what differs, and `--set` changes single keys ([`overlay`]).
//! `train`, `init` and `experiment` read it; `paper.toml` states every key.

mod overlay;

use crate::suite::list::is_plain;
use crate::suite::method::Usage;
use crate::toml_file::at_line;
use elunar_base::{Error, Result, read};
use elunar_data::source::{DataSpec, VALIDATION_SEED};
use elunar_evaluate::CoAlignment;
use elunar_learn::model::backend::Backend;
use elunar_learn::train::recipe::Recipe;
use elunar_learn::train::run::RunRecord;
use elunar_net::config::{NetConfig, Preset};
use overlay::Overlay;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use toml::de::DeTable;

/// Everything that determines a training and the use of its network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Configuration {
    /// Name of the file.
    #[serde(default)]
    pub name: String,
    /// Question that an experiment answers.
    #[serde(default)]
    pub answers: String,
    /// Base, as `preset nano` or the name of another file.
    #[serde(default)]
    pub like: String,
    /// Changes to the base, as `network.nr = 1`.
    #[serde(default)]
    pub changes: Vec<String>,
    /// Seed of initial weights and of cropping.
    pub seed: u64,
    /// The network.
    pub network: NetConfig,
    /// The hyper-parameters.
    pub recipe: Recipe,
    /// Training tiles.
    pub data: DataSpec,
    /// Validation tiles; `None`: [`DataSpec::validation`] of the training tiles.
    pub validation_data: Option<DataSpec>,
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

/// Greatest number of files in a chain of derivations.
const DEPTH: usize = 8;
/// Keys that say what a file is, and are no settings.
const WORDS: [&str; 3] = ["like", "preset", "answers"];

impl Configuration {
    /// Returns the configuration of a preset.
    ///
    /// # Errors
    /// [`Error::Input`] if the document that is built in is not understood.
    pub fn preset(preset: Preset) -> Result<Self> {
        let of: Self = serde_json::from_value(preset.document())
            .map_err(|e| Error::input(format!("preset {}: {e}", preset.name())))?;
        Ok(Self { like: format!("preset {}", preset.name()), ..of })
    }

    /// Reads a file, and its bases.
    ///
    /// # Errors
    /// [`Error::Io`] if a file cannot be read; [`Error::Broken`], with file and line, for entries that are not understood or do not fit
    /// together.
    pub fn read(path: &Path) -> Result<Self> {
        let found = Self::derived(path, DEPTH)?;
        found.check().map_err(|what| Error::broken(path, what))?;
        Ok(found)
    }

    fn derived(path: &Path, depth: usize) -> Result<Self> {
        let text = read::text(path, read::MOST_SETTINGS_BYTES)?;
        let broken = |what: &str| Error::broken(path, what);
        let table = parsed(path, &text)?;
        let word = |key: &str| table.get(key).map(|v| v.get_ref().as_str().unwrap_or_default());
        let base = match (word("like"), word("preset")) {
            (Some(like), None) if is_plain(like) && depth > 0 => {
                let parent = Self::derived(&path.with_file_name(format!("{like}.toml")), depth - 1)?;
                Self { like: like.into(), changes: vec![], ..parent }
            }
            (Some(_), None) => return Err(broken("like: expected the name of another configuration beside it")),
            (None, Some(preset)) => {
                let preset = Preset::ALL.into_iter().find(|known| known.name() == preset);
                Self::preset(preset.ok_or_else(|| broken("preset: expected paper, small, tiny or nano"))?)?
            }
            _ => return Err(broken("expected either preset or like, a text")),
        };
        let name = path.file_stem().and_then(|stem| stem.to_str()).filter(|name| is_plain(name));
        let name = name.ok_or_else(|| broken("expected a file name of letters, digits, - and _"))?.into();
        let answers = word("answers").unwrap_or_default().into();
        let mut overlay = Overlay::new(path, &text, Self { name, answers, ..base });
        for (key, value) in table.iter().filter(|(key, _)| !WORDS.contains(&key.get_ref().as_ref())) {
            overlay.set(&mut vec![], key.get_ref(), key.span().start, value)?;
        }
        Ok(overlay.finish())
    }

    /// Sets a key, as `recipe.steps=2000`. A text needs no quotation marks.
    ///
    /// # Errors
    /// [`Error::Usage`] if there is no such key, or its value is of another type.
    pub fn set(self, setting: &str) -> Result<Self> {
        let path = Path::new("--set");
        let quoted = setting.split_once('=').map(|(key, value)| format!("{key} = {:?}", value.trim()));
        let text = match quoted {
            Some(quoted) if DeTable::parse(setting).is_err() => quoted,
            _ => setting.into(),
        };
        let usage = |e: Error| Error::usage(format!("--set {setting}: {}", overlay::reason(&e)));
        let table = parsed(path, &text).map_err(usage)?;
        let mut overlay = Overlay::new(path, &text, self);
        for (key, value) in table.iter() {
            overlay.set(&mut vec![], key.get_ref(), key.span().start, value).map_err(usage)?;
        }
        Ok(overlay.finish())
    }

    /// Checks that network and recipe can be trained.
    ///
    /// # Errors
    /// One line with the field, what was expected and what was found.
    pub fn check(&self) -> std::result::Result<(), String> {
        self.network.check()?;
        self.recipe.check()
    }

    /// Returns the source of the validation tiles. The validation Moon and the training Moon share only their statistics.
    #[must_use]
    pub fn validation(&self) -> DataSpec {
        let seed = match self.data {
            DataSpec::Synth { seed, .. } => seed,
            DataSpec::Folder { .. } | DataSpec::Prepared { .. } => self.seed,
        };
        self.validation_data.clone().unwrap_or_else(|| self.data.validation(seed.wrapping_add(VALIDATION_SEED)))
    }

    /// Returns all settings as TOML: after a line `preset = ...` or `like = ...` they are a configuration file.
    ///
    /// # Errors
    /// If a number has no form in TOML.
    pub fn text(&self) -> Result<String> {
        #[derive(Serialize)]
        struct Settings<'a> {
            seed: u64,
            network: &'a NetConfig,
            recipe: &'a Recipe,
            data: &'a DataSpec,
            validation_data: &'a Option<DataSpec>,
            evaluation: Evaluation,
        }
        let Self { seed, network, recipe, data, validation_data, evaluation, .. } = self;
        let all = Settings { seed: *seed, network, recipe, data, validation_data, evaluation: *evaluation };
        toml::to_string(&all).map_err(|e| Error::input(e.to_string()))
    }

    /// Returns what the record of a run from random weights says of them.
    #[must_use]
    pub fn random_weights(&self) -> String {
        random_weights(self.seed)
    }

    /// Returns the record of a run.
    #[must_use]
    pub fn record(&self, backend: Backend, started_from: String) -> RunRecord {
        RunRecord {
            network: self.network.clone(),
            recipe: self.recipe.clone(),
            data: self.data.clone(),
            validation_data: self.validation(),
            seed: self.seed,
            backend,
            started_from,
        }
    }

    /// Replaces the number of steps.
    ///
    /// # Errors
    /// [`Error::Input`] if it is 0.
    pub fn with_steps(self, steps: usize) -> Result<Self> {
        let found = self.set(&format!("recipe.steps={steps}"))?;
        found.recipe.check().map_err(|what| Error::input(format!("{}: {what}", found.name)))?;
        Ok(found)
    }

    /// Returns the configuration with `count` seeds, its own and the next ones. Of several, the names end in the seed.
    #[must_use]
    pub fn with_seeds(&self, count: u64) -> Vec<Self> {
        let of = |offset: u64| {
            let seed = self.seed.wrapping_add(offset);
            let mut one = Self { seed, ..self.clone() };
            if count > 1 {
                one.name = format!("{}-seed{seed}", self.name);
                one.changes.push(format!("seed = {seed}"));
            }
            one
        };
        (0..count).map(of).collect()
    }
}

/// Returns what the record of a run from random weights of a seed says of them.
#[must_use]
pub fn random_weights(seed: u64) -> String {
    format!("random weights, seed {seed}")
}

/// Parses a TOML text; an error has its line.
fn parsed<'t>(path: &Path, text: &'t str) -> Result<DeTable<'t>> {
    let table = DeTable::parse(text).map_err(|e| {
        let message = e.message().split_whitespace().collect::<Vec<_>>().join(" ");
        at_line(path, text, e.span().map_or(0, |span| span.start), &message)
    })?;
    Ok(table.into_inner())
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
    use elunar_net::config::{ImageEncoderKind, OutputHead};
    use serde_json::json;

    const BASE: &str = "answers = '?'\npreset = 'nano'\nseed = 3\n[recipe]\nsteps = 7\n";

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            std::fs::write(folder.path().join(format!("{name}.toml")), text).unwrap();
        }
        folder
    }

    #[test]
    fn an_ablation_is_its_parent_with_what_it_says() {
        let text = "answers = 'more?'\nlike = 'base'\n[network]\nimage_encoder = 'resnet'\nnr = 1\n\
            [data.synth]\nseed = 9\noptions = { kind = 'mare', sun_elevation_deg = [20, 30.5] }\n[evaluation]\nco_alignment = 'low-pass'\n";
        let folder = folder(&[("base", BASE), ("child", text)]);
        let base = Configuration::read(&folder.path().join("base.toml")).unwrap();
        assert_eq!((base.seed, base.recipe.steps, base.network.head), (3, 7, OutputHead::Residual));
        assert_eq!((base.like.as_str(), base.changes.len(), base.recipe.warm_up), ("preset nano", 2, 3));
        let child = Configuration::read(&folder.path().join("child.toml")).unwrap();
        let network = NetConfig { image_encoder: ImageEncoderKind::Resnet, nr: 1.0, ..base.network.clone() };
        assert_eq!((&child.network, &child.recipe, child.seed), (&network, &base.recipe, 3));
        let DataSpec::Synth { seed: 9, options } = &child.data else { panic!("{:?}", child.data) };
        assert_eq!(options.sun_elevation_deg, (20.0, 30.5));
        assert_eq!(child.evaluation.co_alignment, CoAlignment::LowPass);
        assert!(child.changes.contains(&"network.nr = 1".to_string()), "{:?}", child.changes);
        assert_eq!(serde_json::from_value::<Configuration>(json!(child)).unwrap(), child);
        assert_eq!(child.with_steps(4).unwrap().recipe.warm_up, 2);
    }

    #[test]
    fn other_data_may_be_named() {
        let text =
            format!("{BASE}[data.prepared]\npath = 'tiles'\nsplit = 'train'\n[validation_data.folder]\npath = 'v'\n");
        let folder = folder(&[("base", &text)]);
        let found = Configuration::read(&folder.path().join("base.toml")).unwrap();
        assert!(matches!(&found.data, DataSpec::Prepared { path, .. } if path.as_os_str() == "tiles"));
        assert_eq!(found.validation(), DataSpec::Folder { path: "v".into() });
    }

    #[test]
    fn one_key_is_set_on_the_command_line() {
        let of = |settings: &[&str]| {
            let nano = Configuration::preset(Preset::Nano).unwrap();
            settings.iter().try_fold(nano, |one, setting| one.set(setting)).map_err(|e| e.to_string())
        };
        let found =
            of(&["recipe.steps=50", "network.head = relu", "recipe.crop=[64, 96]", "data.folder.path=tiles"]).unwrap();
        assert_eq!((found.recipe.steps, found.recipe.warm_up, found.network.head), (50, 25, OutputHead::Relu));
        assert_eq!((found.recipe.crop, &found.data), ([64, 96], &DataSpec::Folder { path: "tiles".into() }));
        assert_eq!(found.changes.len(), 4, "{:?}", found.changes);
        for (setting, expected) in [
            ("recipe.step=5", "unknown key recipe.step"),
            ("recipe.steps=many", "recipe.steps: invalid type"),
            ("recipe.steps", "--set recipe.steps: "),
            ("like=full", "unknown key like"),
            ("network=3", "network: invalid type"),
        ] {
            let refused = of(&[setting]).unwrap_err();
            assert!(refused.contains(expected) && refused.lines().count() == 1, "{refused}, not {expected}");
        }
    }

    #[test]
    fn presets_can_be_trained_and_their_text_can_be_read_again() {
        for preset in Preset::ALL {
            let found = Configuration::preset(preset).unwrap();
            assert_eq!(found.check(), Ok(()), "{}", preset.name());
            let text = format!("preset = '{}'\n{}", preset.name(), found.text().unwrap());
            let folder = folder(&[("again", &text)]);
            let again = Configuration::read(&folder.path().join("again.toml")).unwrap();
            assert_eq!(Configuration { changes: vec![], ..again }, Configuration { name: "again".into(), ..found });
        }
    }

    #[test]
    fn seeds_have_names_of_their_own() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("experiments/full.toml");
        let one = Configuration::read(&path).unwrap();
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
            (format!("{BASE}step = 3\n"), "line 6: unknown key recipe.step"),
            (format!("{BASE}[network]\nhead = 'round'\n"), "line 7: network.head: unknown variant `round`"),
            (format!("{BASE}[network]\n\ndecoder = [1, 2]\n"), "line 8: network.decoder"),
            (format!("{BASE}[data.synth.options]\nrow = 3\n"), "line 7: unknown key data.synth.options.row"),
            (format!("changes = []\n{BASE}"), "line 1: unknown key changes"),
            (format!("{BASE}batch = 0\n"), "batch: expected at least 1"),
            (format!("{BASE}[network]\nhead = 'residual'\nuse_coarse = false\n"), "use_coarse"),
            (format!("name = 'base'\n{BASE}"), "line 1: unknown key name"),
            (BASE.replace("preset = 'nano'", ""), "either preset or like"),
            (BASE.replace("preset = 'nano'", "like = '../x'"), "like: expected"),
            (BASE.replace("preset = 'nano'", "like = 'base'"), "like: expected"),
            (BASE.replace("'nano'", "'giant'"), "preset: expected"),
            ("seed = ".into(), "line 1"),
        ] {
            let folder = folder(&[("base", &text)]);
            let refused = Configuration::read(&folder.path().join("base.toml")).unwrap_err().to_string();
            assert!(refused.contains(expected) && refused.lines().count() == 1, "{refused}, not {expected}");
        }
    }
}
