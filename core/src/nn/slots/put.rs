//! Bytes on their way into a region: sectors erased, bytes written, and read back.

use super::work::{Given, SlotPlaces};
use super::{Region, SlotError};
use crate::words::Words;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Phase {
    Erase,
    Write,
    Read,
}

/// Bytes that are erased, written and read back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Put {
    pub(super) region: Region,
    pub(super) offset_bytes: usize,
    pub(super) len: usize,
    /// The next sector that is erased.
    pub(super) sector: usize,
    pub(super) phase: Phase,
}

impl Put {
    pub(super) const NONE: Self =
        Self { region: Region::Record, offset_bytes: 0, len: 0, sector: 0, phase: Phase::Erase };

    /// Erases the sectors that begin within the range, and then writes it. If the region does not have the range, nothing is written and read.
    pub(super) fn new(places: &SlotPlaces, region: Region, offset_bytes: usize, len: usize) -> Self {
        let end = offset_bytes.saturating_add(len);
        if end > places.bytes(region) {
            return Self { region, offset_bytes: 0, len: 0, sector: 0, phase: Phase::Read };
        }
        let sector = offset_bytes.checked_next_multiple_of(places.sector_bytes(region)).unwrap_or(end);
        let phase = if sector < end { Phase::Erase } else { Phase::Write };
        Self { region, offset_bytes, len, sector, phase }
    }

    /// Takes what the driver has done or read; `None` until the bytes are there.
    pub(super) fn go_on(
        &mut self,
        places: &SlotPlaces,
        given: &Given<'_>,
        holds: impl FnOnce(&[u8]) -> bool,
    ) -> Option<Result<(), SlotError>> {
        let end = self.offset_bytes.saturating_add(self.len);
        match (self.phase, given) {
            (Phase::Read, Given::Bytes(bytes)) if holds(bytes) => return Some(Ok(())),
            (Phase::Read, _) => return Some(Err(SlotError::NotWritten { offset_bytes: self.offset_bytes })),
            (_, Given::Done(Err(error))) => return Some(Err(SlotError::Storage(*error))),
            // Bytes were not asked for.
            (_, Given::Bytes(_)) => {}
            (Phase::Erase, Given::Done(Ok(()))) => {
                self.sector = self.sector.saturating_add(places.sector_bytes(self.region));
                self.phase = if self.sector < end { Phase::Erase } else { Phase::Write };
            }
            (Phase::Write, Given::Done(Ok(()))) => self.phase = Phase::Read,
        }
        None
    }

    pub(super) fn visit(&mut self, words: &mut Words<'_>) {
        words.choice(&mut self.region, &Region::ALL);
        words.usize(&mut self.offset_bytes);
        words.usize(&mut self.len);
        words.usize(&mut self.sector);
        words.choice(&mut self.phase, &[Phase::Erase, Phase::Write, Phase::Read]);
    }
}
