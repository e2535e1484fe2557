//! The program in memory.
#![allow(unsafe_code)] // addresses of the program

use elunar_core::nn::code_sum;

unsafe extern "C" {
    /// First byte of the program, by the linker.
    static __executable_start: u8;
    /// First byte behind its instructions.
    static etext: u8;
}

/// Returns the addresses of the program.
pub(crate) fn program() -> std::ops::Range<u64> {
    (&raw const __executable_start) as u64..(&raw const etext) as u64
}

/// Returns the checksum of the program as it is now.
pub(crate) fn program_sum() -> u32 {
    let range = program();
    // SAFETY: the linker's range; it is mapped for reading as long as the process runs.
    code_sum(unsafe { std::slice::from_raw_parts(range.start as *const u8, (range.end - range.start) as usize) })
}
