//! Terrain maps line by line, as the lines of a DTM arrive. Only the lines under one footprint are kept.

use super::footprint::{self, MAX_RADIUS_PX, MAX_SIDE};
use super::hillshade::{Sun, SunVector};
use super::slope::from_gradient_deg;
use super::{HazardLimits, PixelSize, of_lines};
use crate::error::{LengthError, same_length};
use crate::part::{copy, head, head_mut, item, part, part_mut};
use crate::terrain::TerrainError;

/// Settings of the maps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineOptions {
    /// Number of samples of a line, at least 1.
    pub cols: usize,
    /// Size of a pixel on the ground.
    pub pixel: PixelSize,
    /// Radius r of the footprint, pixels, 1 to [`MAX_RADIUS_PX`]: a square of 2r + 1 pixels a side.
    pub radius_px: usize,
    /// Light of the hillshade.
    pub sun: Sun,
    /// Limits of the vehicle.
    pub limits: HazardLimits,
}

impl LineOptions {
    /// Number of samples of memory to lend: the 2r + 1 lines under a footprint, and as many of their slopes' errors if the limits ask for
    /// them ([`HazardLimits::with_sigmas`]); `usize::MAX` if the product overflows.
    #[must_use]
    pub fn memory_len(&self) -> usize {
        let kinds = if self.limits.sigmas() > 0.0 { 2 } else { 1 };
        self.heights_len().saturating_mul(kinds)
    }

    fn heights_len(&self) -> usize {
        self.side().saturating_mul(self.cols)
    }

    fn side(&self) -> usize {
        self.radius_px.saturating_mul(2).saturating_add(1)
    }

    /// Validates the settings.
    ///
    /// # Errors
    /// [`TerrainError::Radius`], [`TerrainError::Pixel`], or [`TerrainError::Length`] if there are no columns.
    pub fn check(&self) -> Result<(), TerrainError> {
        if !(1..=MAX_RADIUS_PX).contains(&self.radius_px) {
            return Err(TerrainError::Radius { found_px: self.radius_px });
        }
        if self.cols == 0 {
            return Err(TerrainError::Length(LengthError { expected: 1, found: 0 }));
        }
        for found_m in [self.pixel.row_m, self.pixel.col_m] {
            if !(found_m > 0.0 && found_m.is_finite()) {
                return Err(TerrainError::Pixel { found_m });
            }
        }
        Ok(())
    }
}

/// The output maps of one line. Each slice has the line's number of samples, or is empty. An empty map is not written, and is computed only
/// if another map depends on it.
#[derive(Debug, Default)]
pub struct LineMaps<'o> {
    /// Horn slope of the pixel, degrees, NaN without a value: as [`super::slope_deg`].
    pub slope_deg: &'o mut [f32],
    /// Shaded relief, 0 without a value: as [`super::hillshade()`].
    pub hillshade: &'o mut [u8],
    /// Slope of the least-squares plane of the footprint, degrees, NaN without a value.
    pub footprint_slope_deg: &'o mut [f32],
    /// Largest distance of a pixel of the footprint from that plane, up or down, metres along the vertical; NaN without a value.
    ///
    /// Our choice, for the comparison with a lander's clearance. A plane has a roughness of 0 for every tilt. A single boulder of height h
    /// on flat ground, at the centre of n pixels, has h (n − 1)/n.
    pub roughness_m: &'o mut [f32],
    /// Bits of [`super::hazard`]; 0 is safe.
    pub hazard: &'o mut [u8],
}

impl LineMaps<'_> {
    /// Validates that every map has `cols` samples or none.
    fn check(&self, cols: usize) -> Result<(), LengthError> {
        let floats = [&self.slope_deg, &self.footprint_slope_deg, &self.roughness_m].map(|map| map.len());
        let bytes = [&self.hillshade, &self.hazard].map(|map| map.len());
        floats.into_iter().chain(bytes).filter(|len| *len != 0).try_for_each(|len| same_length(cols, len))
    }
}

/// The position of paused [`TerrainLines`]; their memory holds the rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LinesPaused {
    /// Number of lines of the grid that were pushed.
    pub taken: u64,
    /// Number of lines that were returned.
    pub given: u64,
    /// Whether [`TerrainLines::finish`] returns the remaining ones.
    pub finishing: bool,
}

/// Terrain maps of a DTM whose lines come one at a time, north first. It returns as many lines as it takes.
///
/// A line is returned r lines after it was pushed, the last ones by [`Self::finish`]. Edges follow the rule of the whole-grid functions:
/// there is no value where a window leaves the grid. The work per line is bounded: about 2 (2r + 1)² multiplications and additions per
/// pixel, less only for pixels without a value.
///
/// ```
/// use elunar_core::terrain::{HazardLimits, LineMaps, LineOptions, PixelSize, Sun, TerrainLines, hazard};
///
/// let limits = HazardLimits::new(10.0, 0.3)?; // degrees, metres
/// let options = LineOptions { cols: 7, pixel: PixelSize::square(0.5), radius_px: 1, sun: Sun::default(), limits };
/// let mut memory = [0.0; 21];
/// assert_eq!(options.memory_len(), memory.len());
/// let mut lines = TerrainLines::new(options, &mut memory)?;
///
/// // Flat ground with a boulder of 0.6 m.
/// let flat = [-1900.0; 7];
/// let mut boulder = flat;
/// boulder[2] += 0.6;
/// let (mut hazards, mut mask) = (Vec::new(), [0; 7]);
/// for line in [flat, flat, boulder, flat, flat] {
///     if lines.push(&line, &mut LineMaps { hazard: &mut mask, ..LineMaps::default() })?.is_some() {
///         hazards.push(mask);
///     }
/// }
/// while lines.finish(&mut LineMaps { hazard: &mut mask, ..LineMaps::default() })?.is_some() {
///     hazards.push(mask);
/// }
/// assert_eq!(hazards.len(), 5, "as many lines as went in");
/// assert_eq!(hazards[0], [hazard::UNKNOWN; 7], "the edge has too few neighbours");
/// assert_eq!(hazards[2][1..6], [3, 2, 3, 0, 0], "the boulder is too rough, and what stands beside it tilts");
/// # Ok::<(), elunar_core::terrain::TerrainError>(())
/// ```
#[derive(Debug)]
pub struct TerrainLines<'m> {
    options: LineOptions,
    light: SunVector,
    /// The last 2r + 1 lines; line k is in place k mod (2r + 1). The errors of their slopes follow.
    memory: &'m mut [f32],
    at: LinesPaused,
}

impl<'m> TerrainLines<'m> {
    /// Takes [`LineOptions::memory_len`] samples of `memory`, which may be longer and may have any contents.
    ///
    /// # Errors
    /// [`TerrainError::Radius`], [`TerrainError::Pixel`], or [`TerrainError::Length`] if there are no columns or too little memory.
    pub fn new(options: LineOptions, memory: &'m mut [f32]) -> Result<Self, TerrainError> {
        options.check()?;
        let (expected, found) = (options.memory_len(), memory.len());
        if found < expected {
            return Err(TerrainError::Length(LengthError { expected, found }));
        }
        let memory = head_mut(memory, expected);
        Ok(Self { options, light: SunVector::of(options.sun), memory, at: LinesPaused::default() })
    }

    /// Returns the position. With it and unchanged memory, the lines can be resumed.
    #[must_use]
    pub fn pause(&self) -> LinesPaused {
        self.at
    }

    /// Resumes paused lines with the memory that they used. Any position is harmless; one that does not exist stands for a new grid.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn resume(options: LineOptions, memory: &'m mut [f32], paused: LinesPaused) -> Result<Self, TerrainError> {
        let lines = Self::new(options, memory)?;
        let waiting = paused.taken.checked_sub(paused.given).filter(|_| paused.taken < u64::MAX);
        let exists = waiting.is_some_and(|lines| lines <= options.radius_px as u64);
        Ok(Self { at: if exists { paused } else { LinesPaused::default() }, ..lines })
    }

    /// Takes the next line: `cols` heights in metres, NaN or a special value of [`crate::mask`] for voids. If there is a line whose window
    /// is complete, fills `maps` with it and returns its number, counted from 0. Otherwise `maps` stay unchanged.
    ///
    /// # Errors
    /// [`TerrainError::Length`] for a line or a map of another length, [`TerrainError::Unfinished`] between the first and the last line of
    /// [`Self::finish`]; nothing is changed then.
    pub fn push(&mut self, line_m: &[f32], maps: &mut LineMaps<'_>) -> Result<Option<u64>, TerrainError> {
        self.push_with(line_m, &[], maps)
    }

    /// As [`Self::push`], with the standard deviations of the errors of the line's slopes along either axis, metres per metre, as
    /// [`crate::strip::Strip::take_line_with`] gives them; NaN where unknown. An empty slice stands for an unknown line. They count if the
    /// limits ask for them.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn push_with(
        &mut self,
        line_m: &[f32],
        slope_sd: &[f32],
        maps: &mut LineMaps<'_>,
    ) -> Result<Option<u64>, TerrainError> {
        if self.at.finishing && self.at.given < self.at.taken {
            return Err(TerrainError::Unfinished { lines: self.at.taken - self.at.given });
        }
        same_length(self.options.cols, line_m.len())?;
        same_length(if slope_sd.is_empty() { 0 } else { self.options.cols }, slope_sd.len())?;
        maps.check(self.options.cols)?;
        if self.at.finishing {
            self.restart();
        }
        let at = self.place(self.at.taken);
        copy(part_mut(self.memory, at, self.options.cols), line_m);
        if self.options.limits.sigmas() > 0.0 {
            let errors = part_mut(self.memory, self.options.heights_len().saturating_add(at), self.options.cols);
            match slope_sd {
                [] => errors.fill(f32::NAN),
                slope_sd => copy(errors, slope_sd),
            }
        }
        self.at.taken += 1;
        if self.at.taken - self.at.given <= self.options.radius_px as u64 {
            return Ok(None);
        }
        Ok(Some(self.give(maps)))
    }

    /// Returns the remaining lines, one per call, after the last push; `None` when all were returned. Then the next grid may begin.
    ///
    /// # Errors
    /// [`TerrainError::Length`] for a map of another length; nothing is changed then.
    pub fn finish(&mut self, maps: &mut LineMaps<'_>) -> Result<Option<u64>, TerrainError> {
        maps.check(self.options.cols)?;
        self.at.finishing = self.at.given < self.at.taken;
        if self.at.finishing {
            return Ok(Some(self.give(maps)));
        }
        self.restart();
        Ok(None)
    }

    fn restart(&mut self) {
        self.at = LinesPaused::default();
    }

    /// Returns the index in memory of a line's first sample.
    fn place(&self, line: u64) -> usize {
        (line % self.options.side() as u64) as usize * self.options.cols
    }

    /// Writes the maps of the next line to be returned, and returns its number.
    fn give(&mut self, maps: &mut LineMaps<'_>) -> u64 {
        let (row, radius_px) = (self.at.given, self.options.radius_px);
        let mut lines: [&[f32]; MAX_SIDE] = [&[]; MAX_SIDE];
        for (i, line) in lines.iter_mut().take(self.options.side()).enumerate() {
            // Empty above the first line and below the last one.
            let there = (row + i as u64).checked_sub(radius_px as u64).filter(|there| *there < self.at.taken);
            *line = there.map_or(&[], |there| part(self.memory, self.place(there), self.options.cols));
        }
        let errors = match self.options.limits.sigmas() > 0.0 {
            true => part(self.memory, self.options.heights_len().saturating_add(self.place(row)), self.options.cols),
            false => &[],
        };
        self.fill(head(&lines, self.options.side()), errors, maps);
        self.at.given += 1;
        row
    }

    /// Writes the maps of the middle one of 2r + 1 lines, whose slopes have these errors.
    fn fill(&self, lines: &[&[f32]], slope_sd: &[f32], maps: &mut LineMaps<'_>) {
        let LineOptions { cols, pixel, radius_px, limits, .. } = self.options;
        let around = [radius_px.wrapping_sub(1), radius_px, radius_px + 1].map(|i| item(lines, i));
        if !(maps.slope_deg.is_empty() && maps.hillshade.is_empty()) {
            for col in 0..cols {
                let gradient = of_lines(around, col, pixel);
                give(maps.slope_deg, col, gradient.map_or(f32::NAN, |gradient| from_gradient_deg(gradient) as f32));
                give(maps.hillshade, col, gradient.map_or(0, |gradient| self.light.shade(gradient)));
            }
        }
        if !(maps.footprint_slope_deg.is_empty() && maps.roughness_m.is_empty() && maps.hazard.is_empty()) {
            for col in 0..cols {
                let footprint = footprint::at(lines, col, radius_px, pixel);
                give(maps.footprint_slope_deg, col, footprint.map_or(f32::NAN, |f| f.slope_deg as f32));
                give(maps.roughness_m, col, footprint.map_or(f32::NAN, |f| f.roughness_m as f32));
                give(maps.hazard, col, limits.classify(footprint, slope_sd.get(col).copied().unwrap_or(f32::NAN)));
            }
        }
    }
}

/// Writes a pixel of a map; does nothing if the map is empty.
fn give<T>(map: &mut [T], col: usize, value: T) {
    if let Some(pixel) = map.get_mut(col) {
        *pixel = value;
    }
}

#[cfg(test)]
mod tests;
