//! The caller's tile as samples.

use elunar_core::mask::is_real;
use elunar_core::nn::TileLight;
use elunar_core::pixels::Pixels;
use elunar_core::posts::PostMap;
use elunar_core::samples::Samples;
use elunar_core::{TileInput, TileRules};

/// A tile whose pointers have been validated.
pub(crate) struct CallerTile<'t> {
    pub(crate) image: Pixels<'t>,
    pub(crate) coarse_m: Coarse<'t>,
    pub(crate) valid: Option<&'t [bool]>,
    pub(crate) rules: TileRules,
    pub(crate) light: TileLight,
    /// Checksum of the structure, by which a tile that is prepared is known again.
    pub(crate) crc: u32,
}

/// The coarse DTM, on either grid.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Coarse<'t> {
    /// On the image's.
    Grid(&'t [f32]),
    /// On its own.
    Posts(PostMap<'t>),
}

impl Samples for Coarse<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Grid(map) => map.len(),
            Self::Posts(map) => map.len(),
        }
    }

    fn at(&self, index: usize) -> f32 {
        match self {
            Self::Grid(map) => map.at(index),
            Self::Posts(map) => map.at(index),
        }
    }

    fn read(&self, first: usize, out: &mut [f32]) {
        match self {
            Self::Grid(map) => map.read(first, out),
            Self::Posts(map) => map.read(first, out),
        }
    }

    fn work(&self) -> u64 {
        match self {
            Self::Grid(map) => map.work(),
            Self::Posts(map) => map.work(),
        }
    }
}

/// Samples under the caller's mask.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Unmasked<'t, S> {
    samples: S,
    valid: Option<&'t [bool]>,
}

impl<S: Samples> Samples for Unmasked<'_, S> {
    fn len(&self) -> usize {
        self.samples.len()
    }

    fn at(&self, index: usize) -> f32 {
        let counts = self.valid.is_none_or(|valid| valid.get(index) == Some(&true));
        if counts { self.samples.at(index) } else { f32::NAN }
    }

    fn work(&self) -> u64 {
        self.samples.work()
    }

    fn read(&self, first: usize, out: &mut [f32]) {
        self.samples.read(first, out);
        if let Some(valid) = self.valid {
            let valid = valid.get(first..).unwrap_or_default();
            out.iter_mut().zip(valid).filter(|(_, valid)| !**valid).for_each(|(v, _)| *v = f32::NAN);
        }
    }
}

impl CallerTile<'_> {
    /// Returns the tile for a job.
    pub(crate) fn input(&self) -> TileInput<Unmasked<'_, Pixels<'_>>, Unmasked<'_, Coarse<'_>>> {
        let Self { image, coarse_m, valid, light, .. } = *self;
        let (image, coarse_m) = (Unmasked { samples: image, valid }, Unmasked { samples: coarse_m, valid });
        TileInput { image, coarse_m, inside: self.image.shape, light }
    }

    /// Returns whether a pixel is valid. Of posts, which are not interpolated for this, one must be real.
    pub(crate) fn has_valid_pixels(&self) -> bool {
        let TileInput { image, coarse_m, .. } = self.input();
        let is_covered = |i: usize| match self.coarse_m {
            Coarse::Grid(_) => is_real(coarse_m.at(i)),
            Coarse::Posts(_) => true,
        };
        let has_posts = if let Coarse::Posts(map) = &self.coarse_m { map.has_posts() } else { true };
        has_posts && (0..coarse_m.len()).any(|i| is_covered(i) && is_real(image.at(i)))
    }
}

/// Writes each bit as a byte, 1 or 0.
pub(crate) fn unpack(bits: &[u8], out: &mut [u8]) {
    for (eight, &byte) in out.chunks_mut(8).zip(bits) {
        for (bit, out) in eight.iter_mut().enumerate() {
            *out = byte >> bit & 1;
        }
    }
}
