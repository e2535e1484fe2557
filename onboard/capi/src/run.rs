//! Works on a tile, returns its heights, checks the self test, and scrubs the model.

use crate::context::{Context, Lent, Outcome};
use crate::record::{COARSE, ContextRecord, EMPTY, PREDICTED, PREPARING, SELF_TEST, SURVEY, TILE};
use crate::sealed::{read_job, write_job};
use crate::status::*;
use crate::tile::unpack;
use crate::types::{
    ELD_PHASE_EMPTY, ELD_PHASE_LIGHT, ELD_PHASE_PREPARING, ELD_PHASE_SELF_TEST, ELD_PHASE_SELF_TEST_DONE,
    ELD_PHASE_TILE, ELD_PHASE_TILE_DONE, eld_errors_t, eld_status_t, eld_telemetry_t,
};
use elunar_core::job::TilePart;
use elunar_core::nn::file::crc32c;
use elunar_core::nn::{Kernel, Model, Progress, RunError, Runner, Suspended};
use elunar_core::photoclinometry::{Errors, ExpectedErrors};
use elunar_core::samples::is_set;
use elunar_core::{JobError, Made, TileJob};

/// Resumes the runner from the record.
///
/// # Errors
/// [`ELD_FAULT_RUN`] if the position does not exist in the model.
pub(crate) fn runner<'a, 'm>(
    record: &ContextRecord,
    model: Model<'a>,
    arena: &'m mut [u8],
) -> Result<Runner<'a, 'm>, eld_status_t> {
    Runner::resume(Kernel::best(), model, arena, &record.suspended).map_err(|_| ELD_FAULT_RUN)
}

/// Returns the job of the tile from its words, which are kept twice.
///
/// # Errors
/// [`ELD_FAULT_RUN`] if both copies are damaged.
pub(crate) fn tile_job(context: &mut Context<'_>, model: &Model<'_>, block: &[u8]) -> Result<TileJob, eld_status_t> {
    let (words, damaged) = read_job(block).ok_or(ELD_FAULT_RUN)?;
    context.repaired(damaged);
    TileJob::from_words(words, model.input_rules(), model.tile()).ok_or(ELD_FAULT_RUN)
}

/// Works until `budget_macs` are spent.
pub(crate) fn step(context: &mut Context<'_>, model: Model<'_>, mut lent: Lent<'_>, budget_macs: u64) -> Outcome {
    match context.record.tile {
        EMPTY | SURVEY => return Err(ELD_REFUSED_NO_TILE),
        PREPARING => return Err(ELD_REFUSED_NOT_BEGUN),
        TILE if context.record.made != 0 => return Ok(ELD_OK),
        SELF_TEST if context.record.suspended.phase == Suspended::DONE => return Ok(ELD_OK),
        _ => (),
    }
    let job = if context.record.tile == TILE { Some(tile_job(context, &model, lent.job)?) } else { None };
    context.start();
    let record = &mut context.record;
    let mut runner = runner(record, model, lent.arena)?;
    let Some(mut job) = job else {
        let worked = runner.step(budget_macs);
        record.suspended = runner.suspend();
        let progress = worked.map_err(run_status).inspect_err(|_| record.lose_tile())?;
        return Ok(if progress == Progress::Done { ELD_OK } else { ELD_RUNNING });
    };
    let worked = job.run(&mut runner, &mut lent.tile, budget_macs);
    record.suspended = runner.suspend();
    let progress = worked.map_err(job_status).inspect_err(|_| record.lose_tile())?;
    write_job(lent.job, &job);
    if progress == Progress::Running {
        return Ok(ELD_RUNNING);
    }
    record.made = if job.made() == Some(Made::Coarse) { COARSE } else { PREDICTED };
    keep_errors(record, &job);
    Ok(ELD_OK)
}

/// Keeps the expected errors of a tile.
pub(crate) fn keep_errors(record: &mut ContextRecord, job: &TileJob) {
    record.expected_bits = job.expected().unwrap_or(ExpectedErrors::UNKNOWN).to_values().map(f32::to_bits);
}

/// Copies the finished tile; `valid` may be empty.
pub(crate) fn output(
    context: &mut Context<'_>,
    model: &Model<'_>,
    lent: &Lent<'_>,
    heights_m: &mut [f32],
    valid: Option<&mut [u8]>,
) -> Outcome {
    context.finished(TILE)?;
    let job = tile_job(context, model, lent.job)?;
    job.check(&lent.tile).map_err(job_status)?;
    heights_m.copy_from_slice(job.heights_m(&lent.tile).get(..heights_m.len()).ok_or(ELD_FAULT_RUN)?);
    if let Some(valid) = valid {
        unpack(lent.tile.valid, valid);
    }
    Ok(ELD_OK)
}

/// Returns the expected errors of the finished tile.
fn expected(context: &Context<'_>) -> Result<ExpectedErrors, eld_status_t> {
    context.finished(TILE)?;
    let expected = ExpectedErrors::from_values(context.record.expected_bits.map(f32::from_bits));
    if expected.lit().explained.is_nan() { Err(ELD_REFUSED_NO_ERRORS) } else { Ok(expected) }
}

/// As [`expected`], for C.
pub(crate) fn errors(context: &Context<'_>, struct_bytes: u32) -> Result<eld_errors_t, eld_status_t> {
    let [height_m, slope, explained, dark_height_m, dark_slope, dark_below] = expected(context)?.to_values();
    Ok(eld_errors_t { struct_bytes, height_m, slope, explained, dark_height_m, dark_slope, dark_below })
}

/// Maps of expected errors; `None` is not wanted.
pub(crate) struct ErrorMaps<'o> {
    pub(crate) height_m: Option<&'o mut [f32]>,
    pub(crate) slope: Option<&'o mut [f32]>,
    pub(crate) origin: Option<&'o mut [u8]>,
}

/// Writes the expected errors and the origin of every height of the finished tile.
pub(crate) fn error_maps(
    context: &mut Context<'_>,
    model: &Model<'_>,
    lent: &Lent<'_>,
    maps: ErrorMaps<'_>,
) -> Outcome {
    let expected = expected(context)?;
    tile_job(context, model, lent.job)?.check(&lent.tile).map_err(job_status)?;
    if crc32c(lent.dark) != context.record.dark_crc {
        return Err(ELD_FAULT_VALIDITY);
    }
    let at = |i| if is_set(lent.tile.valid, i) { expected.of(is_set(lent.dark, i)) } else { Errors::VOID };
    let ErrorMaps { height_m, slope, origin } = maps;
    height_m.into_iter().flatten().enumerate().for_each(|(i, to)| *to = at(i).height_m);
    slope.into_iter().flatten().enumerate().for_each(|(i, to)| *to = at(i).slope);
    origin.into_iter().flatten().enumerate().for_each(|(i, to)| *to = at(i).origin() as u8);
    Ok(ELD_OK)
}

/// Checks the finished self test.
pub(crate) fn check_self_test(context: &mut Context<'_>, model: Model<'_>, lent: Lent<'_>) -> Outcome {
    context.finished(SELF_TEST)?;
    let mut runner = runner(&context.record, model, lent.arena)?;
    let checked = runner.check_self_test();
    context.record.suspended = runner.suspend();
    checked.map(|()| ELD_OK).map_err(run_status)
}

/// Compares `max_bytes` of the model with its checksums, whether or not the position of the tile is legal.
pub(crate) fn scrub(context: &mut Context<'_>, model: Model<'_>, lent: Lent<'_>, max_bytes: usize) -> Outcome {
    let record = &mut context.record;
    let Suspended { phase, entry, step, unit, .. } = record.suspended;
    let aside = Suspended { phase: Suspended::IDLE, entry: 0, step: 0, unit: 0, ..record.suspended };
    let mut runner = Runner::resume(Kernel::best(), model, lent.arena, &aside).map_err(|_| ELD_FAULT_RUN)?;
    let found = runner.scrub(max_bytes);
    record.suspended = Suspended { phase, entry, step, unit, ..runner.suspend() };
    found.map(|()| ELD_OK).map_err(run_status)
}

/// Returns the counters.
pub(crate) fn telemetry(record: &ContextRecord, struct_bytes: u32) -> eld_telemetry_t {
    let (at, t) = (&record.suspended, &record.suspended.telemetry);
    let done = at.phase == Suspended::DONE;
    let phase = match record.tile {
        EMPTY => ELD_PHASE_EMPTY,
        PREPARING => ELD_PHASE_PREPARING,
        SURVEY => ELD_PHASE_LIGHT,
        TILE if record.made != 0 => ELD_PHASE_TILE_DONE,
        TILE => ELD_PHASE_TILE,
        _ if done => ELD_PHASE_SELF_TEST_DONE,
        _ => ELD_PHASE_SELF_TEST,
    };
    eld_telemetry_t {
        struct_bytes,
        phase,
        entry: if at.phase == Suspended::LOADING { 0 } else { at.entry },
        valid_px: record.valid_px,
        last_fault: record.last_fault,
        header_crc: record.verdict.header_crc,
        calls: record.calls,
        faults: record.faults,
        context_repairs: record.repairs,
        lights_assumed: record.lights_assumed,
        tiles_dropped: record.tiles_dropped,
        tiles: t.tiles,
        steps: t.steps,
        macs: t.macs,
        inputs_clamped: t.inputs_clamped,
        saturated: t.saturated,
        scrubbed_bytes: t.scrubbed_bytes,
        scrub_passes: t.scrub_passes,
        scrub_faults: t.scrub_faults,
        self_test_faults: t.self_test_faults,
        tile_faults: t.tile_faults,
    }
}

/// Returns the status of a job's error.
pub(crate) fn job_status(error: JobError<RunError>) -> eld_status_t {
    match error {
        JobError::Network(error) => run_status(error),
        // From the header, which was validated before.
        JobError::Rules(_) => ELD_FAULT_MODEL_CHANGED,
        JobError::Height { .. } => ELD_FAULT_HEIGHT,
        JobError::Changed { part: TilePart::Valid } => ELD_FAULT_VALIDITY,
        JobError::Changed { .. } => ELD_FAULT_DATA_CHANGED,
        JobError::Unequal => ELD_FAULT_DATA_CHANGED,
        // Lengths and order are validated before the job is called.
        JobError::Length(_) | JobError::State => ELD_FAULT_RUN,
    }
}

/// Returns the status of a runner's error.
pub(crate) fn run_status(error: RunError) -> eld_status_t {
    match error {
        RunError::TileSize { .. } => ELD_REFUSED_BUFFER,
        RunError::SelfTest { .. } => ELD_FAULT_SELF_TEST,
        RunError::ModelChanged { .. } | RunError::ProgramChanged { .. } => ELD_FAULT_MODEL_CHANGED,
        RunError::DataChanged { .. } | RunError::Miscomputed { .. } => ELD_FAULT_DATA_CHANGED,
        // Memory, samples and order are validated before the runner is called.
        RunError::ArenaTooSmall { .. } | RunError::NotFinite { .. } | RunError::State => ELD_FAULT_RUN,
    }
}
