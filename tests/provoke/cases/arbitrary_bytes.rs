//! The fuzz targets `kernels` and `model` on seeded bytes, without a nightly compiler.

use elunar_provoke::Random;
use elunar_provoke::model::{kernels, mutated_model, raw_model};

#[test]
fn kernels_agree_on_products_of_any_shape() {
    let mut random = Random(1);
    let (rounds, mut computed) = (40_000, 0);
    for _ in 0..rounds {
        let len = random.number() as usize % 400;
        computed += kernels(&random.bytes(len)) as usize;
    }
    println!("{computed} of {rounds} products computed");
    assert!(computed > rounds / 10 && computed < rounds, "{computed}");
}

#[test]
fn no_bytes_are_a_model_by_chance() {
    let mut random = Random(2);
    for _ in 0..2000 {
        let len = random.number() as usize % 3000;
        let mut bytes = random.bytes(len);
        if len > 8 {
            bytes[..8].copy_from_slice(&elunar_core::nn::file::MAGIC);
        }
        assert!(!raw_model(&bytes));
    }
}

#[test]
fn mutated_models_under_valid_checksums_do_no_harm() {
    let mut random = Random(3);
    let (rounds, mut accepted) = (3000, 0);
    for _ in 0..rounds {
        let patches = 1 + random.number() as usize % 3;
        accepted += mutated_model(&random.bytes(1 + 10 * patches)) as usize;
    }
    println!("{accepted} of {rounds} accepted and run");
    // Constants may change within their limits: some models must be accepted, and most changes of structure must be refused.
    assert!(accepted > rounds / 20 && accepted < rounds / 2, "{accepted}");
    (0..4).for_each(|model| assert!(mutated_model(&[model]), "unchanged model {model}"));
}
