//! The archive for flight software. Everything testable is in `elunar-capi` and `elunar-core`; this crate adds a panic handler, which only
//! a target may have. No `std`, no allocator.
#![no_std]

pub use elunar_capi as capi;

#[cfg(feature = "proof")]
mod proof;

/// Stops the processor in a loop. No function of the library panics on legal values. If one does on a faulty machine, the watchdog of the
/// flight software detects a task that no longer reports.
#[cfg(not(feature = "proof"))]
#[panic_handler]
fn park(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {
        core::hint::spin_loop();
    }
}
