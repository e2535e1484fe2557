//! The work that is disturbed: the golden flight tile, a unit of work at a time.
#![allow(unsafe_code)] // reads lent memory while the job has it

use elunar_base::{Error, Result, read};
use elunar_core::nn::{Kernel, KnownSun, Suspended, TileLight};
use elunar_core::tile::Shape;
use elunar_core::{Made, Model, Progress, Runner, TileInput, TileJob, TileMemory, TileRules, required};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering::SeqCst};

/// Most bytes of an input: more than a model has.
const MOST_BYTES: u64 = 1 << 30;
/// The rules of the golden tile.
const RULES: TileRules = TileRules { pixel_m: 2.0, coarse_px: 29.61, anchor: true, checked: true };
/// Its Sun.
const SUN: KnownSun = KnownSun { azimuth_deg: Some(189.488_525), elevation_deg: Some(25.614_722) };

/// A tile in progress, in memory that is never given back.
pub(crate) struct Tile {
    job: TileJob,
    runner: Runner<'static, 'static>,
    memory: TileMemory<'static>,
    input: TileInput<&'static [f32], &'static [f32]>,
    /// All memory that the work depends on.
    lent: Vec<(*const u8, usize)>,
}

fn floats(path: &Path) -> Result<&'static mut [f32]> {
    let bytes = read::bytes(path, MOST_BYTES)?;
    Ok(bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect::<Vec<_>>().leak())
}

fn place<T>(slice: &[T]) -> (*const u8, usize) {
    (slice.as_ptr().cast(), size_of_val(slice))
}

impl Tile {
    /// Prepares the golden tile (`image.f32`, `coarse_m.f32`, `valid.u8` of `folder`) for a model.
    ///
    /// # Errors
    /// Files that cannot be read or do not fit.
    pub(crate) fn new(model: &Path, folder: &Path, kernel: Kernel) -> Result<Self> {
        let file = read::bytes(model, MOST_BYTES)?.leak();
        let broken = |text: String| Error::input(format!("{}: {text}", model.display()));
        let model = Model::new(file).map_err(|e| broken(e.to_string()))?;
        let (shape, rules) = (model.tile(), model.input_rules());
        let (image, coarse) = (floats(&folder.join("image.f32"))?, floats(&folder.join("coarse_m.f32"))?);
        let counts = read::bytes(&folder.join("valid.u8"), MOST_BYTES)?;
        if [image.len(), coarse.len(), counts.len()] != [shape.pixels(); 3] {
            return Err(broken(format!("expected tiles like {}, found {shape:?}", folder.display())));
        }
        image.iter_mut().zip(&counts).filter(|(_, c)| **c == 0).for_each(|(v, _)| *v = f32::NAN);
        let arena = vec![0u8; required(&model)].leak();
        let memory = TileMemory {
            coarse_m: vec![0.0; shape.pixels()].leak(),
            valid: vec![0; TileMemory::valid_len(shape)].leak(),
            scratch: vec![0.0; TileMemory::scratch_len(&rules, shape)].leak(),
            lines: vec![0.0; TileMemory::lines_len(shape)].leak(),
        };
        let lent = vec![
            place(file),
            place(image),
            place(coarse),
            place(arena),
            place(memory.coarse_m),
            place(memory.valid),
            place(memory.scratch),
            place(memory.lines),
        ];
        let input = TileInput { image: &*image, coarse_m: &*coarse, inside: shape, light: TileLight::Own(SUN) };
        let runner = Runner::with_kernel(kernel, model, arena).map_err(|e| broken(e.to_string()))?;
        Ok(Self { job: TileJob::new(RULES, rules, shape), runner, memory, input, lent })
    }

    /// Returns the size of the tile.
    pub(crate) fn shape(&self) -> Shape {
        self.input.inside
    }

    /// Does a unit of work; returns whether the tile is finished. While the library works, `caller` is an address of the stack of its caller,
    /// otherwise 0.
    ///
    /// # Errors
    /// What the library reports.
    #[inline(never)]
    pub(crate) fn unit(&mut self, caller: &AtomicU64) -> std::result::Result<bool, String> {
        let mark = 0u64;
        caller.store(std::ptr::from_ref(&mark) as u64, SeqCst);
        let progress = if self.job.is_prepared() {
            self.job.run(&mut self.runner, &mut self.memory, 1)
        } else {
            self.job.prepare(&mut self.runner, &self.input, &mut self.memory, 1).map(|_| Progress::Running)
        };
        caller.store(0, SeqCst);
        progress.map(|progress| progress == Progress::Done).map_err(|error| error.to_string())
    }

    /// Returns what the next unit works on.
    pub(crate) fn phase(&self) -> &'static str {
        let model = self.runner.model();
        match self.runner.position() {
            _ if !self.job.is_prepared() => "preparation",
            Some(at) if at < model.entry_count() => {
                model.entry(at).and_then(|entry| model.operator(entry.operator)).map_or("network", |o| o.name())
            }
            _ if self.runner.suspend().phase == Suspended::DONE => "heights",
            _ => "comparison of the model",
        }
    }

    /// Returns the heights, and the bits of those that are valid; `None` if the tile was not made by the network.
    pub(crate) fn made(&self) -> Option<(&[f32], &[u8])> {
        let made = self.job.made() == Some(Made::Predicted);
        made.then(|| (self.job.heights_m(&self.memory), self.job.valid(&self.memory)))
    }

    /// Returns a checksum of all that the further work depends on.
    pub(crate) fn state(&self) -> u64 {
        let mut sum = Sum(0x9e37_79b9_7f4a_7c15);
        for &(start, bytes) in &self.lent {
            // SAFETY: memory of `new`, which is never given back; no other thread writes it.
            sum.add(unsafe { std::slice::from_raw_parts(start, bytes) });
        }
        self.job.to_words().iter().for_each(|word| sum.add(&word.to_le_bytes()));
        sum.add(format!("{:?}", self.runner.suspend()).as_bytes());
        sum.0
    }
}

/// A checksum of 64 bits.
struct Sum(u64);

impl Sum {
    fn add(&mut self, bytes: &[u8]) {
        let (words, rest) = bytes.as_chunks::<8>();
        let step = |sum: u64, word: u64| (sum.rotate_left(7) ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = words.iter().fold(self.0, |sum, word| step(sum, u64::from_le_bytes(*word)));
        self.0 = rest.iter().fold(self.0, |sum, byte| step(sum, u64::from(*byte)));
    }
}
