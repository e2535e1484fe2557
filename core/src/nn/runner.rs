//! Runs a model in memory that the caller lends, a bounded amount of work at a time.

use super::arena::{Arena, OVERREAD, Row};
use super::crc::Crc32c;
use super::error::RunError;
use super::format::{NONE, Scrub};
use super::kernels::Kernel;
use super::model::Model;
use super::program::Tensor;
use super::self_test;
use crate::quant::params::quantise;

/// Bytes of arena that [`Runner::new`] needs for `model`: exactly, known before any run.
pub fn required(model: &Model<'_>) -> usize {
    model.scratch_offset() + model.scratch_bytes() + OVERREAD
}

/// Whether a tile is finished.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// More steps are needed.
    Running,
    /// The output can be read.
    Done,
}

/// Counters since the runner was made; they wrap never in a mission's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Telemetry {
    /// Tiles finished.
    pub tiles: u64,
    /// Calls of [`Runner::step`].
    pub steps: u64,
    /// Multiply-accumulates done.
    pub macs: u64,
    /// Input samples outside the range the model was calibrated for.
    pub inputs_clamped: u64,
    /// Intermediate results cut to their tensor's range.
    pub saturated: u64,
    /// Model bytes re-checked by [`Runner::scrub`].
    pub scrubbed_bytes: u64,
    /// Complete passes over the model.
    pub scrub_passes: u64,
    /// Chunks found changed.
    pub scrub_faults: u64,
    /// Self tests that failed.
    pub self_test_faults: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum State {
    Idle,
    At { entry: usize, step: usize, unit: usize },
    Done,
}

/// A model with its working memory. One tile at a time: `begin`, `step` until done, `output`.
#[derive(Debug)]
pub struct Runner<'a, 'm> {
    kernel: Kernel,
    model: Model<'a>,
    arena: Arena<'m>,
    pub(super) state: State,
    pub(super) scrub: Scrub,
    pub(super) telemetry: Telemetry,
}

impl<'a, 'm> Runner<'a, 'm> {
    /// Takes [`required`] bytes of `arena`; more do no harm, and no alignment is asked for. Computes with the fastest kernel
    /// this processor runs ([`Kernel::best`]).
    ///
    /// # Errors
    /// [`RunError::ArenaTooSmall`].
    pub fn new(model: Model<'a>, arena: &'m mut [u8]) -> Result<Self, RunError> {
        Self::with_kernel(Kernel::best(), model, arena)
    }

    /// As [`Self::new`], with a kernel of the caller's choice: the results are the same bytes.
    ///
    /// # Errors
    /// [`RunError::ArenaTooSmall`].
    pub fn with_kernel(kernel: Kernel, model: Model<'a>, arena: &'m mut [u8]) -> Result<Self, RunError> {
        let (required, found) = (required(&model), arena.len());
        if found < required {
            return Err(RunError::ArenaTooSmall { required, found });
        }
        let arena = Arena { bytes: &mut arena[..required], scratch: model.scratch_offset() };
        Ok(Self { kernel, model, arena, state: State::Idle, scrub: Scrub::default(), telemetry: Telemetry::default() })
    }

    /// Name of the kernel that computes.
    pub fn kernel(&self) -> &'static str {
        self.kernel.name()
    }

    /// The model.
    pub fn model(&self) -> &Model<'a> {
        &self.model
    }

    /// The counters.
    pub fn telemetry(&self) -> Telemetry {
        self.telemetry
    }

    /// Quantises a tile's inputs and stands ready for the first step. `image` in [0, 1] (or a guide's maps, [`Model::image_maps`] samples
    /// in every pixel), `coarse` in [0, NR] (or pixels), both row-major rows * cols; a tile in progress is dropped.
    ///
    /// # Errors
    /// [`RunError::TileSize`], or [`RunError::NotFinite`]; then nothing has begun.
    pub fn begin(&mut self, image: &[f32], coarse: &[f32]) -> Result<(), RunError> {
        self.state = State::Idle;
        let (rows, cols) = self.model.tile();
        for (input, maps) in [(image, self.model.image_maps()), (coarse, 1)] {
            let expected = maps * rows * cols;
            if input.len() != expected {
                return Err(RunError::TileSize { expected, found: input.len() });
            }
            if let Some(index) = input.iter().position(|v| !v.is_finite()) {
                return Err(RunError::NotFinite { index });
            }
        }
        self.load(|index| image[index], |index| coarse[index]);
        Ok(())
    }

    /// As [`Self::begin`] with the built-in tile; when done, [`Self::check_self_test`] judges it.
    pub fn begin_self_test(&mut self) {
        let ((seed, _), (_, cols), nr) = (self.model.self_test(), self.model.tile(), self.model.nr());
        let line = cols * self.model.image_maps();
        self.load(|i| self_test::image_sample(seed, line, i), |i| self_test::coarse_sample(seed, cols, i, nr));
    }

    pub(super) fn load(&mut self, image: impl Fn(usize) -> f32, coarse: impl Fn(usize) -> f32) {
        let model = self.model;
        self.load_codes(model.image_tensor(), image);
        if model.coarse_tensor() != NONE {
            self.load_codes(model.coarse_tensor(), &coarse);
        }
        self.state = State::At { entry: 0, step: 0, unit: 0 };
    }

    fn load_codes(&mut self, tensor: u32, sample: impl Fn(usize) -> f32) {
        let tensor = self.model.tensor(tensor);
        let inverse = 1.0 / tensor.scale;
        for row in 0..tensor.rows {
            let to = Row::of(&tensor, row);
            let (line, mut at) = (tensor.cols * tensor.channels, 0);
            while at < line {
                // Samples first: a loop over constants that asks for nothing becomes vectors.
                const TOGETHER: usize = 64;
                let (mut values, mut codes, mut clamps) = ([0f32; TOGETHER], [0; TOGETHER], [0u32; TOGETHER]);
                let count = TOGETHER.min(line - at);
                for (i, value) in values[..count].iter_mut().enumerate() {
                    *value = sample(row * line + at + i);
                }
                for i in 0..TOGETHER {
                    let (kept, clamped) = quantise(values[i], inverse, tensor.zero, tensor.lo, tensor.hi);
                    (codes[i], clamps[i]) = (kept, clamped as u32);
                }
                self.telemetry.inputs_clamped += clamps[..count].iter().sum::<u32>() as u64;
                to.store(self.arena.bytes, at, &codes[..count]);
                at += count;
            }
            self.arena.fill_margins(&tensor, row);
        }
    }

    /// Works until `budget_macs` multiply-accumulates are spent or the tile is done; at least one unit of work, so the budget
    /// is overrun by less than one unit ([`Model::unit_macs`]). The work does not depend on the data.
    ///
    /// # Errors
    /// [`RunError::State`] if no tile was begun.
    pub fn step(&mut self, budget_macs: u64) -> Result<Progress, RunError> {
        let State::At { mut entry, mut step, mut unit } = self.state else {
            return if self.state == State::Done { Ok(Progress::Done) } else { Err(RunError::State) };
        };
        self.telemetry.steps += 1;
        let mut spent = 0;
        while let Some(now) = self.model.entry(entry) {
            // The schedule names operators that exist.
            let Some(operator) = self.model.operator(now.operator) else { break };
            let units = self.model.units(&operator);
            while step < now.count {
                while unit < units {
                    if spent >= budget_macs.max(1) {
                        self.state = State::At { entry, step, unit };
                        return Ok(Progress::Running);
                    }
                    let cost = self.model.unit_macs(&operator, now.first + step, unit);
                    let cut = (self.kernel.unit)(&self.model, &operator, &mut self.arena, now.first + step, unit);
                    self.telemetry.saturated += cut;
                    self.telemetry.macs += cost;
                    (spent, unit) = (spent + cost, unit + 1);
                }
                (step, unit) = (step + 1, 0);
            }
            (entry, step) = (entry + 1, 0);
        }
        self.state = State::Done;
        self.telemetry.tiles += 1;
        Ok(Progress::Done)
    }

    /// Copies the finished tile: normalised elevation, row-major, in the units of `coarse`.
    ///
    /// # Errors
    /// [`RunError::State`] before the tile is done, [`RunError::TileSize`].
    pub fn output(&self, out: &mut [f32]) -> Result<(), RunError> {
        let tensor = self.finished()?;
        if out.len() != tensor.len() {
            return Err(RunError::TileSize { expected: tensor.len(), found: out.len() });
        }
        for (row, out) in out.chunks_exact_mut(tensor.cols * tensor.channels).enumerate() {
            out.iter_mut().enumerate().for_each(|(col, v)| *v = self.arena.float(&tensor, row, col));
        }
        Ok(())
    }

    fn finished(&self) -> Result<Tensor, RunError> {
        if self.state == State::Done { Ok(self.model.tensor(self.model.output_tensor())) } else { Err(RunError::State) }
    }

    /// CRC32C of the finished tile's little-endian f32 bytes.
    ///
    /// # Errors
    /// [`RunError::State`] before the tile is done.
    pub fn output_crc(&self) -> Result<u32, RunError> {
        let tensor = self.finished()?;
        let mut crc = Crc32c::default();
        for row in 0..tensor.rows {
            crc.update(&self.arena.bytes[tensor.row_offset(row)..][..tensor.row_bytes()]);
        }
        Ok(crc.value())
    }

    /// Compares the finished tile with the model's stored self-test result.
    ///
    /// # Errors
    /// [`RunError::SelfTest`] if they differ, [`RunError::State`] before the tile is done.
    pub fn check_self_test(&mut self) -> Result<(), RunError> {
        let (found, (_, expected)) = (self.output_crc()?, self.model.self_test());
        if found != expected {
            self.telemetry.self_test_faults += 1;
            return Err(RunError::SelfTest { expected, found });
        }
        Ok(())
    }

    /// Re-checks up to `max_bytes` of the model against its checksums, going round and round over calls.
    ///
    /// # Errors
    /// [`RunError::ModelChanged`] for a chunk that no longer matches; the next call goes on behind it.
    pub fn scrub(&mut self, max_bytes: usize) -> Result<(), RunError> {
        match self.scrub.advance(self.model.raw(), max_bytes) {
            Ok((bytes, pass)) => {
                self.telemetry.scrubbed_bytes += bytes as u64;
                self.telemetry.scrub_passes += pass as u64;
                Ok(())
            }
            Err(chunk) => {
                self.telemetry.scrub_faults += 1;
                Err(RunError::ModelChanged { chunk })
            }
        }
    }

    /// The entry of the schedule at work; the number of entries when done, `None` when idle.
    pub fn position(&self) -> Option<usize> {
        match self.state {
            State::Idle => None,
            State::At { entry, .. } => Some(entry),
            State::Done => Some(self.model.entry_count()),
        }
    }

    /// The arena's bytes of tensor `index` as they are now, from its first to its last: for tests and diagnosis.
    pub fn tensor_bytes(&self, index: u32) -> &[u8] {
        let tensor = self.model.tensor(index);
        &self.arena.bytes[tensor.offset..tensor.offset + tensor.size_bytes()]
    }
}
