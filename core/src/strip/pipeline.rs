//! Lines in, tiles through the network, lines out: a state machine driven by the caller.

use super::blend::Blend;
use super::cut::Cut;
use super::error::{StripError, lent, whole_line};
use super::expected::{Expected, LineErrors};
use super::lines::Lines;
use super::plan::StripPlan;
use crate::job::{JobError, Made, TileInput, TileJob, TileMemory};
use crate::nn::{Progress, RunError, Runner, Suspended, Telemetry, TileLight};
use crate::overlap::OverlapWeights;
use crate::part::head;
use crate::photoclinometry::{ExpectedErrors, Origin};
use crate::tile::{Shape, Tiling, Window};

/// The memory of a strip; each block is at least as long as [`StripPlan`] says.
#[derive(Debug)]
pub struct StripMemory<'m> {
    /// Samples of lines and of a tile.
    pub samples: &'m mut [f32],
    /// Sums over tiles.
    pub sums: &'m mut [f64],
    /// Bits of a tile's valid heights.
    pub valid: &'m mut [u8],
}

/// The next call that a strip needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// [`Strip::step`]: a tile is in progress, or can begin.
    Step,
    /// [`Strip::push_line`], or [`Strip::finish`]: no tile has all of its lines.
    Push,
    /// [`Strip::take_line`]: finished lines occupy the place of the next tile.
    Take,
    /// None: all tiles are done. [`Strip::take_line`] returns the last lines.
    Done,
}

/// Counters since the strip began. They do not wrap within the time of a mission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StripCounters {
    /// Tiles done, with those below.
    pub tiles: u64,
    /// Tiles without image contrast or coarse relief, which keep the coarse heights.
    pub tiles_coarse: u64,
    /// Tiles without a valid pixel.
    pub tiles_empty: u64,
    /// Tiles that began again after a fault.
    pub tiles_again: u64,
    /// Tiles given up after a second fault, which keep the coarse heights.
    pub tiles_lost: u64,
    /// The last fault; `None` also for heights that were not finite, and for numbers of the header that no model has.
    pub last_fault: Option<RunError>,
}

/// The progress of the current tile.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Waiting,
    Working,
    /// The heights are at the begin of the scratch memory.
    Made,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct At {
    /// Number of lines taken in.
    lines: usize,
    /// Number of lines returned.
    taken: usize,
    ended: bool,
    /// Number of finished rows of tiles.
    tile_rows: usize,
    /// Number of finished tiles of the next row.
    tile_cols: usize,
    phase: Phase,
    job: TileJob,
    /// Whether the current tile had a fault before.
    again: bool,
    /// Whether it was given up.
    lost: bool,
    counters: StripCounters,
}

/// The position of a paused strip. Its memory and the runner's arena hold the rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StripPaused {
    /// The position of the runner, for [`Runner::resume`].
    pub runner: Suspended,
    at: At,
}

/// A strip in progress. See [the module](super).
#[derive(Debug)]
pub struct Strip<'a, 'm> {
    plan: StripPlan,
    runner: Runner<'a, 'm>,
    lines: Lines<'m>,
    blend: Blend<'m>,
    expected: Expected<'m>,
    /// The current tile: its coarse heights, its valid pixels, and scratch memory.
    coarse_m: &'m mut [f32],
    valid: &'m mut [u8],
    scratch: &'m mut [f32],
    at: At,
}

impl<'a, 'm> Strip<'a, 'm> {
    /// Prepares for the first line. A tile in progress in the runner is dropped.
    ///
    /// # Errors
    /// [`StripError::Model`] if the runner's model is not the plan's, [`StripError::Memory`].
    pub fn new(plan: StripPlan, runner: Runner<'a, 'm>, memory: StripMemory<'m>) -> Result<Self, StripError> {
        let counters = StripCounters::default();
        let (phase, ended, again) = (Phase::Waiting, false, false);
        let job = plan.job(runner.model());
        let at = At { lines: 0, taken: 0, ended, tile_rows: 0, tile_cols: 0, phase, job, again, lost: false, counters };
        let strip = Self::open(plan, runner, memory, at)?;
        strip.blend.sums.fill(f64::NAN);
        Ok(strip)
    }

    /// Returns the position of the strip. With it and unchanged memory and arena, the strip can be resumed.
    #[must_use]
    pub fn pause(&self) -> StripPaused {
        StripPaused { runner: self.runner.suspend(), at: self.at }
    }

    /// Resumes a paused strip with the memory that it used. `runner` is the result of [`Runner::resume`] for its part. The model may have
    /// been loaded again in the meantime.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn resume(
        plan: StripPlan,
        runner: Runner<'a, 'm>,
        memory: StripMemory<'m>,
        paused: &StripPaused,
    ) -> Result<Self, StripError> {
        Self::open(plan, runner, memory, paused.at)
    }

    fn open(plan: StripPlan, runner: Runner<'a, 'm>, memory: StripMemory<'m>, at: At) -> Result<Self, StripError> {
        if StripPlan::new(runner.model(), plan.settings) != Ok(plan) {
            return Err(StripError::Model);
        }
        let samples = lent(memory.samples, plan.samples_len())?;
        let sums = lent(memory.sums, plan.sums_len())?;
        let valid = lent(memory.valid, plan.valid_len())?;
        let (cols, ring) = (plan.settings.cols, plan.settings.ring_lines);
        let (image, rest) = samples.split_at_mut_checked(ring.saturating_mul(cols)).unwrap_or_default();
        let (coarse_m, rest) = rest.split_at_mut_checked(ring.saturating_mul(cols)).unwrap_or_default();
        let lines = Lines { image, coarse_m, cols, ring };
        let (coarse_m, rest) = rest.split_at_mut_checked(plan.pixels()).unwrap_or_default();
        let (values, scratch) = rest.split_at_mut_checked(plan.expected_len).unwrap_or_default();
        let (sums, aside) = sums.split_at_mut_checked(plan.tile.rows.saturating_mul(cols)).unwrap_or_default();
        let blend = Blend { sums, aside, weights: OverlapWeights::new(plan.tile), tile: plan.tile, cols };
        let expected = Expected { values };
        Ok(Self { plan, runner, lines, blend, expected, coarse_m, valid, scratch, at })
    }

    /// Takes the next line: relative brightness, and the coarse DTM on the same pixels, metres above the sphere. A pixel that is not real
    /// ([`crate::mask`]) in either is a void, also in the result. Returns the line's number.
    ///
    /// # Errors
    /// [`StripError::Line`], [`StripError::Ended`]; [`StripError::Full`] while all lines kept are needed.
    pub fn push_line(&mut self, image: &[f32], coarse_m: &[f32]) -> Result<usize, StripError> {
        whole_line(self.plan.settings.cols, image.len())?;
        whole_line(self.plan.settings.cols, coarse_m.len())?;
        if self.at.ended {
            return Err(StripError::Ended);
        }
        let row = self.at.lines;
        let longer = At { lines: row.saturating_add(1), ..self.at };
        // A strip with the largest countable number of lines stays full.
        if longer.lines - self.first_kept(&longer) > self.lines.ring || longer.lines == usize::MAX {
            return Err(StripError::Full);
        }
        self.lines.keep(row, image, coarse_m);
        self.at = longer;
        Ok(row)
    }

    /// Ends the strip with the last line taken in. The last row of tiles is moved back to end there, as in [`Tiling`]. A strip shorter than
    /// a tile is continued by its last line.
    pub fn finish(&mut self) {
        self.at.ended = true;
    }

    /// Does a bounded piece of work: `budget_macs` of a tile ([`TileJob`]), or adds its heights to the sums. Does nothing if a line must be pushed
    /// or taken first.
    pub fn step(&mut self, budget_macs: u64) -> Next {
        if let Some((window, cut)) = self.tile() {
            match self.at.phase {
                Phase::Waiting => {
                    (self.at.job, self.at.phase) = (self.plan.job(self.runner.model()), Phase::Working);
                    self.work(window, budget_macs);
                }
                Phase::Working => self.work(window, budget_macs),
                Phase::Made if self.at.taken < window.row => (),
                Phase::Made => {
                    self.blend.add(&cut, window, &self.lines, head(self.scratch, self.plan.pixels()));
                    self.advance();
                }
            }
        }
        self.wants()
    }

    /// Returns the next call that the strip needs.
    #[must_use]
    pub fn wants(&self) -> Next {
        match self.tile() {
            Some((window, _)) if self.at.phase == Phase::Made && self.at.taken < window.row => Next::Take,
            Some(_) => Next::Step,
            None if self.at.ended => Next::Done,
            None if self.at.lines - self.first_kept(&self.at) >= self.lines.ring && self.ready() > 0 => Next::Take,
            None => Next::Push,
        }
    }

    /// Number of lines that [`Self::take_line`] can return now.
    #[must_use]
    pub fn ready(&self) -> usize {
        self.first_needed(&self.at) - self.at.taken
    }

    /// Writes the heights of the next finished line, metres above the sphere, NaN in voids, and returns its number; `None` if it is not
    /// finished.
    ///
    /// # Errors
    /// [`StripError::Line`].
    pub fn take_line(&mut self, out_m: &mut [f32]) -> Result<Option<usize>, StripError> {
        whole_line(self.plan.settings.cols, out_m.len())?;
        if self.ready() == 0 {
            return Ok(None);
        }
        let row = self.at.taken;
        if let Some(cut) = self.cut(&self.at) {
            self.blend.take(&cut, row, out_m);
        }
        self.at.taken = row.saturating_add(1);
        Ok(Some(row))
    }

    /// As [`Self::take_line`], with the expected errors of the line; the settings must ask for them, otherwise all are NaN or void. Each slice of
    /// `errors` has the line's number of samples.
    ///
    /// # Errors
    /// [`StripError::Line`].
    pub fn take_line_with(&mut self, out_m: &mut [f32], errors: LineErrors<'_>) -> Result<Option<usize>, StripError> {
        for found in [errors.height_m.len(), errors.slope.len(), errors.origin.len()] {
            whole_line(self.plan.settings.cols, found)?;
        }
        whole_line(self.plan.settings.cols, out_m.len())?;
        match self.cut(&self.at).filter(|_| self.ready() > 0) {
            Some(cut) if self.plan.settings.expected_errors => {
                self.blend.expected(&cut, self.at.taken, &self.lines, &self.expected, errors);
            }
            Some(_) => {
                errors.height_m.fill(f32::NAN);
                errors.slope.fill(f32::NAN);
                errors.origin.fill(Origin::Void as u8);
            }
            None => (),
        }
        self.take_line(out_m)
    }

    /// Returns the counters.
    #[must_use]
    pub fn counters(&self) -> StripCounters {
        self.at.counters
    }

    /// Returns the runner's counters.
    #[must_use]
    pub fn telemetry(&self) -> Telemetry {
        self.runner.telemetry()
    }

    /// Compares the model with its checksums in spare time, as [`Runner::scrub`].
    ///
    /// # Errors
    /// As [`Runner::scrub`].
    pub fn scrub(&mut self, max_bytes: usize) -> Result<(), RunError> {
        self.runner.scrub(max_bytes)
    }

    /// Returns the division of the strip as far as it is known. A strip without a known end is cut as if it had none.
    fn cut(&self, at: &At) -> Option<Cut> {
        let (tile, settings) = (self.plan.tile, self.plan.settings);
        let rows = if at.ended { at.lines } else { usize::MAX };
        // The plan guarantees that the tiling exists.
        let tiling =
            Tiling::new(Shape::new(rows.max(tile.rows), settings.cols.max(tile.cols)), tile, settings.overlap_px)
                .ok()?;
        Some(Cut { scene: Shape::new(rows, settings.cols), tiling })
    }

    /// Returns the current tile, if its lines are there and it is known whether more lines follow.
    fn tile(&self) -> Option<(Window, Cut)> {
        let cut = self.cut(&self.at)?;
        let across = cut.tiling.shape().cols;
        let index = self.at.tile_rows.saturating_mul(across).saturating_add(self.at.tile_cols);
        let window = cut.tiling.get(index)?;
        let complete = self.at.lines > window.row.saturating_add(window.rows);
        ((complete || self.at.ended) && self.at.lines > 0).then_some((window, cut))
    }

    /// Returns the first line that later tiles can reach, wherever the strip ends. Lines above it are finished and not kept.
    fn first_needed(&self, at: &At) -> usize {
        let Some(cut) = self.cut(at) else { return 0 };
        let across = cut.tiling.shape().cols;
        let next = cut.tiling.get(at.tile_rows.saturating_mul(across)).map_or(at.lines, |window| window.row);
        // If the strip ended now, the last row of tiles would begin here; if it continues, further down.
        let last = if at.ended { at.lines } else { at.lines.saturating_sub(self.plan.tile.rows) };
        next.min(last)
    }

    /// Returns the first line whose place is not free.
    fn first_kept(&self, at: &At) -> usize {
        let needed = self.first_needed(at);
        if self.plan.settings.expected_errors { needed.min(at.taken) } else { needed }
    }

    /// Works on the current tile.
    fn work(&mut self, window: Window, budget_macs: u64) {
        let Self { plan, runner, lines, blend, coarse_m, valid, scratch, at, .. } = self;
        let mut memory = TileMemory { coarse_m, valid, scratch, lines: blend.aside };
        let worked = if at.job.is_prepared() {
            at.job.run(runner, &mut memory, budget_macs)
        } else {
            let [image, coarse_m] = lines.tile(window, at.lines);
            let inside = Shape::new(at.lines - window.row.min(at.lines), lines.cols - window.col.min(lines.cols));
            let tile = TileInput { image, coarse_m, inside, light: TileLight::Scene(plan.settings.light) };
            at.job.prepare(runner, &tile, &mut memory, budget_macs).map(|_| Progress::Running)
        };
        match (worked, at.job.made()) {
            (Err(JobError::Network(error)), _) => self.fault(Some(error)),
            // A model whose header has changed, or whose heights are not real.
            (Err(_), _) => self.fault(None),
            (Ok(_), Some(Made::Empty)) => {
                self.at.counters.tiles_empty += 1;
                self.advance();
            }
            (Ok(Progress::Done), made) => {
                self.at.counters.tiles_coarse += u64::from(made == Some(Made::Coarse) && !self.at.lost);
                self.expect(&self.at.job.expected().unwrap_or(ExpectedErrors::UNKNOWN));
                self.at.phase = Phase::Made;
            }
            (Ok(Progress::Running), _) => (),
        }
    }

    /// Begins the tile again, or keeps its coarse heights.
    fn fault(&mut self, error: Option<RunError>) {
        self.at.counters.last_fault = error;
        if self.at.again {
            self.at.counters.tiles_lost += 1;
            self.at.lost = true;
            self.at.job.give_up();
        } else {
            self.at.counters.tiles_again += 1;
            (self.at.again, self.at.phase) = (true, Phase::Waiting);
        }
    }

    /// Keeps the expected errors of the current tile.
    fn expect(&mut self, errors: &ExpectedErrors) {
        if !self.plan.settings.expected_errors {
            return;
        }
        if let Some(cut) = self.cut(&self.at) {
            let index = self.at.tile_rows.saturating_mul(cut.tiling.shape().cols).saturating_add(self.at.tile_cols);
            self.expected.keep(&cut, self.plan.tile, index, errors);
        }
    }

    /// Finishes the current tile.
    fn advance(&mut self) {
        self.at.counters.tiles += 1;
        (self.at.phase, self.at.again, self.at.lost) = (Phase::Waiting, false, false);
        self.at.tile_cols += 1;
        let across = self.cut(&self.at).map_or(0, |cut| cut.tiling.shape().cols);
        if self.at.tile_cols >= across {
            (self.at.tile_cols, self.at.tile_rows) = (0, self.at.tile_rows.saturating_add(1));
        }
    }
}
