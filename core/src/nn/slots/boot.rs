//! The choice of the model to run, and the end of a trial.

use super::*;

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
        (self.state, self.upload) = (State::New, None);
        self.mend();
        let Some(record) = self.record() else { return self.salvage(&[Slot::A, Slot::B]) };
        if let Some(trial) = record.trial {
            let verdict = self.validate(trial.entry).map(|model| model.verdict());
            match (trial.boots_left.checked_sub(1), verdict) {
                (Some(boots_left), Ok(verdict)) => {
                    let counted = Some(Trial { boots_left, ..trial });
                    if self.store(SlotRecord { trial: counted, ..record }).is_ok() {
                        return Ok(self.run(trial.entry.slot, Standing::Trial, verdict));
                    }
                }
                // If the storage refuses, the next boot tries again.
                _ => _ = self.end_trial(record),
            }
        }
        self.fall_back(record)
    }

    /// Opens the model that runs with the result of its validation.
    ///
    /// # Errors
    /// [`SlotError::NotBooted`], [`SlotError::NothingRuns`], or [`SlotError::Model`] if the header of the model has changed.
    pub fn model(&self) -> Result<Model<'_>, SlotError> {
        let boot = self.running()?;
        Ok(Model::reopen(self.file(boot.slot, boot.verdict.file_bytes), &boot.verdict)?)
    }

    /// Records the model that runs as confirmed, after it has passed its self test. Does nothing if it is confirmed already.
    ///
    /// # Errors
    /// [`SlotError::NotBooted`], [`SlotError::NothingRuns`]; [`SlotError::OtherModel`] if another model has passed; [`SlotError::Storage`],
    /// [`SlotError::NotWritten`]: the model stays on trial then.
    pub fn confirm(&mut self, passed: SelfTestPassed) -> Result<(), SlotError> {
        let boot = self.running()?;
        let id = ModelId { file_bytes: boot.verdict.file_bytes, header_crc: boot.verdict.header_crc };
        id.same(passed.id())?;
        if boot.standing == Standing::Confirmed {
            return Ok(());
        }
        let confirmed = Some(SlotEntry { slot: boot.slot, id });
        self.store(SlotRecord { confirmed, trial: None, ..self.record().unwrap_or_default() })?;
        self.run(boot.slot, Standing::Confirmed, boot.verdict);
        Ok(())
    }

    /// Ends the trial of the model that runs, after it has failed its self test, and returns which model to run instead. Of models that
    /// were found without a record, this is the next one. While the confirmed model runs, withdraws a trial that has not begun.
    ///
    /// # Errors
    /// [`SlotError::NotBooted`], [`SlotError::NothingRuns`]; [`SlotError::Confirmed`] if there is no trial to end; nothing is changed then.
    pub fn reject(&mut self) -> Result<Boot, SlotError> {
        let boot = self.running()?;
        let record = self.record().unwrap_or_default();
        match boot.standing {
            Standing::Confirmed if record.trial.is_none() => Err(SlotError::Confirmed),
            Standing::Confirmed => self.end_trial(record).map(|()| boot),
            Standing::Trial => {
                // If the storage refuses, a reset without boots left ends the trial.
                let _ = self.end_trial(record);
                self.fall_back(record)
            }
            Standing::Salvaged if boot.slot == Slot::A => self.salvage(&[Slot::B]),
            Standing::Salvaged => self.salvage(&[]),
        }
    }

    fn running(&self) -> Result<Boot, SlotError> {
        match self.state {
            State::New => Err(SlotError::NotBooted),
            State::NothingRuns => Err(SlotError::NothingRuns),
            State::Runs(boot) => Ok(boot),
        }
    }

    fn run(&mut self, slot: Slot, standing: Standing, verdict: Verdict) -> Boot {
        let boot = Boot { slot, standing, verdict };
        self.state = State::Runs(boot);
        boot
    }

    /// Returns the confirmed model, else any.
    fn fall_back(&mut self, record: SlotRecord) -> Result<Boot, SlotError> {
        if let Some(confirmed) = record.confirmed {
            let verdict = self.validate(confirmed).map(|model| model.verdict());
            if let Ok(verdict) = verdict {
                return Ok(self.run(confirmed.slot, Standing::Confirmed, verdict));
            }
        }
        self.salvage(&[Slot::A, Slot::B])
    }

    /// Returns the first of these slots whose model this runner accepts.
    fn salvage(&mut self, slots: &[Slot]) -> Result<Boot, SlotError> {
        for &slot in slots {
            let id = ModelId::of(self.storage.bytes(Region::Model(slot)));
            let verdict = self.validate(SlotEntry { slot, id }).map(|model| model.verdict());
            if let Ok(verdict) = verdict {
                return Ok(self.run(slot, Standing::Salvaged, verdict));
            }
        }
        self.state = State::NothingRuns;
        Err(SlotError::NothingRuns)
    }

    fn end_trial(&mut self, record: SlotRecord) -> Result<(), SlotError> {
        self.store(SlotRecord { trial: None, rollbacks: record.rollbacks.saturating_add(1), ..record })
    }
}
