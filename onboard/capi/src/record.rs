//! The data of a context between two calls: plain numbers, so that any bit pattern is legal to read.

use elunar_core::nn::{Suspended, Verdict};

/// Number of eight-byte words of a record.
pub(crate) const WORDS: usize = 34;

/// No tile was begun.
pub(crate) const EMPTY: u32 = 0;
/// The arena contains a tile of the caller.
pub(crate) const TILE: u32 = 1;
/// A tile of the caller is prepared.
pub(crate) const PREPARING: u32 = 3;
/// A tile of the caller shows the light of its scene.
pub(crate) const SURVEY: u32 = 4;
/// The arena contains the tile of the self test.
pub(crate) const SELF_TEST: u32 = 2;

/// A tile in progress was dropped for this one.
pub(crate) const DROPPED: u32 = 1;
/// The heights are the network's.
pub(crate) const PREDICTED: u32 = 1;
/// The heights are those of the coarse DTM.
pub(crate) const COARSE: u32 = 2;

/// The data of a context.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct ContextRecord {
    /// Address and length of the lent memory, bytes.
    pub(crate) home: u64,
    pub(crate) home_bytes: u64,
    /// Address of the model; the verdict has its length.
    pub(crate) model: u64,
    pub(crate) verdict: Verdict,
    /// The tile: [`EMPTY`], [`PREPARING`], [`SURVEY`], [`TILE`] or [`SELF_TEST`].
    pub(crate) tile: u32,
    /// 1 while a call changes the arena. A call finds 1 at its start only if the previous call did not return.
    pub(crate) busy: u32,
    /// The position of the runner.
    pub(crate) suspended: Suspended,
    /// Checksum of the caller's structure of the tile that is prepared.
    pub(crate) tile_crc: u32,
    /// What the end of the preparation reports: [`DROPPED`].
    pub(crate) notices: u32,
    /// How the tile was made: 0 unless it is finished, [`PREDICTED`] or [`COARSE`].
    pub(crate) made: u32,
    /// Number of pixels with valid heights, and checksum of the bits of dark pixels.
    pub(crate) valid_px: u32,
    pub(crate) dark_crc: u32,
    /// Counters: see [`crate::types::eld_telemetry_t`].
    pub(crate) calls: u64,
    pub(crate) faults: u64,
    pub(crate) repairs: u64,
    /// Repairs that no status has reported yet.
    pub(crate) repairs_untold: u32,
    pub(crate) last_fault: u32,
    pub(crate) lights_assumed: u64,
    pub(crate) tiles_dropped: u64,
    /// Number of tiles that were added to the light of the scene.
    pub(crate) lights_added: u64,
    /// Bits of [`elunar_core::photoclinometry::ExpectedErrors::to_values`].
    pub(crate) expected_bits: [u32; 6],
}

/// Returns a word of two numbers; a number of 64 bits stands alone.
const fn pair(low: u64, high: u32) -> u64 {
    low | (high as u64) << 32
}

/// Makes [`ContextRecord::words`] and [`ContextRecord::of`] from one list of words, each one field or a pair of fields of 32 bits.
macro_rules! words {
    ($record:ident: $([$low:expr $(, $high:expr)?])+) => {
        impl ContextRecord {
            /// Returns the record as words, in a fixed order.
            pub(crate) fn words(&self) -> [u64; WORDS] {
                let $record = self;
                [$(pair($low as u64, 0 $(+ $high)?)),+]
            }

            /// Returns the record of these words.
            pub(crate) fn of(words: &[u64; WORDS]) -> Self {
                let mut all = Self::default();
                let $record = &mut all;
                let mut words = words.iter();
                $({
                    let word = words.next().copied().unwrap_or_default();
                    $low = word as _;
                    $($high = (word >> 32) as u32;)?
                })+
                all
            }
        }
    };
}

words!(r:
    [r.home]
    [r.home_bytes]
    [r.model]
    [r.verdict.header_crc, r.verdict.file_bytes]
    [r.verdict.scratch_offset, r.verdict.scratch_bytes]
    [r.verdict.macs]
    [r.tile, r.busy]
    [r.suspended.phase, r.suspended.entry]
    [r.suspended.step, r.suspended.unit]
    [r.suspended.scrub_chunk, r.suspended.scrub_offset]
    [r.suspended.scrub_crc, r.tile_crc]
    [r.notices, r.made]
    [r.valid_px, r.repairs_untold]
    [r.suspended.telemetry.tiles]
    [r.suspended.telemetry.steps]
    [r.suspended.telemetry.macs]
    [r.suspended.telemetry.inputs_clamped]
    [r.suspended.telemetry.saturated]
    [r.suspended.telemetry.scrubbed_bytes]
    [r.suspended.telemetry.scrub_passes]
    [r.suspended.telemetry.scrub_faults]
    [r.suspended.telemetry.self_test_faults]
    [r.calls]
    [r.faults]
    [r.repairs]
    [r.lights_assumed]
    [r.tiles_dropped]
    [r.lights_added]
    [r.last_fault, r.suspended.protection]
    [r.verdict.sum_count, r.dark_crc]
    [r.suspended.telemetry.tile_faults]
    [r.expected_bits[0], r.expected_bits[1]]
    [r.expected_bits[2], r.expected_bits[3]]
    [r.expected_bits[4], r.expected_bits[5]]
);

impl ContextRecord {
    /// Drops the tile and counts it; the other counters stay unchanged.
    pub(crate) fn lose_tile(&mut self) {
        self.tiles_dropped = self.tiles_dropped.wrapping_add(u64::from(self.tile != EMPTY));
        (self.tile, self.valid_px, self.made) = (EMPTY, 0, 0);
        self.suspended = Suspended { phase: Suspended::IDLE, entry: 0, step: 0, unit: 0, ..self.suspended };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_come_back_as_they_were() {
        let words: [u64; WORDS] = core::array::from_fn(|i| 0x0101_0101_0101_0101 * (i as u64 + 1));
        let back = ContextRecord::of(&words).words();
        assert_eq!(back, words);
        let all_ones = ContextRecord::of(&[u64::MAX; WORDS]);
        assert_eq!(ContextRecord::of(&all_ones.words()), all_ones);
    }
}
