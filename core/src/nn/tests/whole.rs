//! Whole models from file to metres: their self tests pass, and no slice is shorter than validation has proven (a missing part fails a test
//! of this crate, see [`crate::part`]).

use super::kernels;
use crate::job::{Made, TileInput};
use crate::nn::file::{Content, Entry, Operator, Tensor, word};
use crate::nn::{Kernel, Lighting, Model, Progress, Runner, TileLight, Validation, required};
use crate::norm::Light;
use crate::tile::Shape;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Returns this crate's model file and the repository's files, which are absent if this crate is alone.
fn files() -> Vec<PathBuf> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let own = here.join("fixtures/tile-v4.eld");
    assert!(own.is_file(), "expected {}", own.display());
    let golden = ["int8", "int16", "mixed", "guided"].map(|name| format!("tests/golden/provoked/{name}.eld"));
    let others = golden.into_iter().chain(["host-train/models/nano.eld".into()]).map(|file| here.join("..").join(file));
    let (found, absent): (Vec<_>, Vec<_>) = others.partition(|file| file.is_file());
    if !absent.is_empty() {
        // Not `eprintln!`, because the test runner hides its text for tests that pass.
        let _ = writeln!(std::io::stderr(), "SKIPPED: whole models: this crate stands alone, without {absent:?}");
    }
    std::iter::once(own).chain(found).collect()
}

fn finish(runner: &mut Runner<'_, '_>) {
    while runner.step(1 << 24).unwrap() == Progress::Running {}
}

/// Runs a self test and a tile in metres, as in flight, with and without protection of memory.
fn run(kernel: Kernel, model: Model<'_>, protect: bool) {
    let Shape { rows, cols } = model.tile();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::with_kernel(kernel, model, &mut arena).unwrap();
    runner.protect(protect);
    runner.begin_self_test().unwrap();
    finish(&mut runner);
    runner.check_self_test().unwrap();
    let image: Vec<f32> = (0..rows * cols).map(|i| 90.0 + ((i * 2_654_435_761) >> 7 & 63) as f32).collect();
    let coarse_m: Vec<f32> = (0..rows * cols).map(|i| -1900.0 + (i / cols) as f32 + (i % cols) as f32 / 3.0).collect();
    let light = TileLight::Scene(Lighting::given(Light { east: 20.0, south: 20.0 }));
    let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: model.tile(), light };
    let (made, heights_m) = crate::job::tests::made(&mut runner, &tile, 1 << 24);
    assert_eq!(made, Made::Predicted);
    assert!(heights_m.len() == rows * cols && heights_m.iter().all(|h| h.is_finite()));
}

#[test]
fn healthy_models_use_only_what_is_there() {
    for file in files() {
        let bytes = std::fs::read(&file).unwrap();
        for kernel in kernels() {
            run(kernel, Model::new(&bytes).unwrap(), true);
        }
        run(Kernel::best(), Model::new(&bytes).unwrap(), false);
    }
}

#[test]
fn a_file_that_is_read_and_written_again_is_the_same_file() {
    for file in files() {
        let bytes = std::fs::read(&file).unwrap();
        let model = Model::new(&bytes).unwrap();
        let tensors: Vec<Tensor> = (0..model.tensor_count()).map(|i| model.tensor(i as u32)).collect();
        let operators: Vec<Operator> = (0..model.operator_count()).map(|i| model.operator(i).unwrap()).collect();
        let schedule: Vec<Entry> = (0..model.entry_count()).map(|i| model.entry(i).unwrap()).collect();
        let constants = model.raw().section(word::CONSTANTS, model.constants_bytes() as u64).unwrap();
        let content = Content {
            text: model.text(),
            tensors: &tensors,
            operators: &operators,
            schedule: &schedule,
            constants,
            tile: (model.tile().rows, model.tile().cols),
            nr: model.nr(),
            range_margin: model.range_margin(),
            truth_range: model.truth_range(),
            illumination: model.illumination(),
            roles: [model.image_tensor(), model.raw().word(word::COARSE), model.output_tensor()],
            self_test: model.self_test(),
            alignment: 8,
        };
        let mut again = vec![0xff; content.file_bytes()];
        content.write(&mut again).unwrap();
        assert!(again == bytes, "{}", file.display());
        assert_eq!(content.write(&mut again[1..]), None, "a byte too few");
    }
}

#[test]
fn a_validation_in_parts_is_the_same_validation() {
    for file in files() {
        let bytes = std::fs::read(&file).unwrap();
        let mut work = 0;
        let whole = Model::new_counted(&bytes, &mut work).unwrap().verdict();
        for budget in [0, 3_000_000] {
            let (mut validation, mut parts) = (Validation::default(), 0);
            let model = loop {
                // Between two calls it is words.
                validation = Validation::from_words(validation.to_words()).unwrap();
                parts += 1;
                if let Some(model) = validation.advance(&bytes, budget).unwrap() {
                    break model;
                }
            };
            assert_eq!((model.verdict(), validation.spent()), (whole, work), "{}", file.display());
            assert!(budget > 0 || parts > model.operator_count() + model.raw().chunks() as usize, "{parts}");
        }
        // A byte that changes before its part is read is found.
        let mut spoilt = bytes.clone();
        *spoilt.last_mut().unwrap() ^= 1;
        let mut validation = Validation::default();
        assert!(validation.advance(&bytes, 0).unwrap().is_none());
        assert!(validation.advance(&spoilt, u64::MAX).is_err());
    }
}
