//! The runner on a bare board: finds a model file in memory, runs its built-in self test in a lent arena, and says whether
//! the output is, byte for byte, what the exporting host computed.
//!
//! 1. [`arch`] starts the processor, writes text and ends the run; `boards/<board>/memory.x` says where things lie.
//! 2. [`report`] opens the model and runs the tile, once with the fastest kernel and once with the specification.
//! 3. [`mark`] are the two places an instruction counter watches.
//!
//! Without a board (`cargo run -p elunar-demo -- MODEL.eld`) it is an ordinary program: the reference to compare with.
#![cfg_attr(bare, no_std, no_main)]
#![cfg_attr(all(bare, any(target_arch = "sparc", target_arch = "powerpc")), feature(asm_experimental_arch))]

#[cfg(bare)]
mod arch;
#[cfg(not(bare))]
mod hosted;
mod mark;
mod report;

#[cfg(not(bare))]
fn main() -> std::process::ExitCode {
    hosted::main()
}
