//! A copy of this process that makes the rest of a tile, watched by this process.
#![allow(unsafe_code)] // fork, a timer

use super::program::program_sum;
use super::shared::Shared;
use crate::tile::Tile;
use elunar_base::{Error, Result};
use nix::libc;
use nix::sys::ptrace;
use nix::sys::signal::{Signal, raise};
use nix::sys::wait::{WaitStatus, waitpid};
use nix::unistd::{ForkResult, Pid, fork};
use std::ffi::c_void;
use std::sync::atomic::Ordering::SeqCst;

/// A watched process, killed when it is dropped.
pub(crate) struct Child(Pid);

/// Why a watched process stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stop {
    /// It asks for it: before the first unit, or behind it.
    Asked,
    /// A breakpoint.
    Trap,
    /// Its time is over.
    Late,
    /// It ended as it should.
    Ended,
    /// It ended otherwise, or would.
    Crashed(&'static str),
}

/// What a copy does.
#[derive(Clone, Copy)]
pub(crate) struct Orders {
    /// Seconds of processor time that it has.
    pub(crate) seconds: f64,
    /// Whether it stops behind its first unit with a checksum of its state.
    pub(crate) sums: bool,
    /// The program's checksum, if it is checked at the end.
    pub(crate) code: Option<u32>,
}

fn error(what: &str, e: nix::Error) -> Error {
    Error::input(format!("inject: {what}: {e}"))
}

impl Child {
    /// Copies this process. The copy waits, and then finishes the tile from unit `unit` on.
    ///
    /// # Errors
    /// If the system refuses.
    pub(crate) fn new(tile: &mut Tile, shared: &Shared, unit: u64, orders: Orders) -> Result<Self> {
        // SAFETY: this process has one thread.
        match unsafe { fork() }.map_err(|e| error("a copy of the process", e))? {
            ForkResult::Child => {
                finish(tile, shared, unit, orders);
                // SAFETY: ends the copy at once.
                unsafe { libc::_exit(0) }
            }
            ForkResult::Parent { child } => {
                let child = Self(child);
                match child.wait()? {
                    Stop::Asked => {
                        // It ends with this process.
                        let set = ptrace::setoptions(child.0, ptrace::Options::PTRACE_O_EXITKILL);
                        set.map_err(|e| error("an option", e))?;
                        Ok(child)
                    }
                    other => Err(Error::input(format!("inject: expected a copy that waits, found {other:?}"))),
                }
            }
        }
    }

    /// Returns the process.
    pub(crate) fn pid(&self) -> Pid {
        self.0
    }

    /// Waits until it stops or ends.
    ///
    /// # Errors
    /// If it cannot be watched.
    pub(crate) fn wait(&self) -> Result<Stop> {
        Ok(match waitpid(self.0, None).map_err(|e| error("waiting", e))? {
            WaitStatus::Exited(_, 0) => Stop::Ended,
            WaitStatus::Exited(..) => Stop::Crashed("panic"),
            WaitStatus::Signaled(_, signal, _) => Stop::Crashed(signal.as_str()),
            WaitStatus::Stopped(_, Signal::SIGSTOP) => Stop::Asked,
            WaitStatus::Stopped(_, Signal::SIGTRAP) => Stop::Trap,
            WaitStatus::Stopped(_, Signal::SIGVTALRM) => Stop::Late,
            WaitStatus::Stopped(_, signal) => Stop::Crashed(signal.as_str()),
            other => return Err(Error::input(format!("inject: expected a stop, found {other:?}"))),
        })
    }

    /// Lets it go on until it stops or ends.
    ///
    /// # Errors
    /// As [`Self::wait`].
    pub(crate) fn go_on(&self) -> Result<Stop> {
        ptrace::cont(self.0, None).map_err(|e| error("going on", e))?;
        self.wait()
    }

    /// Sets a breakpoint at an address, or takes it away (`None`).
    ///
    /// # Errors
    /// If the processor has none.
    pub(crate) fn stop_at(&self, address: Option<u64>) -> Result<()> {
        let register =
            |number: usize| (std::mem::offset_of!(libc::user, u_debugreg) + number * size_of::<u64>()) as *mut c_void;
        let write = |number, value: u64| {
            ptrace::write_user(self.0, register(number), value as i64).map_err(|e| error("a breakpoint", e))
        };
        write(7, 0)?;
        if let Some(address) = address {
            write(0, address)?;
            // Breakpoint 0, of one byte, when it is executed.
            write(7, 1)?;
        }
        Ok(())
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        // It may have ended.
        let _ = ptrace::kill(self.0);
        let _ = waitpid(self.0, None);
    }
}

/// Finishes the tile in the copy. Nothing is freed, and nothing else is written but `shared`.
fn finish(tile: &mut Tile, shared: &Shared, first: u64, orders: Orders) {
    let whole = orders.seconds as libc::time_t;
    let interval = libc::timeval { tv_sec: 0, tv_usec: 0 };
    let micros = (1e6 * orders.seconds.fract()) as libc::suseconds_t;
    let timer = libc::itimerval { it_interval: interval, it_value: libc::timeval { tv_sec: whole, tv_usec: micros } };
    // SAFETY: a timer on the stack; when it expires, the watching process is told.
    unsafe { libc::setitimer(libc::ITIMER_VIRTUAL, &raw const timer, std::ptr::null_mut()) };
    let watched = ptrace::traceme().is_ok() && raise(Signal::SIGSTOP).is_ok();
    if !watched {
        return;
    }
    let mut unit = first;
    let end = loop {
        shared.head().unit.store(unit, SeqCst);
        let done = tile.unit(&shared.head().caller);
        if orders.sums && unit == first {
            let state = if done.is_ok() { tile.state() | 1 } else { 0 };
            shared.head().state.store(state, SeqCst);
            let _ = raise(Signal::SIGSTOP);
        }
        unit += 1;
        match done {
            Ok(false) => (),
            Ok(true) => break Ok(()),
            Err(text) => break Err(text),
        }
    };
    let end = end.and_then(|()| {
        let holds = orders.code.is_none_or(|sum| program_sum() == sum);
        if holds { Ok(()) } else { Err("the program has changed".to_string()) }
    });
    match (end, tile.made()) {
        (Ok(()), Some((heights_m, valid))) => shared.write(heights_m, valid),
        (Ok(()), None) => shared.write_error("notice: coarse heights are kept"),
        (Err(text), _) => shared.write_error(&text),
    }
}
