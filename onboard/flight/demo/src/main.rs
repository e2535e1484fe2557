//! The runner on a bare board: finds a model file in memory, runs its built-in self test in a lent arena, and reports whether the output
//! equals that of the exporting host byte for byte.
//!
//! 1. [`arch`] starts the processor, writes text and ends the run; `boards/<board>/memory.x` is the memory map.
//! 2. [`report`] opens the model and runs the tile, once with the fastest kernel and once with the specification.
//! 3. `c_calls` runs tiles through the C functions instead, `c_lines` strips and terrain maps, `c_slots` model slots.
//! 4. `inject` makes one tile, and flips a bit of a register, the stack or the code when a timer says so.
//! 5. `provoke` makes random calls, changed models and random programs.
//! 6. [`calls`] has the library's functions under fixed names, and [`mark`] the two functions for the instruction counter: for the tools in
//!    `../../proofs` and `../../boards`.
//!
//! Without a board (`cargo run -p elunar-demo -- MODEL.eld`) it is an ordinary program, whose output is the reference.
#![cfg_attr(bare, no_std, no_main)]
#![cfg_attr(all(bare, target_arch = "sparc"), feature(asm_experimental_arch))]

#[cfg(bare)]
mod arch;
#[cfg(feature = "c_calls")]
mod c_calls;
#[cfg(feature = "c_calls")]
mod c_lines;
#[cfg(feature = "c_calls")]
mod c_slots;
mod calls;
#[cfg(not(bare))]
mod hosted;
#[cfg(all(bare, feature = "inject"))]
mod inject;
mod mark;
#[cfg(all(bare, feature = "provoke"))]
mod provoke;
mod report;
#[cfg(all(bare, feature = "two_tiles"))]
mod two_tiles;

#[cfg(bare)]
use arch::stack;
#[cfg(not(bare))]
use hosted::stack;

#[cfg(not(bare))]
fn main() -> std::process::ExitCode {
    hosted::main()
}
