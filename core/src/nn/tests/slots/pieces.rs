//! Work that a driver does in pieces, from words that are kept between two of them: the same bytes in the storage as at once.

use super::flash::Flash;
use super::*;

/// Work and storage; nothing of the storage is seen but what is read.
struct Pieces {
    words: [u64; SlotWork::WORDS],
    flash: Flash,
    pieces: usize,
}

impl Pieces {
    fn new(flash: Flash) -> Self {
        let bytes = [Region::Model(Slot::A), Region::Model(Slot::B), Region::Record, Region::RecordCopy]
            .map(|region| flash.bytes(region).len());
        let work = SlotWork::new(SlotPlaces { bytes, sector_bytes: [flash.sector_bytes; 4] });
        Self { words: work.to_words(), flash, pieces: 0 }
    }

    fn work(&self) -> SlotWork {
        SlotWork::from_words(self.words).expect("words of a work")
    }

    /// Begins a task and does it, with the smallest budget.
    fn task(
        &mut self,
        begin: impl FnOnce(&mut SlotWork) -> Result<(), SlotError>,
        chunk: &[u8],
    ) -> Result<Answer, SlotError> {
        let mut work = self.work();
        begin(&mut work)?;
        loop {
            self.words = work.to_words();
            work = self.work();
            let read;
            let given = match work.want() {
                Want::Read { region, offset_bytes, len } => {
                    read = self.flash.bytes(region)[offset_bytes..offset_bytes + len].to_vec();
                    Given::Bytes(&read)
                }
                Want::Erase { region, offset_bytes } => Given::Done(self.flash.erase(region, offset_bytes)),
                Want::WriteRecord { region, bytes } => Given::Done(self.flash.write(region, 0, &bytes)),
                Want::WriteChunk { slot, offset_bytes, len } => {
                    assert_eq!(len, chunk.len());
                    Given::Done(self.flash.write(Region::Model(slot), offset_bytes, chunk))
                }
                Want::Nothing => panic!("work without an end"),
            };
            self.pieces += 1;
            if let Some(answer) = work.give(given, 1) {
                assert!(!work.is_at_work() && work.want() == Want::Nothing);
                self.words = work.to_words();
                return answer;
            }
        }
    }

    fn boot(&mut self) -> Result<Answer, SlotError> {
        let boot = |work: &mut SlotWork| {
            work.boot();
            Ok(())
        };
        self.task(boot, &[])
    }

    fn upload(&mut self, file: &[u8]) -> Result<Answer, SlotError> {
        let Ok(Answer::Written(mut there)) = self.task(|work| work.begin_upload(ModelId::of(file)), &[]) else {
            panic!("no upload")
        };
        while there < file.len() {
            let chunk = &file[there..file.len().min(there + 150)];
            let Answer::Written(now) = self.task(|work| work.write(there, chunk), chunk)? else {
                panic!("not written")
            };
            assert_eq!(self.work().uploaded(), Some(now));
            there = now;
        }
        self.task(|work| work.start_trial(1), &[])
    }
}

#[test]
fn an_update_in_pieces_leaves_the_bytes_of_one_at_once() {
    let (old, new) = (model(1, 0), model(2, 50_000));
    let mut flash = commissioned(&old, Slot::A, &new);
    // A part of the upload is there.
    flash.region(Region::Model(Slot::B))[20_000..].fill(0xff);
    let mut slots = Slots::new(flash.clone());
    slots.boot().unwrap();
    upload(&mut slots, &new).unwrap();
    let booted = slots.boot().unwrap();
    slots.confirm(self_test(&slots).unwrap()).unwrap();

    let mut pieces = Pieces::new(flash);
    pieces.boot().unwrap();
    assert_eq!(pieces.work().running().map(|boot| boot.standing), Ok(Standing::Confirmed));
    assert_eq!(pieces.upload(&new), Ok(Answer::Done));
    assert_eq!(pieces.boot(), Ok(Answer::Runs(booted)));
    // The validation of the boot serves the runner.
    let mut validation = pieces.work().validation().expect("just validated");
    assert_eq!(validation.advance(&new, 1).unwrap().map(|model| model.verdict()), Some(booted.verdict));
    assert_eq!(pieces.task(|work| work.confirm(ModelId::of(&new)), &[]), Ok(Answer::Done));
    assert!(pieces.flash.regions == slots.storage().regions, "other bytes than at once");
    assert_eq!(pieces.work().record(), (slots.record(), 2));
    assert!(pieces.pieces > 1000, "{}", pieces.pieces);
    assert_eq!(pieces.task(SlotWork::reject, &[]), Err(SlotError::Confirmed));
}

#[test]
fn storage_that_cannot_be_read_is_no_model() {
    let old = model(1, 0);
    let mut work = Pieces::new(commissioned(&old, Slot::A, &[])).work();
    assert_eq!(work.give(Given::Bytes(&[]), 1), Some(Err(SlotError::NotBooted)));
    work.boot();
    let mut given = 0;
    let answer = loop {
        if let Some(answer) = work.give(Given::Done(Err(StorageError { code: 3 })), 1) {
            break answer;
        }
        given += 1;
    };
    assert_eq!((answer, given < 10), (Err(SlotError::NothingRuns), true));
}

/// Does a task with what `read` makes of the bytes of each region that are read.
fn with_reads(
    work: &mut SlotWork,
    flash: &Flash,
    mut read: impl FnMut(Region, Vec<u8>) -> Vec<u8>,
) -> Result<Answer, SlotError> {
    loop {
        let Want::Read { region, offset_bytes, len } = work.want() else { panic!("expected a read") };
        let bytes = read(region, flash.bytes(region)[offset_bytes..offset_bytes + len].to_vec());
        if let Some(answer) = work.give(Given::Bytes(&bytes), u64::MAX) {
            return answer;
        }
    }
}

#[test]
fn an_upload_whose_header_changes_between_two_reads_begins_again() {
    let (old, new) = (model(1, 0), model(2, 50_000));
    let mut pieces = Pieces::new(commissioned(&old, Slot::A, &new));
    pieces.boot().unwrap();
    for (changes, there) in [(false, new.len()), (true, 0)] {
        let mut work = pieces.work();
        work.begin_upload(ModelId::of(&new)).unwrap();
        let answer = with_reads(&mut work, &pieces.flash, |_, mut bytes| {
            if changes && bytes.len() == new.len() {
                bytes[word::TENSORS * 4] ^= 1;
            }
            bytes
        });
        assert_eq!(answer, Ok(Answer::Written(there)));
    }
}

#[test]
fn an_upload_ends_when_its_slot_holds_the_confirmed_model() {
    let (old, new) = (model(1, 0), model(2, 0));
    let mut pieces = Pieces::new(commissioned(&old, Slot::A, &[]));
    let mut work = pieces.work();
    let blank = |_, bytes: Vec<u8>| vec![0xff; bytes.len()];
    // Nothing can be read: no model runs, and the first slot is taken for free.
    work.boot();
    assert_eq!(with_reads(&mut work, &pieces.flash, blank), Err(SlotError::NothingRuns));
    work.begin_upload(ModelId::of(&new)).unwrap();
    assert_eq!(with_reads(&mut work, &pieces.flash, blank), Ok(Answer::Written(0)));
    pieces.words = work.to_words();
    // The record is readable again: the confirmed model is in this slot.
    assert_eq!(pieces.task(|work| work.write(0, &new), &new), Err(SlotError::NoUpload));
    assert_eq!(pieces.flash.bytes(Region::Model(Slot::A))[..old.len()], old);
}

#[test]
fn a_validation_serves_the_model_that_runs_alone() {
    let (old, new) = (model(1, 0), model(2, 0));
    let mut pieces = Pieces::new(commissioned(&old, Slot::A, &[]));
    assert_eq!(pieces.work().validation(), None, "before the boot");
    pieces.boot().unwrap();
    assert!(pieces.work().validation().is_some());
    assert_eq!(pieces.upload(&new), Ok(Answer::Done));
    assert_eq!(pieces.work().validation(), None, "the upload was validated since");
}

#[test]
fn words_that_no_work_has_are_refused() {
    let words = Pieces::new(Flash::new(1000, 128)).words;
    let legal = |at: usize| SlotWork::from_words(std::array::from_fn(|i| if i == at { u64::MAX } else { words[i] }));
    assert!((0..words.len()).filter(|at| legal(*at).is_none()).count() > 60);
}
