//! The demo's calls of the library: never inlined and under their own names, so that the tools in `../../proofs` can analyse each of them
//! in the linked program.

use elunar_core::nn::{Model, ModelError, Progress, RunError, Runner};

/// Opens the model at the start of `memory`; its header, which has its own checksum, contains its length.
#[inline(never)]
#[unsafe(no_mangle)]
pub(crate) fn elunar_call_open(memory: &[u8]) -> Result<Model<'_>, ModelError> {
    match Model::new(memory) {
        Err(ModelError::Length { expected, found }) if expected < found => {
            Model::new(memory.get(..expected as usize).unwrap_or(memory))
        }
        other => other,
    }
}

/// Quantises the tile of the self test.
#[inline(never)]
#[unsafe(no_mangle)]
pub(crate) fn elunar_call_begin(runner: &mut Runner<'_, '_>) -> Result<(), RunError> {
    runner.begin_self_test()
}

/// Works for about `macs` multiply-accumulates.
#[inline(never)]
#[unsafe(no_mangle)]
pub(crate) fn elunar_call_step(runner: &mut Runner<'_, '_>, macs: u64) -> Result<Progress, RunError> {
    runner.step(macs)
}

/// Checks the finished self test; returns the output's CRC.
#[inline(never)]
#[unsafe(no_mangle)]
pub(crate) fn elunar_call_check(runner: &mut Runner<'_, '_>) -> Result<u32, RunError> {
    runner.check_self_test()?;
    runner.output_crc()
}
