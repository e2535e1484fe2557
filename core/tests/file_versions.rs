//! A file of every supported version opens, runs, and gives the same bytes as when it was written.

use elunar_core::nn::file::{Operator, VERSION, word};
use elunar_core::nn::{Kernel, Model, ModelError, Progress, Runner, required};
use elunar_core::tile::Shape;
use std::path::Path;

const FILE: &[u8] = include_bytes!("../fixtures/tile-v4.eld");

/// Output of [`FILE`] for [`image`] and [`coarse`], as bytes.
const OUTPUT: &str = "fixtures/tile-v4.f32";

/// Returns brightness in [0, 1], exact in binary.
fn image(i: usize) -> f32 {
    (i * 37 % 256) as f32 / 256.0
}

/// Returns normalised heights in [0, 50), exact in binary: a slope with steps.
fn coarse(i: usize) -> f32 {
    (i / 32 + i % 32 / 8 * 4) as f32
}

fn output(kernel: Kernel, model: Model<'_>) -> Vec<u8> {
    let samples = model.tile().pixels();
    let image: Vec<f32> = (0..samples).map(image).collect();
    let coarse: Vec<f32> = (0..samples).map(coarse).collect();
    let mut arena = vec![0xa5; required(&model)];
    let mut runner = Runner::with_kernel(kernel, model, &mut arena).unwrap();
    runner.begin_self_test().unwrap();
    while runner.step(100_000).unwrap() == Progress::Running {}
    runner.check_self_test().unwrap();
    runner.begin(&image, &coarse).unwrap();
    while runner.step(100_000).unwrap() == Progress::Running {}
    let mut heights = vec![0.0; samples];
    runner.output(&mut heights).unwrap();
    heights.into_iter().flat_map(f32::to_le_bytes).collect()
}

#[test]
fn version_4_gives_the_bytes_it_gave() {
    assert_eq!(VERSION, 4, "a version without a file here");
    let model = Model::new(FILE).unwrap();
    assert_eq!((model.raw().word(word::VERSION), model.tile()), (4, Shape::new(32, 32)));
    let mut kinds: Vec<&str> =
        (0..model.operator_count()).map(|i| model.operator(i).as_ref().map_or("", Operator::name)).collect();
    kinds.sort_unstable();
    kinds.dedup();
    assert_eq!(kinds, ["attention", "conv", "layer-norm", "merge-norm", "up-conv", "upsampling"]);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(OUTPUT);
    if std::env::var_os("ELUNAR_WRITE_FIXTURE").is_some() {
        std::fs::write(&path, output(Kernel::SCALAR, model)).unwrap();
    }
    let expected = std::fs::read(&path).unwrap();
    assert_eq!(expected.len(), 4 * 32 * 32);
    for kernel in Kernel::available() {
        let found = output(kernel, model);
        let first = found.iter().zip(&expected).position(|(a, b)| a != b);
        assert_eq!((found.len(), first), (expected.len(), None), "{kernel:?}: length, first byte that differs");
    }
}

#[test]
fn other_versions_are_refused_by_their_number() {
    for version in [0, 1, 2, 3, 5, u32::MAX] {
        let mut file = FILE.to_vec();
        file[4 * word::VERSION..][..4].copy_from_slice(&version.to_le_bytes());
        assert_eq!(Model::new(&file).unwrap_err(), ModelError::Version { found: version });
    }
}
