//! The choice of the model to run, and the end of a trial.

use super::put::Put;
use super::work::{Answer, SlotWork, Step, What, copy_of};
use super::*;
use crate::words::Words;

/// What was begun.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Task {
    Boot,
    /// A model has passed its self test.
    Confirm(ModelId),
    Reject,
    Upload(ModelId),
    /// A chunk with this checksum.
    Write {
        crc: u32,
    },
    /// A trial of so many boots.
    Trial {
        boots: u32,
    },
}

/// What a model is validated for, or a record stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Why {
    /// The model on trial is to run.
    Trial,
    /// The confirmed model is to run.
    Confirmed,
    /// Any model is to run.
    Salvage,
    /// A trial that has ended: the confirmed model is to run.
    Ended,
    /// A trial that has not begun was withdrawn.
    Withdrawn,
    /// An upload is put on trial.
    Upload,
}

impl Task {
    pub(super) fn visit(&mut self, words: &mut Words<'_>) {
        let none = ModelId { file_bytes: 0, header_crc: 0 };
        let (mut kind, mut id, mut number) = match *self {
            Self::Boot => (0, none, 0),
            Self::Confirm(id) => (1, id, 0),
            Self::Reject => (2, none, 0),
            Self::Upload(id) => (3, id, 0),
            Self::Write { crc } => (4, none, crc),
            Self::Trial { boots } => (5, none, boots),
        };
        words.choice(&mut kind, &[0, 1, 2, 3, 4, 5]);
        id.visit(words);
        words.u32(&mut number);
        *self = match kind {
            0 => Self::Boot,
            1 => Self::Confirm(id),
            2 => Self::Reject,
            3 => Self::Upload(id),
            4 => Self::Write { crc: number },
            _ => Self::Trial { boots: number },
        };
    }
}

impl Why {
    pub(super) const ALL: [Self; 6] =
        [Self::Trial, Self::Confirmed, Self::Salvage, Self::Ended, Self::Withdrawn, Self::Upload];
}

impl SlotWork {
    /// Begins to find out which model to run; see [`Slots::boot`].
    pub fn boot(&mut self) {
        (self.state, self.upload) = (State::New, None);
        self.begin(Task::Boot);
    }

    /// Begins to record the model that runs as confirmed; see [`Slots::confirm`].
    ///
    /// # Errors
    /// [`SlotError::NotBooted`], [`SlotError::NothingRuns`], [`SlotError::OtherModel`].
    pub fn confirm(&mut self, passed: ModelId) -> Result<(), SlotError> {
        self.running()?.id().same(passed)?;
        self.begin(Task::Confirm(passed));
        Ok(())
    }

    /// Begins to end a trial; see [`Slots::reject`].
    ///
    /// # Errors
    /// [`SlotError::NotBooted`], [`SlotError::NothingRuns`].
    pub fn reject(&mut self) -> Result<(), SlotError> {
        self.running()?;
        self.begin(Task::Reject);
        Ok(())
    }

    /// Goes on when the record has been read.
    pub(super) fn decide(&mut self) -> Step {
        let record = self.record().0;
        match (self.task, self.state) {
            (Task::Boot, _) => self.mend(&[false, true]),
            (Task::Upload(id), _) => self.upload_to(id),
            (Task::Write { .. }, _) => self.write_to(),
            (Task::Trial { .. }, _) => self.check(self.entry, Why::Upload),
            (Task::Confirm(_), State::Runs(Boot { standing: Standing::Confirmed, .. })) => Some(Ok(Answer::Done)),
            (Task::Confirm(id), State::Runs(boot)) => {
                let confirmed = Some(SlotEntry { slot: boot.slot, id });
                self.store(SlotRecord { confirmed, trial: None, ..record.unwrap_or_default() }, Why::Confirmed)
            }
            (Task::Reject, State::Runs(boot)) => match boot.standing {
                Standing::Confirmed if record.is_none_or(|record| record.trial.is_none()) => {
                    Some(Err(SlotError::Confirmed))
                }
                Standing::Confirmed => self.end_trial(Why::Withdrawn),
                Standing::Trial => self.end_trial(Why::Ended),
                Standing::Salvaged if boot.slot == Slot::A => self.salvage(&[Slot::B]),
                Standing::Salvaged => self.salvage(&[]),
            },
            (Task::Confirm(_) | Task::Reject, _) => Some(Err(SlotError::NotBooted)),
        }
    }

    /// Writes the first of these copies of the record again that is not intact, or older. A failure is ignored, because the other copy is valid.
    pub(super) fn mend(&mut self, copies: &[bool]) -> Step {
        let record = self.record().0;
        for &second in copies {
            let [one, two] = self.copies;
            if record.is_some() && record != if second { two } else { one } {
                return self.put_record(second, What::Mend);
            }
        }
        self.boot_mended()
    }

    /// Chooses the model.
    pub(super) fn boot_mended(&mut self) -> Step {
        match self.record().0 {
            None => self.salvage(&[Slot::A, Slot::B]),
            Some(SlotRecord { trial: Some(trial), .. }) => self.check(trial.entry, Why::Trial),
            Some(_) => self.fall_back(),
        }
    }

    /// Goes on when a model was validated.
    pub(super) fn checked(&mut self, found: Result<(), SlotError>) -> Step {
        let (slot, record) = (self.entry.slot, self.record().0.unwrap_or_default());
        match (self.why, found) {
            (Why::Trial, found) => {
                let left = record.trial.and_then(|trial| Some((trial, trial.boots_left.checked_sub(1)?)));
                match (left, found) {
                    (Some((trial, boots_left)), Ok(())) => {
                        let trial = Some(Trial { boots_left, ..trial });
                        self.store(SlotRecord { trial, ..record }, Why::Trial)
                    }
                    _ => self.end_trial(Why::Ended),
                }
            }
            (Why::Upload, Ok(())) => {
                let Task::Trial { boots } = self.task else { return Some(Err(SlotError::NoUpload)) };
                let trial = Some(Trial { entry: self.entry, boots_left: boots });
                self.store(SlotRecord { trial, ..record }, Why::Upload)
            }
            (Why::Upload, Err(error)) => Some(Err(error)),
            (Why::Salvage, Ok(())) => self.run(slot, Standing::Salvaged),
            (Why::Salvage, Err(_)) if slot == Slot::A => self.salvage(&[Slot::B]),
            (Why::Salvage, Err(_)) => self.salvage(&[]),
            (_, Ok(())) => self.run(slot, Standing::Confirmed),
            (_, Err(_)) => self.salvage(&[Slot::A, Slot::B]),
        }
    }

    /// Goes on when a record was stored, or could not be.
    pub(super) fn stored(&mut self, done: Result<(), SlotError>) -> Step {
        let slot = self.entry.slot;
        match (self.why, done) {
            (Why::Trial, Ok(())) => self.run(slot, Standing::Trial),
            // A trial that cannot be counted is not run. One that cannot be ended ends with the boots that are left.
            (Why::Trial, Err(_)) | (Why::Ended, _) => self.fall_back(),
            (Why::Withdrawn, done) => Some(done.and_then(|()| self.running().map(Answer::Runs))),
            (Why::Upload, Ok(())) => {
                self.upload = None;
                Some(Ok(Answer::Done))
            }
            (_, Ok(())) => {
                if let State::Runs(boot) = &mut self.state {
                    boot.standing = Standing::Confirmed;
                }
                Some(Ok(Answer::Done))
            }
            (_, Err(error)) => Some(Err(error)),
        }
    }

    fn run(&mut self, slot: Slot, standing: Standing) -> Step {
        let boot = Boot { slot, standing, verdict: self.verdict };
        self.state = State::Runs(boot);
        Some(Ok(Answer::Runs(boot)))
    }

    /// Returns the confirmed model, else any.
    fn fall_back(&mut self) -> Step {
        match self.record().0.and_then(|record| record.confirmed) {
            Some(confirmed) => self.check(confirmed, Why::Confirmed),
            None => self.salvage(&[Slot::A, Slot::B]),
        }
    }

    /// Tries the first of these slots that can hold a model.
    fn salvage(&mut self, slots: &[Slot]) -> Step {
        for &slot in slots {
            if self.places.bytes(Region::Model(slot)) >= HEADER_BYTES {
                (self.entry.slot, self.what) = (slot, What::Head);
                return None;
            }
        }
        self.state = State::NothingRuns;
        Some(Err(SlotError::NothingRuns))
    }

    fn end_trial(&mut self, why: Why) -> Step {
        let record = self.record().0.unwrap_or_default();
        self.store(SlotRecord { trial: None, rollbacks: record.rollbacks.saturating_add(1), ..record }, why)
    }

    /// Stores the next record: over the older copy, then over the other. It is valid as soon as the first copy is intact.
    fn store(&mut self, record: SlotRecord, why: Why) -> Step {
        let (held, [first, _]) = (self.record().0, self.copies);
        let sequence = held.map_or(0, |held| held.sequence).saturating_add(1);
        (self.next, self.why) = (SlotRecord { sequence, ..record }, why);
        self.put_record(first.is_some() && first == held, What::StoreFirst)
    }

    /// Stores the record in its other copy.
    pub(super) fn store_second(&mut self) -> Step {
        self.put_record(!self.second, What::StoreSecond)
    }

    fn put_record(&mut self, second: bool, what: What) -> Step {
        (self.what, self.second) = (what, second);
        self.put = Put::new(&self.places, copy_of(second), 0, RECORD_BYTES);
        None
    }
}

impl<S: Storage> Slots<S> {
    /// Returns which model to run; to be called after every reset. It is the model on trial if it has boots left, else the confirmed one,
    /// else any that this runner accepts. Counts a boot of a trial before the trial runs, rolls back a trial that has no boots left, and
    /// repairs the record's copy. Validates the whole model, which takes time proportional to the file. An upload that was begun must be
    /// begun again.
    ///
    /// A trial whose boot cannot be counted, because the storage refuses, is not run.
    ///
    /// # Errors
    /// [`SlotError::NothingRuns`].
    pub fn boot(&mut self) -> Result<Boot, SlotError> {
        self.work.boot();
        self.drive(&[])?;
        self.work.running()
    }

    /// Opens the model that runs with the result of its validation.
    ///
    /// # Errors
    /// [`SlotError::NotBooted`], [`SlotError::NothingRuns`], or [`SlotError::Model`] if the header of the model has changed.
    pub fn model(&self) -> Result<Model<'_>, SlotError> {
        let Boot { slot, verdict, .. } = self.work.running()?;
        let file = self.storage.bytes(Region::Model(slot)).get(..verdict.file_bytes as usize);
        Ok(Model::reopen(file.unwrap_or_default(), &verdict)?)
    }

    /// Records the model that runs as confirmed, after it has passed its self test. Does nothing if it is confirmed already.
    ///
    /// # Errors
    /// [`SlotError::NotBooted`], [`SlotError::NothingRuns`]; [`SlotError::OtherModel`] if another model has passed; [`SlotError::Storage`],
    /// [`SlotError::NotWritten`]: the model stays on trial then.
    pub fn confirm(&mut self, passed: SelfTestPassed) -> Result<(), SlotError> {
        self.work.confirm(passed.id())?;
        self.drive(&[]).map(|_| ())
    }

    /// Ends the trial of the model that runs, after it has failed its self test, and returns which model to run instead. Of models that
    /// were found without a record, this is the next one. While the confirmed model runs, withdraws a trial that has not begun.
    ///
    /// # Errors
    /// [`SlotError::NotBooted`], [`SlotError::NothingRuns`]; [`SlotError::Confirmed`] if there is no trial to end; nothing is changed then.
    pub fn reject(&mut self) -> Result<Boot, SlotError> {
        self.work.reject()?;
        self.drive(&[])?;
        self.work.running()
    }
}
