//! Storage whose power fails after any byte written or erased.

use crate::nn::slots::{RECORD_BYTES, Region, Slot, Storage, StorageError};
use crate::nn::tests::Random;

pub(super) const REGIONS: [Region; 4] =
    [Region::Model(Slot::A), Region::Model(Slot::B), Region::Record, Region::RecordCopy];

/// The state that a cut leaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cut {
    /// All bytes before the cut are done.
    Clean,
    /// As `Clean`, with noise in the current byte.
    Garbage,
    /// As `Garbage`, with noise in the whole sector that was being erased.
    Torn,
}

/// NOR flash: bytes are erased before they are written, and written once.
#[derive(Debug, Clone)]
pub(super) struct Flash {
    pub(super) regions: [Vec<u8>; 4],
    pub(super) sector_bytes: usize,
    /// Number of bytes that may still be written or erased before power fails.
    pub(super) power: Option<usize>,
    pub(super) cut: Cut,
    pub(super) noise: Random,
    /// Number of bytes written and erased so far.
    pub(super) traffic: usize,
    /// Regions that report success without writing, and regions that refuse.
    pub(super) lies: Vec<Region>,
    pub(super) refuses: Vec<Region>,
    /// A region that keeps one bit of every write wrong.
    pub(super) worn: Option<Region>,
}

impl Flash {
    /// Makes blank storage; sectors of the records are at least as long as those of the models.
    pub(super) fn new(slot_bytes: usize, sector_bytes: usize) -> Self {
        let slot = vec![0xff; slot_bytes.next_multiple_of(sector_bytes)];
        let record = vec![0xff; RECORD_BYTES.next_multiple_of(sector_bytes)];
        Self {
            regions: [slot.clone(), slot, record.clone(), record],
            sector_bytes,
            power: None,
            cut: Cut::Clean,
            noise: Random::new(1),
            traffic: 0,
            lies: Vec::new(),
            refuses: Vec::new(),
            worn: None,
        }
    }

    pub(super) fn region(&mut self, region: Region) -> &mut Vec<u8> {
        &mut self.regions[index(region)]
    }

    pub(super) fn dead(&self) -> bool {
        self.power == Some(0)
    }

    /// Spends power for one more byte; returns `false` when it fails.
    fn byte(&mut self) -> bool {
        match &mut self.power {
            Some(0) => false,
            Some(left) => {
                *left -= 1;
                self.traffic += 1;
                *left > 0
            }
            None => {
                self.traffic += 1;
                true
            }
        }
    }
}

fn index(region: Region) -> usize {
    REGIONS.iter().position(|r| *r == region).unwrap()
}

const POWER: StorageError = StorageError { code: 1 };
const REFUSED: StorageError = StorageError { code: 2 };

impl Storage for Flash {
    fn bytes(&self, region: Region) -> &[u8] {
        &self.regions[index(region)]
    }

    fn sector_bytes(&self, _: Region) -> usize {
        self.sector_bytes
    }

    fn erase(&mut self, region: Region, offset_bytes: usize) -> Result<(), StorageError> {
        if self.refuses.contains(&region) {
            return Err(REFUSED);
        }
        assert_eq!(offset_bytes % self.sector_bytes, 0, "not the start of a sector");
        for at in offset_bytes..offset_bytes + self.sector_bytes {
            if self.dead() {
                return Err(POWER);
            }
            let alive = self.byte();
            let noise = self.noise.next() as u8;
            self.region(region)[at] = if alive || self.cut == Cut::Clean { 0xff } else { noise };
            if !alive && self.cut == Cut::Torn {
                for at in offset_bytes..offset_bytes + self.sector_bytes {
                    let noise = self.noise.next() as u8;
                    self.region(region)[at] = noise;
                }
            }
        }
        if self.dead() { Err(POWER) } else { Ok(()) }
    }

    fn write(&mut self, region: Region, offset_bytes: usize, bytes: &[u8]) -> Result<(), StorageError> {
        if self.refuses.contains(&region) {
            return Err(REFUSED);
        }
        for (at, &byte) in (offset_bytes..).zip(bytes) {
            if self.dead() {
                return Err(POWER);
            }
            assert_eq!(self.region(region)[at], 0xff, "{region:?} byte {at} was not erased");
            let alive = self.byte();
            let noise = self.noise.next() as u8;
            if !self.lies.contains(&region) {
                let wrong = u8::from(self.worn == Some(region) && at == offset_bytes) << 2;
                self.region(region)[at] = if alive || self.cut == Cut::Clean { byte ^ wrong } else { noise };
            }
        }
        if self.dead() { Err(POWER) } else { Ok(()) }
    }
}
