//! The training loop on a miniature network and synthetic tiles.

use super::adversarial::Adversarial;
use super::elevation_only::ElevationOnly;
use super::feed::{Feed, tensors};
use super::recipe::Recipe;
use super::run::{BEST, LAST, Run, RunRecord};
use super::sample::{RawTile, Sample};
use super::source::{DataSpec, TileSource};
use super::step::Trainer;
use crate::model::backend::Backend;
use crate::model::init::initial_weights;
use crate::model::precision::TrainingPrecision;
use crate::model::store;
use crate::testing::without_zeros;
use elunar_base::Result;
use elunar_net::config::{Illumination, NetConfig, Preset, miniature_network};
use elunar_net::illumination::KnownSun;
use std::path::Path;
use std::sync::Arc;

/// Ripples lit from the west. Image and relief are related, so that a network can learn from them.
struct Ripples;

impl TileSource for Ripples {
    fn tile(&self, index: u64) -> Result<RawTile> {
        let (rows, cols) = (96, 96);
        let phase = index as f32 * 0.7;
        let height = |r: f32, c: f32| 10.0 * (r * 0.05 + phase).sin() + (c * 0.4 + phase).sin();
        let map = |f: &dyn Fn(f32, f32) -> f32| -> Vec<f32> {
            (0..rows * cols).map(|i| f((i / cols) as f32, (i % cols) as f32)).collect()
        };
        Ok(RawTile {
            rows,
            cols,
            pixel_m: 2.0,
            image: map(&|r, c| 3.0 + height(r, c + 1.0) - height(r, c)),
            coarse_m: map(&|r, _| 10.0 * (r * 0.05 + phase).sin()),
            truth_m: map(&height),
            coarse_px: 30.0,
            sun: KnownSun { azimuth_deg: Some(270.0), elevation_deg: None },
        })
    }
}

fn miniature() -> (NetConfig, Recipe) {
    let network = miniature_network();
    let recipe = Recipe {
        batch: 2,
        steps: 8,
        warm_up: 2,
        crop: [64, 64],
        crops_per_tile: 1,
        pool: 0,
        validate_every: 3,
        validation_tiles: 2,
        checkpoint_every: 2,
        ..Recipe::preset(Preset::Nano)
    };
    (network, recipe)
}

/// Returns an adversarial variant: one branch, and a critic from the third step on.
fn rival() -> (NetConfig, Recipe) {
    let (network, recipe) = miniature();
    let network = NetConfig { use_coarse: false, coarse_channel: true, ..network };
    let adversarial = Some(Adversarial { weight: 0.1, learning_rate: 2e-3, width: 4 });
    (network, Recipe { adversarial, elevation_only: ElevationOnly::Share(0.25), ..recipe })
}

fn run(folder: &Path, resume: bool, stop_after: Option<usize>) -> Run {
    run_of(miniature(), folder, resume, stop_after)
}

fn run_of((network, recipe): (NetConfig, Recipe), folder: &Path, resume: bool, stop_after: Option<usize>) -> Run {
    let initial = (!resume).then(|| initial_weights(&network, 1));
    // This is never opened; the sources below are used.
    let spec = DataSpec::Folder { path: "ripples".into() };
    let record = RunRecord {
        network,
        recipe,
        data: spec.clone(),
        validation_data: spec,
        seed: 5,
        backend: Backend::Flex,
        started_from: "seed 1".into(),
    };
    let source: Arc<dyn TileSource> = Arc::new(Ripples);
    Run { folder: folder.into(), record, initial, training: source.clone(), validation: source, stop_after }
}

#[test]
fn a_killed_run_resumes_bit_for_bit() {
    let (network, recipe) = miniature();
    let shared = (network.clone(), Recipe { devices: 2, precision: TrainingPrecision::Bf16, ..recipe.clone() });
    // Tiles of several steps, crops that are not square, a mean of weights. It begins at 32 steps.
    let pooled = (network.clone(), Recipe { pool: 5, crop: [64, 96], average_steps: 64, steps: 144, ..recipe.clone() });
    // A network given no slopes, without a detail stage.
    let plain = NetConfig { illumination: Illumination::Weighed, detail: 0, ..network.clone() };
    let plain = (plain, Recipe { transpose: false, ..recipe.clone() });
    let shallow = (network, Recipe { drop_path: 0.5, ..recipe });
    for kind in [miniature(), rival(), shared, pooled, plain, shallow] {
        resumes_bit_for_bit(&kind);
    }
}

fn resumes_bit_for_bit(kind: &(NetConfig, Recipe)) {
    let run = |folder: &Path, resume, stop_after| run_of(kind.clone(), folder, resume, stop_after);
    let folder = tempfile::tempdir().unwrap();
    let (whole, parts) = (folder.path().join("whole"), folder.path().join("parts"));
    assert!(run(&whole, false, None).train().unwrap().finished);
    let stop = kind.1.steps / 2 + 1;
    assert!(!run(&parts, false, Some(stop)).train().unwrap().finished);
    // A kill after the checkpoint leaves rows of steps that are done again.
    let steps = parts.join("steps.csv");
    let text = std::fs::read_to_string(&steps).unwrap() + &format!("{},0,0,0,0,0\n{},0,", stop + 1, stop + 2);
    std::fs::write(&steps, text).unwrap();
    assert!(run(&parts, true, None).train().unwrap().finished);
    for file in [BEST, LAST, "steps.csv", "validation.csv", "checkpoint/optimiser.safetensors", "checkpoint/state.json"]
    {
        let [a, b] = [&whole, &parts].map(|f| std::fs::read(f.join(file)).unwrap());
        assert!(a == b, "{file} differs");
    }
}

#[test]
fn batches_do_not_depend_on_the_number_of_their_makers() {
    let (network, recipe) = miniature();
    batches_are_those_of_one_maker(&network, &recipe);
    batches_are_those_of_one_maker(&network, &Recipe { pool: 5, transpose: true, crop: [64, 96], ..recipe });
}

fn batches_are_those_of_one_maker(network: &NetConfig, recipe: &Recipe) {
    let feed = Feed::new(Arc::new(Ripples), network.clone(), recipe.clone(), 5);
    for makers in [1, 2, 3, 11] {
        for first in [0, 3] {
            let made: Vec<_> = feed.ahead(first, makers).map(Result::unwrap).collect();
            assert_eq!(made.len(), recipe.steps - first);
            for (step, batch) in (first..).zip(made) {
                let expected = feed.batch(step).unwrap();
                let maps = |batch: &[Sample]| {
                    batch.iter().map(|s| [&s.image, &s.coarse, &s.truth].map(Clone::clone)).collect::<Vec<_>>()
                };
                assert!(maps(&batch) == maps(&expected), "batch of step {step} from {makers} makers");
            }
        }
    }
}

#[test]
fn a_turned_crop_that_does_not_fit_is_named() {
    let (network, recipe) = miniature();
    let recipe = Recipe { transpose: true, crop: [96, 128], ..recipe };
    let feed = Feed::new(Arc::new(Ripples), network, recipe, 5);
    let errors: Vec<String> = (0..8).map(|step| feed.batch(step).unwrap_err().to_string()).collect();
    let found = |part: &str| errors.iter().any(|error| error.contains(part));
    assert!(found("at least 96x128 pixels, found 96x96"), "{errors:?}");
    assert!(found("at least 128x96 pixels (a turned crop; transpose = false has none), found 96x96"), "{errors:?}");
}

/// Breaks after the tiles of four steps.
struct Breaking;

impl TileSource for Breaking {
    fn tile(&self, index: u64) -> Result<RawTile> {
        if index < 8 { Ripples.tile(index) } else { Err(elunar_base::Error::input("the disk is gone")) }
    }
}

#[test]
fn checkpoints_are_written_by_time_too() {
    let (network, recipe) = miniature();
    let kept = |minutes: f64| {
        let folder = tempfile::tempdir().unwrap();
        let recipe = Recipe { checkpoint_every: 1_000, checkpoint_minutes: minutes, ..recipe.clone() };
        let mut run = run_of((network.clone(), recipe), folder.path(), false, None);
        run.training = Arc::new(Breaking);
        assert!(run.train().unwrap_err().to_string().contains("the disk is gone"));
        super::checkpoint::load(folder.path()).unwrap().expect("a checkpoint").state.step
    };
    assert_eq!([kept(0.0), kept(60.0)], [4, 0]);
}

/// Fails before the first step, as if the run were killed there.
struct Absent;

impl TileSource for Absent {
    fn tile(&self, _: u64) -> Result<RawTile> {
        Err(elunar_base::Error::input("killed"))
    }
}

#[test]
fn a_run_killed_before_its_first_step_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let whole = run(&at("whole"), false, None).train().unwrap();
    let same = |name: &str| {
        let [a, b] = ["whole", name].map(|name| std::fs::read(at(name).join(LAST)).unwrap());
        assert!(whole.finished && a == b, "{name}: weights differ");
    };
    // Killed while the validation tiles were made: there is a checkpoint of step 0 already.
    let mut killed = run(&at("early"), false, None);
    killed.validation = Arc::new(Absent);
    assert!(killed.train().unwrap_err().to_string().contains("killed"));
    assert!(run(&at("early"), true, None).train().unwrap().finished);
    same("early");
    // Killed before: a record alone, a part of a checkpoint, or a checkpoint without a record. All begin anew.
    let record = std::fs::read(at("whole").join("run.json")).unwrap();
    for (name, left) in
        [("record", "run.json"), ("part", "checkpoint.new/state.json"), ("nameless", "checkpoint/state.json")]
    {
        let left = at(name).join(left);
        std::fs::create_dir_all(left.parent().unwrap()).unwrap();
        std::fs::write(&left, &record).unwrap();
        let refused = run(&at(name), false, None).train().unwrap_err().to_string();
        assert!(refused.contains("nothing, or what "), "no list names it: {refused}");
        let list = ["run.json", "checkpoint.new/", "checkpoint.new/state.json", "checkpoint/", "checkpoint/state.json"];
        std::fs::write(at(name).join("train.files"), format!("elunar files 1\n{}\n", list.join("\n"))).unwrap();
        assert!(run(&at(name), false, None).train().unwrap().finished);
        same(name);
    }
    // Weights without a checkpoint are somebody's work.
    std::fs::remove_dir_all(at("record/checkpoint")).unwrap();
    let refused = run(&at("record"), false, None).train().unwrap_err().to_string();
    assert!(refused.contains("found a run in it"), "{refused}");
}

#[test]
fn a_run_has_one_trainer_at_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let owner = elunar_base::output::Owner::of_folder(folder.path(), "test", []).unwrap();
    let refused = run(folder.path(), false, Some(1)).train().unwrap_err();
    assert!(matches!(refused, elunar_base::Error::Busy { .. }), "{refused}");
    drop(owner);
    run(folder.path(), false, Some(1)).train().unwrap();
}

#[test]
fn a_run_is_never_overwritten_or_mixed_with_another() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), false, Some(1)).train().unwrap();
    let again = run(folder.path(), false, None).train().unwrap_err().to_string();
    assert!(again.contains("--resume"), "{again}");
    let mut other = run(folder.path(), true, None);
    other.record.seed = 6;
    let mixed = other.train().unwrap_err().to_string();
    assert!(mixed.contains("found another"), "{mixed}");
}

#[test]
fn a_checkpoint_with_a_flipped_byte_or_without_an_optimiser_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), false, Some(2)).train().unwrap();
    let path = folder.path().join("checkpoint/optimiser.safetensors");
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let refused = || run(folder.path(), true, None).train().unwrap_err().to_string();
    assert!(refused().contains("SHA-256"), "{}", refused());
    // Earlier versions had a file of another name and form.
    std::fs::remove_file(&path).unwrap();
    assert!(refused().contains("the version of the program that began the run"), "{}", refused());
}

#[test]
fn a_critic_learns_and_is_felt() {
    let folder = tempfile::tempdir().unwrap();
    let (network, recipe) = rival();
    let without = Recipe { adversarial: None, ..recipe.clone() };
    let weights = |name: &str, recipe: Recipe| {
        let path = folder.path().join(name);
        assert!(run_of((network.clone(), recipe), &path, false, None).train().unwrap().finished);
        std::fs::read(path.join(LAST)).unwrap()
    };
    assert!(weights("with", recipe) != weights("without", without));
    let critic = |step: &str| std::fs::read(folder.path().join(step).join("checkpoint/critic.safetensors"));
    assert!(critic("without").is_err());
    let path = folder.path().join("begun");
    run_of(rival(), &path, false, Some(1)).train().unwrap();
    assert!(critic("begun").unwrap() != critic("with").unwrap());
}

/// Returns trainable weights and running statistics after steps on the same micro-batches. Each micro-batch holds the crops of one of the
/// feed's steps.
fn learnt_and_seen(recipe: &Recipe, micro: &[usize], steps: usize) -> [Vec<f32>; 2] {
    let (network, _) = miniature();
    // A head of zeros passes no gradient, so that the layers before it would not change in the first step.
    let weights = without_zeros(initial_weights(&network, 1));
    let devices = Backend::Flex.devices(recipe.devices).unwrap();
    let mut trainer = Trainer::new(&network, recipe, &weights, Path::new("weights"), devices).unwrap();
    let feed = Feed::new(Arc::new(Ripples), network.clone(), recipe.clone(), 5);
    for step in 0..steps {
        let batch = |(i, &of): (usize, &usize)| tensors(&feed.batch(of).unwrap(), trainer.device_of(i, micro.len()));
        let micro = micro.iter().enumerate().map(batch).collect();
        trainer.step(recipe, step, micro).unwrap();
    }
    let after = store::save(&network, &trainer.net).tensors;
    let (seen, trained): (Vec<_>, Vec<_>) = after.into_iter().partition(|(name, _)| name.contains(".running_"));
    [trained, seen].map(|arrays| arrays.into_iter().flat_map(|(_, array)| array.data).collect())
}

/// Returns the trainable weights after a step on micro-batches.
fn learnt(recipe: &Recipe, micro: &[usize]) -> Vec<f32> {
    let [learnt, _] = learnt_and_seen(recipe, micro, 1);
    learnt
}

#[test]
fn half_precision_learns_as_well() {
    let (network, recipe) = miniature();
    let folder = tempfile::tempdir().unwrap();
    let losses = |precision: TrainingPrecision| -> Vec<f64> {
        let recipe = Recipe { precision, steps: 60, validate_every: 60, checkpoint_every: 60, ..recipe.clone() };
        let path = folder.path().join(format!("{precision:?}"));
        assert!(run_of((network.clone(), recipe), &path, false, None).train().unwrap().finished);
        let text = std::fs::read_to_string(path.join("steps.csv")).unwrap();
        text.lines().skip(1).map(|line| line.split(',').nth(2).unwrap().parse().unwrap()).collect()
    };
    let [full, half] = [TrainingPrecision::F32, TrainingPrecision::Bf16].map(losses);
    let mean = |losses: &[f64]| losses.iter().sum::<f64>() / losses.len() as f64;
    let [(first, last), (_, half)] = [&full, &half].map(|losses| (mean(&losses[..5]), mean(&losses[55..])));
    println!("loss {first:.4} at first, {last:.4} in f32 and {half:.4} in bf16 at last");
    assert!(last < 0.8 * first && (half / last - 1.0).abs() < 0.1);
}

#[test]
fn devices_learn_what_one_learns_from_their_micro_batches() {
    let (_, one) = miniature();
    let two = Recipe { devices: 2, ..one.clone() };
    let [alone, together] = [&one, &two].map(|recipe| learnt_and_seen(recipe, &[0, 1], 3));
    assert!(alone[0] == together[0], "weights differ");
    // They leave out the same branches of the same samples.
    let shallow = |recipe: &Recipe| learnt_and_seen(&Recipe { drop_path: 0.5, ..recipe.clone() }, &[0, 1], 3);
    let [alone_shallow, together_shallow] = [&one, &two].map(shallow);
    assert!(alone_shallow[0] == together_shallow[0], "weights differ with stochastic depth");
    assert!(alone_shallow[0] != alone[0], "stochastic depth changes nothing");
    // Each device processes two of four micro-batches, and the rounding order of sums differs.
    let [alone, together] = [&one, &two].map(|recipe| learnt(recipe, &[0, 1, 2, 3]));
    let apart = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>();
    assert!(apart(&alone, &together) < 1e-3 * apart(&alone, &learnt(&one, &[0, 1])));
    // Running statistics are the means of the devices' statistics.
    let [[_, first], [_, second]] = [0, 1].map(|micro| learnt_and_seen(&one, &[micro], 1));
    let [_, both] = learnt_and_seen(&two, &[0, 1], 1);
    for ((a, b), mean) in first.iter().zip(&second).zip(&both) {
        assert!((0.5 * (a + b) - mean).abs() <= 1e-6 * mean.abs().max(1e-3), "{mean} of {a} and {b}");
    }
    assert!(first != second);
}

#[test]
fn checkpointing_changes_no_weight() {
    let (_, recipe) = miniature();
    let saving = Recipe { checkpointing: true, ..recipe.clone() };
    assert!(learnt(&recipe, &[0]) == learnt(&saving, &[0]));
}

#[test]
fn every_micro_batch_counts_and_their_order_does_not() {
    let (_, recipe) = miniature();
    // AdamW's first step depends on the gradients' signs. If another gradient reverses a weight's direction, the weights differ by two
    // rates.
    let apart = |a: &[usize], b: &[usize]| -> f64 {
        let (a, b) = (learnt(&recipe, a), learnt(&recipe, b));
        let squares = a.iter().zip(&b).map(|(a, b)| f64::from(a - b).powi(2));
        (squares.sum::<f64>() / a.len() as f64).sqrt() / recipe.learning_rate_at(0)
    };
    for same in [apart(&[0, 1], &[1, 0]), apart(&[0, 0, 0, 0], &[0])] {
        assert!(same < 1e-3, "{same}");
    }
    for other in [apart(&[0, 1], &[0]), apart(&[0, 1], &[1]), apart(&[0], &[1])] {
        assert!(other > 0.2, "{other}");
    }
}

/// A turned tile is the tile of turned ground under a turned Sun.
#[test]
fn turned_samples_are_samples_of_turned_ground() {
    let config = NetConfig { illumination: Illumination::Sloped, ..miniature_network() };
    let mut tile = Ripples.tile(3).unwrap();
    tile.sun = KnownSun { azimuth_deg: Some(290.0), elevation_deg: Some(30.0) };
    let (rows, cols) = (tile.rows, tile.cols);
    let turn = |map: &[f32]| (0..rows * cols).map(|i| map[i % rows * cols + i / rows]).collect::<Vec<f32>>();
    let turned = RawTile {
        image: turn(&tile.image),
        coarse_m: turn(&tile.coarse_m),
        truth_m: turn(&tile.truth_m),
        // Exchanging east and south takes 290 degrees (20 north of west) to 340 (20 west of north).
        sun: KnownSun { azimuth_deg: Some(340.0), elevation_deg: Some(30.0) },
        ..tile.clone()
    };
    let (found, expected) = (Sample::new(&config, &tile).unwrap().transposed(), Sample::new(&config, &turned).unwrap());
    for (found, expected) in
        [(&found.image, &expected.image), (&found.coarse, &expected.coarse), (&found.truth, &expected.truth)]
    {
        assert_eq!(found.len(), expected.len());
        let apart = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart < 2e-3, "{apart}");
    }
    assert!(found.image != Sample::new(&config, &tile).unwrap().image);
}
