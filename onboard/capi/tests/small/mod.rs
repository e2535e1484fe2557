//! Small models made by hand, for what would take too long with the shipped one.
#![allow(dead_code)] // each test file uses only some functions

use elunar_core::nn::file::*;
use elunar_core::nn::{Kernel, Model, Progress, Runner, TruthRange, required};

/// Rows and columns of the tile.
pub(crate) const SHAPE: (usize, usize) = (4, 6);
/// Number of pixels.
pub(crate) const PX: usize = SHAPE.0 * SHAPE.1;

/// Returns a tensor of one channel, `margin` columns wider on each side.
fn tensor(dtype: Dtype, size: (usize, usize), margin: usize, offset: usize) -> Tensor {
    let t = Tensor { margin, offset, scale: 1.0 / 255.0, ..Tensor::new(dtype, size, 1) };
    Tensor { hi: if dtype == Dtype::U8 { 255 } else { 0 }, pitch: t.row_bytes(), ..t }
}

/// Returns a convolution of one channel by a square kernel, with the constants of [`constants`].
fn conv(first: usize, out: usize, kernel: usize, float: bool) -> Operator {
    Operator::Conv(Conv {
        out: out as u32,
        first: first as u32,
        kernel_rows: kernel,
        kernel_cols: kernel,
        pad: kernel / 2,
        weights: if kernel == 1 { 108 } else { 0 },
        bias: 96,
        multipliers: if float { 104 } else { 100 },
        shift: if float { 0 } else { 8 },
        ..Conv::default()
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
    let content = Content {
        tensors,
        operators,
        schedule,
        constants: &constants(),
        tile: shape,
        truth_range: TruthRange::Reference,
        roles: [0, NONE, tensors.len() as u32 - 1],
        alignment: 8,
        ..Content::default()
    };
    let mut bytes = vec![0; content.file_bytes()];
    content.write(&mut bytes).unwrap();
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
    set_word(&mut bytes, word::SELF_TEST_CRC, crc);
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
