//! Entries of the schedule: the order in which the operators compute the rows of their outputs.

use super::super::sum::seal;

/// Bytes of an entry of the schedule.
pub const ENTRY_BYTES: usize = 8;

/// `count` steps of one operator, from step `first` on. Each step of an operator runs once, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Number of the operator.
    pub operator: usize,
    /// First step of the operator.
    pub first: usize,
    /// Number of steps.
    pub count: usize,
}

impl Entry {
    /// Reads an entry; `None` if its seal is broken.
    #[inline]
    pub fn decode(bytes: &[u8; ENTRY_BYTES]) -> Option<Self> {
        let [a, b, c, d, e, f, g, h] = *bytes;
        let halves = [[a, b], [c, d], [e, f]].map(u16::from_le_bytes);
        let [operator, first, count] = halves.map(usize::from);
        (Self::seal(halves) == u16::from_le_bytes([g, h])).then_some(Self { operator, first, count })
    }

    /// Writes the seal, the last of the four numbers of an entry.
    pub(super) fn seal_record(bytes: &mut [u8; ENTRY_BYTES]) {
        let [a, b, c, d, e, f, ..] = *bytes;
        let [g, h] = Self::seal([[a, b], [c, d], [e, f]].map(u16::from_le_bytes)).to_le_bytes();
        *bytes = [a, b, c, d, e, f, g, h];
    }

    /// Returns the last of the four numbers from the others.
    fn seal(halves: [u16; 3]) -> u16 {
        let whole = seal(halves.map(u32::from));
        (whole ^ whole >> 16) as u16
    }

    /// Returns the entry's bytes. Each number is below 65536.
    pub fn encode(&self) -> [u8; ENTRY_BYTES] {
        let mut bytes = [0; ENTRY_BYTES];
        let halves = [self.operator, self.first, self.count].map(|v| v as u16);
        let all = halves.into_iter().chain([Self::seal(halves)]);
        bytes.as_chunks_mut::<2>().0.iter_mut().zip(all).for_each(|(b, v)| *b = v.to_le_bytes());
        bytes
    }
}
