//! The requirements of a strip, known before its first line.

use super::blend::Blend;
use super::error::StripError;
use super::expected::Expected;
use super::mean::MEAN_BYTES;
use super::posts::PostGrid;
use super::ring::RingShape;
use crate::job::{TileJob, TileMemory, TileRules};
use crate::nn::{Illumination, LightSource, Lighting, Model, required};
use crate::pixels::PixelForm;
use crate::tile::{Shape, Tiling};
use core::ops::Range;

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
    /// Whether each tile's long waves are drawn to the coarse DTM's ([`crate::norm::Anchor`]), and keeps of short ones what the image shows
    /// ([`crate::norm::FineWaves`]).
    pub anchor: bool,
    /// Whether the processor may err ([`TileRules::checked`]).
    pub checked: bool,
    /// The light of the whole strip ([`Lighting::decide`] for its model); [`Lighting::NOT_ASKED`] for models that know any light.
    pub light: Lighting,
    /// The pixels of the image's lines. The lines are kept as they come.
    pub pixels: PixelForm,
    /// The place of the coarse DTM's posts, if it comes as rows of posts ([`super::Strip::push_posts`]); otherwise it comes with every line, on the
    /// image's pixels, and each of its samples is kept.
    pub posts: Option<PostGrid>,
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
    pub(super) rings: Rings,
    bytes_len: usize,
    samples_len: usize,
    sums_len: usize,
}

/// The rings of a strip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rings {
    pub(super) image: RingShape,
    pub(super) coarse: RingShape,
    pub(super) means: RingShape,
    pub(super) expected: RingShape,
}

impl Rings {
    /// Returns the rings for settings; `None` if their bytes overflow.
    fn new(settings: &StripSettings, tiling: &Tiling, tile: Shape) -> Option<Self> {
        let StripSettings { cols, ring_lines, pixels, posts, expected_errors, .. } = *settings;
        let floats = cols.checked_mul(4)?;
        let coarse = match posts {
            Some(grid) => RingShape { lines: grid.rows_for(ring_lines), line_bytes: grid.stride().checked_mul(4)? },
            None => RingShape { lines: ring_lines, line_bytes: floats },
        };
        let none = RingShape { lines: 0, line_bytes: 0 };
        Some(Self {
            image: RingShape { lines: ring_lines, line_bytes: pixels.format.row_bytes(cols) },
            coarse,
            means: RingShape { lines: tile.rows, line_bytes: cols.checked_mul(MEAN_BYTES)? },
            expected: if expected_errors { Expected::shape(tiling, tile)? } else { none },
        })
    }

    fn bytes(&self) -> Option<usize> {
        let Self { image, coarse, means, expected } = *self;
        [image, coarse, means, expected].into_iter().try_fold(0usize, |sum, ring| sum.checked_add(ring.bytes()?))
    }
}

impl StripPlan {
    /// Validates settings and computes the lengths.
    ///
    /// # Errors
    /// [`StripError::Columns`], [`StripError::Tile`], [`StripError::Ring`], [`StripError::Pixel`], [`StripError::Posts`], [`StripError::Light`].
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
        if ![pixel_m, coarse_px].iter().all(|v| v.is_finite() && *v > 0.0) || !settings.pixels.is_legal() {
            return Err(StripError::Pixel);
        }
        settings.posts.map_or(Ok(()), |grid| grid.check())?;
        if light.source == LightSource::NotAsked && model.illumination() != Illumination::Any {
            return Err(StripError::Light);
        }
        let rings = Rings::new(&settings, &tiling, tile).ok_or(many)?;
        let bytes_len = rings.bytes().and_then(|bytes| bytes.checked_add(TileMemory::valid_len(tile))).ok_or(many)?;
        let samples_len = tile.pixels().saturating_add(TileMemory::scratch_len(&model.input_rules(), tile));
        let sums_len = Blend::aside_len(cols, tile, expected_errors).max(TileMemory::lines_len(tile));
        let plan = Self { settings, tile, arena_bytes: required(model), rings, bytes_len, samples_len, sums_len };
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
        let StripSettings { pixel_m, coarse_px, anchor, checked, .. } = self.settings;
        TileJob::new(TileRules { pixel_m, coarse_px, anchor, checked }, model.input_rules(), self.tile)
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

    /// Length of [`super::StripMemory::bytes`]: image and coarse DTM of the lines kept, means of a tile's rows, expected errors of some rows of
    /// tiles if wanted, their checksums, and a bit per pixel of a tile.
    #[must_use]
    pub fn bytes_len(&self) -> usize {
        self.bytes_len
    }

    /// Length of [`super::StripMemory::samples`]: the coarse heights of a tile, and scratch memory.
    #[must_use]
    pub fn samples_len(&self) -> usize {
        self.samples_len
    }

    /// Length of [`super::StripMemory::sums`]: a few lines, in which nothing is kept.
    #[must_use]
    pub fn sums_len(&self) -> usize {
        self.sums_len
    }

    /// Returns the places of the parts of [`super::StripMemory::bytes`], each with its checksums: image lines, coarse lines or posts, means of
    /// heights, expected errors, and bits of a tile's valid heights.
    #[must_use]
    pub fn parts(&self) -> [Range<usize>; 5] {
        let Rings { image, coarse, means, expected } = self.rings;
        let mut end = 0;
        let rings = [image, coarse, means, expected].map(|ring| ring.bytes().unwrap_or_default());
        let [image, coarse, means, expected] = rings.map(|bytes| {
            let start = end;
            end += bytes;
            start..end
        });
        [image, coarse, means, expected, end..self.bytes_len]
    }

    /// Number of bytes in total, without the model's own.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.checked_bytes().unwrap_or(usize::MAX)
    }

    fn checked_bytes(&self) -> Option<usize> {
        let parts = [(self.arena_bytes, 1), (self.samples_len, 4), (self.sums_len, 8), (self.bytes_len, 1)];
        parts.into_iter().try_fold(0usize, |sum, (len, bytes)| sum.checked_add(len.checked_mul(bytes)?))
    }
}
