//! Ctrl-C and SIGTERM as a flag that long loops read, so that the program does not end at once. Work for a caller in this process asks that
//! caller, and leaves signals to it.

use crate::caller::current;
use crate::{Error, Result};
#[cfg(unix)]
use std::sync::Arc;
use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

static ASKED: AtomicBool = AtomicBool::new(false);
static HANDLER: Once = Once::new();

/// Installs the handler. The first Ctrl-C, SIGTERM or SIGHUP then sets the flag that [`requested`] reads. The second ends the program, with
/// 128 plus the number of the signal.
pub fn listen() {
    if current().is_some() {
        return;
    }
    HANDLER.call_once(|| {
        if let Err(error) = install() {
            eprintln!("note: Ctrl-C will stop at once ({error})");
        }
    });
}

/// Lets a write beyond the limit of a file's size (`ulimit -f`) fail like any other write, with an error. By default the system's signal ends
/// the program there and then.
pub fn outlive_file_limit() {
    #[cfg(unix)]
    // The flag is not read: the write says what happened. If there can be no handler, the default remains.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default());
}

/// Returns whether the user has asked to stop.
pub fn requested() -> bool {
    current().map_or_else(|| ASKED.load(Ordering::SeqCst), |caller| caller.asks_to_stop())
}

/// Ends work that leaves nothing behind, if the user has asked to stop. `what` names it.
///
/// # Errors
/// [`Error::Stopped`] then.
pub fn check(what: &str) -> Result<()> {
    if requested() { Err(Error::stopped(format!("{what}: interrupted; the same command begins anew"))) } else { Ok(()) }
}

#[cfg(unix)]
fn install() -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM, SIGHUP])?;
    let listen = move || signals.forever().for_each(|signal| ask(128 + signal));
    // It waits, and needs next to no stack.
    std::thread::Builder::new().name("signals".into()).stack_size(64 << 10).spawn(listen).map(drop)
}

#[cfg(not(any(unix, target_family = "wasm")))]
fn install() -> std::result::Result<(), ctrlc::Error> {
    ctrlc::set_handler(|| ask(130))
}

/// WebAssembly has no signals. Who runs it may ask as a caller, or end it.
#[cfg(target_family = "wasm")]
fn install() -> std::io::Result<()> {
    Ok(())
}

/// Asks once; asked again, ends the program.
#[cfg(not(target_family = "wasm"))]
fn ask(code: i32) {
    if ASKED.swap(true, Ordering::SeqCst) {
        std::process::exit(code);
    }
    // A closed stderr must not end the thread.
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "\nstopping at the next safe point; press Ctrl-C again to stop at once");
}
