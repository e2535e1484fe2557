//! The work of validating a model is at most `MAX_WORK` for each byte of its file; exported models stay far below.

use elunar_core::nn::Model;
use elunar_core::nn::file::MAX_WORK;
use elunar_provoke::Random;
use elunar_provoke::model::{mutated, sound_models};

/// Exported models may use a third of the limit at most, so that larger networks of the same kind are valid, too.
const EXPORTED: u64 = MAX_WORK / 3;

#[test]
fn exported_models_stay_far_below_the_limit() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
    let read = |path: &str| (path.to_string(), std::fs::read(format!("{root}/{path}")).unwrap());
    let folder = std::fs::read_dir(format!("{root}/host-train/models")).unwrap();
    let shipped = folder.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let shipped = shipped.filter(|name| name.ends_with(".eld")).map(|name| read(&format!("host-train/models/{name}")));
    let sound = (0..).map(|i| format!("golden/provoked {i}")).zip(sound_models().map(<[u8]>::to_vec));
    let mut count = 0;
    for (name, bytes) in shipped.chain([read("core/fixtures/tile-v4.eld")]).chain(sound) {
        let mut work = 0;
        let model = Model::new_counted(&bytes, &mut work).unwrap_or_else(|error| panic!("{name}: {error}"));
        let ratio = work as f64 / bytes.len() as f64;
        println!("{name}: {ratio:.1} for each of {} bytes, {} entries", bytes.len(), model.entry_count());
        assert!(work > 2 * bytes.len() as u64 && work < EXPORTED * bytes.len() as u64, "{name}: {ratio}");
        count += 1;
    }
    assert!(count >= 6, "{count}");
}

#[test]
fn no_change_of_an_exported_model_takes_more_than_the_limit() {
    let (mut random, mut most) = (Random(77), 0.0f64);
    for _ in 0..4000 {
        let patches = 1 + random.number() as usize % 6;
        let bytes = mutated(&random.bytes(1 + 10 * patches));
        let mut work = 0;
        _ = Model::new_counted(&bytes, &mut work);
        assert!(work <= MAX_WORK * bytes.len() as u64);
        most = most.max(work as f64 / bytes.len() as f64);
    }
    println!("at most {most:.1} for a byte");
    assert!(most > 2.0);
}
