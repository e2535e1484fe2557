//! No file can harm the runner: with flipped bytes, truncated, or random under valid checksums.

use super::super::MapBits;
use super::{random_export, small_config};
use crate::config::{NetConfig, OutputHead};
use elunar_core::nn::file::{ENTRY_BYTES, HEADER_BYTES, OPERATOR_BYTES, TENSOR_BYTES, seal_file, word};
use elunar_core::nn::{Model, ModelError, Progress, Runner, required};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Returns a model with fewer weights than [`small_config`], so that every byte can be tried.
fn tiny() -> Vec<u8> {
    let narrow = NetConfig { embed: 2, depths: [1; 4], heads: [1; 4], window: 2, decoder: [2; 5], ..small_config() };
    let config = NetConfig { head: OutputHead::Residual, dtm: [1; 5], stem: 1, ..narrow };
    random_export(&config, (32, 32), MapBits::Mixed, 11).0.bytes
}

#[test]
fn every_flipped_byte_is_refused() {
    let good = tiny();
    println!("{} bytes", good.len());
    assert!(Model::new(&good).is_ok());
    let mut bytes = good.clone();
    for index in 0..good.len() {
        bytes[index] ^= 1 << (index % 8);
        assert!(Model::new(&bytes).is_err(), "byte {index}, one bit");
        bytes[index] = !good[index];
        assert!(Model::new(&bytes).is_err(), "byte {index}, all bits");
        bytes[index] = good[index];
    }
}

#[test]
fn every_truncation_and_extension_is_refused() {
    let mut bytes = tiny();
    for len in 0..bytes.len() {
        assert!(Model::new(&bytes[..len]).is_err(), "{len} bytes");
    }
    bytes.push(0);
    assert!(matches!(Model::new(&bytes), Err(ModelError::Length { .. })));
}

/// Loads a file and, if it is accepted, runs it for a bounded time.
fn provoke(bytes: &[u8]) -> bool {
    let Ok(model) = Model::new(bytes) else { return false };
    if required(&model) > 1 << 26 {
        return true;
    }
    let mut arena = vec![0x5a; required(&model)];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    runner.begin_self_test().unwrap();
    for _ in 0..200 {
        if runner.step(100_000).unwrap() == Progress::Done {
            break;
        }
    }
    true
}

#[test]
fn invented_programs_under_valid_checksums_do_no_harm() {
    let good = tiny();
    let field = |index: usize| u32::from_le_bytes(good[4 * index..4 * index + 4].try_into().unwrap()) as usize;
    let sections = [
        (0, HEADER_BYTES),
        (field(word::TENSORS), field(word::TENSORS + 1) * TENSOR_BYTES),
        (field(word::OPERATORS), field(word::OPERATORS + 1) * OPERATOR_BYTES),
        (field(word::SCHEDULE), field(word::SCHEDULE + 1) * ENTRY_BYTES),
        (field(word::CONSTANTS), field(word::CONSTANTS + 1)),
    ];
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let (mut accepted, rounds) = (0, 6000);
    for round in 0..rounds {
        let mut bytes = good.clone();
        for _ in 0..rng.random_range(1..=3) {
            let (start, len) = sections[round % sections.len()];
            let at = start + rng.random_range(0..len / 4) * 4;
            // The number of chunks determines where the checksums are. The flips above test a wrong number.
            if at == 4 * word::CHUNKS {
                continue;
            }
            let old = u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
            let new = match rng.random_range(0..6) {
                0 => rng.random(),
                1 => old.wrapping_add(rng.random_range(0..9)).wrapping_sub(4),
                2 => old ^ 1 << rng.random_range(0..32),
                3 => [0, 1, 0x7fff_ffff, 0x8000_0000, u32::MAX][rng.random_range(0..5)],
                4 => old.rotate_left(rng.random_range(0..32)),
                _ => rng.random_range(0..300),
            };
            bytes[at..at + 4].copy_from_slice(&new.to_le_bytes());
        }
        seal_file(&mut bytes);
        accepted += provoke(&bytes) as usize;
    }
    println!("{accepted} of {rounds} accepted and run");
    // Constants may change freely within their limits. Some files must be accepted, and most structures must not.
    assert!(accepted > rounds / 20 && accepted < rounds / 2, "{accepted}");
}
