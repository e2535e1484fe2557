//! The campaign in the process that makes the tile.

mod child;
mod inject;
mod program;
mod shared;

use crate::row::{Row, Sample};
use crate::tile::Tile;
use child::{Child, Orders, Stop};
use elunar_base::{Error, Result};
use inject::{Clean, Waiting};
use nix::sys::personality::{self, Persona};
use nix::sys::ptrace;
use nix::sys::signal::{Signal, kill};
use program::{program, program_sum};
use shared::{DONE, Shared};
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

/// A tile may take this many times its time.
const PATIENCE: f64 = 3.0;

/// Asks the system to put this program, when it is started again, at the same addresses.
///
/// # Errors
/// If the system refuses.
pub(crate) fn fix_addresses() -> Result<()> {
    let now = personality::get().map_err(|e| Error::input(format!("inject: {e}")))?;
    personality::set(now | Persona::ADDR_NO_RANDOMIZE).map_err(|e| Error::input(format!("inject: {e}")))?;
    Ok(())
}

/// A tile that is disturbed.
pub(crate) struct Bench {
    tile: Tile,
    shared: Shared,
    clean: Clean,
    seconds: f64,
}

impl Bench {
    /// Makes the tile once, undisturbed.
    ///
    /// # Errors
    /// If it cannot be made.
    pub(crate) fn new(mut tile: Tile) -> Result<Self> {
        let shared = Shared::new(tile.shape().pixels())?;
        let start = Instant::now();
        let whole = Child::new(&mut tile, &shared, 0, Orders { seconds: 1e4, sums: false, code: None })?;
        let stop = whole.go_on()?;
        if (stop, shared.head().end.load(SeqCst)) != (Stop::Ended, DONE) {
            let found = shared.read_error();
            return Err(Error::input(format!("inject: expected a tile, found {stop:?} {found}")));
        }
        let (heights_m, valid) = shared.read();
        Ok(Self { tile, shared, clean: Clean { heights_m, valid }, seconds: start.elapsed().as_secs_f64() })
    }

    /// Looks `count` times where the processor is while a tile is made, at moments spread over its time.
    ///
    /// # Errors
    /// If the copy cannot be watched.
    pub(crate) fn sample(&mut self, count: usize, mut jitter: impl FnMut() -> f64) -> Result<Vec<Sample>> {
        let mut samples = Vec::new();
        let pause = (self.seconds / count as f64).max(2e-3);
        while samples.len() < count {
            let orders = Orders { seconds: 1e4, sums: false, code: None };
            let child = Child::new(&mut self.tile, &self.shared, 0, orders)?;
            loop {
                ptrace::cont(child.pid(), None).map_err(|e| Error::input(format!("inject: {e}")))?;
                std::thread::sleep(Duration::from_secs_f64(2.0 * pause * jitter()));
                let _ = kill(child.pid(), Signal::SIGSTOP);
                if child.wait()? != Stop::Asked {
                    break;
                }
                let registers = ptrace::getregs(child.pid()).map_err(|e| Error::input(format!("inject: {e}")))?;
                let head = self.shared.head();
                let depth = head.caller.load(SeqCst).saturating_sub(registers.rsp);
                // Not in the C library, and not between two units, when there is no caller.
                let is_inside = program().contains(&registers.rip) && (1..1 << 20).contains(&depth);
                if is_inside {
                    let (unit, at) = (head.unit.load(SeqCst), registers.rip - program().start);
                    samples.push(Sample { unit, at, depth });
                }
            }
        }
        Ok(samples)
    }

    /// Makes injections, sorted by unit; calls `done` with each.
    ///
    /// # Errors
    /// If a copy cannot be watched.
    pub(crate) fn run(mut self, rows: Vec<Row>, guarded: bool, mut done: impl FnMut(Row) -> Result<()>) -> Result<()> {
        let code = guarded.then(program_sum);
        let orders = Orders { seconds: PATIENCE * self.seconds, sums: true, code };
        let mut rows = rows.into_iter().peekable();
        let mut unit = 0;
        while rows.peek().is_some() {
            let mut waiting = Vec::new();
            while let Some(row) = rows.next_if(|row| row.unit <= unit) {
                waiting.push(Waiting::new(row, &mut self.tile, &self.shared, orders)?);
            }
            let finished = self.tile.unit(&self.shared.head().caller).map_err(Error::input)?;
            if !waiting.is_empty() {
                let state = self.tile.state() | 1;
                for waiting in waiting {
                    done(waiting.inject(&self.shared, &self.clean, state)?)?;
                }
            }
            if finished && rows.peek().is_some() {
                return Err(Error::input("inject: a unit beyond the tile's last"));
            }
            unit += 1;
        }
        Ok(())
    }
}
