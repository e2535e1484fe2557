//! The injections on several threads.

use super::injection::{Injection, InjectionTarget};
use super::journal::CampaignJournal;
use super::moments::{Moments, STEP_MACS};
use super::outcome::{FaultOutcome, LIMIT_M, Tried};
use super::table::CampaignResults;
use elunar_base::{Error, Result, interrupt};
use elunar_core::nn::{Kernel, Model, Progress, Runner, Suspended};
use elunar_scene::predict::int8::Int8Model;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};

/// One in this many tiles with a reported error is run again, to check that its result is then right.
const SECOND_TRY: u64 = 16;

/// Settings of a campaign.
#[derive(Debug, Clone, Copy)]
pub struct Campaign {
    /// Number of injections.
    pub injections: u64,
    /// Seed of all random choices.
    pub seed: u64,
    /// Number of threads.
    pub threads: usize,
}

/// Runs the injections of a campaign that its journal lacks. Calls `progress` after every injection. On Ctrl-C it stops early and returns
/// the results so far.
///
/// # Errors
/// If a thread fails for another reason than an injection, or the journal cannot be written.
pub fn run(
    model: &Int8Model,
    moments: &Moments,
    campaign: &Campaign,
    journal: Option<&CampaignJournal>,
    progress: impl Fn() + Sync,
) -> Result<CampaignResults> {
    repeat(campaign, journal, progress, || {
        let mut memory = WorkerMemory::new(model, moments);
        move |index| {
            let injection = Injection::new(&model.model(), moments.moments.len(), campaign.seed, index);
            let outcome = memory.try_one(&injection, index);
            let operator = moments.moments.get(injection.moment).map_or("none", |moment| moment.operator).into();
            Tried { index, target: injection.target, bits: injection.count(), operator, outcome }
        }
    })
}

/// Makes the injections that a journal lacks, on several threads. `worker` makes what tries one on a thread.
pub(super) fn repeat<W: FnMut(u64) -> Tried>(
    campaign: &Campaign,
    journal: Option<&CampaignJournal>,
    progress: impl Fn() + Sync,
    worker: impl Fn() -> W + Sync,
) -> Result<CampaignResults> {
    let next = AtomicU64::new(0);
    let work = || -> Result<CampaignResults> {
        let mut try_one = worker();
        let mut results = CampaignResults::default();
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            if index >= campaign.injections || interrupt::requested() {
                return Ok(results);
            }
            if journal.is_some_and(|journal| journal.has(index)) {
                continue;
            }
            let tried = try_one(index);
            journal.map_or(Ok(()), |journal| journal.add(&tried))?;
            results.add(&tried);
            progress();
        }
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..campaign.threads.max(1)).map(|_| scope.spawn(work)).collect();
        let mut all = journal.map(|journal| journal.results().clone()).unwrap_or_default();
        for worker in workers {
            all.merge(&worker.join().unwrap_or_else(|_| Err(Error::input("faults: a thread failed")))?);
        }
        Ok(all)
    })
}

/// The model and arena of a thread.
struct WorkerMemory<'c> {
    moments: &'c Moments,
    kernel: Kernel,
    clean: Vec<u8>,
    model: Vec<u8>,
    arena: Vec<u8>,
    heights_m: Vec<f32>,
}

impl<'c> WorkerMemory<'c> {
    fn new(model: &Int8Model, moments: &'c Moments) -> Self {
        let clean = model.model().raw().bytes().to_vec();
        let heights_m = vec![0.0; moments.heights_m.len()];
        Self { moments, kernel: model.kernel(), model: clean.clone(), clean, arena: Vec::new(), heights_m }
    }

    fn try_one(&mut self, injection: &Injection, index: u64) -> FaultOutcome {
        let Some(moment) = self.moments.moments.get(injection.moment) else { return FaultOutcome::Masked };
        self.arena.clone_from(&moment.arena);
        let place = match injection.target {
            target if target.is_model() => {
                injection.flip(&mut self.model);
                moment.place
            }
            InjectionTarget::Place => injection.flip_place(&moment.place),
            InjectionTarget::StuckBit => moment.place,
            _ => {
                injection.flip(&mut self.arena);
                moment.place
            }
        };
        let stuck = (injection.target == InjectionTarget::StuckBit).then_some(injection);
        let outcome = self.outcome(&place, stuck, injection.target, index);
        if injection.target.is_model() {
            injection.flip(&mut self.model);
            debug_assert_eq!(self.model, self.clean);
        }
        outcome
    }

    /// Continues a run from a place and classifies its outcome.
    fn outcome(
        &mut self,
        place: &Suspended,
        stuck: Option<&Injection>,
        target: InjectionTarget,
        index: u64,
    ) -> FaultOutcome {
        match catch_unwind(AssertUnwindSafe(|| self.finish(place, stuck))) {
            Err(_) => FaultOutcome::Crash,
            Ok(Ended::Hanging) => FaultOutcome::Hang,
            Ok(Ended::Done) => self.compare(),
            Ok(Ended::Refused) if target.is_model() => FaultOutcome::Reported,
            // A stuck bit would be stuck in a second run, too.
            Ok(Ended::Refused) if stuck.is_some() => FaultOutcome::Reported,
            Ok(Ended::Refused) if !index.is_multiple_of(SECOND_TRY) => FaultOutcome::Recovered,
            Ok(Ended::Refused) => self.again(),
        }
    }

    fn finish(&mut self, place: &Suspended, stuck: Option<&Injection>) -> Ended {
        let Ok(model) = Model::reopen(&self.model, &self.moments.verdict) else { return Ended::Refused };
        let (mut place, begun) = (*place, place.telemetry.macs);
        loop {
            if let Some(injection) = stuck {
                injection.stick(&mut self.arena);
            }
            let Ok(mut runner) = Runner::resume(self.kernel, model, &mut self.arena, &place) else {
                return Ended::Refused;
            };
            match runner.step(STEP_MACS) {
                Err(_) => return Ended::Refused,
                Ok(Progress::Done) => {
                    let read = runner.output(&mut self.heights_m);
                    self.moments.scale.recover(model.tile(), &mut self.heights_m);
                    return if read.is_ok() { Ended::Done } else { Ended::Refused };
                }
                Ok(Progress::Running) => place = runner.suspend(),
            }
            if place.telemetry.macs - begun > 2 * model.macs() {
                return Ended::Hanging;
            }
        }
    }

    /// Compares the heights with those of the clean run.
    fn compare(&self) -> FaultOutcome {
        let pairs = self.heights_m.iter().zip(&self.moments.heights_m);
        // NaN counts as different.
        let near = pairs.into_iter().all(|(found, clean)| (found - clean).abs() <= LIMIT_M);
        if near { FaultOutcome::Masked } else { FaultOutcome::Silent }
    }

    /// Runs the tile again from its beginning.
    fn again(&mut self) -> FaultOutcome {
        let Some(first) = self.moments.moments.first() else { return FaultOutcome::Recovered };
        self.arena.clone_from(&first.arena);
        let place = first.place;
        match self.finish(&place, None) {
            Ended::Done if self.compare() == FaultOutcome::Masked => FaultOutcome::Recovered,
            Ended::Done => FaultOutcome::Silent,
            _ => FaultOutcome::Reported,
        }
    }
}

/// End of a run.
enum Ended {
    Done,
    /// The run ended with an error.
    Refused,
    Hanging,
}
