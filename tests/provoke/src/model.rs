//! Arbitrary bytes as input of the integer runner: as products, as models, as changes to sound models.

use alloc::vec;
use alloc::vec::Vec;
use elunar_core::nn::file::{
    ENTRY_BYTES, HEADER_BYTES, OPERATOR_BYTES, TENSOR_BYTES, seal_file, set_word, u32_at, word,
};
use elunar_core::nn::{Kernel, MatrixProduct, Model, Progress, RunError, Runner, required};

/// Bytes before and after a lent arena, which must not change.
const GUARD: usize = 64;
const GUARD_BYTE: u8 = 0xc3;
/// Largest lent arena, bytes.
const LARGEST_ARENA: usize = 1 << 21;
/// Multiply-accumulates after which a tile is not continued.
const BUDGET_MACS: u64 = 1 << 22;

/// Reads numbers from the front of some bytes; zeros at the end of the bytes.
pub(crate) struct Reader<'a>(pub(crate) &'a [u8]);

impl Reader<'_> {
    pub(crate) fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }

    /// Returns a size, mostly small, sometimes near the largest number.
    pub(crate) fn size(&mut self, limit: usize) -> usize {
        match (self.byte() as usize, self.byte() as usize) {
            (255, n) => usize::MAX - n,
            (254, n) => (usize::MAX >> 1) - n,
            (253, n) => (usize::MAX >> 2) + 1 + n,
            (high, low) => (high << 8 | low) % limit,
        }
    }

    pub(crate) fn word(&mut self) -> u32 {
        u32::from_le_bytes(core::array::from_fn(|_| self.byte()))
    }
}

/// Computes a matrix product of any shape: every kernel of this machine refuses it like the scalar one, or returns the same numbers.
///
/// Returns whether there was a product to compute.
///
/// # Panics
/// If two kernels differ, or a refused product has changed its accumulators.
pub fn kernels(bytes: &[u8]) -> bool {
    let mut reader = Reader(bytes);
    let width = [8, 16, 32, 32, 16, 8, reader.byte() as usize][reader.byte() as usize % 7];
    let (pixels, stride, groups) = (reader.size(50), reader.size(40), reader.size(24));
    let starts: Vec<usize> = (0..reader.byte() % 6).map(|_| reader.size(90)).collect();
    let fill = reader.byte();
    let acc = vec![i32::from_le_bytes(core::array::from_fn(|_| reader.byte())); pixels.min(64).saturating_mul(width)];
    // The remaining bytes are both weights and activations. They may be too few; they are repeated for shapes that fit.
    let needed = groups.saturating_mul(4 * width).saturating_mul(starts.len()).min(1 << 16);
    let mut weights = reader.0.to_vec();
    let mut codes: Vec<u8> = reader.0.iter().rev().copied().collect();
    if fill % 4 != 0 {
        weights = weights.iter().copied().cycle().take(needed).collect();
        weights.resize(needed, fill);
        codes.resize(codes.len().max(4096), fill);
    }
    let product = |kernel: Kernel| {
        let mut acc = acc.clone();
        let (bytes, starts, weights) = (&codes[..], &starts[..], &weights[..]);
        let product = MatrixProduct { pixels, width, bytes, starts, stride, groups, weights };
        (kernel.matrix_product(&mut acc, &product), acc)
    };
    let expected = product(Kernel::SCALAR);
    assert!(expected.0.is_ok() || expected.1 == acc, "refused, and yet changed");
    for kernel in Kernel::available() {
        assert!(
            product(kernel) == expected,
            "{kernel:?}: {pixels} x {width}, {groups} groups, {stride} apart, {starts:?}"
        );
    }
    expected.0.is_ok() && pixels > 0 && groups > 0 && !starts.is_empty()
}

/// Uses any bytes as a model: refused, or run without memory errors.
pub fn raw_model(bytes: &[u8]) -> bool {
    run(bytes)
}

/// Replaces words of a sound model as `patches` says, under valid checksums. The model is refused, or runs without memory errors, and all
/// kernels agree.
///
/// Returns whether it was accepted.
///
/// # Panics
/// If kernels differ, or memory that was not lent has changed.
pub fn mutated_model(patches: &[u8]) -> bool {
    run(&mutated(patches))
}

/// Returns the model that [`mutated_model`] validates.
pub fn mutated(patches: &[u8]) -> Vec<u8> {
    let mut reader = Reader(patches);
    let models = sound_models();
    let sound = models[reader.byte() as usize % models.len()];
    let sections = sections(sound);
    let mut bytes = sound.to_vec();
    while !reader.0.is_empty() {
        let (start, len) = sections[reader.byte() as usize % sections.len()];
        let at = start + reader.word() as usize % (len / 4).max(1) * 4;
        let old = u32_at(&bytes, at);
        let new = changed(old, reader.byte(), reader.word());
        // The number of chunks gives the place of the checksums; with another number they could not be renewed.
        if at != 4 * word::CHUNKS {
            set_word(&mut bytes, at / 4, new);
        }
    }
    seal_file(&mut bytes);
    bytes
}

/// Returns offset and length of the header, and of the sections that contain records or constants.
pub(crate) fn sections(bytes: &[u8]) -> [(usize, usize); 5] {
    let field = |i: usize| u32_at(bytes, 4 * i) as usize;
    let section = |index: usize, size: usize| (field(index), field(index + 1) * size);
    [
        section(word::TENSORS, TENSOR_BYTES),
        section(word::OPERATORS, OPERATOR_BYTES),
        section(word::SCHEDULE, ENTRY_BYTES),
        section(word::CONSTANTS, 1),
        (0, HEADER_BYTES),
    ]
}

/// Returns another number for `old`: a neighbour, a flipped bit, an extreme, or any number.
pub(crate) fn changed(old: u32, how: u8, value: u32) -> u32 {
    match how % 6 {
        0 => value,
        1 => old.wrapping_add(value % 9).wrapping_sub(4),
        2 => old ^ 1 << (value % 32),
        3 => [0, 1, 0x7fff_ffff, 0x8000_0000, u32::MAX][value as usize % 5],
        // Numbers of the schedule have two bytes.
        4 => old.wrapping_add((value % 5) << 16).wrapping_sub(2 << 16),
        _ => value % 300,
    }
}

/// Loads a model and, if it is accepted, runs it for a bounded time with the fastest and the scalar kernel.
fn run(bytes: &[u8]) -> bool {
    let Ok(model) = Model::new(bytes) else { return false };
    let needed = required(&model);
    if needed > LARGEST_ARENA {
        return true;
    }
    let mut results = Vec::new();
    for kernel in [Kernel::best(), Kernel::SCALAR] {
        let mut memory = vec![GUARD_BYTE; needed + 2 * GUARD];
        let refused = Runner::with_kernel(kernel, model, &mut memory[..needed - 1]).map(|_| ());
        assert_eq!(refused, Err(RunError::ArenaTooSmall { required: needed, found: needed - 1 }));
        let mut runner = Runner::with_kernel(kernel, model, &mut memory[GUARD..GUARD + needed]).expect("enough memory");
        runner.begin_self_test().expect("the model is as it was");
        let mut done = false;
        while !done && runner.telemetry().macs < BUDGET_MACS {
            done = runner.step(100_000).expect("a tile is begun") == Progress::Done;
            runner.scrub(512).expect("the model does not change");
        }
        let crc = runner.output_crc();
        assert_eq!(crc.is_ok(), done);
        results.push((crc, runner.telemetry()));
        let (front, rest) = memory.split_at(GUARD);
        let guards = front.iter().chain(&rest[needed..]);
        assert!(guards.copied().all(|byte| byte == GUARD_BYTE), "memory outside the arena");
    }
    assert_eq!(results[0], results[1], "kernels differ");
    true
}

/// Returns models of the smallest networks with every operator, as `host-train` exports them: ../../golden/provoked.
pub fn sound_models() -> [&'static [u8]; 4] {
    [
        include_bytes!("../../golden/provoked/mixed.eld"),
        include_bytes!("../../golden/provoked/int8.eld"),
        include_bytes!("../../golden/provoked/int16.eld"),
        include_bytes!("../../golden/provoked/guided.eld"),
    ]
}
