//! Lines in, tiles through the network, lines out: a state machine that the caller drives.

use super::blend::{Blend, Cut};
use super::error::{StripError, lent, whole_line};
use super::lines::Lines;
use super::plan::StripPlan;
use crate::fill::fill_gaps;
use crate::nn::{Progress, RunError, Runner, Suspended, Telemetry, TileError, TileInput, TileLight, TileScale};
use crate::norm::Anchor;
use crate::overlap::OverlapWeights;
use crate::part::{copy, head_mut};
use crate::tile::{Shape, Tiling, Window};

/// Blocks that a strip works in, each at least as long as [`StripPlan`] says.
#[derive(Debug)]
pub struct StripMemory<'m> {
    /// Samples of lines and of a tile.
    pub samples: &'m mut [f32],
    /// Sums over tiles.
    pub sums: &'m mut [f64],
    /// Pixels beside gaps.
    pub queue: &'m mut [u32],
}

/// What a strip wants next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// [`Strip::step`]: a tile is at work, or can be.
    Step,
    /// [`Strip::push_line`], or [`Strip::finish`]: no tile has all of its lines.
    Push,
    /// [`Strip::take_line`]: finished lines lie where a tile is to be added.
    Take,
    /// Nothing: all tiles are made. The lines that [`Strip::take_line`] still gives are the last.
    Done,
}

/// Counters since the strip began; they wrap never in a mission's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StripCounters {
    /// Tiles made, those below included.
    pub tiles: u64,
    /// Tiles without image contrast or coarse relief: there the coarse heights stand.
    pub tiles_coarse: u64,
    /// Tiles without a valid pixel.
    pub tiles_empty: u64,
    /// Tiles begun again after a fault.
    pub tiles_again: u64,
    /// Tiles given up after a second fault: there the coarse heights stand.
    pub tiles_lost: u64,
    /// What the last fault was; `None` also for heights that were not finite.
    pub last_fault: Option<RunError>,
}

/// Where the tile at hand is.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Waiting,
    Running(TileScale),
    Computed(TileScale),
    /// Its heights lie in the place of its image.
    Made,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct At {
    /// Lines that have come.
    lines: usize,
    /// Lines that have left.
    taken: usize,
    ended: bool,
    /// Rows of tiles that are done.
    tile_rows: usize,
    /// Tiles of the next row that are done.
    tile_cols: usize,
    phase: Phase,
    /// Whether the tile at hand had a fault before.
    again: bool,
    counters: StripCounters,
}

/// A strip put aside: where it stands. Its memory and the runner's arena keep the rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StripPaused {
    /// Where the runner stands, for [`Runner::resume`].
    pub runner: Suspended,
    at: At,
}

/// A strip at work. See [the module](super).
#[derive(Debug)]
pub struct Strip<'a, 'm> {
    plan: StripPlan,
    runner: Runner<'a, 'm>,
    lines: Lines<'m>,
    blend: Blend<'m>,
    /// The tile at hand: its image, then its heights; its coarse heights; and scratch memory.
    image: &'m mut [f32],
    coarse_m: &'m mut [f32],
    scratch: &'m mut [f32],
    queue: &'m mut [u32],
    at: At,
}

impl<'a, 'm> Strip<'a, 'm> {
    /// Stands ready for the first line. A tile that the runner has at work is dropped.
    ///
    /// # Errors
    /// [`StripError::Model`] if the runner's model is not the plan's, [`StripError::Memory`].
    pub fn new(plan: StripPlan, runner: Runner<'a, 'm>, memory: StripMemory<'m>) -> Result<Self, StripError> {
        let counters = StripCounters::default();
        let (phase, ended, again) = (Phase::Waiting, false, false);
        let at = At { lines: 0, taken: 0, ended, tile_rows: 0, tile_cols: 0, phase, again, counters };
        let strip = Self::open(plan, runner, memory, at)?;
        strip.blend.sums.fill(f64::NAN);
        Ok(strip)
    }

    /// Where the strip stands: with it, its memory and the arena as they are now, it can be taken up again.
    #[must_use]
    pub fn pause(&self) -> StripPaused {
        StripPaused { runner: self.runner.suspend(), at: self.at }
    }

    /// The strip that was paused, in the memory it left; `runner` is what [`Runner::resume`] makes of its part. In between the model may have
    /// been loaded again.
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
        let queue = lent(memory.queue, plan.queue_len())?;
        let (cols, ring) = (plan.settings.cols, plan.settings.ring_lines);
        let (image, rest) = samples.split_at_mut_checked(ring.saturating_mul(cols)).unwrap_or_default();
        let (coarse_m, rest) = rest.split_at_mut_checked(ring.saturating_mul(cols)).unwrap_or_default();
        let lines = Lines { image, coarse_m, cols, ring };
        let (image, rest) = rest.split_at_mut_checked(plan.pixels()).unwrap_or_default();
        let (coarse_m, scratch) = rest.split_at_mut_checked(plan.pixels()).unwrap_or_default();
        let (sums, aside) = sums.split_at_mut_checked(plan.tile.rows.saturating_mul(cols)).unwrap_or_default();
        let blend = Blend { sums, aside, weights: OverlapWeights::new(plan.tile), tile: plan.tile, cols };
        Ok(Self { plan, runner, lines, blend, image, coarse_m, scratch, queue, at })
    }

    /// Takes the next line: relative brightness, and the coarse DTM on the same pixels, metres above the sphere. What is not real
    /// ([`crate::mask`]) in either is a gap, and stays one. Returns the line's number.
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
        // A strip of as many lines as can be counted is full for good.
        if longer.lines - self.first_needed(&longer) > self.lines.ring || longer.lines == usize::MAX {
            return Err(StripError::Full);
        }
        self.lines.keep(row, image, coarse_m);
        self.at = longer;
        Ok(row)
    }

    /// The strip ends with the last line that came. The last row of tiles is moved back to end there, as [`Tiling`] does; a strip shorter than a
    /// tile is continued by its last line.
    pub fn finish(&mut self) {
        self.at.ended = true;
    }

    /// Does a bounded piece of work, one of: preparing a tile, `budget_macs` of the network ([`Runner::step`]), bringing its result back to
    /// metres, adding it to its neighbours. Nothing, if a line must come or go first.
    pub fn step(&mut self, budget_macs: u64) -> Next {
        if let Some((window, cut)) = self.tile() {
            match self.at.phase {
                Phase::Waiting => self.prepare(window),
                Phase::Running(scale) => match self.runner.step(budget_macs) {
                    Ok(Progress::Running) => (),
                    Ok(Progress::Done) => self.at.phase = Phase::Computed(scale),
                    Err(error) => self.fault(Some(error)),
                },
                Phase::Computed(scale) => self.bring_back(&scale),
                Phase::Made if self.at.taken < window.row => (),
                Phase::Made => {
                    self.blend.add(&cut, window, &self.lines, self.image);
                    self.advance();
                }
            }
        }
        self.wants()
    }

    /// What the strip wants.
    #[must_use]
    pub fn wants(&self) -> Next {
        match self.tile() {
            Some((window, _)) if self.at.phase == Phase::Made && self.at.taken < window.row => Next::Take,
            Some(_) => Next::Step,
            None if self.at.ended => Next::Done,
            None => Next::Push,
        }
    }

    /// Lines that [`Self::take_line`] can give now.
    #[must_use]
    pub fn ready(&self) -> usize {
        self.first_needed(&self.at) - self.at.taken
    }

    /// The next finished line: writes its heights, metres above the sphere, NaN in its gaps, and returns its number; `None` if it is not
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

    /// The counters.
    #[must_use]
    pub fn counters(&self) -> StripCounters {
        self.at.counters
    }

    /// The runner's counters.
    #[must_use]
    pub fn telemetry(&self) -> Telemetry {
        self.runner.telemetry()
    }

    /// Looks over the model in spare time, as [`Runner::scrub`].
    ///
    /// # Errors
    /// As there.
    pub fn scrub(&mut self, max_bytes: usize) -> Result<(), RunError> {
        self.runner.scrub(max_bytes)
    }

    /// How the strip is cut, as far as is known. A strip whose end is not known is cut as if there were none.
    fn cut(&self, at: &At) -> Option<Cut> {
        let (tile, settings) = (self.plan.tile, self.plan.settings);
        let rows = if at.ended { at.lines } else { usize::MAX };
        // The plan has proved that this is a tiling.
        let tiling =
            Tiling::new(Shape::new(rows.max(tile.rows), settings.cols.max(tile.cols)), tile, settings.overlap_px)
                .ok()?;
        Some(Cut { scene: Shape::new(rows, settings.cols), tiling })
    }

    /// The tile at hand, if its lines have come, and it is known whether there are more below.
    fn tile(&self) -> Option<(Window, Cut)> {
        let cut = self.cut(&self.at)?;
        let across = cut.tiling.shape().cols;
        let index = self.at.tile_rows.saturating_mul(across).saturating_add(self.at.tile_cols);
        let window = cut.tiling.get(index)?;
        let complete = self.at.lines > window.row.saturating_add(window.rows);
        ((complete || self.at.ended) && self.at.lines > 0).then_some((window, cut))
    }

    /// The first line that tiles to come can reach, wherever the strip will end: those above are finished, and kept no longer.
    fn first_needed(&self, at: &At) -> usize {
        let Some(cut) = self.cut(at) else { return 0 };
        let across = cut.tiling.shape().cols;
        let next = cut.tiling.get(at.tile_rows.saturating_mul(across)).map_or(at.lines, |window| window.row);
        // If it ended now, the last row of tiles would begin here; should it go on, further down.
        let last = if at.ended { at.lines } else { at.lines.saturating_sub(self.plan.tile.rows) };
        next.min(last)
    }

    /// Cuts the tile out, closes its gaps and begins it.
    fn prepare(&mut self, window: Window) {
        let Self { lines, image, coarse_m, queue, .. } = self;
        if !lines.cut(window, self.at.lines, image, coarse_m) {
            self.at.counters.tiles_empty += 1;
            return self.advance();
        }
        for map in [&mut **image, &mut **coarse_m] {
            // The lengths are planned.
            let _ = fill_gaps(map, window.cols, queue);
        }
        let settings = self.plan.settings;
        let (pixel_m, coarse_px, light) = (settings.pixel_m, settings.coarse_px, TileLight::Scene(settings.light));
        let tile = TileInput { image: self.image, coarse_m: self.coarse_m, valid: None, pixel_m, coarse_px, light };
        match self.runner.begin_metres(&tile, self.scratch) {
            Ok(begun) => self.at.phase = Phase::Running(begun.scale),
            Err(TileError::Run(error)) => self.fault(Some(error)),
            Err(TileError::Norm(_)) => {
                self.at.counters.tiles_coarse += 1;
                self.keep_coarse();
            }
        }
    }

    /// Brings a finished tile's heights to metres, and its low frequencies to the coarse DTM's.
    fn bring_back(&mut self, scale: &TileScale) {
        if let Err(error) = self.runner.heights(scale, self.image) {
            return self.fault(Some(error));
        }
        if !self.image.iter().all(|z| z.is_finite()) {
            return self.fault(None);
        }
        if self.plan.settings.anchor {
            let (pixels, cols) = (self.plan.pixels(), self.plan.tile.cols);
            let anchor = Anchor::new(self.plan.settings.coarse_px);
            // The lengths are planned.
            let _ = anchor.apply(self.image, self.coarse_m, cols, head_mut(self.scratch, pixels), self.blend.aside);
        }
        self.at.phase = Phase::Made;
    }

    /// Begins the tile once more, or lets its coarse heights stand.
    fn fault(&mut self, error: Option<RunError>) {
        self.at.counters.last_fault = error;
        if self.at.again {
            self.at.counters.tiles_lost += 1;
            self.keep_coarse();
        } else {
            self.at.counters.tiles_again += 1;
            (self.at.again, self.at.phase) = (true, Phase::Waiting);
        }
    }

    fn keep_coarse(&mut self) {
        copy(self.image, self.coarse_m);
        self.at.phase = Phase::Made;
    }

    /// The tile at hand is done.
    fn advance(&mut self) {
        self.at.counters.tiles += 1;
        (self.at.phase, self.at.again) = (Phase::Waiting, false);
        self.at.tile_cols += 1;
        let across = self.cut(&self.at).map_or(0, |cut| cut.tiling.shape().cols);
        if self.at.tile_cols >= across {
            (self.at.tile_cols, self.at.tile_rows) = (0, self.at.tile_rows.saturating_add(1));
        }
    }
}
