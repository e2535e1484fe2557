//! What the demo does and prints, on every machine the same.

use crate::mark::{elunar_count_start, elunar_count_stop};
use core::fmt::Write;
use elunar_core::nn::kernels::Kernel;
use elunar_core::nn::{Model, ModelError, Progress, RunError, Runner, required};

/// Multiply-accumulates per step: large beside the cost of a call; or one, so that a step never reaches into the next operator.
const STEP_MACS: u64 = if cfg!(feature = "per_operator") { 1 } else { 1 << 20 };

/// Opens the model at the start of `memory` (which may be longer than the file), runs its self test with the fastest kernel
/// and, if that is another one, with the specification; prints a line per run, and PASS or FAIL.
pub(crate) fn run(memory: &[u8], arena: &mut [u8], console: &mut impl Write) -> bool {
    let passed = match open(memory) {
        Ok(model) => both(model, arena, console),
        Err(error) => refuse(console, &error),
    };
    let _ = writeln!(console, "{}", if passed { "PASS" } else { "FAIL" });
    passed
}

/// The model at the start of `memory`: its header, which has a checksum of its own, says how long it is.
fn open(memory: &[u8]) -> Result<Model<'_>, ModelError> {
    match Model::new(memory) {
        Err(ModelError::Length { expected, found }) if expected < found => Model::new(&memory[..expected as usize]),
        other => other,
    }
}

fn refuse(console: &mut impl Write, error: &impl core::fmt::Display) -> bool {
    let _ = writeln!(console, "ERROR: {error}");
    false
}

fn both(model: Model<'_>, arena: &mut [u8], console: &mut impl Write) -> bool {
    let (rows, cols) = model.tile();
    let (_, crc) = model.self_test();
    let (bytes, macs, operators) = (model.raw().bytes().len(), model.macs(), model.operator_count());
    let _ =
        writeln!(console, "model {bytes} bytes, {operators} operators, tile {rows}x{cols}, {macs} macs, crc {crc:08x}");
    let best = Kernel::best();
    let mut passed = one(best, model, arena, console);
    if best.name() != Kernel::SCALAR.name() {
        passed &= one(Kernel::SCALAR, model, arena, console);
    }
    passed
}

/// One tile with one kernel.
fn one(kernel: Kernel, model: Model<'_>, arena: &mut [u8], console: &mut impl Write) -> bool {
    let _ = writeln!(console, "run {}", kernel.name());
    match tile(kernel, model, arena, console) {
        Ok(crc) => {
            let (name, bytes) = (kernel.name(), required(&model));
            let _ = writeln!(console, "ran {name}: crc {crc:08x} as expected, arena {bytes} bytes");
            true
        }
        Err(error) => refuse(console, &error),
    }
}

/// Runs and judges the self test; returns the output's CRC.
fn tile(kernel: Kernel, model: Model<'_>, arena: &mut [u8], console: &mut impl Write) -> Result<u32, RunError> {
    let mut runner = Runner::with_kernel(kernel, model, arena)?;
    runner.begin_self_test()?;
    if cfg!(feature = "per_operator") {
        work_by_entries(&mut runner, console)?;
    } else {
        elunar_count_start();
        while runner.step(STEP_MACS)? == Progress::Running {}
        elunar_count_stop();
    }
    runner.check_self_test()?;
    runner.output_crc()
}

/// Prints the operator and the multiply-accumulates of every entry of the schedule, outside of what is counted.
fn work_by_entries(runner: &mut Runner<'_, '_>, console: &mut impl Write) -> Result<(), RunError> {
    let mut macs = 0;
    loop {
        let at = runner.position();
        elunar_count_start();
        let progress = loop {
            let progress = runner.step(STEP_MACS)?;
            if runner.position() != at || progress == Progress::Done {
                break progress;
            }
        };
        elunar_count_stop();
        let operator = at.and_then(|index| runner.model().entry(index)).map_or(0, |entry| entry.operator);
        let done = runner.telemetry().macs;
        let _ = writeln!(console, "at {operator} {}", done - macs);
        if progress == Progress::Done {
            return Ok(());
        }
        macs = done;
    }
}
