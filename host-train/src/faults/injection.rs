//! Where and when a bit flips.

use elunar_core::nn::file::{HEADER_BYTES, word};
use elunar_core::nn::{Model, Suspended, required};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// What is hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Target {
    /// Constants of the model: weights, biases, multipliers, tables.
    Constants,
    /// Records of tensors and operators, and the schedule.
    Program,
    /// The model's header and list of checksums.
    Header,
    /// Maps in the arena, whether or not they are still wanted.
    Maps,
    /// Scratch memory of the operator at work, and the checksums of rows.
    Notes,
    /// A bit of a map that cannot change any more.
    StuckBit,
    /// What a caller keeps of the run between two steps, as plain numbers without a checksum of their own.
    Place,
}

impl Target {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Constants, Self::Program, Self::Header, Self::Maps, Self::Notes, Self::StuckBit, Self::Place];

    /// As the tables have it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Constants => "constants (weights, biases, tables)",
            Self::Program => "program (records, schedule)",
            Self::Header => "model header and checksums",
            Self::Maps => "maps",
            Self::Notes => "scratch and row checksums",
            Self::StuckBit => "stuck bit in a map",
            Self::Place => "place of the run, unguarded",
        }
    }

    /// Whether the model itself is hit, which begins no tile again undone.
    pub const fn is_model(self) -> bool {
        matches!(self, Self::Constants | Self::Program | Self::Header)
    }

    /// The bytes it may hit: of the model, of the arena, or of the place.
    fn bytes(self, model: &Model<'_>) -> Range<usize> {
        let word = |index: usize| model.raw().word(index) as usize;
        match self {
            Self::Constants => word(word::CONSTANTS)..word(word::CONSTANTS) + word(word::CONSTANTS + 1),
            Self::Program => word(word::TENSORS)..word(word::CONSTANTS),
            // Not the magic and what says how long the file is: a loader reads them, a run does not.
            Self::Header => 4 * word::TILE..model.raw().body_offset().max(HEADER_BYTES),
            Self::Maps | Self::StuckBit => 0..model.scratch_offset(),
            Self::Notes => model.scratch_offset()..required(model),
            Self::Place => 0..PLACE_BYTES,
        }
    }
}

/// Numbers of a place, four bytes each: phase, entry, step, unit.
const PLACE_BYTES: usize = 16;

/// Bits that flip together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Injection {
    /// What is hit.
    pub target: Target,
    /// After which of the moments.
    pub moment: usize,
    /// The bits, counted from the start of the model, the arena, or the place; the second may be the first again: then it is one.
    pub bits: [usize; 2],
    /// Of a stuck bit: what it is from now on.
    pub stuck_at: bool,
}

impl Injection {
    /// Number `index` of a seed: a third of all flip two bits, half of those side by side, the others anywhere in the target.
    pub fn new(model: &Model<'_>, moments: usize, seed: u64, index: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(index);
        let target = Target::ALL[index as usize % Target::ALL.len()];
        let bytes = target.bytes(model);
        let mut any = || rng.random_range(8 * bytes.start..8 * bytes.end);
        let (first, far) = (any(), any());
        let near = if first + 1 < 8 * bytes.end { first + 1 } else { first - 1 };
        let second = match rng.random_range(0..6) {
            _ if target == Target::StuckBit => first,
            0 => near,
            1 => far,
            _ => first,
        };
        let moment = rng.random_range(0..moments.max(1));
        Self { target, moment, bits: [first, second], stuck_at: rng.random() }
    }

    /// How many bits flip.
    pub fn count(&self) -> usize {
        1 + (self.bits[0] != self.bits[1]) as usize
    }

    /// Flips them.
    pub fn flip(&self, bytes: &mut [u8]) {
        for &bit in &self.bits[..self.count()] {
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
    }

    /// Forces the stuck bit.
    pub fn stick(&self, bytes: &mut [u8]) {
        let [bit, _] = self.bits;
        let mask = 1 << (bit % 8);
        if self.stuck_at {
            bytes[bit / 8] |= mask;
        } else {
            bytes[bit / 8] &= !mask;
        }
    }

    /// Flips them in a place.
    pub fn flip_place(&self, place: &Suspended) -> Suspended {
        let numbers = [place.phase, place.entry, place.step, place.unit];
        let mut bytes: Vec<u8> = numbers.iter().flat_map(|n| n.to_le_bytes()).collect();
        self.flip(&mut bytes);
        let number = |i: usize| bytes[4 * i..].first_chunk().map_or(0, |b| u32::from_le_bytes(*b));
        Suspended { phase: number(0), entry: number(1), step: number(2), unit: number(3), ..*place }
    }
}
