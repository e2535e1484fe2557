//! A tiny model, scenes, memory with guards, and a simple implementation that has the whole scene.

use crate::fill::fill_gaps;
use crate::mask::is_real;
use crate::nn::file::{Conv, Dtype, Operator, Tensor};
use crate::nn::tests::draft::Draft;
use crate::nn::{Lighting, Model, Progress, Runner, required};
use crate::norm::intensity::normalise;
use crate::norm::{Anchor, ElevationScale};
use crate::overlap::{Open, OverlapWeights};
use crate::pixels::PixelForm;
use crate::strip::{Next, Strip, StripMemory, StripPlan, StripSettings};
use crate::tile::{Shape, Tiling};

pub(super) const TILE: Shape = Shape::new(12, 10);

/// Returns a model whose heights are its image, with an additional layer that only takes time.
pub(super) fn file() -> Vec<u8> {
    file_of(50.0)
}

/// As [`file`], with so much for the brightest pixel of the image.
pub(super) fn file_of(most: f32) -> Vec<u8> {
    let mut draft = Draft::new((TILE.rows, TILE.cols));
    draft.tensors[0].scale = 1.0 / 255.0;
    draft.made(Tensor { lo: 0, hi: 255, ..Tensor::new(Dtype::U8, (TILE.rows, TILE.cols), 40) });
    draft.finish();
    let Some(Operator::Conv(Conv { weights, multipliers, .. })) = draft.operators.last().copied() else { panic!() };
    draft.constants[weights] = 1;
    draft.constants[multipliers..multipliers + 4].copy_from_slice(&(most / 255.0).to_le_bytes());
    draft.in_order();
    draft.file()
}

pub(super) fn settings(cols: usize, ring_lines: usize) -> StripSettings {
    StripSettings {
        cols,
        ring_lines,
        overlap_px: 3,
        pixel_m: 2.0,
        coarse_px: 4.0,
        anchor: true,
        checked: false,
        light: Lighting::NOT_ASKED,
        pixels: PixelForm::F32,
        posts: None,
        expected_errors: false,
    }
}

/// A scene with voids of all kinds in both maps.
pub(super) struct Scene {
    pub(super) rows: usize,
    pub(super) cols: usize,
    pub(super) image: Vec<f32>,
    pub(super) coarse_m: Vec<f32>,
}

impl Scene {
    pub(super) fn new(rows: usize, cols: usize) -> Self {
        let noise = |i: usize| ((i * 2654435761) >> 7) % 251;
        let gap = |i: usize, every: usize| match noise(i) % every {
            0 => Some(f32::NAN),
            1 => Some(f32::from_bits(0xFF7F_FFFB)),
            2 => Some(f32::INFINITY),
            _ => None,
        };
        let image = |i: usize| gap(i, 83).unwrap_or(100.0 + noise(i * 3 + 1) as f32);
        let height = |i: usize| -1900.0 + ((i % cols) as f32 / 7.0).sin() * 20.0 + (i / cols) as f32 * 0.3;
        let coarse_m = |i: usize| gap(i + 77, 61).unwrap_or(height(i));
        let all = 0..rows * cols;
        Self { rows, cols, image: all.clone().map(image).collect(), coarse_m: all.map(coarse_m).collect() }
    }

    pub(super) fn line(&self, row: usize) -> (&[f32], &[f32]) {
        (&self.image[row * self.cols..][..self.cols], &self.coarse_m[row * self.cols..][..self.cols])
    }

    /// Returns the heights of the whole scene: every tile separately, all sums at once.
    pub(super) fn heights_m(&self, file: &[u8], settings: &StripSettings) -> Vec<f32> {
        let (rows, cols) = (self.rows, self.cols);
        let tiling =
            Tiling::new(Shape::new(rows.max(TILE.rows), cols.max(TILE.cols)), TILE, settings.overlap_px).unwrap();
        let weights = OverlapWeights::new(TILE);
        let (mut sums, mut totals) = (vec![0.0; rows * cols], vec![0.0; rows * cols]);
        for window in tiling.iter() {
            let from = |i: usize| {
                let (r, c) = (window.row + i / TILE.cols, window.col + i % TILE.cols);
                (r.min(rows - 1) * cols + c.min(cols - 1), r < rows && c < cols)
            };
            let real = |v: f32| if is_real(v) { v } else { f32::NAN };
            let image: Vec<f32> = (0..TILE.rows * TILE.cols).map(|i| real(self.image[from(i).0])).collect();
            let coarse_m: Vec<f32> = (0..TILE.rows * TILE.cols).map(|i| real(self.coarse_m[from(i).0])).collect();
            let valid = |i: usize| from(i).1 && image[i].is_finite() && coarse_m[i].is_finite();
            let Some(heights_m) = tile(file, &image, &coarse_m, settings) else { continue };
            let mut line = vec![0.0; TILE.cols];
            for i in 0..TILE.rows * TILE.cols {
                let mut scratch = vec![0.0; OverlapWeights::scratch_len(TILE.cols)];
                weights.line(Open::of(window, Shape::new(rows, cols)), i / TILE.cols, &mut line, &mut scratch).unwrap();
                if valid(i) {
                    sums[from(i).0] += line[i % TILE.cols] * f64::from(heights_m[i]);
                    totals[from(i).0] += line[i % TILE.cols];
                }
            }
        }
        sums.iter().zip(totals).map(|(s, t)| (s / t) as f32).collect()
    }

    /// Returns the number of tiles over every pixel.
    pub(super) fn tiles(&self, settings: &StripSettings) -> Vec<usize> {
        let (rows, cols) = (self.rows, self.cols);
        let whole = Shape::new(rows.max(TILE.rows), cols.max(TILE.cols));
        let windows: Vec<_> = Tiling::new(whole, TILE, settings.overlap_px).unwrap().iter().collect();
        let over = |i: usize| {
            let near = |at: usize, first: usize, len: usize| at >= first && at - first < len;
            windows.iter().filter(|w| near(i / cols, w.row, w.rows) && near(i % cols, w.col, w.cols)).count()
        };
        (0..rows * cols).map(over).collect()
    }

    /// Checks that heights are those of the whole scene: bit for bit under up to two tiles, else up to the next float.
    pub(super) fn assert_heights(&self, found: &[f32], expected: &[f32], settings: &StripSettings, what: &str) {
        let near = |a: f32, b: f32| a.is_nan() && b.is_nan() || a.to_bits().abs_diff(b.to_bits()) <= 1;
        let take = |values: &[f32], many: bool| -> Vec<f32> {
            let tiles = self.tiles(settings).into_iter();
            values.iter().zip(tiles).filter(|(_, tiles)| (*tiles > 2) == many).map(|(v, _)| *v).collect()
        };
        assert_eq!(found.len(), expected.len(), "{what}");
        assert_same(&take(found, false), &take(expected, false), what);
        let (found, expected) = (take(found, true), take(expected, true));
        let differs = found.iter().zip(&expected).position(|(a, b)| !near(*a, *b));
        assert_eq!(differs.map(|i| (i, found[i], expected[i])), None, "{what}");
        let others = found.iter().zip(&expected).filter(|(a, b)| a.to_bits() != b.to_bits() && !a.is_nan()).count();
        assert!(50 * others <= found.len() + 100, "{what}: {others} of {}", found.len());
    }
}

/// Returns the heights of one tile whose voids are not filled yet; `None` without a pixel that is real in both maps.
fn tile(file: &[u8], image: &[f32], coarse_m: &[f32], settings: &StripSettings) -> Option<Vec<f32>> {
    if !image.iter().zip(coarse_m).any(|(v, z)| v.is_finite() && z.is_finite()) {
        return None;
    }
    let (mut image, mut coarse_m) = (image.to_vec(), coarse_m.to_vec());
    for map in [&mut image, &mut coarse_m] {
        fill_gaps(map, TILE.cols, &mut vec![0.0; TILE.rows * TILE.cols]).unwrap();
    }
    let model = Model::new(file).unwrap();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    let (mut bright, mut coarse) = (vec![0.0; image.len()], vec![0.0; image.len()]);
    let Ok(_) = normalise(&image, None, &mut bright) else { return Some(coarse_m) };
    let Ok(scale) = ElevationScale::from_heights(&coarse_m, None, model.nr()) else { return Some(coarse_m) };
    scale.normalise(&coarse_m, &mut coarse).unwrap();
    runner.begin(&bright, &coarse).unwrap();
    while runner.step(u64::MAX).unwrap() == Progress::Running {}
    let (mut found, mut heights_m) = (vec![0.0; image.len()], vec![0.0; image.len()]);
    runner.output(&mut found).unwrap();
    scale.recover(&found, &mut heights_m).unwrap();
    if settings.anchor {
        let (mut difference, mut sums) = (vec![0.0; image.len()], vec![0.0; Anchor::sums_len(TILE.rows, TILE.cols)]);
        let anchor = Anchor::new(settings.coarse_px);
        anchor.apply(&mut heights_m, &coarse_m, TILE.cols, &mut difference, &mut sums).unwrap();
    }
    Some(heights_m)
}

/// Number of values behind each block that must not change.
const GUARDS: usize = 8;

/// The blocks of a plan, with exactly its lengths and guards behind them.
pub(super) struct Blocks {
    arena: Vec<u8>,
    samples: Vec<f32>,
    sums: Vec<f64>,
    valid: Vec<u8>,
}

impl Blocks {
    pub(super) fn new(plan: &StripPlan) -> Self {
        Self {
            arena: vec![0xA5; plan.arena_bytes() + GUARDS],
            samples: vec![-7.5; plan.samples_len() + GUARDS],
            sums: vec![-7.5; plan.sums_len() + GUARDS],
            valid: vec![0xA5; plan.bytes_len() + GUARDS],
        }
    }

    /// Lends the blocks without their guards.
    pub(super) fn lend(&mut self) -> (&mut [u8], StripMemory<'_>) {
        let Self { arena, samples, sums, valid } = self;
        let lent = [arena.len(), samples.len(), sums.len(), valid.len()].map(|len| len - GUARDS);
        let memory =
            StripMemory { samples: &mut samples[..lent[1]], sums: &mut sums[..lent[2]], bytes: &mut valid[..lent[3]] };
        (&mut arena[..lent[0]], memory)
    }

    /// First byte of the tile's coarse heights, counted as [`Self::flip`] does.
    pub(super) const COARSE: usize = 1 << 30;
    /// A byte behind them, in scratch memory.
    pub(super) const SCRATCH: usize = Self::COARSE + 4 * TILE.rows * TILE.cols;

    /// Flips a bit of a byte of what is kept between two calls: of all blocks but the sums, the arena included. From [`Self::COARSE`] on those of
    /// samples are counted.
    pub(super) fn flip(&mut self, place: usize, bit: usize) {
        let Self { arena, samples, valid, .. } = self;
        let lens = [arena.len(), 4 * samples.len(), valid.len()].map(|len| len - GUARDS * 4);
        let at = place % lens.iter().sum::<usize>();
        let mask = 1 << bit;
        match () {
            () if at < lens[0] => arena[at] ^= mask,
            () if at < lens[0] + lens[1] => {
                let (at, v) = (at - lens[0], &mut samples[(at - lens[0]) / 4]);
                *v = f32::from_bits(v.to_bits() ^ u32::from(mask) << (8 * (at % 4)));
            }
            () => valid[at - lens[0] - lens[1]] ^= mask,
        }
    }

    /// Changes a byte of the rings, of which those of the image come first.
    pub(super) fn change_ring(&mut self, byte: usize) {
        self.valid[byte] ^= 0x80;
    }

    /// Sets a byte of the samples, from [`Self::COARSE`] on.
    pub(super) fn set(&mut self, place: usize, value: u8) {
        let (at, shift) = ((place - Self::COARSE) / 4, (place - Self::COARSE) % 4 * 8);
        let bits = self.samples[at].to_bits() & !(0xff << shift) | u32::from(value) << shift;
        self.samples[at] = f32::from_bits(bits);
    }

    pub(super) fn assert_guards(&self) {
        assert!(self.arena.iter().rev().take(GUARDS).all(|v| *v == 0xA5));
        assert!(self.samples.iter().rev().take(GUARDS).all(|v| *v == -7.5));
        assert!(self.sums.iter().rev().take(GUARDS).all(|v| *v == -7.5));
        assert!(self.valid.iter().rev().take(GUARDS).all(|v| *v == 0xA5));
    }
}

/// Takes all finished lines and checks that they come in order.
pub(super) fn take(strip: &mut Strip<'_, '_>, cols: usize, found: &mut Vec<f32>) {
    let mut line = vec![0.0; cols];
    while let Some(row) = strip.take_line(&mut line).unwrap() {
        assert_eq!(row, found.len() / cols);
        found.extend_from_slice(&line);
    }
}

/// Runs a scene through a strip with steps of `budget_macs`. With `eager` it steps as long as possible after every line, otherwise only
/// when necessary.
pub(super) fn run(file: &[u8], scene: &Scene, settings: StripSettings, budget_macs: u64, eager: bool) -> Vec<f32> {
    let model = Model::new(file).unwrap();
    let plan = StripPlan::new(&model, settings).unwrap();
    let mut blocks = Blocks::new(&plan);
    let (arena, memory) = blocks.lend();
    let mut strip = Strip::new(plan, Runner::new(model, arena).unwrap(), memory).unwrap();
    let mut found = vec![];
    for row in 0..scene.rows {
        let (image, coarse_m) = scene.line(row);
        while strip.push_line(image, coarse_m) == Err(crate::strip::StripError::Full) {
            assert_ne!(strip.wants(), Next::Push, "a strip that wants a line has room for it");
            if strip.step(budget_macs) == Next::Take {
                take(&mut strip, scene.cols, &mut found);
            }
        }
        while eager && strip.step(budget_macs) == Next::Step {}
        if eager {
            take(&mut strip, scene.cols, &mut found);
        }
    }
    strip.finish();
    while strip.wants() != Next::Done {
        if strip.step(budget_macs) == Next::Take {
            take(&mut strip, scene.cols, &mut found);
        }
    }
    take(&mut strip, scene.cols, &mut found);
    assert_eq!((strip.ready(), strip.step(1)), (0, Next::Done));
    blocks.assert_guards();
    found
}

/// Checks that all values are equal bit for bit; voids equal voids.
pub(super) fn assert_same(found: &[f32], expected: &[f32], what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let same = |a: &f32, b: &f32| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan();
    let differs = found.iter().zip(expected).position(|(a, b)| !same(a, b));
    assert_eq!(differs.map(|i| (i, found[i], expected[i])), None, "{what}");
}
