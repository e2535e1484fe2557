//! The work and the output of the demo, the same on every machine.

use crate::calls::{elunar_call_begin, elunar_call_check, elunar_call_open, elunar_call_step};
use crate::mark::{elunar_count_start, elunar_count_stop};
use crate::stack::depth;
use core::fmt::Write;
use elunar_core::nn::{Kernel, Model, ModelError, Progress, RunError, Runner, required};
use elunar_core::tile::Shape;

/// Multiply-accumulates per step: large relative to the cost of a call; or one, so that a step never continues into the next operator.
const STEP_MACS: u64 = if cfg!(feature = "per_operator") { 1 } else { 1 << 20 };

/// Opens the model at the start of `memory` (which may be longer than the file), and runs its self test with the fastest kernel and, if
/// that is another one, with the specification. Prints a line per run, and PASS or FAIL.
pub(crate) fn run(memory: &[u8], arena: &mut [u8], console: &mut impl Write) -> bool {
    #[cfg(feature = "c_calls")]
    if let Ok(model) = elunar_call_open(memory) {
        let passed = crate::c_calls::run(model.raw().bytes(), arena, console);
        // The scalar kernel takes long for a large model, and small ones show the same.
        #[cfg(all(bare, feature = "provoke"))]
        let passed = passed
            && (model.macs() > 1 << 27 || both(model, arena, console))
            && crate::provoke::run(model.self_test().1, arena, console);
        let _ = writeln!(console, "{}", if passed { "PASS" } else { "FAIL" });
        return passed;
    }
    #[cfg(all(bare, feature = "inject"))]
    if let Ok(model) = elunar_call_open(memory) {
        let passed = crate::inject::run(model.raw().bytes(), memory, arena, console);
        let _ = writeln!(console, "{}", if passed { "PASS" } else { "FAIL" });
        return passed;
    }
    let mut opened = Err(ModelError::Header);
    let stack = depth(|| opened = elunar_call_open(memory));
    let passed = match opened {
        Ok(model) => {
            print_stack(console, "open", stack);
            both(model, arena, console)
        }
        Err(error) => refuse(console, &error),
    };
    let _ = writeln!(console, "{}", if passed { "PASS" } else { "FAIL" });
    passed
}

/// Prints the stack of a call, if it is known.
fn print_stack(console: &mut impl Write, call: &str, bytes: Option<usize>) {
    if let Some(bytes) = bytes {
        let _ = writeln!(console, "stack {call} {bytes} bytes");
    }
}

fn refuse(console: &mut impl Write, error: &impl core::fmt::Display) -> bool {
    let _ = writeln!(console, "ERROR: {error}");
    false
}

fn both(model: Model<'_>, arena: &mut [u8], console: &mut impl Write) -> bool {
    let Shape { rows, cols } = model.tile();
    let (_, crc) = model.self_test();
    let (bytes, macs, operators) = (model.raw().bytes().len(), model.macs(), model.operator_count());
    let _ =
        writeln!(console, "model {bytes} bytes, {operators} operators, tile {rows}x{cols}, {macs} macs, crc {crc:08x}");
    let best = Kernel::best();
    let mut passed = one(best, model, arena, console);
    if best.name() != Kernel::SCALAR.name() && !cfg!(feature = "two_tiles") {
        passed &= one(Kernel::SCALAR, model, arena, console);
    }
    passed
}

/// Runs one tile with one kernel.
fn one(kernel: Kernel, model: Model<'_>, arena: &mut [u8], console: &mut impl Write) -> bool {
    let _ = writeln!(console, "run {}", kernel.name());
    match tile(kernel, model, arena, console) {
        Ok(crc) => {
            let (name, bytes, context) = (kernel.name(), required(&model), size_of::<Runner<'_, '_>>());
            let _ = writeln!(
                console,
                "ran {name}: crc {crc:08x} as expected, arena {bytes} bytes, context {context} bytes"
            );
            true
        }
        Err(error) => refuse(console, &error),
    }
}

/// Runs and checks the self test; returns the output's CRC.
fn tile(kernel: Kernel, model: Model<'_>, arena: &mut [u8], console: &mut impl Write) -> Result<u32, RunError> {
    let (arena, _rest) = arena.split_at_mut(required(&model).min(arena.len()));
    let mut runner = Runner::with_kernel(kernel, model, arena)?;
    #[cfg(all(bare, feature = "two_tiles"))]
    {
        crate::two_tiles::begin_other(&mut runner, crate::arch::floats(_rest))?;
        crate::two_tiles::steps(&mut runner, STEP_MACS, "other", console)?;
    }
    let mut begun = Ok(());
    let begin = depth(|| begun = elunar_call_begin(&mut runner));
    begun?;
    #[cfg(all(bare, feature = "two_tiles"))]
    crate::two_tiles::steps(&mut runner, STEP_MACS, "own", console)?;
    let (step, done) = if cfg!(feature = "per_operator") {
        (None, work_by_entries(&mut runner, console))
    } else if cfg!(feature = "two_tiles") {
        (None, Ok(()))
    } else {
        let mut done = Ok(());
        let step = depth(|| {
            elunar_count_start();
            done = work(&mut runner);
            elunar_count_stop();
        });
        (step, done)
    };
    done?;
    let mut checked = Err(RunError::State);
    let check = depth(|| checked = elunar_call_check(&mut runner));
    for (call, stack) in [("begin", begin), ("step", step), ("check", check)] {
        print_stack(console, call, stack);
    }
    checked
}

/// Steps until the tile is done.
fn work(runner: &mut Runner<'_, '_>) -> Result<(), RunError> {
    while elunar_call_step(runner, STEP_MACS)? == Progress::Running {}
    Ok(())
}

/// Prints the operator and the multiply-accumulates of every entry of the schedule, outside of the counted calls.
fn work_by_entries(runner: &mut Runner<'_, '_>, console: &mut impl Write) -> Result<(), RunError> {
    let mut macs = 0;
    loop {
        let at = runner.position();
        elunar_count_start();
        let progress = loop {
            let progress = elunar_call_step(runner, STEP_MACS)?;
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
