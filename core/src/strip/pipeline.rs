//! Lines in, tiles through the network, lines out: a state machine driven by the caller.

use super::at::{At, Phase, StripCounters, StripPaused};
use super::blend::{Added, Blend};
use super::cut::Cut;
use super::error::{StripError, lent, whole_line};
use super::expected::{Expected, LineErrors};
use super::lines::{Known, Lines};
use super::plan::{StripPlan, StripSettings};
use super::ring::{Ring, put_floats};
use crate::job::{JobError, Made, TileInput, TileMemory};
use crate::nn::{Progress, RunError, Runner, Telemetry, TileLight};
use crate::overlap::OverlapWeights;
use crate::part::head;
use crate::photoclinometry::{ExpectedErrors, Origin};
use crate::pixels::PixelFormat;
use crate::tile::{Shape, Tiling, Window};

/// Number of faults after which a tile keeps its coarse heights.
const LOST: u32 = 2;

/// The memory of a strip; each block is at least as long as [`StripPlan`] says.
#[derive(Debug)]
pub struct StripMemory<'m> {
    /// What is kept of lines and tiles, and bits of a tile's valid heights.
    pub bytes: &'m mut [u8],
    /// Samples of a tile.
    pub samples: &'m mut [f32],
    /// Sums of a line.
    pub sums: &'m mut [f64],
}

/// The next call that a strip needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// [`Strip::step`]: a tile is in progress, or can begin.
    Step,
    /// [`Strip::push_line`], or [`Strip::finish`]: no tile has all of its lines.
    Push,
    /// [`Strip::push_posts`], or [`Strip::finish_posts`]: the next line needs another row of posts. The strip can also end here.
    Posts,
    /// [`Strip::take_line`]: finished lines occupy the place of the next tile.
    Take,
    /// None: all tiles are done. [`Strip::take_line`] returns the last lines.
    Done,
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
        let at = At::new(plan.job(runner.model()));
        let mut strip = Self::open(plan, runner, memory, at)?;
        strip.blend.clear();
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
        let bytes = lent(memory.bytes, plan.bytes_len())?;
        let samples = lent(memory.samples, plan.samples_len())?;
        let aside = lent(memory.sums, plan.sums_len())?;
        let StripSettings { cols, pixels: form, posts, .. } = plan.settings;
        let (image, bytes) = Ring::cut(bytes, plan.rings.image);
        let (coarse, bytes) = Ring::cut(bytes, plan.rings.coarse);
        let (means, bytes) = Ring::cut(bytes, plan.rings.means);
        let (expected, valid) = Ring::cut(bytes, plan.rings.expected);
        let lines = Lines { image, coarse, form, posts, cols };
        let blend = Blend { means, aside, weights: OverlapWeights::new(plan.tile), tile: plan.tile, cols };
        let (coarse_m, scratch) = samples.split_at_mut_checked(plan.tile.pixels()).unwrap_or_default();
        Ok(Self { plan, runner, lines, blend, expected: Expected(expected), coarse_m, valid, scratch, at })
    }

    /// Takes the next line as floats: relative brightness, and the coarse DTM on the same pixels, metres above the sphere; none if it comes as
    /// posts. A pixel that is not real ([`crate::mask`]) in either is a void, also in the result. Returns the line's number.
    ///
    /// # Errors
    /// As [`Self::push_pixels`]; [`StripError::Pixel`] if the settings have other pixels than floats.
    pub fn push_line(&mut self, image: &[f32], coarse_m: &[f32]) -> Result<usize, StripError> {
        if self.lines.form.format != PixelFormat::F32 {
            return Err(StripError::Pixel);
        }
        whole_line(self.plan.settings.cols, image.len())?;
        let row = self.next_line(coarse_m)?;
        self.lines.image.write(row, |bytes| put_floats(bytes, image.iter().copied()));
        Ok(row)
    }

    /// Takes the next line as the camera has it: the bytes of its pixels in the form of the settings. See [`Self::push_line`].
    ///
    /// # Errors
    /// [`StripError::Line`], [`StripError::Ended`]; [`StripError::PostsFirst`]; [`StripError::Full`] while all lines kept are needed.
    pub fn push_pixels(&mut self, image: &[u8], coarse_m: &[f32]) -> Result<usize, StripError> {
        whole_line(self.lines.form.format.row_bytes(self.plan.settings.cols), image.len())?;
        let row = self.next_line(coarse_m)?;
        self.lines.keep(row, image);
        Ok(row)
    }

    /// Counts a line, whose coarse heights are kept.
    fn next_line(&mut self, coarse_m: &[f32]) -> Result<usize, StripError> {
        let grid = self.plan.settings.posts;
        whole_line(if grid.is_some() { 0 } else { self.plan.settings.cols }, coarse_m.len())?;
        if self.at.ended {
            return Err(StripError::Ended);
        }
        if self.wants_posts() {
            return Err(StripError::PostsFirst);
        }
        let row = self.at.lines;
        let longer = At { lines: row.saturating_add(1), ..self.at };
        // A strip with the largest countable number of lines stays full.
        if longer.lines - self.first_kept(&longer) > self.plan.settings.ring_lines || longer.lines == usize::MAX {
            return Err(StripError::Full);
        }
        if grid.is_none() {
            self.lines.keep_coarse(row, coarse_m);
        }
        self.at = longer;
        Ok(row)
    }

    /// Takes the next row of the coarse DTM's posts, metres; a value that is not real ([`crate::mask`]) is a void.
    ///
    /// # Errors
    /// [`StripError::NoPosts`], [`StripError::Line`], [`StripError::Ended`]; [`StripError::Full`] while the oldest row kept is needed.
    pub fn push_posts(&mut self, posts_m: &[f32]) -> Result<(), StripError> {
        let grid = self.plan.settings.posts.ok_or(StripError::NoPosts)?;
        whole_line(grid.cols, posts_m.len())?;
        if self.at.posts_ended {
            return Err(StripError::Ended);
        }
        let (row, kept) = (self.at.post_rows, self.plan.rings.coarse.lines);
        if row >= kept && grid.oldest(self.first_kept(&self.at)) <= row - kept {
            return Err(StripError::Full);
        }
        self.lines.keep_posts(row, posts_m);
        self.at.post_rows = row.saturating_add(1);
        Ok(())
    }

    /// Ends the rows of posts: lines up to the outer edge of the last row are continued from it, lines beyond are voids.
    pub fn finish_posts(&mut self) {
        self.at.posts_ended = true;
    }

    fn wants_posts(&self) -> bool {
        let At { lines, post_rows, posts_ended, ended, .. } = self.at;
        let is_ready = |grid: &super::PostGrid| grid.is_ready(lines, post_rows);
        !posts_ended && !ended && !self.plan.settings.posts.as_ref().is_none_or(is_ready)
    }

    /// Ends the strip with the last line taken in. The last row of tiles is moved back to end there, as in [`Tiling`]. A strip shorter than
    /// a tile is continued by its last line.
    pub fn finish(&mut self) {
        self.at.ended = true;
    }

    /// Does a bounded piece of work: `budget_macs` of a tile ([`crate::TileJob`]), or of adding its heights to the means. Does nothing if a line must be
    /// pushed or taken first. What it uses is compared with its checksums, which counts towards the budget.
    pub fn step(&mut self, budget_macs: u64) -> Next {
        if let Some((window, cut)) = self.tile() {
            match self.at.phase {
                Phase::Waiting => {
                    self.begin();
                    self.work(window, budget_macs);
                }
                Phase::Working => self.work(window, budget_macs),
                Phase::Made if self.at.taken < window.row => (),
                Phase::Made => self.add(&cut, window, budget_macs),
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
            None if self.at.lines - self.first_kept(&self.at) >= self.plan.settings.ring_lines && self.ready() > 0 => {
                Next::Take
            }
            None if self.wants_posts() => Next::Posts,
            None => Next::Push,
        }
    }

    /// Returns whether the network runs: its arena alone changes with the next step.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.at.phase == Phase::Working && self.at.job.is_running()
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
        self.at.counters.pieces_lost += self.blend.take(row, out_m);
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
        let taken = self.take_line(out_m)?;
        match (taken, self.cut(&self.at)) {
            (Some(row), Some(cut)) if self.plan.settings.expected_errors => {
                let Self { lines, blend, expected, at, .. } = self;
                let mut lost = lines.image.check(row, 0..usize::MAX);
                lost += blend.expected(&cut, row, &lines.line(row), out_m, expected, errors);
                at.counters.pieces_lost += lost;
            }
            (Some(_), _) => {
                errors.height_m.fill(f32::NAN);
                errors.slope.fill(f32::NAN);
                errors.origin.fill(Origin::Void as u8);
            }
            _ => (),
        }
        Ok(taken)
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

    /// Returns the number of the current tile.
    fn index(&self, cut: &Cut) -> usize {
        self.at.tile_rows.saturating_mul(cut.tiling.shape().cols).saturating_add(self.at.tile_cols)
    }

    /// Returns the current tile, if its lines are there and it is known whether more lines follow.
    fn tile(&self) -> Option<(Window, Cut)> {
        let cut = self.cut(&self.at)?;
        let window = cut.tiling.get(self.index(&cut))?;
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

    /// Begins the current tile from its lines.
    fn begin(&mut self) {
        (self.at.job, self.at.phase) = (self.plan.job(self.runner.model()), Phase::Working);
        if self.at.faults >= LOST {
            self.at.job.give_up();
        }
    }

    /// Works on the current tile.
    fn work(&mut self, window: Window, budget_macs: u64) {
        let known = Known { lines: self.at.lines, post_rows: self.at.post_rows };
        let mut budget_macs = budget_macs;
        if !self.at.job.is_prepared() {
            let lost = self.lines.check(window, known, self.at.job.takes_samples());
            self.at.counters.pieces_lost += lost;
            if lost > 0 {
                // Their samples are voids from now on.
                self.begin();
            }
            budget_macs = budget_macs.saturating_sub(self.lines.check_bytes(window) as u64 / 4);
        }
        let Self { plan, runner, lines, blend, coarse_m, valid, scratch, at, .. } = self;
        let mut memory = TileMemory { coarse_m, valid, scratch, lines: blend.aside };
        let worked = if at.job.is_prepared() {
            at.job.run(runner, &mut memory, budget_macs)
        } else {
            let (image, coarse_m) = lines.tile(window, known);
            let inside = Shape::new(at.lines - window.row.min(at.lines), lines.cols - window.col.min(lines.cols));
            let tile = TileInput { image, coarse_m, inside, light: TileLight::Scene(plan.settings.light) };
            at.job.prepare(runner, &tile, &mut memory, budget_macs).map(|_| Progress::Running)
        };
        match (worked, at.job.made()) {
            (Err(error), _) => self.fault(&error),
            (Ok(_), Some(Made::Empty)) => {
                self.at.counters.tiles_empty += 1;
                self.advance();
            }
            (Ok(Progress::Done), made) => {
                self.at.counters.tiles_coarse += u64::from(made == Some(Made::Coarse) && self.at.faults < LOST);
                self.expect(&self.at.job.expected().unwrap_or(ExpectedErrors::UNKNOWN));
                self.at.phase = Phase::Made;
            }
            (Ok(Progress::Running), _) => (),
        }
    }

    /// Adds lines of the current tile to the means.
    fn add(&mut self, cut: &Cut, window: Window, budget_macs: u64) {
        let index = self.index(cut);
        let Self { plan, blend, coarse_m, valid, scratch, at, .. } = self;
        let memory = TileMemory { coarse_m, valid, scratch, lines: &mut [] };
        let checked: Result<(), JobError<RunError>> = at.job.check(&memory);
        let tile = Added { index, window, heights_m: head(memory.scratch, plan.tile.pixels()), valid: memory.valid };
        let rows = window.rows.min(cut.scene.rows.saturating_sub(window.row));
        let mut spent = (memory.coarse_m.len() + memory.scratch.len()) as u64;
        while checked.is_ok() && at.added < rows {
            at.counters.pieces_lost += blend.add(cut, &tile, at.added);
            at.added += 1;
            spent = spent.saturating_add(blend.line_cost());
            if spent >= budget_macs {
                break;
            }
        }
        match checked {
            Err(error) => self.fault(&error),
            Ok(()) if self.at.added >= rows => self.advance(),
            Ok(()) => (),
        }
    }

    /// Begins the tile again after a first fault; keeps its coarse heights after a second; leaves it without heights after a third.
    fn fault(&mut self, error: &JobError<RunError>) {
        let counters = &mut self.at.counters;
        let is_memory = matches!(error, JobError::Changed { .. });
        counters.memory_faults += u64::from(is_memory);
        if !is_memory {
            // Others: a model whose header has changed, or whose heights are not real.
            counters.last_fault = if let JobError::Network(error) = error { Some(*error) } else { None };
        }
        self.at.faults += 1;
        self.at.phase = Phase::Waiting;
        match self.at.faults {
            1 => counters.tiles_again += 1,
            LOST => {
                counters.tiles_lost += 1;
                if !is_memory {
                    self.at.phase = Phase::Working;
                    self.at.job.give_up();
                }
            }
            _ => {
                counters.tiles_void += 1;
                self.advance();
            }
        }
    }

    /// Keeps the expected errors of the current tile.
    fn expect(&mut self, errors: &ExpectedErrors) {
        if !self.plan.settings.expected_errors {
            return;
        }
        if let Some(cut) = self.cut(&self.at) {
            self.expected.keep(self.index(&cut), errors);
        }
    }

    /// Finishes the current tile.
    fn advance(&mut self) {
        self.at.counters.tiles += 1;
        (self.at.phase, self.at.added, self.at.faults) = (Phase::Waiting, 0, 0);
        self.at.tile_cols += 1;
        let across = self.cut(&self.at).map_or(0, |cut| cut.tiling.shape().cols);
        if self.at.tile_cols >= across {
            (self.at.tile_cols, self.at.tile_rows) = (0, self.at.tile_rows.saturating_add(1));
        }
    }
}
