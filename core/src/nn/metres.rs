//! A tile in physical units through the runner: brightness and metres in, metres out, without a buffer in between.

use super::error::RunError;
use super::runner::Runner;
use crate::error::NormError;
use crate::mask;
use crate::norm::ElevationScale;
use core::fmt;

/// Why a tile in physical units cannot begin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TileError {
    /// The runner refuses it.
    Run(RunError),
    /// It cannot be normalised: no relief, no contrast, too few valid pixels.
    Norm(NormError),
}

impl fmt::Display for TileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Run(e) => e.fmt(f),
            Self::Norm(e) => e.fmt(f),
        }
    }
}

impl core::error::Error for TileError {}

impl From<NormError> for TileError {
    fn from(e: NormError) -> Self {
        Self::Norm(e)
    }
}

impl Runner<'_, '_> {
    /// Normalises a tile as the model was trained (Eq. 2 with the model's NR and margin, Sec. III-A2 for the image), pixel by
    /// pixel on the way into the arena, and stands ready for the first step. `image` is relative brightness, `coarse_m` metres
    /// above the sphere, both row-major rows * cols. Pixels that do not count (see [`mask`]) are fed as 0.
    ///
    /// The scale that comes back is what [`Self::heights`] needs.
    ///
    /// # Errors
    /// [`TileError`]; then nothing has begun.
    pub fn begin_metres(
        &mut self,
        image: &[f32],
        coarse_m: &[f32],
        valid: Option<&[bool]>,
    ) -> Result<ElevationScale, TileError> {
        let (rows, cols) = self.model().tile();
        let lengths = [image.len(), coarse_m.len(), valid.map_or(rows * cols, <[bool]>::len)];
        if let Some(&found) = lengths.iter().find(|&&len| len != rows * cols) {
            return Err(TileError::Run(RunError::TileSize { expected: rows * cols, found }));
        }
        let (nr, margin) = (self.model().nr(), self.model().range_margin());
        let scale = ElevationScale::from_heights(coarse_m, valid, nr)?.with_margin(margin)?;
        let (min, max) = mask::extent(image, valid).map_err(|found| NormError::TooFewValid { found })?;
        let span = max - min;
        if !(span.is_finite() && span > 0.0) {
            return Err(NormError::ConstantImage.into());
        }
        let brightness = |i: usize| if mask::counts(image, valid, i) { (image[i] - min) / span } else { 0.0 };
        let elevation = |i: usize| {
            let mut z = [0.0];
            // One sample in, one out: the lengths agree.
            let _ = scale.normalise(&coarse_m[i..=i], &mut z);
            z[0]
        };
        self.load(brightness, elevation);
        Ok(scale)
    }

    /// The finished tile in metres above the sphere (Eq. 8), row-major; `scale` is the one that [`Self::begin_metres`] returned.
    ///
    /// # Errors
    /// [`RunError::State`] before the tile is done, [`RunError::TileSize`].
    pub fn heights(&self, scale: &ElevationScale, out_m: &mut [f32]) -> Result<(), RunError> {
        self.output(out_m)?;
        for z in out_m {
            let mut metres = [0.0];
            let _ = scale.recover(&[*z], &mut metres);
            *z = metres[0];
        }
        Ok(())
    }
}

/// Which heights of a tile mean something: those of pixels where image and coarse DTM both count. Slices of one length; should
/// they differ, the rest of `out` is false.
pub fn validity(image: &[f32], coarse_m: &[f32], valid: Option<&[bool]>, out: &mut [bool]) {
    let len = image.len().min(coarse_m.len()).min(valid.map_or(usize::MAX, <[bool]>::len));
    for (i, out) in out.iter_mut().enumerate() {
        *out = i < len && mask::counts(image, valid, i) && mask::counts(coarse_m, valid, i);
    }
}
