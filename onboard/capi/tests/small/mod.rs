//! Small models made by hand, for what would take too long with the shipped one.
#![allow(dead_code)] // each test file uses only some functions

use elunar_core::nn::file::*;
use elunar_core::nn::{Kernel, Model, Progress, Runner, required};

/// Rows and columns of the tile.
pub(crate) const SHAPE: (usize, usize) = (4, 6);
/// Number of pixels.
pub(crate) const PX: usize = SHAPE.0 * SHAPE.1;

/// Returns a tensor that keeps all rows, `margin` columns wider on each side.
fn tensor(dtype: Dtype, (rows, cols): (usize, usize), margin: usize, offset: usize) -> Tensor {
    let hi = if dtype == Dtype::U8 { 255 } else { 0 };
    let pitch = (cols + 2 * margin) * dtype.bytes();
    let (zero, lo, scale, channels) = (0, 0, 1.0 / 255.0, 1);
    let edge = Edge::Zero;
    Tensor { dtype, rows, cols, channels, offset, zero, lo, hi, scale, ring: rows, pitch, margin, edge, sums: 0 }
}

/// Returns a convolution of one channel by a square kernel, with the constants of [`constants`].
fn conv(first: usize, out: usize, kernel: usize, float: bool) -> Operator {
    Operator::Conv(Conv {
        out: out as u32,
        first: first as u32,
        second: None,
        kernel_rows: kernel,
        kernel_cols: kernel,
        stride: 1,
        stride_cols: 1,
        pad: kernel / 2,
        block: 1,
        fold: false,
        weights: if kernel == 1 { 108 } else { 0 },
        bias: 96,
        multipliers: if float { 104 } else { 100 },
        shift: if float { 0 } else { 8 },
        add: None,
        add_multipliers: 0,
        add_shift: 0,
        table: None,
        table_zero: 0,
        relu: false,
    })
}

/// Nine weights of 1 in the first of eight channels, a bias of 0, a multiplier of 29/256, a scale of 0.05; one weight of 1.
fn constants() -> Vec<u8> {
    let (mut weights, mut single) = (vec![0; 96], vec![0; 32]);
    single[0] = 1;
    (0..9).for_each(|tap| weights[32 * (tap / 3) + tap % 3] = 1);
    [weights, vec![0; 4], 29i32.to_le_bytes().to_vec(), 0.05f32.to_le_bytes().to_vec(), single].concat()
}

/// Returns the file of a program over an image, tensor 0; the last operator writes the last tensor.
fn file(shape: (usize, usize), tensors: &[Tensor], operators: &[Operator], schedule: &[Entry]) -> Vec<u8> {
    let mut sums = 0;
    let mut counted = |t: &Tensor| {
        sums += t.ring;
        Tensor { sums: sums - t.ring, ..*t }.encode()
    };
    let sections: [(usize, Vec<u8>, usize); 5] = [
        (word::TEXT, b"{}      ".to_vec(), 2),
        (word::TENSORS, tensors.iter().flat_map(&mut counted).collect(), tensors.len()),
        (word::OPERATORS, operators.iter().flat_map(Operator::encode).collect(), operators.len()),
        (word::SCHEDULE, schedule.iter().flat_map(Entry::encode).collect(), schedule.len()),
        (word::CONSTANTS, constants(), constants().len()),
    ];
    let chunks = sections.iter().map(|s| s.1.len()).sum::<usize>().div_ceil(CHUNK_BYTES);
    let mut bytes = vec![0; HEADER_BYTES + CHUNK_RECORD_BYTES * chunks];
    bytes[..8].copy_from_slice(&MAGIC);
    let mut fields = vec![
        (word::VERSION, VERSION),
        (word::CHUNK_BYTES, CHUNK_BYTES as u32),
        (word::CHUNKS, chunks as u32),
        (word::TILE, shape.0 as u32),
        (word::TILE + 1, shape.1 as u32),
        (word::NR, 50f32.to_bits()),
        (word::TARGET_RANGE, 1),
        (word::IMAGE, 0),
        (word::COARSE, NONE),
        (word::OUTPUT, tensors.len() as u32 - 1),
    ];
    for (index, section, count) in sections {
        fields.extend([(index, bytes.len() as u32), (index + 1, count as u32)]);
        bytes.extend(section);
    }
    fields.push((word::FILE_BYTES, bytes.len() as u32));
    for (index, value) in fields {
        bytes[4 * index..4 * index + 4].copy_from_slice(&value.to_le_bytes());
    }
    seal_file(&mut bytes);
    bytes
}

/// Returns a model of two convolutions whose self test succeeds.
pub(crate) fn model() -> Vec<u8> {
    let tensors = [tensor(Dtype::U8, SHAPE, 1, 0), tensor(Dtype::U8, SHAPE, 1, 64), tensor(Dtype::F32, SHAPE, 0, 128)];
    let operators = [conv(0, 1, 3, false), conv(1, 2, 3, true)];
    let schedule = [0, 1].map(|operator| Entry { operator, first: 0, count: SHAPE.0 });
    let mut bytes = file(SHAPE, &tensors, &operators, &schedule);
    let model = Model::new(&bytes).unwrap();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::with_kernel(Kernel::SCALAR, model, &mut arena).unwrap();
    runner.begin_self_test().unwrap();
    while runner.step(u64::MAX).unwrap() == Progress::Running {}
    let crc = runner.output_crc().unwrap();
    bytes[4 * word::SELF_TEST_CRC..4 * word::SELF_TEST_CRC + 4].copy_from_slice(&crc.to_le_bytes());
    seal_file(&mut bytes);
    bytes
}

/// Returns a program of hundreds of maps in one place, each a row before the one that it is computed from: every pair must be compared.
pub(crate) fn slow_model() -> Vec<u8> {
    let (maps, rows) = (300, 4000);
    let shape = (rows, 1);
    let mut tensors: Vec<Tensor> = (0..maps).map(|map| tensor(Dtype::U8, shape, 0, maps - map)).collect();
    tensors.push(tensor(Dtype::F32, shape, 0, 64 * (maps + rows)));
    let operators: Vec<Operator> = (1..=maps).map(|map| conv(map - 1, map, 1, map == maps)).collect();
    let entry = |first, count| (0..maps).map(move |operator| Entry { operator, first, count });
    let schedule: Vec<Entry> = entry(0, 1).chain(entry(1, rows - 1)).collect();
    file(shape, &tensors, &operators, &schedule)
}
