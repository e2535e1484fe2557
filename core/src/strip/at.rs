//! The position of a strip between two calls, and its counters.

use super::plan::StripSettings;
use crate::job::{TileJob, TileRules};
use crate::nn::{InputRules, Lighting, RunError, Suspended};
use crate::pixels::PixelForm;
use crate::strip::PostGrid;
use crate::tile::Shape;
use crate::words::Words;

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
    /// Tiles given up after a third fault, which have no heights.
    pub tiles_void: u64,
    /// Times that the memory of a tile was found to have changed between two steps.
    pub memory_faults: u64,
    /// Pieces of kept lines, means or expected errors that were found to have changed. Their pixels are voids.
    pub pieces_lost: u64,
    /// The last fault of the runner; `None` also for heights that were not finite, and for numbers of the header that no model has.
    pub last_fault: Option<RunError>,
}

/// The progress of the current tile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Phase {
    Waiting,
    Working,
    /// The heights are at the begin of the scratch memory.
    Made,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct At {
    /// Number of lines taken in.
    pub(super) lines: usize,
    /// Number of rows of posts taken in.
    pub(super) post_rows: usize,
    pub(super) posts_ended: bool,
    /// Number of lines returned.
    pub(super) taken: usize,
    pub(super) ended: bool,
    /// Number of finished rows of tiles.
    pub(super) tile_rows: usize,
    /// Number of finished tiles of the next row.
    pub(super) tile_cols: usize,
    pub(super) phase: Phase,
    pub(super) job: TileJob,
    /// Number of lines of the current tile that are in the means.
    pub(super) added: usize,
    /// Number of faults of the current tile.
    pub(super) faults: u32,
    pub(super) counters: StripCounters,
}

/// The position of a paused strip. Its memory and the runner's arena hold the rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StripPaused {
    /// The position of the runner, for [`crate::Runner::resume`].
    pub runner: Suspended,
    pub(super) at: At,
}

impl At {
    pub(super) fn new(job: TileJob) -> Self {
        Self {
            lines: 0,
            post_rows: 0,
            posts_ended: false,
            taken: 0,
            ended: false,
            tile_rows: 0,
            tile_cols: 0,
            phase: Phase::Waiting,
            job,
            added: 0,
            faults: 0,
            counters: StripCounters::default(),
        }
    }

    fn visit(&mut self, words: &mut Words<'_>) {
        let Self { lines, post_rows, taken, tile_rows, tile_cols, added, .. } = self;
        [lines, post_rows, taken, tile_rows, tile_cols, added].into_iter().for_each(|v| words.usize(v));
        words.bool(&mut self.posts_ended);
        words.bool(&mut self.ended);
        words.choice(&mut self.phase, &[Phase::Waiting, Phase::Working, Phase::Made]);
        words.u32(&mut self.faults);
        self.job.visit(words);
        let c = &mut self.counters;
        let counts = [
            &mut c.tiles,
            &mut c.tiles_coarse,
            &mut c.tiles_empty,
            &mut c.tiles_again,
            &mut c.tiles_lost,
            &mut c.tiles_void,
            &mut c.memory_faults,
            &mut c.pieces_lost,
        ];
        counts.into_iter().for_each(|v| words.u64(v));
        words.option(&mut c.last_fault, RunError::State, RunError::visit);
    }
}

impl StripPaused {
    /// Number of words of a paused strip.
    pub const WORDS: usize = Suspended::WORDS + TileJob::WORDS + 22;

    /// Returns the position as words.
    #[must_use]
    pub fn to_words(mut self) -> [u64; Self::WORDS] {
        let mut words = [0; Self::WORDS];
        self.visit(&mut Words::writing(&mut words));
        words
    }

    /// Returns the position of these words, for a network with these rules and a tile of this shape; `None` if they are not those of a strip.
    #[must_use]
    pub fn from_words(mut words: [u64; Self::WORDS], input: InputRules, tile: Shape) -> Option<Self> {
        let rules = TileRules { pixel_m: 0.0, coarse_px: 0.0, anchor: false, checked: false };
        let mut paused = Self { runner: Suspended::default(), at: At::new(TileJob::new(rules, input, tile)) };
        let mut words = Words::reading(&mut words);
        paused.visit(&mut words);
        words.is_legal().then_some(paused)
    }

    fn visit(&mut self, words: &mut Words<'_>) {
        self.runner.visit(words);
        self.at.visit(words);
    }

    /// Returns the counters.
    #[must_use]
    pub fn counters(&self) -> StripCounters {
        self.at.counters
    }
}

impl StripSettings {
    /// Number of words of settings.
    pub const WORDS: usize = 30;

    /// Returns the settings as words.
    #[must_use]
    pub fn to_words(mut self) -> [u64; Self::WORDS] {
        let mut words = [0; Self::WORDS];
        self.visit(&mut Words::writing(&mut words));
        words
    }

    /// Returns the settings of these words; `None` if they are not those of settings. Whether they can be planned is another question.
    #[must_use]
    pub fn from_words(mut words: [u64; Self::WORDS]) -> Option<Self> {
        let mut settings = Self {
            cols: 0,
            ring_lines: 0,
            overlap_px: 0,
            pixel_m: 0.0,
            coarse_px: 0.0,
            anchor: false,
            checked: false,
            light: Lighting::NOT_ASKED,
            pixels: PixelForm::F32,
            posts: None,
            expected_errors: false,
        };
        let mut words = Words::reading(&mut words);
        settings.visit(&mut words);
        words.is_legal().then_some(settings)
    }

    fn visit(&mut self, words: &mut Words<'_>) {
        let Self { cols, ring_lines, overlap_px, pixel_m, coarse_px, .. } = self;
        [cols, ring_lines, overlap_px].into_iter().for_each(|v| words.usize(v));
        [pixel_m, coarse_px].into_iter().for_each(|v| words.f32(v));
        words.bool(&mut self.anchor);
        words.bool(&mut self.checked);
        words.bool(&mut self.expected_errors);
        self.light.visit(words);
        self.pixels.visit(words);
        let empty = PostGrid::spaced(0, (0.0, 0.0), (1.0, 1.0));
        words.option(&mut self.posts, empty, |grid, words| {
            words.usize(&mut grid.cols);
            let PostGrid { row0, rows_per_line, col0, cols_per_px, .. } = grid;
            [row0, rows_per_line, col0, cols_per_px].into_iter().for_each(|v| words.f64(v));
        });
    }
}
