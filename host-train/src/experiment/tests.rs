//! Experiments on miniature networks and tiles, and one step of every shipped experiment.

use super::*;
use crate::config::files;
use crate::suite::results::{COARSE, UNTRAINED};
use elunar_data::source::DataSpec;
use elunar_learn::model::backend::Backend;
use elunar_learn::train::run::Run;
use elunar_net::config::NetConfig;
use elunar_synth::SynthOptions;
use std::path::PathBuf;

/// Returns the experiments of this repository.
fn shipped() -> Vec<PathBuf> {
    files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("experiments")).unwrap()
}

/// Returns the experiment on tiles of 64 x 64 pixels, in `steps` steps.
fn small(experiment: Configuration, steps: usize) -> Configuration {
    let tiles = |data: &DataSpec| match data {
        DataSpec::Synth { seed, options } => {
            let options = SynthOptions { rows: 64, cols: 64, ..options.clone() };
            DataSpec::Synth { seed: *seed, options }
        }
        other => other.clone(),
    };
    let mut made = Configuration {
        data: tiles(&experiment.data),
        validation_data: Some(tiles(&experiment.validation())),
        ..experiment.with_steps(steps).unwrap()
    };
    let recipe = &mut made.recipe;
    (recipe.batch, recipe.crop, recipe.validation_tiles, recipe.checkpoint_every) = (1, [64, 64], 2, 1);
    recipe.validate_every = steps;
    made
}

/// Returns an experiment with the narrowest possible network.
fn miniature(name: &str, steps: usize) -> Configuration {
    let full = Configuration::read(&shipped()[0].with_file_name("full.toml")).unwrap();
    let network = NetConfig {
        embed: 8,
        depths: [1; 4],
        heads: [1, 1, 2, 2],
        window: 4,
        stem: 4,
        dtm: [4, 4, 4, 4, 8],
        decoder: [8, 8, 8, 4, 4],
        ..full.network.clone()
    };
    Configuration { name: name.into(), network, ..small(full, steps) }
}

#[test]
fn every_shipped_experiment_is_read_and_makes_a_step() {
    let paths = shipped();
    let names: Vec<String> = paths.iter().map(|p| Configuration::read(p).unwrap().name).collect();
    for expected in ["full", "no-coarse", "resnet", "upb", "l1", "max-min", "anchored", "ours", "dlunardtmnet"] {
        assert!(names.iter().any(|name| name == expected), "{expected} among {names:?}");
    }
    let folder = tempfile::tempdir().unwrap();
    for path in &paths {
        let experiment = Configuration::read(path).unwrap();
        assert!(experiment.like.starts_with("preset") || !experiment.changes.is_empty(), "{}", experiment.name);
        let at = folder.path().join(&experiment.name);
        let found = train::train(&small(experiment, 1), &at, false, &mut |_| {}).unwrap();
        assert!(found.validation.network.rmse_m.is_finite() && found.parameters > 100_000, "{found:?}");
        assert!(train::model(&at).exists());
    }
}

#[test]
fn a_killed_experiment_goes_on_bit_for_bit_and_a_finished_one_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, parts] = ["whole", "parts"].map(|name| folder.path().join(name));
    let experiment = miniature("e", 3);
    let first = train::train(&experiment, &whole, false, &mut |_| {}).unwrap();

    // The run was killed after the first step.
    let record = experiment.record(Backend::Flex, "random weights, seed 1; experiment e".into());
    let (training, validation) = (record.data.open().unwrap(), record.validation_data.open().unwrap());
    let initial = Some(elunar_learn::model::init::initial_weights(&record.network, record.seed));
    let run = Run { folder: parts.join(train::TRAINING), record, initial, training, validation, stop_after: Some(1) };
    assert!(!run.train().unwrap().finished);
    let refused = train::train(&experiment, &parts, false, &mut |_| {}).unwrap_err().to_string();
    assert!(refused.contains("--resume"), "{refused}");
    let second = train::train(&experiment, &parts, true, &mut |_| {}).unwrap();
    assert_eq!(first.validation, second.validation);
    let [a, b] = [&whole, &parts].map(|at| std::fs::read(train::model(at)).unwrap());
    assert!(a == b, "weights differ");

    // One that was killed before its first checkpoint begins anew, with and without --resume.
    for resume in [false, true] {
        let early = folder.path().join(format!("early-{resume}"));
        let run = early.join(train::TRAINING);
        std::fs::create_dir_all(&run).unwrap();
        std::fs::copy(whole.join(train::TRAINING).join("run.json"), run.join("run.json")).unwrap();
        std::fs::write(run.join("train.files"), "elunar files 1\nrun.json\n").unwrap();
        train::train(&experiment, &early, resume, &mut |_| {}).unwrap();
        assert!(std::fs::read(train::model(&early)).unwrap() == std::fs::read(train::model(&whole)).unwrap());
    }

    // A finished experiment is not trained again, even if its run is removed, and is not confused with another.
    std::fs::remove_dir_all(parts.join(train::TRAINING)).unwrap();
    let mut said = vec![];
    let third = train::train(&experiment, &parts, false, &mut |line| said.push(line.to_string())).unwrap();
    // JSON keeps all digits but the last.
    assert!((third.validation.rmse / second.validation.rmse - 1.0).abs() < 1e-12);
    assert_eq!(third.experiment, second.experiment);
    assert_eq!(said, ["e: trained before"]);
    let other = Configuration { seed: 9, ..experiment };
    let refused = train::train(&other, &parts, true, &mut |_| {}).unwrap_err().to_string();
    assert!(refused.contains("other settings"), "{refused}");
}

#[test]
fn experiments_end_in_one_table_and_one_page() {
    let folder = tempfile::tempdir().unwrap();
    let list = folder.path().join("list.toml");
    let scene = "[[scene]]\nname = 'a'\nground = 'g'\nsynth = { seed = 500000, options = { rows = 64, cols = 80, sun_azimuth_deg = [90, 90] } }\n";
    let other = scene.replace("'a'", "'b'").replace("90", "270");
    std::fs::write(&list, format!("name = 'two'\n{scene}{other}")).unwrap();
    let list = List::read(&list).unwrap();
    let experiments = [miniature("one", 1), Configuration { seed: 2, ..miniature("two", 1) }];
    let out = folder.path().join("out");
    let found = run(&experiments, &list, &out, ExperimentOptions::default(), &mut |_| {}).unwrap();
    assert_eq!(found.trained.len(), 2);
    let methods: Vec<&str> = found.test.scenes[0].scored.iter().map(|j| j.method.as_str()).collect();
    assert_eq!(methods, [COARSE, UNTRAINED, "one", "two"]);
    assert_eq!(found.test.cross.len(), 3);
    for file in ["comparison.md", "comparison.csv", "test.csv", "curves.png", "test/tables.md", "test/dtm/one/a.tif"] {
        assert!(out.join(file).exists(), "{file}");
    }
    let text = std::fs::read_to_string(out.join("comparison.md")).unwrap();
    assert!(text.contains("| one | preset nano |") && text.contains("| g | two |"), "{text}");

    let mut said = vec![];
    let again =
        run(&experiments, &list, &out, ExperimentOptions::default(), &mut |line| said.push(line.to_string())).unwrap();
    assert_eq!(said, ["one: trained before", "two: trained before", "test scenes: scored before"]);
    let read = ExperimentResults::read(&out).unwrap();
    assert_eq!([&again, &read].map(table::markdown), [text.as_str(), text.as_str()]);

    // Another list gives another test.
    let mut other = list.clone();
    other.scene.truncate(1);
    let found = run(&experiments[..1], &other, &out, ExperimentOptions::default(), &mut |_| {}).unwrap();
    assert_eq!((found.test.scenes.len(), found.test.methods.len(), found.trained.len()), (1, 3, 1));
    assert_eq!(run(&experiments, &list, &out, ExperimentOptions::default(), &mut |_| {}).unwrap().test.scenes.len(), 2);

    let page = folder.path().join("page.html");
    crate::report::write(&[out.clone(), out.join(TEST), out.join("one").join(train::TRAINING)], &page).unwrap();
    let page = std::fs::read_to_string(page).unwrap();
    // Of the comparison: two sheets per scene, one of the ground, one of all curves, one per run. Then the suite's and the run's pictures
    // again.
    assert_eq!(page.matches("data:image/png").count(), (5 + 1 + 2) + 5 + 1);
}
