//! The requirements of a strip, known before its first line.

use super::error::StripError;
use super::expected::Expected;
use crate::job::{TileJob, TileMemory, TileRules};
use crate::nn::{Illumination, LightSource, Lighting, Model, required};
use crate::overlap::OverlapWeights;
use crate::tile::{Shape, Tiling};

/// The settings of a strip, known before its first line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StripSettings {
    /// Pixels of a line. A line shorter than a tile is continued by its last pixel to the tile's width.
    pub cols: usize,
    /// Number of lines kept, at least the rows of a tile plus one ([`StripPlan::least_lines`]). With each further line the camera can be
    /// one more line ahead while a row of tiles is computed.
    pub ring_lines: usize,
    /// Overlap of neighbouring tiles, pixels; less than either side of a tile.
    pub overlap_px: usize,
    /// Ground size of a pixel, metres.
    pub pixel_m: f32,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub coarse_px: f32,
    /// Whether each tile takes the long waves from the coarse DTM ([`crate::norm::Anchor`]), and keeps of short ones what the image shows
    /// ([`crate::norm::FineWaves`]).
    pub anchor: bool,
    /// The light of the whole strip ([`Lighting::decide`] for its model); [`Lighting::NOT_ASKED`] for models that know any light.
    pub light: Lighting,
    /// Whether [`super::Strip::take_line_with`] gives expected errors. They depend on the line's brightness, so finished lines keep their
    /// place until they are taken.
    pub expected_errors: bool,
}

/// The memory for a strip with these settings and a model: exact, and constant during the strip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StripPlan {
    pub(super) settings: StripSettings,
    pub(super) tile: Shape,
    arena_bytes: usize,
    /// Number of samples for the expected errors of tiles.
    pub(super) expected_len: usize,
    samples_len: usize,
    sums_len: usize,
}

impl StripPlan {
    /// Validates settings and computes the lengths.
    ///
    /// # Errors
    /// [`StripError::Columns`], [`StripError::Tile`], [`StripError::Ring`], [`StripError::Pixel`], [`StripError::Light`].
    pub fn new(model: &Model<'_>, settings: StripSettings) -> Result<Self, StripError> {
        let StripSettings { cols, ring_lines, overlap_px, pixel_m, coarse_px, light, expected_errors, .. } = settings;
        let tile = model.tile();
        let many = StripError::Columns { found: cols };
        if cols == 0 {
            return Err(many);
        }
        let tiling = Tiling::new(Shape::new(tile.rows, cols.max(tile.cols)), tile, overlap_px)?;
        let expected = Self::least_lines(model);
        if ring_lines < expected {
            return Err(StripError::Ring { expected, found: ring_lines });
        }
        if ![pixel_m, coarse_px].iter().all(|v| v.is_finite() && *v > 0.0) {
            return Err(StripError::Pixel);
        }
        if light.source == LightSource::NotAsked && model.illumination() != Illumination::Any {
            return Err(StripError::Light);
        }
        let pixels = tile.pixels();
        let scratch_len = TileMemory::scratch_len(&model.input_rules(), tile);
        let lines = ring_lines.checked_mul(cols).and_then(|n| n.checked_mul(2)).ok_or(many)?;
        let expected_len = if expected_errors { Expected::len(&tiling, tile).ok_or(many)? } else { 0 };
        let samples_len = lines.checked_add(pixels).and_then(|n| n.checked_add(scratch_len));
        let samples_len = samples_len.and_then(|n| n.checked_add(expected_len)).ok_or(many)?;
        let rows = tile.rows.checked_mul(cols).ok_or(many)?;
        let sums_len = rows.checked_add(Self::aside_len(cols, tile, expected_errors)).ok_or(many)?;
        let plan = Self { settings, tile, arena_bytes: required(model), expected_len, samples_len, sums_len };
        // Memory whose bytes overflow `usize` cannot be lent.
        plan.checked_bytes().map(|_| plan).ok_or(many)
    }

    /// Returns the smallest number of lines that a strip of this model can keep: those of a tile, and one that shows whether the strip
    /// continues below it.
    #[must_use]
    pub fn least_lines(model: &Model<'_>) -> usize {
        model.tile().rows.saturating_add(1)
    }

    /// Returns a job for the next tile.
    pub(super) fn job(&self, model: &Model<'_>) -> TileJob {
        let StripSettings { pixel_m, coarse_px, anchor, .. } = self.settings;
        TileJob::new(TileRules { pixel_m, coarse_px, anchor }, model.input_rules(), self.tile)
    }

    /// Returns the settings.
    #[must_use]
    pub fn settings(&self) -> StripSettings {
        self.settings
    }

    /// Number of bytes of the runner's arena.
    #[must_use]
    pub fn arena_bytes(&self) -> usize {
        self.arena_bytes
    }

    /// Length of [`super::StripMemory::samples`]: image and coarse heights of the lines kept, the coarse heights of a tile, scratch
    /// memory, and expected errors of some rows of tiles if wanted.
    #[must_use]
    pub fn samples_len(&self) -> usize {
        self.samples_len
    }

    /// Length of [`super::StripMemory::sums`]: weighted heights of a tile's rows, and a few lines.
    #[must_use]
    pub fn sums_len(&self) -> usize {
        self.sums_len
    }

    /// Length of [`super::StripMemory::valid`]: one bit per pixel of a tile.
    #[must_use]
    pub fn valid_len(&self) -> usize {
        TileMemory::valid_len(self.tile)
    }

    /// Number of bytes in total, without the model's own.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.checked_bytes().unwrap_or(usize::MAX)
    }

    fn checked_bytes(&self) -> Option<usize> {
        let parts = [(self.arena_bytes, 1), (self.samples_len, 4), (self.sums_len, 8), (self.valid_len(), 1)];
        parts.into_iter().try_fold(0usize, |sum, (len, bytes)| sum.checked_add(len.checked_mul(bytes)?))
    }

    /// Number of pixels of a tile.
    pub(super) fn pixels(&self) -> usize {
        self.tile.rows.saturating_mul(self.tile.cols)
    }

    /// Number of sums beside those of rows: for weights, a line of the strip, four of expected errors if wanted, and one of a tile with its scratch
    /// memory; or those of the anchor.
    fn aside_len(cols: usize, tile: Shape, expected_errors: bool) -> usize {
        let lines = cols.saturating_mul(if expected_errors { 1 + Expected::SUMS } else { 1 });
        let weigh = lines.saturating_add(tile.cols).saturating_add(OverlapWeights::scratch_len(tile.cols));
        weigh.max(TileMemory::lines_len(tile))
    }
}
