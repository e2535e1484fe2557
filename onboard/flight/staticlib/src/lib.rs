//! The archive flight software links: everything testable is in `elunar-capi` and `elunar-core`, this adds what only a
//! target may have, a panic handler. No `std`, no allocator.
#![no_std]

pub use elunar_capi as capi;

#[cfg(feature = "proof")]
mod proof;

/// Parks the processor. No function of ours panics on legal values; should one do so on a broken machine, the watchdog of
/// the flight software finds a task that no longer reports.
#[cfg(not(feature = "proof"))]
#[panic_handler]
fn park(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {
        core::hint::spin_loop();
    }
}
