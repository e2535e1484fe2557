//! Runs a model in memory that the caller lends, a bounded amount of work at a time.

use super::arena::{Arena, OVERREAD, Row};
use super::crc::Crc32c;
use super::dispatch::Kernel;
use super::error::RunError;
use super::file::{CHUNK_BYTES, NONE};
use super::model::Model;
use super::ops::Prepared;
use super::scrub::Scrub;
use super::self_test;
use super::tensor::Tensor;
use crate::part::{copy, head, head_mut, part, part_mut};
use crate::quant::params::quantise;
use crate::tile::Shape;
use core::hint::black_box;

/// Samples of an input that are looked at and quantised together.
const TOGETHER: usize = 64;

/// Returns the first sample that is not finite.
fn not_finite(samples: &[f32]) -> Option<usize> {
    // All of a piece are looked at together, which is faster than one after the other.
    let is_bad = |piece: &&[f32]| piece.iter().fold(0, |bad, v| bad | !v.is_finite() as u32) != 0;
    let first = samples.chunks(TOGETHER).position(|piece| is_bad(&piece))? * TOGETHER;
    samples.iter().skip(first).position(|v| !v.is_finite()).map(|at| first + at)
}

/// Number of bytes of arena that [`Runner::new`] needs for `model`: exact, and known before any run.
pub fn required(model: &Model<'_>) -> usize {
    sums_offset(model) + 4 * model.sum_count()
}

/// Offset of the checksums of rows: behind all other parts.
fn sums_offset(model: &Model<'_>) -> usize {
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

/// Counters since the runner was made. They do not wrap within the time of a mission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Telemetry {
    /// Tiles finished.
    pub tiles: u64,
    /// Calls of [`Runner::step`].
    pub steps: u64,
    /// Multiply-accumulates done.
    pub macs: u64,
    /// Input samples outside the range that the model was calibrated for.
    pub inputs_clamped: u64,
    /// Intermediate results cut to their tensor's range.
    pub saturated: u64,
    /// Bytes of the model compared by [`Runner::scrub`].
    pub scrubbed_bytes: u64,
    /// Complete passes over the model.
    pub scrub_passes: u64,
    /// Chunks found to have changed.
    pub scrub_faults: u64,
    /// Self tests that failed.
    pub self_test_faults: u64,
    /// Tiles that were given up because the model or a map had changed in memory.
    pub tile_faults: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum State {
    Idle,
    /// Rows of the self test's tile are loaded, from this one on.
    Loading {
        row: usize,
    },
    At {
        entry: usize,
        step: usize,
        unit: usize,
    },
    /// All operators are done; the model is compared from this chunk on.
    Verifying {
        chunk: u32,
    },
    Done,
}

/// A model with its working memory. It runs one tile at a time: `begin`, `step` until done, `output`.
#[derive(Debug)]
pub struct Runner<'a, 'm> {
    kernel: Kernel,
    model: Model<'a>,
    arena: Arena<'m>,
    pub(super) state: State,
    pub(super) protected: bool,
    pub(super) checked: bool,
    pub(super) scrub: Scrub,
    pub(super) telemetry: Telemetry,
}

impl<'a, 'm> Runner<'a, 'm> {
    /// Takes [`required`] bytes of `arena`, which may be longer and needs no alignment. Uses the fastest kernel that this processor runs
    /// ([`Kernel::best`]).
    ///
    /// # Errors
    /// [`RunError::ArenaTooSmall`].
    pub fn new(model: Model<'a>, arena: &'m mut [u8]) -> Result<Self, RunError> {
        Self::with_kernel(Kernel::best(), model, arena)
    }

    /// As [`Self::new`], with the caller's kernel. The results are the same bytes with every kernel.
    ///
    /// # Errors
    /// [`RunError::ArenaTooSmall`].
    pub fn with_kernel(kernel: Kernel, model: Model<'a>, arena: &'m mut [u8]) -> Result<Self, RunError> {
        let (required, found) = (required(&model), arena.len());
        if found < required {
            return Err(RunError::ArenaTooSmall { required, found });
        }
        let arena = Arena { bytes: part_mut(arena, 0, required), scratch: model.scratch_offset() };
        let (scrub, telemetry) = (Scrub::default(), Telemetry::default());
        Ok(Self { kernel, model, arena, state: State::Idle, protected: true, checked: false, scrub, telemetry })
    }

    /// Returns the name of the kernel.
    pub fn kernel(&self) -> &'static str {
        self.kernel.name()
    }

    /// Sets whether the runner looks for changed memory, as a new runner does. It costs a few percent of a tile's time. The setting takes
    /// effect with the next tile; a tile in progress is dropped.
    pub fn protect(&mut self, protect: bool) {
        (self.protected, self.state) = (protect, State::Idle);
    }

    /// Sets whether the runner looks for a processor that errs: sums of a convolution's products are found in a second way, and the copies of
    /// records that an operator worked with are compared. A new runner does not; it costs about a tenth of a tile's instructions. The setting
    /// takes effect with the next tile; a tile in progress is dropped.
    pub fn check_products(&mut self, check: bool) {
        (self.checked, self.state) = (check, State::Idle);
    }

    /// Returns the model.
    pub fn model(&self) -> &Model<'a> {
        &self.model
    }

    /// Returns the counters.
    pub fn telemetry(&self) -> Telemetry {
        self.telemetry
    }

    /// Begins a tile: quantises its inputs. `image` is in [0, 1] (or the maps of a guide, [`Model::image_maps`] samples in every pixel),
    /// `coarse` in [0, NR] (or pixels), both row-major rows * cols. A tile in progress is dropped.
    ///
    /// # Errors
    /// [`RunError::TileSize`], or [`RunError::NotFinite`]; then nothing has begun.
    pub fn begin(&mut self, image: &[f32], coarse: &[f32]) -> Result<(), RunError> {
        self.state = State::Idle;
        let Shape { rows, cols } = self.model.tile();
        for (input, maps) in [(image, self.model.image_maps()), (coarse, 1)] {
            let expected = maps * rows * cols;
            if input.len() != expected {
                return Err(RunError::TileSize { expected, found: input.len() });
            }
            if let Some(index) = not_finite(input) {
                return Err(RunError::NotFinite { index });
            }
        }
        self.load(|i, out| copy(out, part(image, i, out.len())), |i, out| copy(out, part(coarse, i, out.len())))
    }

    /// Begins the built-in tile, as [`Self::begin`]. When it is done, [`Self::check_self_test`] compares it.
    ///
    /// # Errors
    /// [`RunError::ModelChanged`].
    pub fn begin_self_test(&mut self) -> Result<(), RunError> {
        self.begin_self_test_in_steps()?;
        self.load_self_test(u64::MAX).map(|_| ())
    }

    /// As [`Self::begin_self_test`], but in constant time: the first calls of [`Self::step`] load the tile.
    ///
    /// # Errors
    /// [`RunError::ModelChanged`].
    pub fn begin_self_test_in_steps(&mut self) -> Result<(), RunError> {
        self.prepare()?;
        self.state = State::Loading { row: 0 };
        Ok(())
    }

    /// Loads rows of the self test's tile until the budget is spent; returns what was spent.
    fn load_self_test(&mut self, budget: u64) -> Result<u64, RunError> {
        let ((seed, _), Shape { rows, cols }, nr) = (self.model.self_test(), self.model.tile(), self.model.nr());
        let line = cols * self.model.image_maps();
        let image = |i: usize| self_test::image_sample(seed, line, i);
        let coarse = |i: usize| self_test::coarse_sample(seed, cols, i, nr);
        let mut spent = 0;
        while let State::Loading { row } = self.state {
            if spent >= budget {
                break;
            }
            let image = |first, out: &mut [f32]| (first..).zip(out).for_each(|(i, v)| *v = image(i));
            let coarse = |first, out: &mut [f32]| (first..).zip(out).for_each(|(i, v)| *v = coarse(i));
            self.load_row(self.model.image_tensor(), row, image)?;
            self.load_row(self.model.coarse_tensor(), row, coarse)?;
            spent += self.model.row_macs();
            self.state = State::Loading { row: row + 1 };
            if row + 1 >= rows {
                self.start();
            }
        }
        Ok(spent)
    }

    /// Begins a tile. `image` and `coarse` write samples from an index on; all samples of a call are in one row.
    fn load(&mut self, image: impl Fn(usize, &mut [f32]), coarse: impl Fn(usize, &mut [f32])) -> Result<(), RunError> {
        self.prepare()?;
        for row in 0..self.model.tile().rows {
            self.load_row(self.model.image_tensor(), row, &image)?;
            self.load_row(self.model.coarse_tensor(), row, &coarse)?;
        }
        self.start();
        Ok(())
    }

    /// Drops the tile before, and prepares for the rows of the next.
    pub(crate) fn prepare(&mut self) -> Result<(), RunError> {
        self.state = State::Idle;
        self.validate_header()
    }

    /// Starts the tile whose rows have been loaded.
    pub(crate) fn start(&mut self) {
        self.state = State::At { entry: 0, step: 0, unit: 0 };
    }

    /// Returns an error if the model's header has changed: tile, roles of tensors, units.
    pub(super) fn validate_header(&self) -> Result<(), RunError> {
        let holds = !self.protected || self.model.raw().header_holds();
        if holds { Ok(()) } else { Err(RunError::ModelChanged { chunk: u32::MAX }) }
    }

    /// Quantises a row of an input. `samples` writes samples from an index on. Does nothing for an input that the model does not have.
    pub(crate) fn load_row(
        &mut self,
        number: u32,
        row: usize,
        samples: impl Fn(usize, &mut [f32]),
    ) -> Result<(), RunError> {
        if number == NONE {
            return Ok(());
        }
        let tensor = self.model.sealed_tensor(number).ok_or(RunError::ProgramChanged { entry: 0 })?;
        let inverse = 1.0 / tensor.scale;
        let to = Row::of(&tensor, row);
        let (line, mut at) = (tensor.cols * tensor.channels, 0);
        while at < line {
            // Samples first, because the compiler vectorises a loop with constant bounds and without checks.
            let (mut values, mut codes, mut clamps) = ([0f32; TOGETHER], [0; TOGETHER], [0u32; TOGETHER]);
            let count = TOGETHER.min(line - at);
            samples(row * line + at, head_mut(&mut values, count));
            for i in 0..TOGETHER {
                let (kept, clamped) = quantise(values[i], inverse, tensor.zero, tensor.lo, tensor.hi);
                (codes[i], clamps[i]) = (kept, clamped as u32);
            }
            self.telemetry.inputs_clamped += clamps.iter().take(count).sum::<u32>() as u64;
            to.store(self.arena.bytes, at, head(&codes, count));
            at += count;
        }
        self.arena.fill_margins(&tensor, row);
        self.note(&tensor, row);
        Ok(())
    }

    /// Returns the bytes of a row and the offset of its checksum.
    fn row(&self, t: &Tensor, row: usize) -> (&[u8], usize) {
        let place = sums_offset(&self.model) + 4 * (t.sums + t.slot(row));
        (part(self.arena.bytes, t.row_offset(row), t.row_bytes()), place)
    }

    /// Stores the checksum of a row that has just been written.
    fn note(&mut self, t: &Tensor, row: usize) {
        if self.protected {
            let (bytes, place) = self.row(t, row);
            let sum = (self.kernel.sum)(bytes);
            copy(part_mut(self.arena.bytes, place, 4), &sum.to_le_bytes());
        }
    }

    /// Returns whether a row is unchanged.
    fn holds(&self, t: &Tensor, row: usize) -> bool {
        let (bytes, place) = self.row(t, row);
        !self.protected || part(self.arena.bytes, place, 4) == (self.kernel.sum)(bytes).to_le_bytes()
    }

    /// Works until `budget_macs` multiply-accumulates are spent or the tile is done. It does at least one unit of work, so it exceeds the
    /// budget by less than one unit ([`Model::largest_unit`]). The work does not depend on the data. What takes longer than a
    /// multiply-accumulate counts as several: two for a sample of 16 bits, 16 for a rounded sum, 40 for a sample of a layer norm, 60 for a
    /// sample of the self test that is loaded. A byte that is compared or summed counts as one: the rows that a step reads belong to its
    /// first unit, the rows that it writes to its last, and the model is compared after the last operator.
    ///
    /// # Errors
    /// [`RunError::State`] if no tile was begun; [`RunError::ProgramChanged`], [`RunError::DataChanged`], [`RunError::ModelChanged`] if
    /// memory has changed. The tile is given up then and must begin again.
    pub fn step(&mut self, budget_macs: u64) -> Result<Progress, RunError> {
        if let State::Idle = self.state {
            return Err(RunError::State);
        }
        self.telemetry.steps += 1;
        let worked = self.work(budget_macs.max(1));
        if worked.is_err() {
            self.state = State::Idle;
            self.telemetry.tile_faults += 1;
        }
        worked
    }

    fn work(&mut self, budget: u64) -> Result<Progress, RunError> {
        let mut spent = self.load_self_test(budget)?;
        if let State::At { entry, step, unit } = self.state {
            spent = self.compute(budget, spent, (entry, step, unit))?;
        }
        while let State::Verifying { chunk } = self.state {
            if spent >= budget {
                break;
            }
            let raw = self.model.raw();
            if chunk == 0 {
                if !raw.head_holds() {
                    return Err(RunError::ModelChanged { chunk: u32::MAX });
                }
                spent += raw.body_offset() as u64;
            }
            if !raw.chunk_holds(chunk, self.kernel.sum) {
                return Err(RunError::ModelChanged { chunk });
            }
            spent += CHUNK_BYTES as u64;
            self.state = State::Verifying { chunk: chunk + 1 };
            if chunk + 1 >= raw.chunks() {
                self.finish();
            }
        }
        Ok(if self.state == State::Done { Progress::Done } else { Progress::Running })
    }

    fn finish(&mut self) {
        self.state = State::Done;
        self.telemetry.tiles += 1;
    }

    /// Continues the schedule; returns the multiply-accumulates and bytes spent, with those before.
    fn compute(
        &mut self,
        budget: u64,
        mut spent: u64,
        (mut entry, mut step, mut unit): (usize, usize, usize),
    ) -> Result<u64, RunError> {
        while entry < self.model.entry_count() {
            let changed = RunError::ProgramChanged { entry: entry as u32 };
            let now = self.model.entry(entry).ok_or(changed)?;
            let prepared = self.ready(now.operator).ok_or(changed)?;
            let units = prepared.units();
            while step < now.count {
                while unit < units {
                    if spent >= budget {
                        self.state = State::At { entry, step, unit };
                        return Ok(spent);
                    }
                    if unit == 0 {
                        spent += self.validate_reads(&prepared, now.first + step)?;
                    }
                    let (constants, at) = (self.model.constants(), now.first + step);
                    let cut = (self.kernel.unit)(constants, &prepared, &mut self.arena, at, unit);
                    // The copy of the operator had no checksum. The compiler must read the operator again.
                    let holds = !self.checked || self.ready(black_box(now.operator)) == Some(prepared);
                    let wrong = RunError::Miscomputed { entry: entry as u32 };
                    self.telemetry.saturated += cut.filter(|_| holds).ok_or(wrong)?;
                    self.telemetry.macs += prepared.unit_macs(at, unit);
                    (spent, unit) = (spent + prepared.unit_work(at, unit), unit + 1);
                }
                let (operator, out) = (&prepared.operator, &prepared.out);
                for row in operator.rows_after(out, now.first + step)..operator.rows_after(out, now.first + step + 1) {
                    self.note(out, row);
                    spent += if self.protected { out.row_bytes() as u64 } else { 0 };
                }
                (step, unit) = (step + 1, 0);
            }
            (entry, step) = (entry + 1, 0);
        }
        if self.protected {
            self.state = State::Verifying { chunk: 0 };
        } else {
            self.finish();
        }
        Ok(spent)
    }

    /// Returns an operator with its tensors; `None` if one of their records has changed.
    fn ready(&self, operator: usize) -> Option<Prepared> {
        Some(Prepared { checked: self.checked, ..self.model.ready(operator)? })
    }

    /// Compares every row that a step reads with its checksum; returns the number of bytes.
    fn validate_reads(&self, prepared: &Prepared, step: usize) -> Result<u64, RunError> {
        let mut bytes = 0;
        if !self.protected {
            return Ok(bytes);
        }
        for (slot, (t, number)) in prepared.inputs.iter().zip(prepared.operator.inputs()).enumerate() {
            let (Some(t), Some(number)) = (t, number) else { continue };
            for row in prepared.operator.rows_read(&prepared.out, slot, t.rows, step) {
                if !self.holds(t, row) {
                    return Err(RunError::DataChanged { tensor: number, row: row as u32 });
                }
                bytes += t.row_bytes() as u64;
            }
        }
        Ok(bytes)
    }

    /// Copies the finished tile: normalised elevation, row-major, in the units of `coarse`.
    ///
    /// # Errors
    /// [`RunError::State`] before the tile is done, [`RunError::TileSize`], [`RunError::DataChanged`].
    pub fn output(&self, out: &mut [f32]) -> Result<(), RunError> {
        let tensor = self.finished()?;
        if out.len() != tensor.len() {
            return Err(RunError::TileSize { expected: tensor.len(), found: out.len() });
        }
        for (row, out) in out.chunks_exact_mut((tensor.cols * tensor.channels).max(1)).enumerate() {
            out.iter_mut().enumerate().for_each(|(col, v)| *v = self.arena.float(&tensor, row, col));
        }
        Ok(())
    }

    /// Returns the output tensor of a finished tile, after a check of its rows.
    fn finished(&self) -> Result<Tensor, RunError> {
        if self.state != State::Done {
            return Err(RunError::State);
        }
        self.validate_header()?;
        let number = self.model.output_tensor();
        let changed = RunError::ProgramChanged { entry: self.model.entry_count() as u32 };
        let tensor = self.model.sealed_tensor(number).ok_or(changed)?;
        match (0..tensor.rows).find(|&row| !self.holds(&tensor, row)) {
            Some(row) => Err(RunError::DataChanged { tensor: number, row: row as u32 }),
            None => Ok(tensor),
        }
    }

    /// Returns the CRC32C of the finished tile's little-endian f32 bytes.
    ///
    /// # Errors
    /// [`RunError::State`] before the tile is done, [`RunError::DataChanged`].
    pub fn output_crc(&self) -> Result<u32, RunError> {
        let tensor = self.finished()?;
        let mut crc = Crc32c::default();
        for row in 0..tensor.rows {
            crc.update(self.row(&tensor, row).0);
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

    /// Compares up to `max_bytes` of the model with its checksums. Each call continues after the last one, and starts again at the end.
    ///
    /// # Errors
    /// [`RunError::ModelChanged`] for a chunk that does not match; the next call continues behind it.
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

    /// Returns the number of the current entry of the schedule; the number of entries when all are done, `None` when idle.
    pub fn position(&self) -> Option<usize> {
        match self.state {
            State::Idle => None,
            State::Loading { .. } => Some(0),
            State::At { entry, .. } => Some(entry),
            State::Verifying { .. } | State::Done => Some(self.model.entry_count()),
        }
    }

    /// Returns the whole arena.
    pub(super) fn arena(&self) -> &[u8] {
        self.arena.bytes
    }
}
