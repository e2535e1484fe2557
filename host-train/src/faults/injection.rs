//! Place and time of a bit flip.

use elunar_core::nn::file::{HEADER_BYTES, word};
use elunar_core::nn::{Model, Suspended, required};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Target of a bit flip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InjectionTarget {
    /// Constants of the model: weights, biases, multipliers, tables.
    Constants,
    /// Records of tensors and operators, and the schedule.
    Program,
    /// The model's header and list of checksums.
    Header,
    /// Maps in the arena, in use or not.
    Maps,
    /// Scratch memory of the current operator, and the checksums of rows.
    Notes,
    /// A bit of a map that keeps one value.
    StuckBit,
    /// The state of a run that a caller keeps between two steps, as plain numbers without a checksum.
    Place,
    /// Image lines of a strip.
    Lines,
    /// Posts of a strip.
    Posts,
    /// Means of a strip's heights.
    Means,
    /// Expected errors of a strip's tiles.
    Errors,
    /// Validity bits of a strip's tile.
    Valid,
    /// Coarse heights and scratch memory of a strip's tile.
    Buffers,
}

impl InjectionTarget {
    /// The targets of a tile.
    pub const ALL: [Self; 7] =
        [Self::Constants, Self::Program, Self::Header, Self::Maps, Self::Notes, Self::StuckBit, Self::Place];

    /// The targets of a strip.
    pub const STRIP: [Self; 6] = [Self::Lines, Self::Posts, Self::Means, Self::Errors, Self::Valid, Self::Buffers];

    /// Returns the name in the tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Constants => "constants (weights, biases, tables)",
            Self::Program => "program (records, schedule)",
            Self::Header => "model header and checksums",
            Self::Maps => "maps",
            Self::Notes => "scratch and row checksums",
            Self::StuckBit => "stuck bit in a map",
            Self::Place => "place of the run, unguarded",
            Self::Lines => "strip: image lines",
            Self::Posts => "strip: posts",
            Self::Means => "strip: means of heights",
            Self::Errors => "strip: expected errors",
            Self::Valid => "strip: validity of a tile",
            Self::Buffers => "strip: coarse heights and scratch of a tile",
        }
    }

    /// Returns whether the target is in the model itself. Then a run of the tile from its beginning cannot repair the fault.
    pub const fn is_model(self) -> bool {
        matches!(self, Self::Constants | Self::Program | Self::Header)
    }

    /// Returns the range of bytes that the target includes: of the model, of the arena, or of the place.
    fn bytes(self, model: &Model<'_>) -> Range<usize> {
        let word = |index: usize| model.raw().word(index) as usize;
        match self {
            Self::Constants => word(word::CONSTANTS)..word(word::CONSTANTS) + word(word::CONSTANTS + 1),
            Self::Program => word(word::TENSORS)..word(word::CONSTANTS),
            // Without the magic and the length of the file. Only a loader reads them, not a run.
            Self::Header => 4 * word::TILE..model.raw().body_offset().max(HEADER_BYTES),
            Self::Maps | Self::StuckBit => 0..model.scratch_offset(),
            Self::Notes => model.scratch_offset()..required(model),
            // A strip says itself where its own are.
            _ => 0..PLACE_BYTES,
        }
    }
}

/// Size of the numbers of a place, four bytes each: phase, entry, step, unit.
const PLACE_BYTES: usize = 16;

/// Bits that flip together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Injection {
    /// Target of the flips.
    pub target: InjectionTarget,
    /// Number of the moment after which the bits flip.
    pub moment: usize,
    /// The bits, counted from the start of the model, the arena, or the place. If both are the same, one bit flips.
    pub bits: [usize; 2],
    /// Value of a stuck bit from now on.
    pub stuck_at: bool,
}

impl Injection {
    /// Returns injection `index` of a seed. A third of all injections flip two bits. Half of these are adjacent, the others anywhere in the
    /// target.
    pub fn new(model: &Model<'_>, moments: usize, seed: u64, index: u64) -> Self {
        Self::draw(&InjectionTarget::ALL, |target| target.bytes(model), moments, seed, index)
    }

    /// Returns injection `index` of a seed into one of some targets; `place` tells the bytes of a target.
    pub(super) fn draw(
        targets: &[InjectionTarget],
        place: impl Fn(InjectionTarget) -> Range<usize>,
        moments: usize,
        seed: u64,
        index: u64,
    ) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(index);
        let target = targets[index as usize % targets.len()];
        let bytes = place(target);
        let mut any = || rng.random_range(8 * bytes.start..8 * bytes.end);
        let (first, far) = (any(), any());
        let near = if first + 1 < 8 * bytes.end { first + 1 } else { first - 1 };
        let second = match rng.random_range(0..6) {
            _ if target == InjectionTarget::StuckBit => first,
            0 => near,
            1 => far,
            _ => first,
        };
        let moment = rng.random_range(0..moments.max(1));
        Self { target, moment, bits: [first, second], stuck_at: rng.random() }
    }

    /// Returns the number of bits that flip.
    pub fn count(&self) -> usize {
        1 + (self.bits[0] != self.bits[1]) as usize
    }

    /// Flips the bits.
    pub fn flip(&self, bytes: &mut [u8]) {
        for &bit in &self.bits[..self.count()] {
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
    }

    /// Sets the stuck bit to its value.
    pub fn stick(&self, bytes: &mut [u8]) {
        let [bit, _] = self.bits;
        let mask = 1 << (bit % 8);
        if self.stuck_at {
            bytes[bit / 8] |= mask;
        } else {
            bytes[bit / 8] &= !mask;
        }
    }

    /// Flips the bits of a place.
    pub fn flip_place(&self, place: &Suspended) -> Suspended {
        let numbers = [place.phase, place.entry, place.step, place.unit];
        let mut bytes: Vec<u8> = numbers.iter().flat_map(|n| n.to_le_bytes()).collect();
        self.flip(&mut bytes);
        let number = |i: usize| bytes[4 * i..].first_chunk().map_or(0, |b| u32::from_le_bytes(*b));
        Suspended { phase: number(0), entry: number(1), step: number(2), unit: number(3), ..*place }
    }
}
