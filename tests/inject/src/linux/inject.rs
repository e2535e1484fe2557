//! A bit flip at a moment of a tile, and what it leads to.

use super::child::{Child, Orders, Stop};
use super::program::program;
use super::shared::{DONE, REPORTED, Shared};
use crate::row::{Class, LIMIT_M, Outcome, Row};
use crate::tile::Tile;
use elunar_base::{Error, Result};
use nix::libc::user_regs_struct;
use nix::sys::ptrace;
use std::ffi::c_void;
use std::sync::atomic::Ordering::SeqCst;

/// The tile as it is without a flip.
pub(crate) struct Clean {
    /// Heights, metres.
    pub(crate) heights_m: Vec<f32>,
    /// Bits of valid heights.
    pub(crate) valid: Vec<u8>,
}

/// Copies that wait before a unit, for the same injection.
pub(crate) struct Waiting {
    row: Row,
    first: Child,
    spare: Child,
}

fn error(e: nix::Error) -> Error {
    Error::input(format!("inject: registers or memory of the copy: {e}"))
}

impl Waiting {
    /// Makes copies of this process, which is before the unit of the row.
    ///
    /// # Errors
    /// Those of [`Child::new`].
    pub(crate) fn new(mut row: Row, tile: &mut Tile, shared: &Shared, orders: Orders) -> Result<Self> {
        row.phase = tile.phase().into();
        // Only a fault that is gone can be judged by the memory that it leaves.
        let orders = Orders { sums: true, ..orders };
        let mut copy = || Child::new(tile, shared, row.unit, orders);
        let (first, spare) = (copy()?, copy()?);
        Ok(Self { row, first, spare })
    }

    /// Flips the bit, lets the copy go on, and returns the row with its outcome. `state` is the checksum behind the unit without a flip.
    ///
    /// # Errors
    /// If the copy cannot be watched, or never comes to the instruction.
    pub(crate) fn inject(self, shared: &Shared, clean: &Clean, state: u64) -> Result<Row> {
        let Self { mut row, first, spare } = self;
        shared.clear();
        let mut hits = reach(&first, &row, row.hit)?;
        let mut child = first;
        if hits < row.hit {
            // The unit comes there less often than drawn.
            row.hit = (row.hit - 1) % hits.max(1) + 1;
            child = spare;
            shared.clear();
            hits = reach(&child, &row, row.hit)?;
        }
        if hits < row.hit {
            return Err(Error::input(format!("inject: unit {} never comes to byte {:#x}", row.unit, row.at)));
        }
        flip(&child, &row)?;
        let mut stop = child.go_on()?;
        if stop == Stop::Asked {
            let found = shared.head().state.load(SeqCst);
            if row.class != Class::Code && found == state {
                row.outcome = Outcome::Masked;
                return Ok(row);
            }
            stop = child.go_on()?;
        }
        judge(&mut row, stop, shared, clean);
        Ok(row)
    }
}

/// Goes to the instruction of the row, `hit` times at most; returns how often.
fn reach(child: &Child, row: &Row, hit: u32) -> Result<u32> {
    child.stop_at(Some(program().start + row.at))?;
    for hits in 0..hit {
        if child.go_on()? != Stop::Trap {
            return Ok(hits);
        }
    }
    child.stop_at(None)?;
    Ok(hit)
}

fn flip(child: &Child, row: &Row) -> Result<()> {
    let pid = child.pid();
    let mut registers = ptrace::getregs(pid).map_err(error)?;
    let base = match row.class {
        Class::Register => {
            if let Some(register) = register(&mut registers, row.place) {
                *register ^= 1 << (row.bit % 64);
            }
            return ptrace::setregs(pid, registers).map_err(error);
        }
        Class::Stack => registers.rsp,
        Class::Code => registers.rip,
    };
    let byte = base.wrapping_add_signed(row.place);
    let word = (byte & !7) as *mut c_void;
    let found = ptrace::read(pid, word).map_err(error)?;
    let bit = 8 * (byte & 7) as u32 + row.bit % 8;
    ptrace::write(pid, word, found ^ (1 << bit)).map_err(error)
}

/// Returns a register by its number ([`crate::row::REGISTERS`]).
fn register(r: &mut user_regs_struct, number: i64) -> Option<&mut u64> {
    let all = [
        &mut r.rax, &mut r.rbx, &mut r.rcx, &mut r.rdx, &mut r.rsi, &mut r.rdi, &mut r.rbp, &mut r.rsp, &mut r.r8,
        &mut r.r9, &mut r.r10, &mut r.r11, &mut r.r12, &mut r.r13, &mut r.r14, &mut r.r15, &mut r.rip,
    ];
    all.into_iter().nth(usize::try_from(number).ok()?)
}

/// Writes the outcome of a copy that stopped or ended.
fn judge(row: &mut Row, stop: Stop, shared: &Shared, clean: &Clean) {
    let (outcome, message) = match stop {
        Stop::Ended if shared.head().end.load(SeqCst) == DONE => {
            compare(row, clean, shared.read());
            return;
        }
        Stop::Ended if shared.head().end.load(SeqCst) == REPORTED => (Outcome::Detected, shared.read_error()),
        Stop::Ended => (Outcome::Crash, "ended early".into()),
        Stop::Late => (Outcome::Hang, String::new()),
        Stop::Crashed(signal) => (Outcome::Crash, signal.to_string()),
        Stop::Trap => (Outcome::Crash, "SIGTRAP".into()),
        Stop::Asked => (Outcome::Crash, "SIGSTOP".into()),
    };
    (row.outcome, row.message) = (outcome, message.replace(',', ";"));
}

/// Compares a tile with the clean one.
fn compare(row: &mut Row, clean: &Clean, (heights_m, valid): (Vec<f32>, Vec<u8>)) {
    for (i, (found, z)) in heights_m.iter().zip(&clean.heights_m).enumerate() {
        let is = |bits: &[u8]| elunar_core::samples::is_set(bits, i);
        let error_m = match (is(&clean.valid), is(&valid)) {
            (true, true) if found.to_bits() == z.to_bits() => 0.0,
            (true, true) if found.is_finite() => (found - z).abs(),
            (true, true) => f32::INFINITY,
            (was, says) => {
                row.wrong_px += u32::from(was != says);
                0.0
            }
        };
        row.error_m = row.error_m.max(error_m);
        row.wrong_px += u32::from(error_m > LIMIT_M);
    }
    row.outcome = if row.wrong_px > 0 { Outcome::Silent } else { Outcome::Masked };
}
